// The picture of a linkage as SVG: legs, toe paths, where it does not close; on the page and in files.
//
// Millimetres in the chassis frame, y downwards; `pixel` is how many of them a CSS pixel is.

import { angleOf, place, placeLeg, SAMPLES } from "./linkage.js";

const GRID = 40; // mm, of the picture's edges, so that it stands still while little changes
const TITLE = 90; // mm of a drawing, above the legs

/** Colours and lines: those of the page, or of a file on white paper. */
export const STYLE = `
.drawing { fill: none; stroke-linecap: round; stroke-linejoin: round; }
.ground { stroke: var(--muted, #566274); fill: var(--muted, #566274); fill-opacity: 0.15; }
.circle { stroke: var(--edge, #d3dce6); }
.path { stroke: var(--accent, #1f69ad); }
.stance { stroke: var(--toe-grip, #008c7a); }
.kept { stroke: var(--second, #b45800); }
.gap { stroke: var(--slip, #c81e1e); }
.plate { fill: var(--accent, #1f69ad); fill-opacity: 0.22; stroke: var(--ink, #263242); }
.link { stroke: var(--ink, #263242); }
.crank { stroke: #f08c10; }
.frame { stroke: var(--muted, #566274); }
.lit { stroke: var(--second, #b45800); }
.dead { fill: var(--force, #7c3abe); }
.far { --ink: var(--edge); --muted: var(--edge); --accent: var(--edge); }
.far .crank { opacity: 0.35; }
.pin { stroke: var(--page, #fff); }
text { font-family: system-ui, sans-serif; fill: var(--ink, #263242); stroke: none; }
.label { text-anchor: middle; paint-order: stroke; stroke: var(--page, #fff); stroke-width: 5; }
`;

const number = (value) => (1000 * value).toFixed(2);
const at = ([x, y]) => `${number(x)} ${number(-y)}`;
const escaped = (text) => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;");

/** Return the distance of the crank's pin from its axis, m. */
const crankOf = ({ design, lengths }) => lengths[design.names[1][0]];

/** Box around all joints of all legs over a turn: {x, y, width, height}, mm, in steps of GRID. */
export function boxOf(linkage, turn, { legs } = linkage.design.robot) {
  const reach = crankOf(linkage);
  const places = turn.flatMap((sample) => Object.values(sample.at));
  const both = legs.some(({ side }) => side === "back");
  const across = [reach, -reach, ...places.flatMap(([u]) => (both ? [u, -u] : [u]))];
  const down = [reach, -reach, ...places.map(([, v]) => -v)];
  const low = (values) => GRID * (Math.floor((1000 * Math.min(...values)) / GRID) - 1);
  const high = (values) => GRID * (Math.ceil((1000 * Math.max(...values)) / GRID) + 1);
  const [x, y] = [low(across), low(down)];
  return { x, y, width: high(across) - x, height: high(down) - y };
}

/** SVG path data through the points of a turn's samples; `pointOf` gives none where there is a gap. */
function trace(pointOf) {
  let text = "";
  let pen = false;
  for (let k = 0; k <= SAMPLES; k++) {
    const point = pointOf(k % SAMPLES);
    if (point) text += `${pen ? "L" : "M"}${at(point)}`;
    pen = Boolean(point);
  }
  return text;
}

/** SVG path data of a closed path [[x, y], ...], m. */
export const closed = (points) => `M${points.map(at).join("L")}Z`;

/** Paths of the first leg's toes, of those samples that `shows` chooses. */
export function toePaths({ toes }, turn, shows = () => true) {
  return [...toes].map((toe, which) => trace((k) => shows(which, k) && turn[k].at[toe]));
}

/**
 * Markup of a linkage at crank angle `psi`.
 *
 * view: {linkage, turn, numbers: of `measure`, or null, psi, pixel, box}; others: whether all legs are
 * drawn; kept: `toePaths` of another design. view.lit: name of the link that is highlighted, if any.
 */
export function pictureOf({ linkage, turn, numbers, psi, pixel, box, lit }, others, kept = []) {
  const { design } = linkage;
  const legs = design.robot.legs.map((_, k) => placeLeg(linkage, k, psi));
  const parts = [];
  const add = (kind, d, width = 0, more = "") =>
    parts.push(`<path class="${kind}" d="${d}" stroke-width="${width * pixel}" ${more}/>`);
  const lowest = Math.min(
    ...legs.flatMap((leg) => [...design.toes].map((toe) => leg.at[toe]?.[1])),
  );
  const [left, wide] = [box.x - 9 * box.width, 19 * box.width];
  if (!Number.isNaN(lowest))
    add("ground", `M${left} ${number(-lowest)}h${wide}v${9 * box.height}h${-wide}z`, 1.5);
  const radius = crankOf(linkage);
  const on = (angle, r = 1) => [r * radius * Math.cos(angle), r * radius * Math.sin(angle)];
  add(
    "circle",
    trace((k) => on(angleOf(k))),
    2,
  );
  add(
    "gap",
    trace((k) => turn[k].open && on(angleOf(k))),
    6,
  );
  for (const d of kept) add("kept", d, 2, `stroke-dasharray="${6 * pixel} ${5 * pixel}"`);
  for (const leg of others ? legs.slice(1) : []) {
    parts.push('<g class="far">');
    addLeg(add, linkage, leg);
    parts.push("</g>");
  }
  for (const d of toePaths(design, turn)) add("path", d, 2.5);
  for (const d of toePaths(design, turn, (toe, k) => numbers?.grounded[toe][k]))
    add("stance", d, 5);
  addLeg(add, linkage, legs[0]);
  if (lit) parts.push(lightOf(add, linkage, legs[0], lit, pixel));
  const mark = (turned, r) => at(on(numbers.dead.psi + turned, r));
  if (numbers) add("dead", `M${mark(0, 1.04)}L${mark(-0.12, 1.3)}L${mark(0.12, 1.3)}Z`);
  return `<g class="drawing">${parts.join("")}</g>`;
}

/** A link once more, highlighted, and its name beside it. */
function lightOf(add, { bodies }, { at: places }, lit, pixel) {
  const joints = [...bodies.find(({ name }) => name === lit).joints];
  const ends = joints.map((joint) => places[joint]);
  if (!ends.every(Boolean)) return "";
  add("lit", `M${ends.map(at).join("L")}${ends.length > 2 ? "Z" : ""}`, 7);
  const [x, y] = [0, 1].map((k) => ends.reduce((sum, end) => sum + end[k], 0) / ends.length);
  const text = escaped(lit.replaceAll("_", " "));
  return `<text class="label" x="${number(x)}" y="${number(-y)}" font-size="${14 * pixel}">${text}</text>`;
}

/** A leg, and in red the two links that do not reach each other. */
function addLeg(add, { bodies }, { at: places, open }) {
  bodies.forEach(({ joints: letters }, k) => {
    const joints = [...letters];
    if (!joints.every((joint) => places[joint])) return;
    const sides = `M${joints.map((joint) => at(places[joint])).join("L")}${joints.length > 2 ? "Z" : ""}`;
    add(["frame", "crank"][k] ?? (joints.length > 2 ? "plate" : "link"), sides, k < 2 ? 7 : 4);
  });
  const dots = Object.values(places).map((point) => `M${at(point)}h0`);
  add("link", dots.join(""), 10);
  add("pin", dots.join(""), 5.5);
  if (!open) return;
  const [start, end] = [places[open.start], places[open.end]];
  const towards = ([x, y], [u, v], way) => at([x + way * (u - x), y + way * (v - y)]);
  add("gap", `M${at(start)}L${towards(start, end, open.first / open.span)}`, 5);
  add("gap", `M${at(end)}L${towards(end, start, open.second / open.span)}`, 5);
  add("gap", `M${at(start)}L${at(end)}`, 1.5);
}

/** A drawing as an SVG file, 1 : 1: one leg with its lengths, toe paths and lines of text. */
export function drawingOf(view, lines) {
  const { bodies } = view.linkage;
  const box = boxOf(view.linkage, view.turn, { legs: [] });
  const { at: places } = place(view.linkage, view.psi);
  const texts = lines.map((text, k) => {
    return `<text x="${box.x + 20}" y="${box.y - 60 + 18 * k}" font-size="${k ? 12 : 18}">${escaped(text)}</text>`;
  });
  const label = (x, y, text, size) =>
    texts.push(
      `<text class="label" x="${number(x)}" y="${number(-y)}" dy="0.35em" font-size="${size}">${escaped(text)}</text>`,
    );
  for (const { joints } of bodies)
    [...joints].forEach((joint, k) => {
      const [p, q] = [places[joint], places[joints[(k + 1) % joints.length]]];
      if (!p || !q || (joints.length === 2 && k)) return;
      const length = 1000 * Math.hypot(q[0] - p[0], q[1] - p[1]);
      label(0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1]), length.toFixed(2), 11);
    });
  for (const [joint, [x, y]] of Object.entries(places)) label(x + 0.014, y + 0.014, joint, 15);
  const [width, height] = [box.width, box.height + TITLE];
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}mm" height="${height}mm" viewBox="${box.x} ${box.y - TITLE} ${width} ${height}">
<style>${STYLE}</style><rect x="${box.x}" y="${box.y - TITLE}" width="${width}" height="${height}" fill="#fff"/>
${pictureOf({ ...view, box, pixel: 1 }, false)}${texts.join("")}</svg>\n`;
}
