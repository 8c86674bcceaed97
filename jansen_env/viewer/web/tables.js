// Robot -> periodic tables, bit for bit as jansen_env/dynamics/reduced.py has them.

import { Closure, hypot, TURN } from "./closure.js";
import { numbersOf, tabulate } from "./engine.js";

const SCALE = 2 ** 200; // for exact sums
const range = (count) => [...Array(count).keys()];
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

/** Tables and reach of a robot: what the kernels have of it. Throws if it cannot turn. */
export function compileRobot({ work }, robot) {
  return work.scratch(() => compileIn(work, robot));
}

function compileIn(memory, robot) {
  const { SAMPLES, HARMONICS, INTERVALS, ORDER, ...numbers } = memory.layout.numbers;
  const closure = new Closure(memory, robot);
  const turn = (count) => {
    const out = memory.array("f8", 2, count);
    memory.call("reduction_put_turn", out);
    return out;
  };
  const halves = turn(2 * INTERVALS).view.slice(); // of half an interval
  const ways = [0, 2 * INTERVALS].map((start) => [...halves.slice(start, start + HARMONICS)]);
  const psi = tabulate(SAMPLES, (i) => (TURN / SAMPLES) * i);
  const places = closure.joints(psi);
  const motion = [memory.filled("f8", psi), closure.coordinates(psi, places), places];
  const links = robot.bodies.map(({ mass, inertia }) => [mass, inertia]);
  const { damped, damping, bearings, friction, legs, pads: padsOfLeg } = robot.leg;
  const leg = [
    memory.rows("f8", links), pairwiseSum(links.map(([, inertia]) => inertia)),
    memory.rows("i8", damped), memory.filled("f8", damping), memory.rows("i8", bearings),
    memory.filled("f8", friction), memory.rows("f8", legs), memory.rows("i8", padsOfLeg),
  ]; // biome-ignore format: in the kernel's order
  const expansion = numbersOf(memory.layout.expansion, Float64Array);
  const constants = [
    memory.filled("f8", expansion, ORDER, HARMONICS), turn(SAMPLES), turn(INTERVALS),
    memory.rows("f8", ways), turn(numbers.BEARING_SAMPLES),
  ]; // biome-ignore format: likewise
  const work = robot.work.map((shape) => memory.array("f8", ...shape));
  const body = memory.array("f8", 1, INTERVALS, ORDER, 8);
  const pads = memory.array("f8", padsOfLeg.length, INTERVALS, ORDER, 3);
  const frictions = memory.array("f8", numbers.BEARING_SAMPLES);
  const out = [body, pads, frictions];
  const tail = memory.call("reduction_compile_tables", motion, leg, constants, work, out);
  if (!(tail <= numbers.TAIL_TOLERANCE))
    throw new Error("its linkage passes too near a dead point: two links that meet are in line");
  const tables = { body: body.view.slice(), pads: pads.view.slice() };
  const reach = reachOf(memory, robot, tables);
  return {
    ...tables,
    bearings: frictions.view.slice(),
    advance: advancePerTurn(closure),
    height: standingHeight(closure),
    ...reach,
  };
}

/** How far pads and centre of mass get: see jansen_env/plants/design_tables.py. */
function reachOf(memory, robot, { body, pads }) {
  const { ORDER, INTERVALS, PITCHES, BETWEEN, SPARSE, SPECULATIVE_MARGIN } = memory.layout.numbers;
  // Lengths of the first two functions of coefficient k in each row of a table.
  const lengths = (table, functions, k) =>
    tabulate(table.length / (ORDER * functions), (row) => {
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
  const [cos, sin] = memory.directions(tabulate(PITCHES, (i) => (TURN * (i + 0.5)) / PITCHES));
  const down = tabulate(2 * PITCHES, (i) => -(i < PITCHES ? sin[i] : cos[i - PITCHES]));
  const out = memory.array("f8", PITCHES);
  const places = memory.filled("f8", points.flat(), points.length, 2);
  memory.call("collision_put_reach", places, memory.filled("f8", down, 2, PITCHES), out);
  const fore = out.view;
  const sides = new Set(robot.legs.map((leg) => leg.side));
  const onSide = (side, i) => fore[side === "fore" ? i : PITCHES - 1 - i];
  const next = (most * Math.PI) / PITCHES;
  const depth = (i) => largest([...sides].map((side) => onSide(side, i))) + next;
  const depths = tabulate(PITCHES + 1, (i) => (i < PITCHES ? depth(i) : most) + SPECULATIVE_MARGIN);
  return { farthest, depths, extent: BETWEEN * farthest[0][1] };
}

/**
 * Advance in one counter-clockwise turn of the crank, m: kinematics.py, advance_per_turn. Throws if
 * the robot cannot stand: soundness.py, check_standing.
 */
function advancePerTurn(closure, samples = 720) {
  const { scene } = closure.robot;
  const step = TURN / samples;
  const places = closure.legs(tabulate(samples + 1, (i) => (i === samples ? TURN : i * step)));
  const steps = tabulate(samples, (i) => {
    const starts = scene.toes.map(
      ([leg, joint]) => 2 * ((leg * (samples + 1) + i) * scene.joints.length + joint),
    );
    const after = 2 * scene.joints.length;
    const heights = starts.map((k) => places[k + after + 1] + places[k + 1]);
    const height = Math.min(...heights);
    if (!(height < 0))
      throw new Error(
        "robot cannot stand: its lowest toe must lie below the crank axis over the whole turn; " +
          "the usual cause is a dyad assembled on its other side",
      );
    const lowest = starts[heights.indexOf(height)];
    return places[lowest + after] - places[lowest];
  });
  return -pairwiseSum(steps);
}

/** Mean height of the crank axis above the lowest toe over a turn, kept level, m: zoo.py. */
function standingHeight(closure, samples = 360) {
  const { toes, joints } = closure.robot.scene;
  const places = closure.legs(tabulate(samples, (i) => (TURN / samples) * i));
  const lowest = tabulate(samples, (i) =>
    Math.min(
      ...toes.map(([leg, joint]) => places[2 * ((leg * samples + i) * joints.length + joint) + 1]),
    ),
  );
  return -pairwiseSum(lowest) / samples;
}
