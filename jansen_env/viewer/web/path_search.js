// Draw a path, get a leg: the linkage and lengths whose toe comes nearest to a drawn path.
//
// Paths are compared by shape: of even spacing, at their mean place, in either direction, from any
// start. First linkages of random lengths are compared, then the nearest of them are fitted by
// Levenberg and Marquardt's method (Nocedal and Wright, Numerical Optimization, 2006, section 10.3).

import { assemble, pathsOf, uncut } from "./linkage.js";
import { Random } from "./random_numbers.js";

export const POINTS = 64; // of a path
const SPREAD = 0.45; // of the logarithm of random lengths; rad, of the frame's angle
const FITTED = 12; // linkages
const ITERATIONS = 40;
const ENOUGH = 1e-4; // by which share an iteration must be better, or the fit ends
const LEAST_SINE = 0.2; // of two links that meet: below, the crank would be hard to turn
const CHANGE = 1e-6; // of lengths, for slopes
const ALIKE = 0.02; // legs whose lengths differ by less, as shares of the longest, are one

/** A closed path [[x, y], ...] as POINTS points evenly along it. */
export function evenly(path) {
  const ends = [...path.slice(1), path[0]];
  const steps = path.map(([x, y], k) => Math.hypot(ends[k][0] - x, ends[k][1] - y));
  const whole = steps.reduce((sum, step) => sum + step, 0);
  const points = [];
  let [side, before] = [0, 0];
  for (let n = 0; n < POINTS; n++) {
    const way = (n / POINTS) * whole;
    while (side < steps.length - 1 && before + steps[side] < way) before += steps[side++];
    const part = steps[side] > 0 ? (way - before) / steps[side] : 0;
    points.push([0, 1].map((i) => path[side][i] + part * (ends[side][i] - path[side][i])));
  }
  return points;
}

/** A path at its mean place, and its size: the root mean square of the distance from there. */
function centred(path) {
  const mean = [0, 1].map((i) => path.reduce((sum, point) => sum + point[i], 0) / path.length);
  const points = path.map(([x, y]) => [x - mean[0], y - mean[1]]);
  const size = Math.sqrt(points.reduce((sum, [x, y]) => sum + x * x + y * y, 0) / path.length);
  return { points: points.map(([x, y]) => [x / size, y / size]), size };
}

/**
 * Path of the first toe over a turn; null where the linkage does not close, or nearly, or where
 * another joint comes lower than the toe, which could not walk.
 */
function toePath(design, lengths) {
  const places = pathsOf(assemble(design, lengths), POINTS, LEAST_SINE);
  if (!places) return null;
  const { toes, joints } = design;
  const pathOf = (joint) => {
    const first = 2 * joints.indexOf(joint);
    return Array.from({ length: POINTS }, (_, i) => {
      const k = first + 2 * joints.length * i;
      return [places[k], places[k + 1]];
    });
  };
  const lowest = (joint) => Math.min(...pathOf(joint).map(([, y]) => y));
  const others = [...joints].filter((joint) => !toes.includes(joint));
  return lowest(toes[0]) < Math.min(...others.map(lowest)) ? pathOf(toes[0]) : null;
}

/**
 * How far a path is from a target, as the points' root mean square distance / the target's size:
 * {error, shift, way, points, size}. Point k of the target is next to point way * k + shift.
 */
function compare(path, target) {
  const { points, size } = centred(evenly(path));
  let best = { error: Number.POSITIVE_INFINITY };
  for (const way of [1, -1])
    for (let shift = 0; shift < POINTS; shift++) {
      let sum = 0;
      for (let k = 0; k < POINTS; k++) {
        const [x, y] = points[(way * k + shift + POINTS) % POINTS];
        sum += x * target[k][0] + y * target[k][1];
      }
      const error = Math.sqrt(Math.max(0, 2 - (2 * sum) / POINTS));
      if (error < best.error) best = { error, shift, way };
    }
  return { ...best, points, size };
}

/** Differences from the target, (2 POINTS), where points are matched as `compare` has found. */
function differences(path, target, { shift, way }) {
  const { points } = centred(evenly(path));
  return target.flatMap(([x, y], k) => {
    const [u, v] = points[(way * k + shift + POINTS) % POINTS];
    return [u - x, v - y];
  });
}

/** Lengths at which the path of a leg is as large as the target; null where they cannot be cut. */
function cutToSize(design, lengths, scale) {
  const scaled = Object.entries(lengths).map(([name, value]) => [
    name,
    name === "frame_angle" ? value : scale * value,
  ]);
  const sized = Object.fromEntries(scaled);
  return uncut(design, sized) ? null : sized;
}

/** Legs without those that are like one before: the best of each linkage first. */
function different(legs) {
  const kept = [];
  for (const leg of legs.sort((a, b) => a.error - b.error))
    if (!kept.some((other) => other.base === leg.base && alike(other.lengths, leg.lengths)))
      kept.push(leg);
  const isBest = (leg) => leg === kept.find(({ base }) => base === leg.base);
  return [...kept.filter(isBest), ...kept.filter((leg) => !isBest(leg))];
}

function alike(lengths, others) {
  const size = Math.max(...Object.values(lengths).map(Math.abs));
  return Object.entries(lengths).every(([name, value]) => {
    return Math.abs(value - others[name]) < ALIKE * (name === "frame_angle" ? 1 : size);
  });
}

/** Random lengths of a design: bodies keep their kind and, about, their shape. */
function varied(design, rng) {
  const size = Math.max(...Object.values(design.lengths).map(Math.abs));
  const lengths = {};
  for (const [name, value] of Object.entries(design.lengths)) {
    if (name === "frame_angle") lengths[name] = value + rng.uniform(-SPREAD, SPREAD);
    else if (design.signed.includes(name))
      lengths[name] = value + size * rng.uniform(-SPREAD, SPREAD) * 0.5;
    else lengths[name] = value * Math.exp(rng.uniform(-SPREAD, SPREAD));
  }
  return lengths;
}

/** Lengths nearer to the target, by a fit from some lengths. */
function fit(design, start, target) {
  const names = Object.keys(design.lengths);
  const size = Math.max(...Object.values(start).map(Math.abs));
  const moved = (from, steps) => {
    const step = (name, i) => steps[i] * (name === "frame_angle" ? 1 : size);
    return Object.fromEntries(names.map((name, i) => [name, from[name] + step(name, i)]));
  };
  let lengths = start;
  let now = compare(toePath(design, lengths), target);
  let damping = 1e-3;
  for (let n = 0; n < ITERATIONS; n++) {
    const here = differences(toePath(design, lengths), target, now);
    const slopes = names.map((chosen) => {
      const steps = names.map((name) => (name === chosen ? CHANGE : 0));
      const path = toePath(design, moved(lengths, steps));
      if (!path) return here.map(() => 0);
      return differences(path, target, now).map((value, k) => (value - here[k]) / CHANGE);
    });
    const before = now.error;
    for (; damping < 1e6; damping *= 4) {
      const steps = solve(slopes, here, damping);
      const tried = moved(lengths, steps);
      const path = allowed(design, tried) && toePath(design, tried);
      const next = path && compare(path, target);
      if (next && next.error < now.error) {
        [lengths, now] = [tried, next];
        damping /= 10;
        break;
      }
    }
    if (now.error > (1 - ENOUGH) * before) break;
  }
  return { lengths, ...now };
}

/** Whether all lengths have their sign, and none is tiny. */
function allowed({ signed }, lengths) {
  const size = Math.max(...Object.values(lengths).map(Math.abs));
  return Object.entries(lengths).every(
    ([name, value]) => signed.includes(name) || value > 0.04 * size,
  );
}

/** The step of least squares of slopes (n, m) and values (m,), damped. */
function solve(slopes, values, damping) {
  const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
  const rows = slopes.map((a, i) => [...slopes.map((b) => dot(a, b)), -dot(a, values), i]);
  const trace = rows.reduce((sum, row, i) => sum + row[i], 0) / rows.length;
  for (const [i, row] of rows.entries()) row[i] += damping * (row[i] + 0.01 * trace);
  for (const [i, pivot] of rows.entries())
    for (const row of rows) {
      if (row === pivot) continue;
      const factor = row[i] / pivot[i];
      for (let k = i; k <= rows.length; k++) row[k] -= factor * pivot[k];
    }
  return rows.map((row, i) => row[rows.length] / row[i]);
}

/** Legs of random lengths that can be cut, nearest first; yields the share of all work that is done. */
function* randomLegs(designs, target, size, { tries, seed }) {
  const rng = new Random(Object.values(designs)[0].memory, seed);
  const near = [];
  const names = Object.keys(designs);
  for (const [number, base] of names.entries())
    for (let n = 0; n < tries; n++) {
      const lengths = n === 0 ? designs[base].lengths : varied(designs[base], rng);
      const toe = toePath(designs[base], lengths);
      const match = toe && compare(toe, target);
      if (match && cutToSize(designs[base], lengths, size / match.size))
        near.push({ base, lengths, ...match });
      if (n % 50 === 0) yield (0.5 * (number + n / tries)) / names.length;
    }
  return near.sort((a, b) => a.error - b.error);
}

/**
 * The legs that come nearest to a closed path [[x, y], ...], m, and can be cut: {base, lengths, error}.
 * The nearest of each linkage are first, in order of their errors, then others, likewise.
 *
 * `designs`: those of the bench, by name; `tries`: random linkages of each; `error`: root mean square
 * distance / size of the path. It yields the share of its work that is done, and returns the legs.
 */
export function* legsFor(designs, path, { tries = 1500, seed = 0 } = {}) {
  const { points: target, size } = centred(evenly(path));
  const near = yield* randomLegs(designs, target, size, { tries, seed });
  const legs = [];
  for (const [n, { base, lengths }] of near.slice(0, FITTED).entries()) {
    const fitted = fit(designs[base], lengths, target);
    const sized = cutToSize(designs[base], fitted.lengths, size / fitted.size);
    if (sized) legs.push({ base, lengths: sized, error: fitted.error });
    yield 0.5 + (0.5 * (n + 1)) / FITTED;
  }
  return different(legs);
}
