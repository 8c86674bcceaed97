// Robot -> periodic tables, bit for bit as jansen_env/dynamics/reduced.py has them.

import { Closure, hypot, modulo, TURN } from "./closure.js";
import { each, numbersOf } from "./engine.js";

const SCALE = 2 ** 200; // for exact sums
const range = (count) => [...Array(count).keys()];
const nearest = (x) => x + 1.5 * 2 ** 52 - 1.5 * 2 ** 52;
const largest = (values) => values.reduce((a, b) => Math.max(a, b));

/** NumPy's sum of contiguous numbers. */
export function pairwiseSum(values) {
  const count = values.length;
  if (count > 128) {
    const half = (count >> 1) - ((count >> 1) % 8);
    return pairwiseSum(values.slice(0, half)) + pairwiseSum(values.slice(half));
  }
  const [r, whole] = [values.slice(0, 8), count - (count % 8)];
  for (let i = 8; i < whole; i += 1) r[i % 8] += values[i];
  const eight = whole ? r[0] + r[1] + (r[2] + r[3]) + (r[4] + r[5] + (r[6] + r[7])) : 0;
  return values.slice(whole).reduce((sum, value) => sum + value, eight);
}

/** Python's math.fsum of numbers that are 0 or above 1e-40: the sum rounded once. */
export function exactSum(values) {
  return Number(values.reduce((sum, value) => sum + BigInt(value * SCALE), 0n)) / SCALE;
}

/** Fourier series of periodic functions, by the engine's kernels: jansen_env/engine/series.py. */
class Fourier {
  constructor(memory) {
    Object.assign(this, { memory, turns: {} });
    this.harmonics = memory.layout.numbers.HARMONICS;
  }

  /** (2, count) cosines and sines of the angles that divide a turn. */
  turn(count) {
    if (!this.turns[count]) {
      const quarter = each(count, (part) => nearest((4 * part) / count));
      const angle = (part) => (0.5 * Math.PI * (4 * part - quarter[part] * count)) / count;
      const [cos, sin] = this.memory.directions(each(count, angle));
      const turned = (k, i) => [cos[i], -sin[i], -cos[i], sin[i]][k % 4];
      const value = (i, ahead) => turned(quarter[i] + ahead, i);
      const values = each(2 * count, (i) => (i < count ? value(i, 0) : value(i - count, 3)));
      this.turns[count] = this.memory.filled("f8", values, 2, count);
    }
    return this.turns[count];
  }

  work(count, functions) {
    return this.memory.array("f8", 4, count * ((functions + 1) >> 1));
  }

  /** Series (2, harmonics, functions) of functions, each an array of samples over a turn. */
  series(functions) {
    const [count, width] = [functions[0].length, functions.length];
    const values = each(count * width, (i) => functions[i % width][(i / width) | 0]);
    const series = this.memory.array("f8", 2, this.harmonics, width);
    const given = this.memory.filled("f8", values, count, width);
    this.memory.call("series_analyse", given, this.turn(count), this.work(count, width), series);
    return series;
  }

  /** Samples of a series times factors (2 harmonics,): for each function an array. */
  sampled(series, count, factors) {
    const { memory, harmonics } = this;
    const width = series.shape[2];
    const values = memory.array("f8", count, width);
    const given = [series, memory.filled("f8", factors, 2, harmonics), this.turn(count)];
    memory.call("series_sample", given, this.work(count, width), values);
    const { view } = values;
    return range(width).map((f) => each(count, (i) => view[i * width + f]));
  }

  /** Largest coefficient of the last eighth, relative to the largest of its function. */
  tail(series) {
    const [{ view }, width, all] = [series, series.shape[2], this.harmonics];
    const sizes = range(width).map((f) =>
      each(all, (n) => hypot(view[n * width + f], view[(all + n) * width + f])),
    );
    const most = sizes.map(largest);
    const least = 1e-3 * largest(most);
    const last = Math.trunc((all * 7) / 8);
    return largest(sizes.map((size, f) => largest(size.slice(last)) / Math.max(most[f], least)));
  }

  /** Sum over legs of the series of a fore leg; of back legs the first functions are mirrored. */
  ofLegs(series, legs, mirrored) {
    const [all, width] = [this.harmonics, series.shape[2]];
    const total = this.memory.array("f8", 2, all, width);
    const [from, to] = [series.view, total.view];
    for (const side of ["fore", "back"]) {
      const phases = legs.filter((leg) => leg.side === side).map((leg) => leg.phase);
      const ways = phases.map((phase) => this.memory.directions(each(all, (n) => phase * n)));
      const sumOf = (k) => each(all, (n) => ways.reduce((sum, way) => sum + way[k][n], 0));
      const [cos, sin] = [sumOf(0), sumOf(1)];
      const back = side === "back";
      for (let i = 0; i < all * width; i += 1) {
        const n = (i / width) | 0;
        const sign = back && (n % 2 === 1) !== i % width < mirrored ? -1 : 1;
        const [real, imaginary] = [sign * from[i], (back ? -sign : sign) * from[all * width + i]];
        to[i] += cos[n] * real - sin[n] * imaginary;
        to[all * width + i] += sin[n] * real + cos[n] * imaginary;
      }
    }
    return total;
  }

  /** (groups, intervals, order, functions of a group) polynomials of a series. */
  polynomials(series, groups) {
    const { memory, harmonics } = this;
    const { INTERVALS, ORDER } = memory.layout.numbers;
    const width = series.shape[2];
    const out = memory.array("f8", groups, INTERVALS, ORDER, width / groups);
    const fine = this.turn(2 * INTERVALS).view; // of which half a step's multiples come first
    const half = [fine.slice(0, harmonics), fine.slice(2 * INTERVALS, 2 * INTERVALS + harmonics)];
    const expansion = numbersOf(memory.layout.expansion, Float64Array);
    const factors = [expansion, half.flatMap((part) => [...part])];
    const given = factors.map((part) =>
      memory.filled("f8", part, part.length / harmonics, harmonics),
    );
    const work = [this.work(INTERVALS, width), memory.array("f8", 2, harmonics)];
    memory.call("series_expand", series, given, this.turn(INTERVALS), work, out);
    return out.view.slice();
  }
}

/** Tables and reach of a robot: what the kernels have of it. Throws if it cannot turn. */
export function compileRobot({ work }, robot) {
  return work.scratch(() => compileIn(work, robot));
}

function compileIn(memory, robot) {
  const fourier = new Fourier(memory);
  const closure = new Closure(memory, robot);
  const { SAMPLES, HARMONICS, INTERVALS, ORDER, TAIL_TOLERANCE } = memory.layout.numbers;
  const psi = each(SAMPLES, (i) => (TURN / SAMPLES) * i);
  const joints = closure.joints(psi);
  const x = closure.coordinates(psi, joints);
  const whole = x.map(([heading]) => unwrapped(heading));
  const turns = whole.map((angle) => nearest((angle.at(-1) - angle[0]) / TURN));
  const angles = whole.map((angle, k) => angle.map((value, i) => value - psi[i] * turns[k]));
  const centres = [1, 2].flatMap((k) => x.map((part) => part[k]));
  const motion = fourier.series([...angles, ...centres]);
  const byAngle = each(2 * HARMONICS, (n) => (n < HARMONICS ? 0 : n - HARMONICS));
  const slope = fourier.sampled(motion, SAMPLES, byAngle);
  for (const [k, turn] of turns.entries()) slope[k] = slope[k].map((rate) => rate + turn);
  const sums = fourier.series(legSums(robot, x, slope));
  const padMotion = robot.pads.flatMap(([joint, link]) => [...joints[joint], angles[link]]);
  const places = fourier.series(padMotion);
  if (![motion, sums, places].every((series) => fourier.tail(series) <= TAIL_TOLERANCE))
    throw new Error("its linkage passes too near a dead point: two links that meet are in line");
  const body = fourier.polynomials(fourier.ofLegs(sums, robot.legs, 1), 1);
  const pads = fourier.polynomials(places, robot.pads.length);
  for (let row = 0; row < robot.pads.length * INTERVALS; row += 1)
    pads[(row * ORDER + 1) * 3 + 2] += turns[robot.pads[(row / INTERVALS) | 0][1]];
  const bearings = bearingFriction(fourier, robot, slope);
  const advance = advancePerTurn(closure);
  return { body, pads, bearings, advance, ...reachOf(memory, robot, { body, pads }) };
}

/** Angles without jumps: `numpy.unwrap`. */
function unwrapped(angles) {
  let correction = 0;
  return angles.map((angle, i) => {
    const step = i > 0 ? angle - angles[i - 1] : 0;
    const way = modulo(step + Math.PI, TURN) - Math.PI;
    const short = way === -Math.PI && step > 0 ? Math.PI : way;
    if (Math.abs(step) >= Math.PI) correction += short - step;
    return angle + correction;
  });
}

/** A fore leg's share of the sums over bodies: c_x, c_y, I, b, k, f, and the links' own b and k. */
function legSums({ bodies, damping, linkage }, x, slope) {
  const count = bodies.length;
  const [mass, inertia] = ["mass", "inertia"].map((name) => bodies.map((link) => link[name]));
  const [da, dx, dy] = [0, 1, 2].map((k) => slope.slice(k * count, (k + 1) * count));
  const [px, py] = [1, 2].map((k) => x.map((part) => part[k]));
  const sum = (factors, make) =>
    each(da[0].length, (i) => {
      let total = factors[0] * make(0, i);
      for (let k = 1; k < factors.length; k += 1) total += factors[k] * make(k, i);
      return total;
    });
  const square = (values) => (k, i) => values[k][i] * values[k][i];
  const squares = (u, v) => (k, i) => u[k][i] * u[k][i] + v[k][i] * v[k][i];
  const all = pairwiseSum(inertia);
  const ownB = sum(inertia, (k, i) => da[k][i]);
  const ownK = sum(inertia, square(da));
  const moment = sum(mass, (k, i) => px[k][i] * dy[k][i] - py[k][i] * dx[k][i]);
  return [
    sum(mass, (k, i) => px[k][i]),
    sum(mass, (k, i) => py[k][i]),
    sum(mass, squares(px, py)).map((value) => value + all),
    moment.map((value, i) => value + ownB[i]),
    sum(mass, squares(dx, dy)).map((value, i) => value + ownK[i]),
    sum(damping, square(relative(da, linkage.damped))),
    ownB,
    ownK,
  ];
}

/** a_j' - a_i' of pairs of bodies (from 1) from a' of each. */
function relative(rates, pairs) {
  return pairs.map(([i, j]) => rates[j - 1].map((rate, n) => rate - rates[i - 1][n]));
}

/** Coulomb friction torque of all bearings on the crank over a turn, N m. */
function bearingFriction(fourier, robot, slope) {
  const { BEARING_SAMPLES, HARMONICS } = fourier.memory.layout.numbers;
  const friction = robot.bearing_friction;
  let total = each(BEARING_SAMPLES, () => 0);
  if (!friction.some((value) => value > 0)) return total;
  const rates = fourier.series(relative(slope, robot.linkage.bearings));
  const unscaled = each(2 * HARMONICS, (n) => (n < HARMONICS ? 1 : 0));
  for (const leg of robot.legs) {
    const turning = fourier.sampled(fourier.ofLegs(rates, [leg], 0), BEARING_SAMPLES, unscaled);
    const share = (i) => (sum, value, k) => sum + value * Math.abs(turning[k][i]);
    total = total.map((value, i) => value + friction.reduce(share(i), 0));
  }
  return total;
}

/** How far pads and centre of mass get: see jansen_env/plants/design_tables.py. */
function reachOf(memory, robot, { body, pads }) {
  const { ORDER, INTERVALS, PITCHES, BETWEEN, SPARSE, SPECULATIVE_MARGIN } = memory.layout.numbers;
  // Lengths of the first two functions of coefficient k in each row of a table.
  const lengths = (table, functions, k) =>
    each(table.length / (ORDER * functions), (row) => {
      const place = (row * ORDER + k) * functions;
      return hypot(table[place], table[place + 1]);
    });
  const farthest = [0, 1].map((k) => [largest(lengths(body, 8, k)), largest(lengths(pads, 3, k))]);
  const others = robot.layout.slice(robot.scene.toes.length).map(([table]) => table);
  const rows = [...new Set(others)].flatMap((table) =>
    range(INTERVALS / SPARSE).map((i) => (table * INTERVALS + i * SPARSE) * ORDER * 3),
  );
  const points = rows.map((place) => [BETWEEN * pads[place], BETWEEN * pads[place + 1]]);
  const most = largest(points.map((point) => hypot(...point)));
  const [cos, sin] = memory.directions(each(PITCHES, (i) => (TURN * (i + 0.5)) / PITCHES));
  const down = each(2 * PITCHES, (i) => -(i < PITCHES ? sin[i] : cos[i - PITCHES]));
  const out = memory.array("f8", PITCHES);
  const places = memory.filled("f8", points.flat(), points.length, 2);
  memory.call("collision_put_reach", places, memory.filled("f8", down, 2, PITCHES), out);
  const fore = out.view;
  const sides = new Set(robot.legs.map((leg) => leg.side));
  const onSide = (side, i) => fore[side === "fore" ? i : PITCHES - 1 - i];
  const next = (most * Math.PI) / PITCHES;
  const depth = (i) => largest([...sides].map((side) => onSide(side, i))) + next;
  const depths = each(PITCHES + 1, (i) => (i < PITCHES ? depth(i) : most) + SPECULATIVE_MARGIN);
  return { farthest, depths, extent: BETWEEN * farthest[0][1] };
}

/** Advance in one counter-clockwise turn of the crank, m: kinematics.py, advance_per_turn. */
function advancePerTurn(closure, samples = 720) {
  const { scene } = closure.robot;
  const step = TURN / samples;
  const psi = each(samples + 1, (i) => (i === samples ? TURN : i * step));
  const legs = closure.legs(psi);
  const toes = scene.toes.map(([leg, joint]) => legs[leg][joint]);
  const steps = each(samples, (i) => {
    const heights = toes.map(([, y]) => y[i + 1] + y[i]);
    const [x] = toes[heights.indexOf(Math.min(...heights))];
    return x[i + 1] - x[i];
  });
  return -pairwiseSum(steps);
}
