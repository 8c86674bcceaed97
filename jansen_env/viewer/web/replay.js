// The replay page: one or two recordings, their pictures, plots and numbers, and all controls.

import { cameraFor } from "./camera.js";
import { clockFor } from "./clock.js";
import { plotOn } from "./plots.js";
import { css, drawGround, drawRobot, THEMES } from "./scene.js";
import { explain } from "./terms.js";
import { numbersAt, pathOf, stateAt, stepAt, trackOf } from "./track.js";

const TRAIL = 2.5; // s of the toes' paths
const COLORS = ["first", "second"]; // of recordings, in the order they came
const OF_STEPS = ["torque", "slip", "power", "reward"]; // there are none of at the start
const PLAY = "M4 2.5v11l9.5-5.5z";
const PAUSE = "M3.5 2.5h3v11h-3zM9.5 2.5h3v11h-3z";
const RATES = [0.1, 0.25, 0.5, 1, 2, 4];

const byId = (id) => document.getElementById(id);
const tracks = JSON.parse(byId("data").textContent).recordings.map(trackOf);
const [{ scene }] = tracks;
const walks = scene.terrain !== null;
const { speedUnit } = scene;
const dark = matchMedia("(prefers-color-scheme: dark)");
const clock = clockFor(Math.max(...tracks.map(({ duration }) => duration)), show);
const longest = tracks.find(({ duration }) => duration === clock.duration);
const view = cameraFor(() => {
  byId("follow").ariaPressed = String(view.camera.following);
  clock.touch();
});
const shown = { ghosts: false, forces: true, paths: true };
let [theme, colors] = [THEMES.light, []];

const NUMBERS = [
  ["command", "commanded speed", speedUnit, 3],
  ["speed", walks ? "speed" : "crank speed", speedUnit, 3],
  ...(walks ? [["crankSpeed", "crank speed", "rad/s", 2]] : []),
  ["torque", "crank torque", "N m", 2],
  ["power", "motor power", "W", 2],
  ...(walks
    ? [
        ["slip", "slip speed, all toes", "m/s", 3],
        ["position", "position", "m", 3],
        ["pitch", "pitch", "rad", 3],
        ["slipPerMetre", "slip per metre so far", "m/m", 3],
        ["costOfTransport", "cost of transport so far", "", 3],
      ]
    : []),
  ["returned", "return so far", "", 1],
];
const PLOTS = [
  ["torque", "Crank torque", "N m"],
  ...(walks ? [["crankSpeed", "Crank speed", "rad/s"]] : []),
  ["speed", walks ? "Speed" : "Crank speed", `${speedUnit}, dashed: command`],
  ...(walks ? [["slip", "Slip speed, all toes", "m/s"]] : []),
  ["power", "Motor power", "W"],
  ["reward", "Reward", ""],
];

function element(tag, parent, text = "", attributes = {}) {
  const made = document.createElement(tag);
  made.textContent = text;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  parent.append(made);
  return made;
}

/** A recording's label, in its colour. */
function labelled(parent, i, more = "") {
  element("i", parent, "", { class: `chip ${COLORS[i]}` });
  parent.append(tracks[i].label.replace("/", "/\u200b") + more); // a line may break there
}

const pictures = tracks.map((track, i) => {
  const figure = element("figure", byId("stage"));
  const canvas = element("canvas", figure, "", { role: "img", "aria-label": track.label });
  const caption = element("figcaption", figure);
  labelled(caption, i);
  const ghost = element("span", caption);
  const note = element("span", caption, "", { class: "ended" });
  view.listen(canvas);
  return { figure, canvas, ghost, note, size: { width: 0, height: 0 } };
});

const plots = PLOTS.map(([name, label, unit]) => {
  const figure = element("figure", byId("plots"));
  const caption = element("figcaption", figure);
  element("b", caption, label);
  element("span", caption, unit);
  const canvas = element("canvas", figure, "", { role: "img", "aria-label": `${label} over time` });
  const first = OF_STEPS.includes(name) ? 1 : 0;
  const curves = tracks.map((track, i) => {
    return { time: track.time, values: track[name], first, color: COLORS[i] };
  });
  if (name === "speed") {
    for (const { time, command } of tracks)
      curves.unshift({ time, values: command, first, dashed: true });
  }
  const plot = plotOn(canvas, curves, clock.duration);
  const go = (event) => seek(plot.timeAt(event.clientX - canvas.getBoundingClientRect().left));
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    go(event);
  });
  canvas.addEventListener("pointermove", (event) => event.buttons && go(event));
  return { ...plot, canvas, name };
});

const cells = (() => {
  const [head, body] = [
    byId("numbers").querySelector("thead"),
    byId("numbers").querySelector("tbody"),
  ];
  const top = element("tr", head);
  element("th", top, "this control step", { scope: "col" });
  tracks.forEach((_, i) => {
    labelled(element("th", top, "", { scope: "col" }), i);
  });
  return NUMBERS.map(([name, label, unit, digits]) => {
    const row = element("tr", body);
    const title = element("th", row, `${label} `, { scope: "row" });
    element("small", title, unit);
    const each = tracks.map((_, i) =>
      element("td", row, "", { "data-name": name, "data-recording": i }),
    );
    return { name, digits, each };
  });
})();

/** Go to the control step nearest to a time, s. */
function seek(time) {
  const after = stepAt(longest, time);
  const before = Math.max(after - 1, 0);
  const nearer = time - longest.time[before] < longest.time[after] - time ? before : after;
  clock.seek(longest.time[nearer]);
  if (!clock.playing) announce();
}

/** Go some control steps on. */
function stepBy(count) {
  const last = longest.time.length - 1;
  clock.play(false);
  seek(longest.time[Math.min(Math.max(stepAt(longest, clock.time) + count, 0), last)]);
}

function play(on) {
  clock.play(on);
  if (!on) announce();
}

/** Tell those who do not see it where the replay stands. */
function announce() {
  const told = tracks.map(
    (track) => `${track.label} ${fixed(track.speed[stepAt(track, clock.time)], 2)} ${speedUnit}`,
  );
  byId("status").textContent = `${clock.time.toFixed(2)} s: ${told.join(", ")}`;
}

function setRate(rate) {
  clock.rate = rate;
  byId("rate").value = String(rate);
}

function toggle(name) {
  if (byId(name).disabled) return;
  shown[name] = !shown[name];
  byId(name).ariaPressed = String(shown[name]);
  if (name === "ghosts") {
    pictures[1].figure.hidden = shown.ghosts;
    pictures[0].ghost.replaceChildren(...(shown.ghosts ? [" \u00a0 "] : []));
    if (shown.ghosts) labelled(pictures[0].ghost, 1, " (ghost)");
    resize();
  }
  clock.touch();
}

function fixed(value, digits) {
  if (value === null) return "\u2013";
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

/** Paths of the toes as scene.js draws them. */
function trails(track) {
  if (!shown.paths) return [];
  const paint = [css(theme.muted, 0.5), css(theme.grip, 0.9), css(theme.slip, 0.9)];
  return track.scene.toes.flatMap((_, toe) =>
    pathOf(track, toe, clock.time, TRAIL).map(({ contact, points }) => ({
      points,
      color: paint[contact],
    })),
  );
}

function drawPicture({ canvas, size }, drawn) {
  if (!size.width || !size.height) return; // not shown
  const ctx = canvas.getContext("2d");
  const ratio = canvas.width / size.width;
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  const states = drawn.map((track) => stateAt(track, clock.time));
  const look = view.viewOf(canvas, size, drawn[0].scene, states);
  drawGround(ctx, size, drawn[0].scene, look, { theme });
  for (let i = drawn.length - 1; i >= 0; i--) {
    drawRobot(ctx, size, drawn[i].scene, states[i], look, {
      theme,
      forces: shown.forces && i === 0,
      paths: i === 0 ? trails(drawn[i]) : [],
      ghost: i > 0 ? theme.crank : null,
    });
  }
}

/** Bring everything to the clock's time. */
function show() {
  if (shown.ghosts) drawPicture(pictures[0], tracks);
  else
    pictures.forEach((picture, i) => {
      drawPicture(picture, [tracks[i]]);
    });
  const steps = tracks.map((track) => stepAt(track, clock.time));
  for (const { draw, name } of plots) {
    const points = tracks.map((track, i) => ({ value: track[name][steps[i]], color: COLORS[i] }));
    draw(clock.time, points, colors);
  }
  const numbers = tracks.map((track, i) => numbersAt(track, steps[i]));
  for (const { name, digits, each } of cells) {
    each.forEach((cell, i) => {
      cell.textContent = fixed(numbers[i][name], digits);
    });
  }
  tracks.forEach((track, i) => {
    const over = track.ended && clock.time >= track.duration;
    pictures[i].note.textContent = over ? ` ended at ${track.duration.toFixed(2)} s` : "";
  });
  const text = `${clock.time.toFixed(2)} s`;
  byId("time").textContent = text;
  byId("scrub").value = clock.time;
  byId("scrub").setAttribute("aria-valuetext", `${text} of ${clock.duration.toFixed(2)} s`);
  byId("play").ariaLabel = clock.playing ? "Pause (space)" : "Play (space)";
  byId("play-icon").setAttribute("d", clock.playing ? PAUSE : PLAY);
}

/** Fit all canvases to the page, and its colours to the reader's. */
function resize() {
  theme = dark.matches ? THEMES.dark : THEMES.light;
  const style = getComputedStyle(document.documentElement);
  colors = Object.fromEntries(COLORS.map((name) => [name, style.getPropertyValue(`--${name}`)]));
  const ratio = Math.min(devicePixelRatio || 1, 3);
  for (const picture of pictures) {
    const { clientWidth: width, clientHeight: height } = picture.canvas;
    picture.size = { width, height };
    picture.canvas.width = Math.round(width * ratio);
    picture.canvas.height = Math.round(height * ratio);
  }
  for (const plot of plots) {
    const { clientWidth: width, clientHeight: height } = plot.canvas;
    plot.paint(theme, colors, { width, height }, ratio);
  }
  show(); // at once: a canvas of another size is empty
}

const [main] = pictures;
const faster = (by) =>
  setRate(RATES[Math.min(Math.max(RATES.indexOf(clock.rate) + by, 0), RATES.length - 1)]);
const KEYS = {
  " ": () => play(!clock.playing),
  ArrowLeft: (event) => (event.shiftKey ? seek(clock.time - 0.5) : stepBy(-1)),
  ArrowRight: (event) => (event.shiftKey ? seek(clock.time + 0.5) : stepBy(1)),
  Home: () => seek(0),
  End: () => seek(clock.duration),
  ",": () => faster(-1),
  ".": () => faster(1),
  "+": () => view.zoomBy(1.25, main.canvas),
  "=": () => view.zoomBy(1.25, main.canvas),
  "-": () => view.zoomBy(0.8, main.canvas),
  0: () => view.fit(),
  w: () => view.panBy(0, 40, main.canvas),
  a: () => view.panBy(40, 0, main.canvas),
  s: () => view.panBy(0, -40, main.canvas),
  d: () => view.panBy(-40, 0, main.canvas),
  f: () => view.follow(!view.camera.following, main.canvas),
  g: () => toggle("ghosts"),
  c: () => toggle("forces"),
  t: () => toggle("paths"),
  "?": () => byId("keys").showModal(),
};

document.addEventListener("keydown", (event) => {
  const act = KEYS[event.key] ?? KEYS[event.key.toLowerCase()];
  const { target } = event;
  const pressing = target.closest("button, select") && event.key === " "; // the key presses it
  const choosing = target.closest("select") && event.key.length > 1;
  const modified = event.ctrlKey || event.metaKey || event.altKey;
  if (!act || pressing || choosing || modified || byId("keys").open) return;
  event.preventDefault();
  act(event);
});
byId("play").addEventListener("click", () => play(!clock.playing));
byId("scrub").addEventListener("input", (event) => seek(Number(event.target.value)));
byId("rate").addEventListener("change", (event) => setRate(Number(event.target.value)));
byId("follow").addEventListener("click", () => KEYS.f());
for (const name of ["ghosts", "forces", "paths"])
  byId(name).addEventListener("click", () => toggle(name));
byId("in").addEventListener("click", () => KEYS["+"]());
byId("out").addEventListener("click", () => KEYS["-"]());
byId("fit").addEventListener("click", () => view.fit());
byId("help").addEventListener("click", () => byId("keys").showModal());
dark.addEventListener("change", resize);
new ResizeObserver(resize).observe(byId("stage"));

const { title, subtitle, comparable } = JSON.parse(byId("data").textContent);
byId("title").textContent = title;
byId("subtitle").textContent = subtitle;
byId("scrub").max = clock.duration;
byId("ghosts").hidden = tracks.length < 2;
byId("ghosts").disabled = tracks.length < 2 || !comparable;
byId("legend").hidden = byId("forces").hidden = !walks;
explain("#numbers th");
byId("starting").remove();
resize();
play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
