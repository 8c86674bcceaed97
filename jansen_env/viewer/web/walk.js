// The page that walks: machines that the engine moves in here, grounds, controllers, and the hand.
//
// The data in the page are those of walk_data.py, the engine's module among them. All that is chosen is
// in the page's address, after the #, so that a link to a walk is a link to this page.

import { copyLink, designOf, download, linkOf } from "./bench_design.js";
import { pointsOf, textOf } from "./drawn_ground.js";
import { loadEngine, numbersOf } from "./engine.js";
import { groundOf } from "./ground.js";
import { robotWithLengths } from "./lengths.js";
import { LESSONS } from "./lessons.js";
import { loadWeights } from "./networks.js";
import { drawPlot } from "./plots.js";
import { CLICK_PUSH, drawPush, impulseOf } from "./push.js";
import { checkRobot, listed } from "./robot.js";
import { css, drawScene, followingView, heightAt, pixels, THEMES } from "./scene.js";
import { explain } from "./terms.js";
import { APART, HAND, shown, Walker } from "./walker.js";

const LARGEST_PUSH = 10; // N s
const LONGEST_GAP = 0.25; // s: after a longer pause of the browser time has stood still
const PACES = [1, 0.5, 0.25, 0.1]; // of the robot's time in the user's
const TORQUE_RATE = 3; // 1/s, of the torque while a key is held ...
const RELEASE_RATE = 8; // ... and after it
const COMMAND_RATE = 0.5; // 1/s, of the command while a key is held, of the fastest
const FIRST_COMMAND = 0.3; // m/s
const WINDOW = 10; // s, of the plots
const REPLOT = 100; // ms between two pictures of a plot; one at a time
const REWRITE = 200; // ms between two writings of numbers
const DEAD_ZONE = 0.12; // of a gamepad's stick
const MESSAGE_TIME = 6000; // ms for which a message is shown
const GOAL = { distance: 10, cost: 0.3 }; // m, at most; by hand
const EMBEDDED = "?embedded"; // in the address of a frame of another page: pictures alone
const FLAT = "flat";
const DRAWN = "drawn";
const OVERVIEW = 0.3; // zoom while a ground is drawn
const STEADY = "constant speed";
const PLOTS = [
  ["crank torque", "N m"],
  ["slip speed, all toes", "m/s"],
  ["motor power", "W"],
  ["ground load", "weights"],
]; // as walker.js has their numbers
const SCORE = [
  ["distance", ({ distance }) => shown(distance, 2, " m")],
  ["slip per metre", ({ slip }) => shown(slip, 3, " m/m")],
  ["cost of transport", ({ cost }) => shown(cost, 2)],
  ["unsupported", ({ unsupported }) => shown(unsupported && 100 * unsupported, 0, " %")],
  ["mean speed", ({ speed }) => shown(speed, 2, " m/s")],
  ["time", ({ time }) => shown(time, 1, " s")],
];
const ENERGIES = [
  ["motor work", "motor_work"],
  ["into joints", "joint_loss"],
  ["into slip", "slip_loss"],
  ["into impacts", "impact_loss"],
];
// biome-ignore format: a table
const DEFAULTS = {
  robot: "built", control: "", terrain: FLAT, level: "0",robot2: "", control2: "", seed: "0",
  ground: "",
};

const $ = (id) => document.getElementById(id);
const sum = (values) => [...values].reduce((total, value) => total + value, 0);
const within = (value, low, high) => Math.min(Math.max(value, low), high);
const plain = (name) => name.replaceAll("_", " ");
const data = JSON.parse($("data").textContent);
const STEP = data.layout.period; // s, of a control step
const dark = matchMedia("(prefers-color-scheme: dark)");
const pictures = $("pictures").children;

let engine; // once it is compiled
let chosen = {}; // by the names of DEFAULTS
let awaited = null; // what will be chosen, once all that it needs is there
let walkers = []; // one, or two that are compared
let torque = 0; // -1 to 1, by hand
let command = FIRST_COMMAND; // m/s, the same for all
let settings = {}; // of the sliders that were moved
let pace = PACES[0];
let running = false;
let shownAt = null; // count of steps at which the past is shown, or null for now
let due = 0; // share of a step that has not been taken
let last = 0; // ms, of the frame before
let written = 0; // ms, when numbers were last written
let plotted = 0; // ms, when the last plot was drawn
let plot = 0; // its number
let held = 0; // -1, 0, 1: the keys
let returns = false; // whether the torque goes back to 0
let won = false; // whether the goal was reached since the start
let lesson = -1; // index of the question that is shown, if one is
let drawing = false; // whether the pointer draws the ground
let stroke = null; // [[x, y] ...], m from the robot, of the pen
let drag = null; // {x, y, toX, toY}, pixels of a `canvas`
let stick = { value: 0, pressed: false }; // of the gamepad

// What walks.

/** The robot of a choice: a name, or a name with lengths as in the bench's links. */
function robotOf(text) {
  if (Object.hasOwn(data.robots, text)) return data.robots[text];
  const { base, changes } = designOf(data.designs, text);
  if (Object.keys(changes).length === 0) return data.robots[base];
  return robotWithLengths(engine, data, base, { ...data.designs[base].lengths, ...changes });
}

/** Start again with a choice; rejects, and changes nothing, where that cannot be. */
async function build(choice) {
  const ground = groundFor(choice);
  await take(choice, async () => {
    const newWalkers = await Promise.all(
      pairsOf(choice).map(([robot, control]) =>
        Walker.create(engine, data, robotOf(robot), ground, control),
      ),
    );
    return () => start(newWalkers, choice);
  });
}

/** Let other controllers turn the cranks from now on; rejects where that cannot be. */
async function changeControls(choice) {
  await take(choice, async () => () => {
    goOn();
    for (const [i, [, name]] of pairsOf(choice).entries()) walkers[i].useController(name);
    chosen = choice;
  });
}

/**
 * Prepare what a choice needs, and then take it, unless another one has been made meanwhile.
 * `prepare` returns a promise of what to do then.
 */
async function take(choice, prepare) {
  awaited = choice;
  try {
    await loadNetworks(pairsOf(choice).map(([, name]) => name));
    const act = await prepare();
    if (awaited === choice) act();
  } finally {
    if (awaited === choice) awaited = null;
  }
}

async function loadNetworks(names) {
  const missing = names.filter((name) => data.policies[name] && !data.policies[name].weights);
  if (missing.length === 0) return;
  say(`Loading the network of the ${missing.join(" and of the ")}.`);
  await Promise.all(missing.map((name) => loadWeights(name, data.policies[name])));
  say("");
}

/** The ground of a choice; throws where the choice has what this page does not. */
function groundFor(choice) {
  for (const [name, values] of Object.entries(OPTIONS)) {
    const allowed = name === "terrain" && choice.ground ? [...values, DRAWN] : values;
    if (!name.startsWith("robot") && !allowed.includes(choice[name]))
      throw new Error(
        `${name} must be one of ${listed(allowed)}, got '${choice[name].slice(0, 40)}'.`,
      );
  }
  const seed = Number(choice.seed);
  const given = choice.seed.slice(0, 40);
  if (!Number.isInteger(seed) || seed < 0 || seed > data.mostSeed)
    throw new Error(`seed must be a whole number from 0 to ${data.mostSeed}, got '${given}'.`);
  if (choice.terrain === DRAWN) return pointsOf(choice.ground, data.steepest);
  return groundOf(engine, data.terrain, choice.terrain, Number(choice.level), seed);
}

/** Robot and controller of each walker of a choice. */
function pairsOf(choice) {
  const pairs = [[choice.robot, choice.control]];
  if (choice.robot2) pairs.push([choice.robot2, secondControl(choice)]);
  return pairs;
}

/** What turns the crank of a robot at first: the policy that has learnt on it, if there is one. */
function controlFor(robot, otherwise = STEADY) {
  const name = `${robot} policy`;
  return Object.hasOwn(data.policies, name) ? name : otherwise;
}

function secondControl({ control, robot2, control2 }) {
  return control2 || controlFor(robot2, control);
}

function start(newWalkers, choice = chosen) {
  const most = newWalkers[0].controller.topSpeed;
  if (!newWalkers[0].byHand) command = within(command, -most, most);
  for (const walker of newWalkers) walker.start(Number(choice.seed), settings, command);
  chosen = choice;
  walkers = newWalkers;
  shownAt = null;
  due = 0;
  won = false;
  torque = written = 0;
  showPanel();
  remember();
}

const hasLevels = ({ terrain }) => terrain !== FLAT && terrain !== DRAWN;
const byHand = () => walkers[0].byHand;
/** -1 to 1: the torque by hand, or the command as a share of the fastest. */
const share = () => (byHand() ? torque : command / walkers[0].controller.topSpeed);

function steer(value) {
  if (byHand()) torque = within(value, -1, 1);
  else command = within(value, -1, 1) * walkers[0].controller.topSpeed;
  showInput();
}

function restart() {
  start(walkers);
}

/** Change choices, or say why not. All but a control start again. */
async function choose(changes) {
  const choice = { ...(awaited ?? chosen), ...changes };
  if (!hasLevels(choice)) choice.level = "0";
  for (const [robot, control] of [
    ["robot", "control"],
    ["robot2", "control2"],
  ])
    if (changes[robot] && choice[control] !== HAND) choice[control] = controlFor(choice[robot]);
  const goesOn = !awaited && Object.keys(changes).every((name) => name.startsWith("control"));
  try {
    await (goesOn ? changeControls(choice) : build(choice));
  } catch (error) {
    say(error.message);
  }
  torque = 0;
  steer(share());
  showPanel();
  remember();
}

/** Move a slider, or say why not. */
function set(name, value) {
  goOn();
  const before = walkers.map(({ machine }) => machine.parameters[name]);
  try {
    for (const walker of walkers) walker.change({ [name]: value });
    settings = { ...settings, [name]: value };
  } catch (error) {
    for (const [i, walker] of walkers.entries()) walker.change({ [name]: before[i] });
    say(error.message);
  }
  showPanel();
}

/** Push all robots, or say why not. */
function push(x, y) {
  goOn();
  try {
    for (const walker of walkers) walker.push(x, y);
  } catch (error) {
    say(error.message);
  }
}

// The address.

/** Put all that is chosen into the page's address. */
function remember() {
  const choices = { ...chosen, command: command.toFixed(2), ...settings };
  const different = Object.entries(choices).filter(([name, value]) => value !== DEFAULTS[name]);
  history.replaceState(null, "", `#${new URLSearchParams(different)}`);
}

/** Choose what an address says. */
async function open(address) {
  const { command: speed = FIRST_COMMAND, ...given } = Object.fromEntries(
    new URLSearchParams(address),
  );
  const choice = { ...DEFAULTS, control: controlFor(given.robot ?? DEFAULTS.robot) };
  const values = {};
  for (const [name, value] of Object.entries(given)) {
    const slider = data.sliders.find((each) => each.name === name);
    if (slider) values[name] = within(Number(value) || 0, slider.low, slider.high);
    else if (Object.hasOwn(DEFAULTS, name)) choice[name] = value;
  }
  command = Number(speed) || 0;
  settings = values;
  try {
    await build(choice);
  } catch (error) {
    settings = {};
    await build({ ...DEFAULTS, control: controlFor(DEFAULTS.robot) });
    say(error.message);
  }
}

// Time.

function frame(now) {
  requestAnimationFrame(frame);
  readGamepad();
  const passed = Math.min((now - last) / 1000, LONGEST_GAP);
  last = now;
  if (running && !$("help").open) advance(passed);
  const rewrite = now - written > REWRITE;
  for (const [i, walker] of walkers.entries()) {
    const figure = pictures[i];
    if (running || drag || stroke || rewrite) draw(walker, figure); // seldom while time stands still
    if (rewrite) showScore(walker, figure);
  }
  if (now - plotted > REPLOT / PLOTS.length) {
    plotted = now;
    plot = (plot + 1) % PLOTS.length;
    drawCurves(plot);
  }
  if (rewrite) {
    written = now;
    showPast();
    showEnergies();
    if (lesson >= 0) write($("answer"), LESSONS[lesson].answer(walkers));
  }
}

/** Let the user's time pass. */
function advance(seconds) {
  moveInput(seconds);
  due += (seconds * pace) / STEP;
  for (; due >= 1; due -= 1) for (const walker of walkers) walker.step(torque, command);
  const { distance, cost } = walkers[0].score;
  if (won || !byHand() || walkers[0].fallen || distance < GOAL.distance || cost > GOAL.cost) return;
  won = true;
  say(`${GOAL.distance} m by hand at a cost of transport of ${cost.toFixed(2)}: well walked!`);
}

/** Move the input as long as a key is held, and the torque back after it. */
function moveInput(seconds) {
  const before = share();
  if (held && byHand())
    // From 0 on where it is against the torque that there is.
    steer((before * held < 0 ? 0 : before) + held * seconds * TORQUE_RATE);
  else if (held) steer(before + held * seconds * COMMAND_RATE);
  else if (returns && byHand()) {
    steer(Math.sign(before) * Math.max(0, Math.abs(before) - RELEASE_RATE * seconds));
    returns = torque !== 0;
  }
}

function run(on) {
  if (on) goOn();
  running = on;
  last = performance.now();
  $("pause").setAttribute("aria-pressed", !on);
}

/** Go on from the place that is shown. */
function goOn() {
  if (shownAt === null) return;
  for (const walker of walkers) walker.back(shownAt);
  shownAt = null;
  due = 0;
  showPanel();
}

/** Show the place `steps` from the one that is shown. */
function goBy(steps) {
  const [first, newest] = rangeOfPast();
  run(false);
  shownAt = within((shownAt ?? newest + (steps < 0 ? 1 : 0)) + steps, first, newest);
  shownAt -= shownAt % APART;
  written = 0; // at once
}

/** First and last count of the past to which all walkers can go. */
function rangeOfPast() {
  const { past } = walkers[0];
  return [past[0].count, past.at(-1).count - (past.at(-1).count % APART)];
}

// What is shown.

const sizes = new Map(); // of canvases, CSS pixels
const watch = new ResizeObserver((entries) => {
  for (const { target, contentRect } of entries) sizes.set(target, contentRect);
});

/** A canvas' context, scaled to CSS pixels, and its size; null while it is not shown. */
function sheetOf(canvas, options) {
  const size = sizes.get(canvas);
  if (!size?.width) return null;
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [size.width, size.height].map((length) => Math.round(length * ratio));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const ctx = canvas.getContext("2d", options);
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { ctx, size };
}

function draw(walker, figure) {
  const canvas = figure.firstElementChild;
  const sheet = sheetOf(canvas, { alpha: false });
  if (!sheet) return;
  const { ctx, size } = sheet;
  const theme = dark.matches ? THEMES.dark : THEMES.light;
  const { scene } = walker.machine;
  const now = shownAt === null;
  const index = now ? walker.past.length - 1 : walker.indexOf(shownAt);
  const state = walker.poseAt(index, now ? due : 1);
  const reach = Math.max(...walkers.map((each) => each.reach)); // one scale
  const view = followingView(size, { ...scene, reach }, state, drawing ? OVERVIEW : 1);
  drawScene(ctx, size, scene, state, view, { theme });
  const at = pixels(size, view);
  const foot = [state.x, heightAt(scene.terrain, state.x)];
  figure.foot = { place: at(foot), scale: view.scale };
  if (stroke) {
    ctx.strokeStyle = css(theme.crank);
    ctx.lineWidth = 3;
    ctx.beginPath();
    for (const [x, y] of stroke) ctx.lineTo(...at([foot[0] + x, foot[1] + y]));
    ctx.stroke();
  }
  figure.axis = at([state.x, state.y]);
  if (drag?.canvas === canvas) drawPush(ctx, drag, LARGEST_PUSH, theme);
}

function write(place, text) {
  if (place.textContent !== text) place.textContent = text;
}

function showScore({ score, fallen, stuck }, figure) {
  const cells = figure.querySelectorAll("dd");
  for (const [i, [, value]] of SCORE.entries()) write(cells[i], value(score));
  const stands = !running && shownAt === null && !$("help").open;
  let note = stands ? "Paused" : "";
  if (fallen) note = "It has fallen. Start again (R), or push it up.";
  if (stuck) note = "The simulation has diverged. Start again.";
  write(figure.querySelector("output"), note);
}

/** Draw a plot: curves of the last seconds before the time that is shown. */
function drawCurves(number) {
  const sheet = sheetOf($("plots").children[number].lastElementChild);
  if (!sheet) return;
  const { ctx, size } = sheet;
  const theme = dark.matches ? THEMES.dark : THEMES.light;
  const curves = walkers.map((walker, i) => {
    const values = lastPlaces(walker).map(({ numbers }) => numbers[number]);
    return { time: values.map((_, k) => k * STEP), values, first: 0, color: NAMES[i] };
  });
  ctx.clearRect(0, 0, size.width, size.height);
  drawPlot(ctx, curves, WINDOW, size, theme, colorsOf(dark.matches));
}

const NAMES = ["first", "second"];
const colors = {}; // of walkers, in the dark and in the light

function colorsOf(isDark) {
  const style = getComputedStyle(document.documentElement);
  colors[isDark] ??= Object.fromEntries(
    NAMES.map((name) => [name, style.getPropertyValue(`--${name}`)]),
  );
  return colors[isDark];
}

/** Steps of a walker that its plots show. */
function lastPlaces(walker) {
  const end = shownAt === null ? walker.past.length - 1 : walker.indexOf(shownAt);
  return walker.past.slice(Math.max(end + 1 - WINDOW / STEP, 1), end + 1);
}

function showPast() {
  const [first, newest] = rangeOfPast();
  Object.assign($("past"), { min: first, max: newest, step: APART });
  $("past").value = shownAt ?? newest;
  write($("past-value"), shownAt === null ? "now" : shown((shownAt - newest) * STEP, 1, " s"));
}

/** Where the motor's work went in the time of the plots. */
function showEnergies() {
  const places = walkers.map(lastPlaces);
  for (const [i, [, name]] of ENERGIES.entries()) {
    const texts = places.map((recent) => {
      const total = (energy) => sum(recent.map(({ info }) => info.energy[energy]));
      const work = total("motor_work");
      if (!(Math.abs(work) > 1e-6)) return "–";
      return i === 0 ? `${work.toFixed(1)} J` : `${Math.round((100 * total(name)) / work)} %`;
    });
    write($("energies").children[i].lastElementChild, texts.join(" | "));
  }
}

function showPanel() {
  for (const name of Object.keys(OPTIONS)) showChoice(name);
  $("level").disabled = !hasLevels(chosen);
  $("control2").disabled = !chosen.robot2;
  pictures[1].hidden = walkers.length < 2;
  $("pictures").classList.toggle("two", walkers.length > 1);
  for (const { name, unit } of data.sliders) {
    const value = walkers[0].machine.parameters[name];
    if (!$(name).matches(":active")) $(name).value = value;
    $(`${name}-value`).textContent = `${value.toFixed(2)} ${unit}`.trim();
  }
  for (const [i, { control }] of walkers.entries()) {
    const robot = [chosen.robot, chosen.robot2][i];
    const title = pictures[i].querySelector("b");
    title.textContent = `${nameOf(robot)}, ${nameOf(control)}`;
  }
  $("input-label").textContent = byHand() ? "torque" : "speed command";
  $("pace").value = pace;
  $("bench").href = `bench.html#${chosen.robot}`;
  $("bench").hidden = !Object.hasOwn(data.designs, chosen.robot.split("&")[0]);
  for (const button of document.querySelectorAll(".take"))
    button.textContent = byHand() ? "Let it walk" : "Take the crank";
  showInput();
  explain("dt, label, #plots span", MEANINGS);
}

/** Show a choice; a robot of other lengths is an entry of its own. */
function showChoice(name) {
  const values = [...$(name).options].map(({ value }) => value);
  if (!values.includes(chosen[name])) $(name).append(optionOf(chosen[name]));
  $(name).value = chosen[name];
}

function showInput() {
  if (!$("input").matches(":active")) $("input").value = share();
  $("input-value").textContent = byHand()
    ? `${(torque * walkers[0].machine.torqueLimit).toFixed(1)} N m`
    : `${command.toFixed(2)} m/s`;
}

function nameOf(text) {
  const [name, ...lengths] = String(text).split("&");
  return plain(name === HAND ? "by hand" : name) + (lengths.length ? " (changed)" : "");
}

let fading; // timer of the message
function say(text) {
  clearTimeout(fading);
  $("message").textContent = text;
  fading = setTimeout(() => $("message").replaceChildren(), MESSAGE_TIME);
}

// The panel.

const robots = Object.keys(data.robots);
const { generators, kinds, levels } = data.terrain;
const OPTIONS = {
  robot: robots,
  control: data.controllers,
  terrain: [FLAT, ...generators],
  level: levels[kinds[0]].map((_, level) => String(level)),
  robot2: ["", ...robots],
  control2: ["", ...data.controllers],
};
const fewPercent = `${100 * data.layout.numbers.UNSUPPORTED} %`;
const MEANINGS = {
  ...Object.fromEntries(data.sliders.map(({ label, meaning }) => [label, meaning])),
  unsupported: `Share of the time in which the ground carries less than ${fewPercent} of the weight: the robot hops.`,
  level: `Difficulty of the terrain, from 0 to ${OPTIONS.level.at(-1)}.`,
};
const LABELS = { robot2: "compare with", control2: "its control" };

function element(tag, properties) {
  return Object.assign(document.createElement(tag), properties);
}

function optionOf(value) {
  return new Option(value === "" ? "–" : nameOf(value), value);
}

function addChoice(id, label, options, act) {
  const select = element("select", { id });
  select.append(...options);
  select.addEventListener("change", () => {
    act(select.value);
    if (!select.matches(":focus-visible")) select.blur(); // the pointer chose
  });
  const row = element("div", {});
  row.append(element("label", { htmlFor: id, textContent: label }), select);
  $("choices").append(row);
}

function addSlider({ name, label, low, high }) {
  const row = element("div", { className: "slider" });
  const slider = element("input", { id: name, type: "range", min: low, max: high, step: 0.01 });
  slider.addEventListener("input", () => set(name, Number(slider.value)));
  slider.addEventListener("change", () => {
    slider.value = walkers[0].machine.parameters[name]; // as it is, where the new one was refused
    remember();
  });
  row.append(
    element("label", { htmlFor: name, textContent: label }),
    element("output", { id: `${name}-value`, htmlFor: name, ariaLive: "off" }),
    slider,
  );
  $("sliders").append(row);
}

function addPlot([label, unit]) {
  const figure = element("figure", {});
  const caption = element("div", {});
  caption.append(element("span", { textContent: label }), ` (${unit})`);
  figure.append(caption, element("canvas", { role: "img", ariaLabel: `${label} over time` }));
  $("plots").append(figure);
}

function addNumber(list, label) {
  const row = element("div", {});
  row.append(element("dt", { textContent: label }), element("dd", {}));
  list.append(row);
}

function buildPanel() {
  for (const [name, values] of Object.entries(OPTIONS))
    addChoice(name, LABELS[name] ?? name, values.map(optionOf), (value) =>
      choose({ [name]: value }),
    );
  const paceOf = (value) => new Option(value === 1 ? "real time" : `1/${1 / value}`, value);
  addChoice("pace", "pace", PACES.map(paceOf), (value) => {
    pace = Number(value);
  });
  data.sliders.forEach(addSlider);
  PLOTS.forEach(addPlot);
  const picture = $("pictures").firstElementChild;
  for (const [label] of SCORE) addNumber(picture.querySelector("dl"), label);
  for (const [label] of ENERGIES) addNumber($("energies"), label);
  $("pictures").append(picture.cloneNode(true));
  for (const figure of pictures) listen(figure);
  for (const canvas of document.querySelectorAll("canvas")) watch.observe(canvas);
}

function shareLink() {
  remember();
  copyLink(say, "The link to this walk is copied.");
}

/** Save the walks since the start as files that Python walks again. */
function save() {
  for (const [i, walker] of walkers.entries()) {
    const label = pictures[i].querySelector("b").textContent;
    download(`walk${i || ""}.json`, "application/json", JSON.stringify(walker.file(label)));
  }
}

/** Let the pointer draw a ground, or no longer. */
function draft(on) {
  drawing = on;
  $("draft").setAttribute("aria-pressed", on);
  if (!on) return;
  pictures[0].scrollIntoView({ block: "nearest" });
  say("Draw the ground ahead, from left to right.");
}

/** Show a question, and what it is about; none for -1. */
async function teach(index) {
  lesson = index;
  $("lesson").hidden = index < 0;
  $("lessons").setAttribute("aria-pressed", index >= 0);
  if (index < 0) return;
  const { title, question, trial, address } = LESSONS[index];
  write($("lesson-title"), `${index + 1}. ${title}: ${question}`);
  write($("trial"), trial);
  await open(address);
  run(true);
  for (const part of [pictures[0], $("lesson")]) part.scrollIntoView({ block: "nearest" });
}

/** Return a new name for the robot of a file, in characters that links may contain. */
function nameOfFile(file) {
  const word = file.replace(/\.json$/, "").replaceAll(/[^\p{L}\p{N}-]+/gu, "_") || "robot";
  let name = word;
  for (let k = 2; Object.hasOwn(data.robots, name); k += 1) name = `${word}_${k}`;
  return name;
}

/** Let the robot of a file walk that the user has dropped on the page. */
async function drop(file) {
  try {
    const content = JSON.parse(await file.text());
    const { design, lengths } = content ?? {};
    if (design) return await choose({ robot: linkOf({ base: design, changes: lengths }) });
    const robot = checkRobot(engine, content);
    const name = nameOfFile(file.name);
    data.robots[name] = { name, ...robot };
    await choose({ robot: name });
  } catch (error) {
    say(error.message);
  }
}

// Keys, pointers and the gamepad.

function hold(direction) {
  if (direction === held) return;
  held = direction;
  if (direction === 0) {
    returns = true;
    remember();
  } else {
    $("help").close();
    run(true);
  }
}

/** Let the hand turn the crank, or a controller. */
function toggleHand() {
  choose({ control: byHand() ? controlFor(chosen.robot) : HAND });
}

function toggleHelp() {
  if ($("help").open) $("help").close();
  else $("help").show();
}

function slower() {
  pace = PACES[(PACES.indexOf(pace) + 1) % PACES.length];
  showPanel();
}

const pressed = { ArrowLeft: false, ArrowRight: false };
const holdKeys = () => hold(Number(pressed.ArrowRight) - Number(pressed.ArrowLeft));
const KEYS = {
  " ": () => push(CLICK_PUSH, 0),
  r: restart,
  n: () => choose({ seed: String(Number((awaited ?? chosen).seed) + 1) }),
  p: () => run(!running),
  s: slower,
  c: toggleHand,
  ",": () => goBy(-APART),
  ".": () => goBy(APART),
  Escape: () => $("help").close(),
  h: toggleHelp,
  "?": toggleHelp,
};

/** Whether a key is the focused element's own: arrows of a slider, letters of a list. */
function taken({ key, target: { tagName } }) {
  if (tagName === "SELECT" || tagName === "INPUT") return key in pressed || tagName === "SELECT";
  return tagName === "BUTTON" && key === " ";
}

/** Let the pointer push the robots from a picture. */
function listen(figure) {
  const canvas = figure.querySelector("canvas");
  const placeOf = ({ offsetX, offsetY }) => {
    const { place, scale } = figure.foot;
    return [(offsetX - place[0]) / scale, (place[1] - offsetY) / scale];
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    if (drawing) {
      run(false);
      stroke = [placeOf(event)];
      return;
    }
    const { offsetX: x, offsetY: y } = event;
    drag = { x, y, toX: x, toY: y, canvas };
    document.activeElement.blur();
  });
  canvas.addEventListener("pointermove", (event) => {
    if (drag) Object.assign(drag, { toX: event.offsetX, toY: event.offsetY });
    stroke?.push(placeOf(event));
  });
  canvas.addEventListener("pointercancel", () => {
    drag = stroke = null;
  });
  canvas.addEventListener("pointerup", () => {
    if (stroke) {
      const ground = textOf(stroke, data.steepest);
      stroke = null;
      draft(false);
      say("");
      if (ground) choose({ terrain: DRAWN, ground });
      run(true);
    }
    const impulse = drag && impulseOf(drag, figure.axis, LARGEST_PUSH);
    drag = null;
    if (impulse) push(impulse.x, impulse.y);
  });
}

function readGamepad() {
  const pad = navigator.getGamepads?.().find((each) => each?.connected && each.axes.length > 0);
  if (!pad) return;
  const value = Math.abs(pad.axes[0]) < DEAD_ZONE ? 0 : within(pad.axes[0], -1, 1);
  const down = Boolean(pad.buttons[0]?.pressed);
  if (value !== stick.value) steer(value);
  if (down && !stick.pressed) restart();
  stick = { value, pressed: down };
}

const BUTTONS = {
  lessons: () => teach(lesson < 0 ? 0 : -1),
  "lesson-before": () => teach((lesson || LESSONS.length) - 1),
  "lesson-next": () => teach((lesson + 1) % LESSONS.length),
  reset: restart,
  another: KEYS.n,
  pause: KEYS.p,
  "show-help": toggleHelp,
  draft: () => draft(!drawing),
  save,
  share: shareLink,
};
/** Let keys be the robot's. */
function listenToKeys() {
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || taken(event)) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (key in pressed) {
      pressed[key] = true;
      holdKeys();
    } else if (KEYS[key]) {
      if (!event.repeat) KEYS[key]();
    } else return;
    event.preventDefault();
  });

  addEventListener("keyup", ({ key }) => {
    if (!pressed[key]) return;
    pressed[key] = false;
    holdKeys();
  });

  addEventListener("blur", () => {
    pressed.ArrowLeft = pressed.ArrowRight = false;
    hold(0);
  });
}

/** Let the buttons, sliders and files of the page do something. */
function listenToPanel() {
  for (const [id, direction] of [
    ["left", -1],
    ["right", 1],
  ]) {
    const press = ({ key }) => (key === " " || key === "Enter") && hold(direction);
    $(id).addEventListener("pointerdown", () => hold(direction));
    for (const end of ["pointerup", "pointercancel", "pointerleave", "blur", "keyup"])
      $(id).addEventListener(end, () => hold(0));
    $(id).addEventListener("keydown", press);
  }
  for (const [id, act] of Object.entries(BUTTONS)) $(id).addEventListener("click", act);
  for (const button of document.querySelectorAll(".take"))
    button.addEventListener("click", toggleHand);
  $("begin").addEventListener("click", () => run(true));
  $("input").addEventListener("input", () => {
    steer(Number($("input").value));
    returns = false;
  });
  $("input").addEventListener("change", remember);
  $("past").addEventListener("input", () => {
    shownAt = Number($("past").value);
    goBy(0);
  });
  $("panel").addEventListener("submit", (event) => event.preventDefault());
  // After the pointer has moved a slider or pressed a button, keys are the robot's again.
  $("panel").addEventListener("pointerup", ({ target }) => target.closest("button, input")?.blur());
  addEventListener("hashchange", () => open(location.hash.slice(1)));
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("drop", (event) => {
    event.preventDefault();
    const [file] = event.dataTransfer.files;
    if (file) drop(file);
  });
}

/** Compile the engine, and walk. */
async function begin() {
  document.body.classList.toggle("embedded", location.search === EMBEDDED);
  engine = await loadEngine(numbersOf(data.engine, Uint8Array), data.layout);
  buildPanel();
  await open(location.hash.slice(1) || data.start);
  listenToKeys();
  listenToPanel();
  run(!matchMedia("(prefers-reduced-motion: reduce)").matches);
  requestAnimationFrame(frame);
}

begin().then(
  () => $("starting").remove(),
  (error) => {
    document.querySelector("main").hidden = true;
    $("reason").textContent = error.message;
    $("failed").hidden = false;
    $("starting").remove();
  },
);
