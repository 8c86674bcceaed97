// The picture of a linkage as SVG: legs, toe paths, where it does not close; on the page and in files.
//
// Millimetres in the chassis frame, y downwards; `pixel` is how many of them a CSS pixel is.

import { angleOf, placeLeg, SAMPLES } from "./linkage.js";

const MARGIN = 0.07; // of the picture, around the legs
const GRID = 40; // mm, of the picture's edges
const TITLE = 90; // mm of a drawing, above the legs

/** Colours and lines: those of the page, or of a file on white paper. */
export const STYLE = `
.drawing { fill: none; stroke-linecap: round; stroke-linejoin: round; }
.ground { stroke: var(--muted, #566274); }
.soil, .dead { fill: var(--muted, #566274); opacity: 0.15; }
.circle { stroke: var(--edge, #d3dce6); }
.path { stroke: var(--accent, #1f69ad); }
.stance { stroke: var(--toe-grip, #008c7a); }
.kept { stroke: var(--second, #c05f00); }
.gap { stroke: var(--slip, #c81e1e); }
.plate { fill: var(--accent, #1f69ad); fill-opacity: 0.22; stroke: var(--ink, #263242); }
.link { stroke: var(--ink, #263242); }
.crank { stroke: #f08c10; }
.frame { stroke: var(--muted, #566274); }
.dead { fill: var(--force, #7c3abe); opacity: 1; }
.far { opacity: 0.2; }
.pin { stroke: var(--page, #fff); }
text { font-family: system-ui, sans-serif; fill: var(--ink, #263242); stroke: none; }
.label { text-anchor: middle; paint-order: stroke; stroke: #fff; }
`;

const number = (value) => (1000 * value).toFixed(2);
const at = ([x, y]) => `${number(x)} ${number(-y)}`;
const escaped = (text) => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;");

/** Box around all joints of all legs over a turn: {x, y, width, height}, mm. */
export function boxOf({ design, bodies }, turn) {
  const places = turn.flatMap((one) => Object.values(one.at));
  const both = design.legs.some(([side]) => side === "back");
  const xs = places.flatMap(([x]) => (both ? [x, -x] : [x]));
  const ys = places.map(([, y]) => -y);
  const reach = Math.max(
    ...bodies[1].joints.map((joint) => Math.hypot(...bodies[1].points.get(joint))),
  );
  const [left, right] = [Math.min(...xs, -reach), Math.max(...xs, reach)];
  const [top, bottom] = [Math.min(...ys, -reach), Math.max(...ys, reach)];
  const room = MARGIN * Math.max(right - left, bottom - top);
  // In steps, so that the picture stands still while little changes.
  const low = (value) => GRID * Math.floor((1000 * (value - room)) / GRID);
  const high = (value) => GRID * Math.ceil((1000 * (value + room)) / GRID);
  const edges = { x: low(left), y: low(top) };
  return { ...edges, width: high(right) - edges.x, height: high(bottom) - edges.y };
}

/** Paths of the first leg's toes over a turn: SVG path data of those samples that `shows` chooses. */
export function toePaths({ toes }, turn, shows = () => true) {
  return [...toes].map((toe, which) => {
    let text = "";
    let pen = false;
    for (let k = 0; k <= SAMPLES; k++) {
      const place = turn[k % SAMPLES].at[toe];
      const draws = Boolean(place) && shows(which, k % SAMPLES);
      if (draws) text += `${pen ? "L" : "M"}${at(place)}`;
      pen = draws;
    }
    return text;
  });
}

/**
 * Markup of a linkage at crank angle `psi`.
 *
 * view: {linkage, turn, numbers: of `measure`, or null, psi, pixel, box}; others: whether all legs are
 * drawn; kept: `toePaths` of another design.
 */
export function pictureOf(view, others, kept = []) {
  const { linkage, turn, numbers, psi, pixel, box } = view;
  const { design } = linkage;
  const legs = design.legs.map((leg) => placeLeg(linkage, leg, psi));
  const parts = [];
  const add = (kind, d, width, more = "") =>
    d && parts.push(`<path class="${kind}" d="${d}" stroke-width="${width * pixel}" ${more}/>`);
  const toes = legs.flatMap((leg) => [...design.toes].map((toe) => leg.at[toe]));
  if (toes.every(Boolean)) {
    const ground = 1000 * Math.max(...toes.map(([, y]) => -y));
    const room = box.y + box.height + 9 * box.height - ground;
    parts.push(`<path class="soil" d="M${box.x - 9 * box.width} ${ground}h${19 * box.width}v${room}h${-19 * box.width}z"/>`); // biome-ignore format: one path
    add("ground", `M${box.x - 9 * box.width} ${ground}h${19 * box.width}`, 1.5);
  }
  addCrankCircle(add, view);
  for (const d of kept) add("kept", d, 2, `stroke-dasharray="${6 * pixel} ${5 * pixel}"`);
  if (others)
    for (const leg of legs.slice(1)) {
      parts.push('<g class="far">');
      addLeg(add, linkage, leg);
      parts.push("</g>");
    }
  for (const d of toePaths(design, turn)) add("path", d, 2.5);
  if (numbers)
    for (const d of toePaths(design, turn, (toe, k) => numbers.grounded[toe][k]))
      add("stance", d, 5);
  addLeg(add, linkage, legs[0]);
  if (legs[0].open) addOpening(add, legs[0]);
  return `<g class="drawing">${parts.join("")}</g>`;
}

/** The crank pin's circle: red where the linkage does not close, a mark at the nearest dead point. */
function addCrankCircle(add, { linkage, turn, numbers }) {
  const [, pin] = linkage.bodies[1].joints;
  const radius = Math.hypot(...linkage.bodies[1].points.get(pin));
  const on = (angle, r = radius) => at([r * Math.cos(angle), r * Math.sin(angle)]);
  add("circle", `M${on(0)}A${number(radius)} ${number(radius)} 0 1 0 ${on(Math.PI)}A${number(radius)} ${number(radius)} 0 1 0 ${on(0)}`, 2); // biome-ignore format: one path
  const red = turn.map(({ open }, k) => (open ? `M${on(angleOf(k))}L${on(angleOf(k + 1))}` : ""));
  add("gap", red.join(""), 6);
  if (!numbers) return;
  const { psi } = numbers.dead;
  add("dead", `M${on(psi, 1.04 * radius)}L${on(psi - 0.12, 1.3 * radius)}L${on(psi + 0.12, 1.3 * radius)}Z`, 0); // biome-ignore format: one path
}

/** Lines of a body: all its sides. */
function sidesOf(joints, places) {
  return `M${joints.map((joint) => at(places[joint])).join("L")}${joints.length > 2 ? "Z" : ""}`;
}

function addLeg(add, { bodies }, { at: places }) {
  const known = bodies.filter(({ joints }) => joints.every((joint) => joint in places));
  const frame = known.filter((body) => body === bodies[0]);
  for (const { joints } of frame) add("frame", sidesOf(joints, places), 7);
  for (const body of known.slice(2))
    add(body.joints.length > 2 ? "plate" : "link", sidesOf(body.joints, places), 4);
  for (const { joints } of known.slice(1, 2)) add("crank", sidesOf(joints, places), 7);
  const dot = Object.values(places).map((place) => `M${at(place)}h0`);
  add("link", dot.join(""), 10);
  add("pin", dot.join(""), 5.5);
}

/** The two links that do not reach each other. */
function addOpening(add, { at: places, open }) {
  const [start, end] = [places[open.start], places[open.end]];
  const towards = ([x, y], [u, v], way) => {
    const share = way / Math.hypot(u - x, v - y);
    return [x + share * (u - x), y + share * (v - y)];
  };
  add("gap", `M${at(start)}L${at(towards(start, end, open.first))}`, 5);
  add("gap", `M${at(end)}L${at(towards(end, start, open.second))}`, 5);
  add("gap", `M${at(start)}L${at(end)}`, 1.5);
}

/** A drawing as an SVG file, 1 : 1: one leg with its lengths, toe paths and lines of `notes`. */
export function drawingOf(view, [title, ...notes]) {
  const { x, width } = view.box;
  const [y, height] = [view.box.y - TITLE, view.box.height + TITLE];
  const { linkage, psi } = view;
  const { at: places } = placeLeg(linkage, ["fore", 0], psi);
  const labels = [];
  const label = ([a, b], text, size) =>
    labels.push(`<text class="label" x="${number(a)}" y="${number(-b)}" dy="${0.35 * size}" font-size="${size}" stroke-width="${0.25 * size}">${escaped(text)}</text>`); // biome-ignore format: one element
  for (const { joints, points } of linkage.bodies)
    joints.forEach((joint, k) => {
      const next = joints[(k + 1) % joints.length];
      if ((joints.length === 2 && k) || !places[joint] || !places[next]) return;
      const [[a, b], [c, d]] = [points.get(joint), points.get(next)];
      const [p, q] = [places[joint], places[next]];
      label(
        [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])],
        (1000 * Math.hypot(c - a, d - b)).toFixed(2),
        11,
      );
    });
  for (const [joint, [a, b]] of Object.entries(places)) label([a + 0.014, b + 0.014], joint, 15);
  const head = [title, ...notes].map((text, k) =>
    `<text x="${x + 20}" y="${y + 30 + 18 * k}" font-size="${k ? 12 : 18}">${escaped(text)}</text>`); // biome-ignore format: one element
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}mm" height="${height}mm" viewBox="${x} ${y} ${width} ${height}">
<title>${escaped(title)}</title><style>${STYLE}</style><rect x="${x}" y="${y}" width="${width}" height="${height}" fill="#fff"/>
${pictureOf({ ...view, pixel: 1 }, false)}${labels.join("")}${head.join("")}</svg>\n`;
}
