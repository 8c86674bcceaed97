// The page of `jansen-env play`: shows a session and passes on what its user does.
//
// The server sends scenes ({kind: "scene", ...}: what is drawn and what may be chosen), states
// ({kind: "state", ...}, 50 a second); messages to it are those of
// jansen_env/play/server.py. No physics in here.

import { download, linkOf, openSocket } from "./bench_design.js";
import { CLICK_PUSH, drawPush, impulseOf } from "./push.js";
import { drawScene, followingView, THEMES } from "./scene.js";
import { explain } from "./terms.js";

const RECONNECT = [0.5, 1, 2, 4, 8]; // s until the next attempt, the last one again and again
const DEAD_ZONE = 0.12; // of a gamepad's stick
const SENDING = 15; // ms between two messages of a slider, at least
const BEGUN = 1; // s, after which a walk is under way
const ACTS = ["hold", "steer", "push", "reset", "another"]; // messages after which help is read

const $ = (id) => document.getElementById(id);
const canvas = $("picture");
const ctx = canvas.getContext("2d");
const dark = matchMedia("(prefers-color-scheme: dark)");

let socket = null;
let attempts = 0;
let scene = null; // the last messages of either kind
let latest = null;
let walker = null; // the control that last walked without the hand
let notice = ""; // of the page itself
let drag = null; // {x, y, toX, toY}, pixels, while the pointer is down
let stick = 0; // where the gamepad's was
let stickButton = false;
let sent = 0; // ms, when values were sent last
let stands = false; // time, as this page's help is open
const waiting = new Map(); // of each slider its newest value

// The connection.

function connect() {
  socket = openSocket();
  socket.addEventListener("open", () => {
    attempts = 0;
    notice = "";
    if (stands) send({ do: "pause", value: true });
  });
  socket.addEventListener("message", (event) => receive(JSON.parse(event.data)));
  socket.addEventListener("close", () => {
    const wait = RECONNECT[Math.min(attempts, RECONNECT.length - 1)];
    attempts += 1;
    notice = "No connection to the program. Trying again …";
    setTimeout(connect, 1000 * wait);
  });
}

function send(message) {
  if (ACTS.includes(message.do)) $("help").close();
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

/** Send a value that may change many times between two pictures: only the last one counts. */
function sendSoon(message) {
  waiting.set(message.do + (message.name ?? ""), message);
}

function receive(message) {
  if (message.kind === "state") {
    const first = !latest && location.hash !== "#walk"; // with which the bench leads here
    latest = message;
    if (first && message.score.time < BEGUN) toggleHelp(); // or somebody plays already
  } else if (message.kind === "scene") {
    if (scene?.paused && !message.paused) $("help").close(); // time goes on: somebody plays
    scene = message;
    showPanel();
  } else if (message.kind === "replay") {
    download("walk.html", "text/html", message.page);
  }
}

// The panel.

function showPanel() {
  if (!$("choices").children.length) buildPanel();
  for (const { name, value } of scene.sliders) {
    const slider = $(name);
    if (document.activeElement !== slider || !slider.matches(":active")) slider.value = value;
    showValue(name);
  }
  for (const [name, value] of Object.entries(scene.choices)) $(name).value = value;
  $("bench").href = `bench#${linkOf({ base: scene.choices.robot, changes: scene.lengths })}`;
  $("level").disabled = scene.choices.terrain === "flat";
  $("pace").value = scene.pace;
  $("pause").setAttribute("aria-pressed", scene.paused);
  if (!byHand()) walker = scene.choices.control;
  walker ??= scene.options.control[2]; // the first that was trained
  $("input-label").textContent = byHand() ? "torque" : "speed command";
  $("help-input").textContent = byHand()
    ? "turn the crank: the longer, the stronger"
    : "faster backwards or forwards";
  $("help-control").textContent = byHand()
    ? `You turn the crank. Or let “${walker}” walk at your command.`
    : `“${walker}” turns the crank at your command: you set the speed. Or take the crank yourself.`;
  for (const button of document.querySelectorAll(".take"))
    button.textContent = byHand() ? `Let “${walker}” walk` : "Take the crank";
  explain("dt, label");
}

function buildPanel() {
  for (const [name, values] of Object.entries(scene.options))
    addChoice(name, values, (text) => {
      const value = name === "level" ? Number(text) : text;
      send({ do: "choose", name, value });
    });
  addChoice("pace", scene.paces, (text) => send({ do: "slow", value: Number(text) }));
  for (const { name, label, low, high } of scene.sliders) {
    const row = element("div", { className: "slider" });
    const slider = element("input", { id: name, type: "range", min: low, max: high, step: 0.01 });
    slider.addEventListener("pointerup", letGo);
    slider.addEventListener("input", () => {
      showValue(name);
      sendSoon({ do: "set", name, value: Number(slider.value) });
    });
    row.append(
      element("label", { htmlFor: name, textContent: label }),
      element("output", { id: `${name}-value`, htmlFor: name, ariaLive: "off" }),
      slider,
    );
    $("sliders").append(row);
  }
}

/** After the pointer has moved a slider or pressed a button, keys are the robot's again. */
function letGo(event) {
  event.target.blur();
}

function addChoice(name, values, choose) {
  const select = element("select", { id: name });
  let pointed = false; // whether it was the pointer that chose, or keys, which may go on
  select.addEventListener("pointerdown", () => {
    pointed = true;
  });
  select.addEventListener("keydown", () => {
    pointed = false;
  });
  for (const value of values)
    select.append(
      element("option", { value, textContent: name === "pace" ? paceOf(value) : nameOf(value) }),
    );
  select.addEventListener("change", () => {
    choose(select.value);
    if (pointed) select.blur();
  });
  const choice = element("div", {});
  choice.append(element("label", { htmlFor: name, textContent: name }), select);
  $("choices").append(choice);
}

function element(tag, properties) {
  return Object.assign(document.createElement(tag), properties);
}

function showValue(name) {
  const { unit } = scene.sliders.find((slider) => slider.name === name);
  $(`${name}-value`).textContent = `${Number($(name).value).toFixed(2)} ${unit}`.trim();
}

function paceOf(value) {
  return value === 1 ? "real time" : `1/${Math.round(1 / value)}`;
}

function nameOf(value) {
  return value === scene.byHand ? "by hand" : String(value);
}

function byHand() {
  return scene.choices.control === scene.byHand;
}

// What is shown at each picture.

function draw(now) {
  requestAnimationFrame(draw);
  readGamepad();
  if (now - sent >= SENDING) {
    sent = now;
    for (const message of waiting.values()) send(message);
    waiting.clear();
  }
  const ratio = window.devicePixelRatio || 1;
  const size = { width: canvas.clientWidth, height: canvas.clientHeight };
  const [width, height] = [size.width, size.height].map((length) => Math.round(length * ratio));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const text = notice || latest?.message || (scene?.paused && !$("help").open ? "Paused" : "");
  $("message").hidden = text === "";
  $("reset").classList.toggle("offered", Boolean(latest?.fallen));
  if ($("message").textContent !== text) $("message").textContent = text;
  if (!scene || !latest) return;
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  const theme = dark.matches ? THEMES.dark : THEMES.light;
  const view = followingView(size, scene.scene, latest.state);
  drawScene(ctx, size, scene.scene, latest.state, view, { theme });
  if (drag) drawPush(ctx, drag, scene.largestPush, theme);
  showScore();
  showInput();
}

function showScore() {
  const { distance, slip_per_metre, cost_of_transport, speed, time } = latest.score;
  const ratio = (value, digits, unit) => (value === null ? "–" : value.toFixed(digits) + unit);
  const texts = {
    distance: `${distance.toFixed(2)} m`,
    slip: ratio(slip_per_metre, 3, " m/m"),
    cost: ratio(cost_of_transport, 2, ""),
    speed: `${speed.toFixed(2).replace("-0.00", "0.00")} m/s`,
    time: `${time.toFixed(1)} s`,
  };
  for (const [id, text] of Object.entries(texts))
    if ($(id).textContent !== text) $(id).textContent = text;
}

function showInput() {
  const value = latest.input;
  if (!$("input").matches(":active") && !waiting.has("steer")) $("input").value = value;
  const text = byHand()
    ? `${(value * scene.scene.torqueLimit).toFixed(1)} N m`
    : `${(value * scene.topSpeed).toFixed(2)} m/s`;
  if ($("input-value").textContent !== text) $("input-value").textContent = text;
}

// Keys, pointers and the gamepad.

const held = { ArrowLeft: false, ArrowRight: false };

function holdKeys() {
  send({ do: "hold", direction: Number(held.ArrowRight) - Number(held.ArrowLeft) });
}

function slower() {
  const at = scene.paces.indexOf(scene.pace);
  send({ do: "slow", value: scene.paces[(at + 1) % scene.paces.length] });
}

const KEYS = {
  " ": () => send({ do: "push", x: CLICK_PUSH, y: 0 }),
  r: () => send({ do: "reset" }),
  n: () => send({ do: "another" }),
  p: () => send({ do: "pause", value: !scene.paused }),
  s: slower,
  c: take,
  Escape: () => $("help").close(),
  h: toggleHelp,
  "?": toggleHelp,
};

/** Let the hand turn the crank, or what has turned it before. */
function take() {
  send({ do: "choose", name: "control", value: byHand() ? walker : scene.byHand });
}

/** While help is open, time stands still. */
function toggleHelp() {
  if ($("help").open) return $("help").close();
  $("help").show();
  stands = !scene.paused;
  if (stands) send({ do: "pause", value: true });
}

/** Whether a key is the focused element's own: arrows of a slider, letters of a list. */
function taken(event) {
  const { tagName } = event.target;
  if (tagName === "SELECT" || tagName === "INPUT") return event.key in held || tagName === "SELECT";
  return tagName === "BUTTON" && event.key === " ";
}

addEventListener("keydown", (event) => {
  if (!scene || event.ctrlKey || event.metaKey || event.altKey || taken(event)) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (key in held) {
    if (!held[key]) {
      held[key] = true;
      holdKeys();
    }
  } else if (KEYS[key]) {
    if (!event.repeat) KEYS[key]();
  } else {
    return;
  }
  event.preventDefault();
});

addEventListener("keyup", (event) => {
  if (!held[event.key]) return;
  held[event.key] = false;
  holdKeys();
});

for (const [id, key] of [
  ["left", "ArrowLeft"],
  ["right", "ArrowRight"],
]) {
  const hold = (down) => () => {
    if (held[key] === down) return;
    held[key] = down;
    holdKeys();
  };
  $(id).addEventListener("pointerdown", hold(true));
  const press = (down) => (event) => {
    if (event.key === " " || event.key === "Enter") hold(down)();
  };
  $(id).addEventListener("keydown", press(true));
  $(id).addEventListener("keyup", press(false));
  $(id).addEventListener("blur", hold(false));
  for (const end of ["pointerup", "pointercancel", "pointerleave"])
    $(id).addEventListener(end, hold(false));
}

addEventListener("blur", () => {
  if (!held.ArrowLeft && !held.ArrowRight) return;
  held.ArrowLeft = held.ArrowRight = false;
  holdKeys();
});

canvas.addEventListener("pointerdown", (event) => {
  if (event.button !== 0) return;
  canvas.setPointerCapture(event.pointerId);
  const { offsetX: x, offsetY: y } = event;
  drag = { x, y, toX: x, toY: y };
  if (document.activeElement !== document.body) document.activeElement.blur();
});

canvas.addEventListener("pointermove", (event) => {
  if (drag) Object.assign(drag, { toX: event.offsetX, toY: event.offsetY });
});

canvas.addEventListener("pointercancel", () => {
  drag = null;
});

canvas.addEventListener("pointerup", () => {
  const size = { width: canvas.clientWidth, height: canvas.clientHeight };
  if (drag && scene && latest) {
    const view = followingView(size, scene.scene, latest.state);
    const axisY = 0.5 * size.height - (latest.state.y - view.y) * view.scale;
    const impulse = impulseOf(drag, [0.5 * size.width, axisY], scene.largestPush);
    if (impulse) send({ do: "push", ...impulse });
  }
  drag = null;
});

function readGamepad() {
  const pad = navigator.getGamepads?.().find((one) => one?.connected && one.axes.length > 0);
  if (!pad) return;
  const value = Math.abs(pad.axes[0]) < DEAD_ZONE ? 0 : Math.min(Math.max(pad.axes[0], -1), 1);
  if (value !== stick) {
    stick = value;
    sendSoon({ do: "steer", value });
  }
  const pressed = Boolean(pad.buttons[0]?.pressed);
  if (pressed && !stickButton) send({ do: "reset" });
  stickButton = pressed;
}

$("input").addEventListener("pointerup", letGo);
$("input").addEventListener("input", () => {
  sendSoon({ do: "steer", value: Number($("input").value) });
});
$("reset").addEventListener("click", KEYS.r);
$("another").addEventListener("click", KEYS.n);
$("pause").addEventListener("click", () => scene && KEYS.p());
$("show-help").addEventListener("click", toggleHelp);
$("help").addEventListener("close", () => {
  if (stands) send({ do: "pause", value: false });
  stands = false;
});
for (const button of document.querySelectorAll(".take"))
  button.addEventListener("click", () => scene && take());
$("replay").addEventListener("click", () => send({ do: "replay" }));
for (const button of document.querySelectorAll("#panel button"))
  button.addEventListener("pointerup", letGo);
$("panel").addEventListener("submit", (event) => event.preventDefault());

connect();
requestAnimationFrame(draw);
