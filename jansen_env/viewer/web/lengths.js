// The same robot with other lengths, bit for bit as jansen_env/robot/lengths.py has it.

import { cornersOf, distance, hypot, sidesOf } from "./closure.js";
import { lengthNames } from "./linkage.js";
import { flatBar, triangularPlate } from "./parts.js";
import { exactSum } from "./tables.js";

const range = (count) => [...Array(count).keys()];

/**
 * A design of data.robots with some other lengths, m, by the names of data.designs. Of the built
 * robot's parts it gets such parts; else links are as heavy per metre of their sides as before.
 */
export function robotWithLengths(engine, data, base, changed) {
  const [robot, design, memory] = [data.robots[base], data.designs[base], engine.work];
  const built = data.built.includes(base);
  const lengths = { ...design.lengths, ...changed };
  const isNew = (name) => lengths[name] !== design.lengths[name];
  const bodies = robot.bodies.map((link, k) => {
    const names = lengthNames(design, k);
    if (!names.some(isNew)) return link;
    const given = names.map((name) => lengths[name]);
    if (!given.every(Number.isFinite))
      throw new Error(`lengths of ${design.bodies[k][0]} are missing`);
    const resizedLink = ofLengths(memory, link, given);
    if (!resizedLink) throw new Error(`the sides of ${design.bodies[k][0]} form no triangle`);
    return built ? resizedLink : asDense(memory, link, resizedLink);
  });
  const parts = (link, k) =>
    builtPart(memory, link, design.bodies[k][0], robot.legs.length, engine.layout.numbers);
  const resized = { ...robot, bodies, frame_angle: lengths.frame_angle };
  if (!built || bodies.every((link, k) => link === robot.bodies[k])) return resized;
  return { ...resized, bodies: bodies.map((link, k) => ({ ...link, ...parts(link, k) })) };
}

/** A link of the same kind with other lengths; null for three that form no triangle. */
function ofLengths(memory, link, lengths) {
  if (link.is === "Bar") return { is: "Bar", length: lengths[0] };
  if (link.is === "Triangle") {
    const [a, b, c] = lengths;
    if (2 * Math.max(a, b, c) >= a + b + c) return null;
    const d = Math.sqrt(2 * a * a + 2 * c * c - b * b) / 3; // two thirds of each median
    const l = Math.sqrt(2 * a * a + 2 * b * b - c * c) / 3;
    const h = Math.sqrt(2 * b * b + 2 * c * c - a * a) / 3;
    const angle = (side, other) => {
      const cosine = (d * d + side * side - other * other) / (2 * d * side);
      return memory.angles([cosine], [Math.sqrt((1 - cosine) * (1 + cosine))])[0];
    };
    const { outward } = link;
    return { is: "Triangle", d, l, h, alpha: angle(l, a), gamma: angle(h, c), outward };
  }
  const [[x, y], [u, v]] = link.points;
  const span = hypot(u - x, v - y);
  const [c, s] = [(u - x) / span, (v - y) / span]; // the way of its first two joints
  const others = range((lengths.length - 1) / 2).map((k) => lengths.slice(2 * k + 1, 2 * k + 3));
  const places = [[0, 0], [lengths[0], 0], ...others]; // biome-ignore format: points
  return uniformPlate(places.map(([a, b]) => [c * a - s * b, s * a + c * b]), 0.1); // biome-ignore format: short
}

/** A uniform plate over the largest triangle of its joints, or a rod if they are in line. */
function uniformPlate(points, mass) {
  const away = points.map(([x, y]) => [x - points[0][0], y - points[0][1]]);
  const squares = away.map(([x, y]) => x * x + y * y);
  const indices = range(points.length);
  let [corners, share, largest] = [null, 12, 1e-9 * squares.reduce((sum, square) => sum + square)];
  for (const i of indices)
    for (const j of indices.slice(i + 1))
      for (const k of indices.slice(j + 1)) {
        const [[x, y], p, q] = [points[i], points[j], points[k]];
        const area = Math.abs((p[0] - x) * (q[1] - y) - (p[1] - y) * (q[0] - x));
        if (area > largest) [corners, largest] = [[points[i], p, q], area];
      }
  if (!corners) {
    const [u, v] = away[squares.indexOf(Math.max(...squares))];
    const along = away.map(([x, y]) => x * u + y * v);
    corners = [Math.min, Math.max].map((end) => points[along.indexOf(end(...along))]);
    share = 6;
  }
  const centre = [0, 1].map(
    (k) => corners.reduce((sum, place) => sum + place[k], 0) / corners.length,
  );
  const offsets = corners.flat().map((x, i) => x - centre[i % 2]);
  const spread = offsets.reduce((sum, x) => sum + x * x, 0);
  const inertia = (mass * spread) / share;
  return {
    is: "Plate",
    points: points.map(([x, y]) => [x - centre[0], y - centre[1]]),
    mass,
    inertia,
  };
}

/** A link with as much mass a metre as another, spread as there. */
function asDense(memory, link, resizedLink) {
  const [before, after] = [link, resizedLink].map((each) => {
    const corners = cornersOf(memory, each);
    const [cos, sin] = memory.directions(corners.map(([, offset]) => offset));
    const spread = uniformPlate(corners.map(([c], k) => [c * cos[k], c * sin[k]]), 1).inertia; // biome-ignore format: short
    const last = corners.length - 1;
    const size = exactSum(range(last).map((k) => distance(memory, each, k, k + 1)));
    return { size: size + (last > 1 ? distance(memory, each, 0, last) : 0), spread };
  });
  const mass = (link.mass * after.size) / before.size;
  return {
    ...resizedLink,
    mass,
    inertia: ((link.inertia * mass) / link.mass) * (after.spread / before.spread),
  };
}

/** Mass and inertia of a part of the built robot, by its lengths: buildable.py, designs.py. */
function builtPart(memory, link, name, legs, numbers) {
  const { FRAME_WIDTH, WIDTH, PIN_SHARE, AXIS_MASS, FOOT_MASS } = numbers;
  if (link.is === "Triangle") {
    const more = name === "foot" ? FOOT_MASS - PIN_SHARE : 0;
    return triangularPlate(sidesOf(memory, link), more, numbers);
  }
  if (name === "frame")
    return flatBar(link.length, FRAME_WIDTH, PIN_SHARE + AXIS_MASS / legs, numbers);
  const lower = name === "lower_rod" ? { BAR_THICKNESS: numbers.LOWER_ROD_THICKNESS } : {};
  return flatBar(link.length, WIDTH, PIN_SHARE, { ...numbers, ...lower });
}
