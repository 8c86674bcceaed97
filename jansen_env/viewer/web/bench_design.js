// Designs that are worked on: {base: name of a built-in design, changes: {name of a length: m, rad}}.
//
// Lengths are whole hundredths of the unit in which they are shown, mm or degrees, so that a link,
// a robot file and the page have the same ones.

const LARGEST = 10_000; // mm or degrees, either way
const LONGEST_LINK = 2_000; // characters
const SLIDE = 0.6; // by which share of itself, or of its link, a slider changes a length
const SLIDE_ANGLE = 60; // degrees

const isAngle = (name) => name === "frame_angle";
const scaleOf = (name) => (isAngle(name) ? 180 / Math.PI : 1000);

export const unitOf = (name) => (isAngle(name) ? "°" : "mm");
/** A length or angle as it is shown. */
export const shown = (name, value) => Math.round(100 * scaleOf(name) * value) / 100;
/** A length or angle from what is shown. */
export const lengthOf = (name, value) => value / scaleOf(name);

/** A design with some more lengths, m and rad; those of the built-in design are left out. */
export function withLengths(designs, { base, changes }, lengths) {
  const { lengths: builtIn } = designs[base];
  const kept = Object.entries({ ...changes, ...lengths })
    .map(([name, value]) => [name, shown(name, value)])
    .filter(([name, value]) => value !== shown(name, builtIn[name]));
  return { base, changes: Object.fromEntries(kept.map(([n, value]) => [n, lengthOf(n, value)])) };
}

/** Lowest and highest value of a slider, as shown. */
export function rangeOf({ lengths, signed }, name) {
  const value = shown(name, lengths[name]);
  const body = name.replace(/_[^_]+_(along|across)$/, "_");
  const first = Object.keys(lengths).find((other) => other.startsWith(body)); // of the same plate
  const size = signed.includes(name) ? shown(first, lengths[first]) : value;
  const slide = isAngle(name) ? SLIDE_ANGLE : SLIDE * size;
  return [Math.floor(value - slide), Math.ceil(value + slide)];
}

/** Return why a value, as shown, cannot be that of a length of a design; "" if it can. */
export function refusal({ signed }, name, value) {
  const low = signed.includes(name) ? -LARGEST : 0.01;
  if (value >= low && value <= LARGEST) return "";
  return `${name} must be between ${low} and ${LARGEST} ${unitOf(name)}, got ${value}.`;
}

/** The fragment of a link to a design: paper&rocker=240. */
export function linkOf({ base, changes }) {
  const each = Object.entries(changes).map(([name, value]) => `${name}=${shown(name, value)}`);
  return [base, ...each].join("&");
}

/** The design of a fragment. Throws an Error that says in one line what is wrong with it. */
export function designOf(designs, fragment) {
  const [base, ...rest] = fragment.slice(0, LONGEST_LINK).split("&");
  if (!Object.hasOwn(designs, base)) {
    const known = Object.keys(designs).join(", ");
    throw new Error(`The robot of the link must be one of ${known}, got "${base.slice(0, 40)}".`);
  }
  const changes = {};
  for (const part of rest) {
    const [, name, text] = /^([A-Za-z_]+)=(-?\d+(?:\.\d+)?)$/.exec(part) ?? [];
    const { lengths } = designs[base];
    const given = `got "${part.slice(0, 40)}"`;
    if (!name) throw new Error(`A length in the link must have the form NAME=NUMBER, ${given}.`);
    if (!Object.hasOwn(lengths, name)) {
      const known = Object.keys(lengths).join(", ");
      throw new Error(`A length in the link must be one of ${known}, ${given}.`);
    }
    const wrong = refusal(designs[base], name, Number(text));
    if (wrong) throw new Error(`In the link, ${wrong}`);
    changes[name] = lengthOf(name, Number(text));
  }
  return withLengths(designs, { base, changes }, {});
}

/** A robot file of a format, which jansen_env/robot/robot_file.py reads. */
export function robotFile(format, { base, changes }) {
  const rounded = ([name, value]) => [name, Number(value.toFixed(isAngle(name) ? 6 : 5))];
  const lengths = Object.fromEntries(Object.entries(changes).map(rounded));
  const content = { format, design: base, lengths };
  return `${JSON.stringify(content, null, 1)}\n`;
}

/** Copy the page's address and say a text, or else the address itself. */
export function copyLink(say, text) {
  const copied = navigator.clipboard?.writeText(location.href) ?? Promise.reject();
  copied.then(
    () => say(text),
    () => say(location.href),
  );
}

/** Let the browser save a text as a file. */
export function download(name, type, text) {
  const href = URL.createObjectURL(new Blob([text], { type }));
  Object.assign(document.createElement("a"), { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), 1000);
}
