// The bench: change the lengths of a walker, and see its toes' paths and their numbers at once.
//
// bench.py writes the page's data: {base: name of the first design, builtIn: names of the designs that
// Python knows, designs, engine, layout}. The page walk.html beside this page lets a design walk.

import * as design from "./bench_design.js";
import * as picture from "./bench_picture.js";
import { loadEngine, numbersOf } from "./engine.js";
import { robotWithLengths } from "./lengths.js";
import { angleOf, assemble, gapOf, lengthsOf, measure, place, prepare, turnOf } from "./linkage.js";
import { evenly, legsFor } from "./path_search.js";
import { explain } from "./terms.js";

const CRANK_SPEED = 2; // rad/s, of the animation
const STEP = 0.001; // m, of an arrow key
const STICKY = 7; // pixels, by which the crank's pin may leave its circle before it gets longer
const TOUCH = 22; // pixels around a joint
const SMALLEST = 0.02; // m, of a path that is drawn
const SEARCHING = 12; // ms of a frame
const FLIPPED = 0.002; // m, by which a joint may miss the pointer, or it would snap to the other side

const $ = (id) => document.getElementById(id);
const data = JSON.parse($("data").textContent);
const { base: first, designs } = data;
const svg = $("picture");
const plain = (name) => name.replaceAll("_", " ");
const mm = (value) => `${(1000 * value).toFixed(1)} mm`;
const degrees = (angle) => `${((Math.round((angle * 180) / Math.PI) % 360) + 360) % 360}°`;
const share = (value) => `${(100 * value).toFixed(1)} %`;
const deadAngle = ({ dead }) => (Math.asin(dead.sine) * 180) / Math.PI;
const deadPlace = ({ dead }) =>
  `${dead.joint} at ${degrees(dead.psi)}, sine ${dead.sine.toFixed(3)}`;

/** Numbers that are shown: name, value by `measure`, how it is written, and more. */
// biome-ignore format: a table
const NUMBERS = [
  ["lift", (n) => n.lift, mm],
  ["stance", (n) => n.stance, share],
  ["advance", (n) => Math.abs(n.advance), mm],
  ["heave", (n) => n.heave, mm],
  ["height", (n) => n.standing, mm],
  ["dead point", deadAngle, (v) => `${v.toFixed(1)}°`, deadPlace],
];

const past = []; // designs, to undo and redo
let now = -1; // which of them is the present one
let draft = null; // the present design while something is dragged
let view = {}; // of the present design: see bench_picture.js
let kept = null; // the view that is A, with its `paths`
let psi = angleOf(0);
let running = false;
let last = 0; // ms, of the frame before
let grabbed = null; // {joint, offset, from: view} while a joint is dragged
let drawing = false; // whether the pointer draws a path
let pen = null; // the path, m, while the pointer is down
let wanted = null; // the last one, where the leg's own is
let legs = []; // those that were found for it; the first is shown
let asked = false; // for a frame
let note = ""; // of the page itself

const present = () => draft ?? past[now];

// What is shown.

/** Work out the present design, as bench_picture.js has it, and show it. */
function rework() {
  const of = present();
  const base = designs[of.base];
  const lengths = { ...base.lengths, ...of.changes };
  const linkage = assemble(base, lengths);
  const turn = turnOf(linkage);
  const gap = gapOf(linkage, turn);
  const numbers = gap || linkage.fault ? null : measure(linkage);
  view = { ...view, of, lengths, linkage, turn, gap, numbers };
  showNumbers();
  showLengths();
  showMessage();
  $("undo").disabled = now === 0;
  $("redo").disabled = now === past.length - 1;
  const changed = Object.keys(of.changes).length > 0;
  $("original").disabled = !changed;
  for (const option of $("base").options)
    option.textContent = `${plain(option.value)}${changed && option.value === of.base ? " (changed)" : ""}`;
  $("back").disabled = !kept || design.linkOf(kept.of) === design.linkOf(of);
  for (const id of ["walk", "dead", "drawn"]) $(id).disabled = !numbers;
  touch();
}

/** Keep a design as the present one; without one, show that which is. */
function settle(other) {
  draft = wanted = null;
  note = "";
  if (other && (now < 0 || design.linkOf(other) !== design.linkOf(past[now])))
    past.splice(++now, past.length, other);
  $("base").value = present().base;
  build();
  rework();
  view.box = picture.boxOf(view.linkage, view.turn);
  svg.setAttribute("viewBox", Object.values(view.box).join(" "));
  history.replaceState(null, "", `#${design.linkOf(present())}`);
}

function touch() {
  if (!asked) requestAnimationFrame(frame);
  asked = true;
}

function frame(time) {
  asked = false;
  if (running) {
    const way = Math.sign(view.numbers?.advance ?? 1); // forwards
    psi += way * CRANK_SPEED * Math.min((time - last) / 1000, 0.1);
    touch();
  }
  last = time;
  const { width, height } = view.box;
  Object.assign(view, { psi, pixel: Math.max(width / svg.clientWidth, height / svg.clientHeight) });
  const others = [pen, wanted].filter(Boolean).map(picture.closed);
  const paths = [...(kept?.paths ?? []), ...others];
  $("drawing").innerHTML = picture.pictureOf(view, $("others").checked, paths);
  const { at } = place(view.linkage, psi);
  for (const handle of $("handles").children) {
    const [x, y] = at[handle.dataset.joint] ?? [1e9, 0]; // out of sight
    handle.setAttribute("transform", `translate(${1000 * x} ${-1000 * y}) scale(${view.pixel})`);
  }
  if (!$("angle").matches(":active")) $("angle").value = Number.parseInt(degrees(psi), 10);
  $("angle-value").textContent = degrees(psi);
}

function showNumbers() {
  NUMBERS.forEach(([, value, text, more], k) => {
    const [, main, detail, compared] = $("numbers").children[k].children;
    const [current, other] = [view.numbers, kept?.numbers].map((n) => n && value(n));
    main.textContent = view.numbers ? text(current) : "–";
    detail.textContent = view.numbers && more ? more(view.numbers) : "";
    const change = view.numbers
      ? `, ${current < other ? "−" : "+"}${text(Math.abs(current - other)).split(/[ °]/)[0]}`
      : "";
    compared.textContent = kept?.numbers ? `A ${text(other)}${change}` : "";
  });
}

/** Where a linkage does not close, in one sentence; "" if it does. */
function faultOf({ linkage, gap }) {
  if (linkage.fault) return `The three sides of ${plain(linkage.fault)} must form a triangle.`;
  if (!gap) return "";
  const { joint, whole, from, to, span } = gap;
  const where = whole ? "at any angle" : `from ${degrees(from)} to ${degrees(to)}`;
  const links = `${mm(gap.first)} and ${mm(gap.second)}`;
  return `Joint ${joint} does not close ${where} of the crank: links of ${links} cannot span ${mm(span)}.`;
}

function showMessage() {
  const text = note || faultOf(view);
  $("message").classList.toggle("calm", Boolean(view.numbers));
  if ($("message").textContent !== text) $("message").textContent = text;
}

function say(text) {
  note = text;
  showMessage();
}

// Sliders, and handles of the joints.

/** Have sliders, fields and handles of the present built-in design. */
function build() {
  const { base } = present();
  if ($("lengths").dataset.base === base) return;
  $("lengths").dataset.base = base;
  const { lengths, joints, robot } = designs[base];
  const rows = Object.keys(lengths).map((name) => {
    const [low, high] = design.rangeOf(designs[base], name);
    const unit = design.unitOf(name);
    return `<div class="length" data-name="${name}"><label for="length-${name}">${plain(name)}</label>
      <input type="range" id="length-${name}" min="${low}" max="${high}" step="0.1">
      <input type="number" step="0.1" aria-label="${plain(name)}, ${unit}"><span>${unit}</span></div>`;
  });
  $("lengths").innerHTML = rows.join("");
  const [axis] = robot.linkage.bodies[1][1];
  const movable = [...joints].filter((joint) => joint !== axis);
  const handle = (joint) => `<g class="handle" data-joint="${joint}" tabindex="0" role="button"
    aria-label="joint ${joint}: arrow keys move it"><circle r="${TOUCH}"/><text x="10" y="-9">${joint}</text></g>`;
  $("handles").innerHTML = movable.map(handle).join("");
}

function showLengths() {
  for (const row of $("lengths").children) {
    const { name } = row.dataset;
    const [, slider, field] = row.children;
    const value = design.shown(name, view.lengths[name]);
    slider.min = Math.min(slider.min, Math.floor(value));
    slider.max = Math.max(slider.max, Math.ceil(value));
    row.classList.toggle("changed", name in present().changes);
    if (!slider.matches(":active")) slider.value = value;
    if (!draft || document.activeElement !== field) field.value = value;
  }
}

/** Highlight the link of a row of the lengths, with its name; null for none. */
function light(row) {
  const length = row?.dataset.name ?? "";
  view.lit = view.linkage.bodies.find(({ name }) => `${length}_`.startsWith(`${name}_`))?.name;
  touch();
}

for (const kind of ["pointerover", "focusin"])
  $("lengths").addEventListener(kind, ({ target }) => light(target.closest(".length")));
for (const kind of ["pointerleave", "focusout"])
  $("lengths").addEventListener(kind, () => light(null));

/** Lengths, m and rad, that are tried until they are settled. */
function attempt(lengths, from = present()) {
  draft = design.withLengths(designs, from, lengths);
  rework();
}

$("lengths").addEventListener("input", ({ target }) => {
  const { name } = target.parentElement.dataset;
  if (design.refusal(designs[present().base], name, target.valueAsNumber)) return;
  attempt({ [name]: design.lengthOf(name, target.valueAsNumber) });
});
$("lengths").addEventListener("change", ({ target }) => {
  const { name } = target.parentElement.dataset;
  const wrong = design.refusal(designs[present().base], name, target.valueAsNumber);
  settle(draft);
  if (wrong) say(plain(wrong));
});

/**
 * Move a joint of `from`, a view, to a place: a pivot with the frame, the crank's pin with the crank's
 * length and angle, any other with the lengths that meet there while the other joints stay.
 */
function move(joint, to, from) {
  const { bodies, design: base } = from.linkage;
  const { at } = place(from.linkage, from.psi);
  const moved = { ...at, [joint]: to };
  const placesOf = (k) => [...bodies[k].joints].map((name) => moved[name]);
  const all = [...bodies.keys()].filter((k) => bodies[k].joints.includes(joint));
  const holding = all[0] < 2 ? all.slice(0, 1) : all; // of frame and crank nothing but these
  if (!holding.flatMap(placesOf).every(Boolean)) return; // a joint that is nowhere
  const lengths = Object.assign({}, ...holding.map((k) => lengthsOf(base, k, placesOf(k))));
  if (all[0] === 1) {
    psi = Math.atan2(to[1], to[0]);
    const away = Math.abs(Math.hypot(...to) - Math.hypot(...at[joint]));
    if (1000 * away < STICKY * from.pixel) return attempt({}, from.of);
  } else if (all[0] > 1) {
    const [x, y] = place(assemble(base, { ...from.lengths, ...lengths }), from.psi).at[joint] ?? [];
    if (!(Math.hypot(x - to[0], y - to[1]) < FLIPPED)) return;
  }
  attempt(lengths, from.of);
}

function pointOf({ clientX, clientY }) {
  const { x, y } = new DOMPoint(clientX, clientY).matrixTransform(svg.getScreenCTM().inverse());
  return [x / 1000, -y / 1000];
}

svg.addEventListener("pointerdown", (event) => {
  if (drawing) {
    svg.setPointerCapture(event.pointerId);
    pen = [pointOf(event)];
    return;
  }
  const { at } = place(view.linkage, psi);
  const [x, y] = pointOf(event);
  const away = ({ dataset }) =>
    Math.hypot(...(at[dataset.joint] ?? [1e9, 0]).map((v, k) => v - [x, y][k]));
  const [handle] = [...$("handles").children].sort((a, b) => away(a) - away(b));
  if (event.button !== 0 || grabbed || 1000 * away(handle) > TOUCH * view.pixel) return;
  event.preventDefault();
  run(false);
  svg.setPointerCapture(event.pointerId);
  handle.focus({ preventScroll: true });
  const { joint } = handle.dataset;
  grabbed = { joint, offset: [at[joint][0] - x, at[joint][1] - y], from: { ...view, psi } };
});
svg.addEventListener("pointermove", (event) => {
  if (pen) {
    pen.push(pointOf(event));
    touch();
  }
  if (!grabbed) return;
  const [x, y] = pointOf(event);
  move(grabbed.joint, [x + grabbed.offset[0], y + grabbed.offset[1]], grabbed.from);
});
for (const end of ["pointerup", "pointercancel"])
  svg.addEventListener(end, () => {
    if (grabbed) settle(draft);
    grabbed = null;
    if (pen) search(pen);
    pen = null;
  });

// A leg for a path that is drawn.

/** Let the pointer draw a path, or no longer. */
function draw(on) {
  drawing = on;
  $("draw").setAttribute("aria-pressed", on);
  svg.classList.toggle("pen", on);
  if (on) say("Draw the path of a toe, all the way round.");
}

/** Search for a path's legs while pictures go on. */
function search(path) {
  const size = (i) => Math.max(...path.map((p) => p[i])) - Math.min(...path.map((p) => p[i]));
  if (Math.max(size(0), size(1)) < SMALLEST) return say("The path is too small.");
  draw(false);
  const { base } = present();
  const work = legsFor(likeIt(base), path);
  const go = () => {
    const until = performance.now() + SEARCHING;
    let done = work.next();
    while (!done.done && performance.now() < until) done = work.next();
    if (!done.done) {
      say(`Searching for a leg: ${Math.round(100 * done.value)} %`);
      return requestAnimationFrame(go);
    }
    legs = done.value;
    $("next").hidden = legs.length < 2;
    if (legs.length > 0) return show(path);
    const { material } = designs[base].cutting;
    say(`No leg was found that walks by such a path and can be cut in ${material}.`);
  };
  go();
}

/** A design, and one of each other linkage that is cut in the same material, by name. */
function likeIt(base) {
  const kinds = new Map();
  for (const name of [...Object.keys(designs), first, base]) {
    const { robot, cutting } = designs[name];
    if (cutting.material === designs[base].cutting.material)
      kinds.set(JSON.stringify(robot.linkage), name);
  }
  return Object.fromEntries([...kinds.values()].map((name) => [name, designs[name]]));
}

/** Show the first of the legs that were found, with the path where its toe's is. */
function show(path) {
  const [{ base, lengths, error }] = legs;
  settle(design.withLengths(designs, { base, changes: {} }, lengths));
  const middle = (points, i) => points.reduce((sum, point) => sum + point[i], 0) / points.length;
  const toe = evenly(view.turn.map(({ at }) => at[view.linkage.design.toes[0]]));
  const drawn = evenly(path);
  wanted = drawn.map((p) => p.map((v, i) => v + middle(toe, i) - middle(drawn, i)));
  say(`${plain(base)}: its toe is ${share(error)} of the path's size away from it.`);
}

/** Show another leg for the same path. */
function next() {
  legs.push(legs.shift());
  show(wanted);
}

// The crank, buttons and keys.

function run(on) {
  running = on;
  $("run").setAttribute("aria-pressed", on);
  last = performance.now();
  touch();
}

function turnTo(angle) {
  psi = angle;
  run(false);
}

function step(way) {
  now = Math.min(Math.max(now + way, 0), past.length - 1);
  settle();
}

function keep() {
  kept = { ...view, paths: picture.toePaths(view.linkage.design, view.turn) };
  rework();
}

function saveDrawing() {
  const { base } = present();
  const each = NUMBERS.map(([name, value, text]) => `${name} ${text(value(view.numbers))}`);
  const lines = [`${plain(base)}, mm, 1 : 1`, design.linkOf(present()), each.join(", ")];
  design.download(`${base}.svg`, "image/svg+xml", picture.drawingOf(view, lines));
}

function saveRobot() {
  const { base, changes } = present();
  // Python knows the built-in designs by name; the file of another robot must contain everything.
  const robots = { [base]: designs[base].robot };
  const work = designs[base].memory;
  const text = data.builtIn.includes(base)
    ? design.robotFile(data.layout.format, present())
    : `${JSON.stringify(robotWithLengths({ work }, { robots, designs }, base, changes), null, 1)}\n`;
  design.download(`${present().base}.json`, "application/json", text);
}

/** Go where it walks. */
function walk() {
  if (!view.numbers) return;
  const robot = design.linkOf(present());
  location.href = `walk.html#${new URLSearchParams({ robot, control: "constant speed" })}`;
}

const BUTTONS = {
  walk,
  keep,
  draw: () => draw(!drawing),
  next,
  undo: () => step(-1),
  redo: () => step(1),
  original: () => settle({ base: present().base, changes: {} }),
  back: () => settle(kept.of),
  link: () => design.copyLink(say, "The link is copied."),
  file: saveRobot,
  drawn: saveDrawing,
  run: () => run(!running),
  dead: () => turnTo(view.numbers.dead.psi),
};
for (const [id, act] of Object.entries(BUTTONS)) $(id).addEventListener("click", act);

const KEYS = { " ": () => run(!running), a: keep, w: walk };
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

function nudge(joint, arrow, size) {
  const [x, y] = place(view.linkage, psi).at[joint];
  run(false);
  move(joint, [x + size * arrow[0], y + size * arrow[1]], { ...view, psi, pixel: 0 });
  settle(draft);
}

/** Whether a key is the focused element's own: letters of a list, the space bar of a button. */
function taken(key, { tagName, type }) {
  if (key === " " && /^(INPUT|BUTTON|SUMMARY)$/.test(tagName)) return true;
  return tagName === "SELECT" || type === "number";
}

function actionOf(key, { target, shiftKey, ctrlKey, metaKey }) {
  const { joint } = target.dataset;
  if (ctrlKey || metaKey) return { z: () => step(shiftKey ? 1 : -1), y: () => step(1) }[key];
  if (!joint || !ARROWS[key]) return KEYS[key];
  return () => nudge(joint, ARROWS[key], shiftKey ? 10 * STEP : STEP);
}

function press(event) {
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const act = taken(key, event.target) || event.altKey ? null : actionOf(key, event);
  if (!act) return;
  event.preventDefault();
  act();
}

$("base").addEventListener("change", () => settle({ base: $("base").value, changes: {} }));
$("angle").addEventListener("input", () => turnTo((Number($("angle").value) * Math.PI) / 180));
$("others").addEventListener("change", touch);
$("panel").addEventListener("submit", (event) => event.preventDefault());

/** Open the design that the page's link holds. */
function open() {
  try {
    settle(design.designOf(designs, location.hash.slice(1) || first));
  } catch (error) {
    settle(past[now] ?? { base: first, changes: {} });
    say(error.message);
  }
}

const style = new CSSStyleSheet();
style.replaceSync(picture.STYLE);
document.adoptedStyleSheets = [style];
$("base").innerHTML = Object.keys(designs)
  .map((name) => `<option value="${name}">${plain(name)}</option>`)
  .join("");
$("numbers").innerHTML = NUMBERS.map(
  ([name]) => `<div><dt>${name}</dt><dd></dd><dd class="more"></dd><dd class="kept"></dd></div>`,
).join("");
const nearGround = `${100 * data.layout.numbers.STANCE} % of the standing height`;
explain("dt", {
  stance: `Share of the turn in which a toe is on the ground, to ${nearGround}; green on its path.`,
});

/** Compile the engine, and show the design in the page's link. */
async function begin() {
  prepare(await loadEngine(numbersOf(data.engine, Uint8Array), data.layout), designs);
  open();
  addEventListener("hashchange", open);
  addEventListener("resize", touch);
  addEventListener("keydown", press);
  document.querySelector("main").inert = false;
  run(!matchMedia("(prefers-reduced-motion: reduce)").matches);
}

begin().then(
  () => $("starting").remove(),
  (error) => {
    $("starting").textContent = error.message;
    for (const part of document.querySelectorAll("main, header")) part.hidden = true;
  },
);
