// Grounds drawn by name, level and seed: the points of jansen_env/terrain, bit for bit.

import { generatorOf } from "./random.js";

const EXTENT = 1000; // m, how far the first and the last segment are extended

/**
 * The points [x, y], m, of a ground.
 *
 * `data` is what jansen_env/viewer/web/terrain_data.py writes; `name` is one of its generators, or
 * "flat", which has no level.
 */
export function groundOf(data, name, level, seed) {
  if (name === "flat") return sloping(0);
  return drawn(data, name, level, generatorOf(seed));
}

/** Draw a ground of a kind by a generator of random.js. */
export function drawn(data, name, level, rng) {
  if (name === "mixed") return drawn(data, data.kinds[rng.integer(data.kinds.length)], level, rng);
  const values = { ...data.levels[name][level] };
  const down = rng.random() < 0.5;
  const sign = data.upOrDown[name];
  if (down && sign) values[sign] *= -1;
  const make = MAKERS[name];
  if (name === "slope" || name === "steps") return make(values, data.start, data, rng);
  return make(values, rng.uniform(data.start, data.start + data.shift), data, rng);
}

/** Points with both ends extended: what the engine's ground consists of. */
export function polyline(points) {
  const end = ([x, y], [dx, dy], way) => [
    x + (way * EXTENT * dx) / dx,
    y + (way * EXTENT * dy) / dx,
  ];
  const step = (i) => [points[i + 1][0] - points[i][0], points[i + 1][1] - points[i][1]];
  const last = points.length - 1;
  return [
    end(points[0], step(0), -1),
    ...points.slice(1, -1),
    end(points[last], step(last - 1), 1),
  ];
}

const MAKERS = {
  slope: ({ gradient }) => sloping(gradient),

  rough({ height, spacing }, start, { reach }, rng) {
    const count = periods(start, reach, spacing);
    const side = () =>
      range(count + 2, (i) => {
        const y = i === 0 || i === count + 1 ? 0 : rng.uniform(-height, height);
        return [start + spacing * i, y];
      });
    return bothSides(side(), side());
  },

  waves({ height, length }, start, { reach, wave }) {
    const size = wave.length;
    const count = periods(start, reach, length);
    const at = (i) => [start + length * (i / size), height * wave[i % size]];
    const side = range(count * size + 1, at);
    return bothSides(side, side);
  },

  stairs({ rise, tread }, start, data) {
    const count = periods(start, data.reach, tread);
    const edges = range(count, (i) => start + 0.5 * tread + tread * i);
    const side = (way) =>
      treads(
        edges,
        edges.map((_, i) => way * (rise * (i + 1))),
        data,
      );
    return bothSides(side(1), side(-1));
  },

  steps({ height, spacing }, start, data, rng) {
    const count = periods(start, data.reach, spacing);
    const uniforms = (from, to) => [0, 1].map(() => range(count, () => rng.uniform(from, to)));
    const lengths = uniforms(0.5 * spacing, 1.5 * spacing);
    const heights = uniforms(-0.5 * height, 0.5 * height);
    const edges = lengths.map((side) => {
      let sum = 0;
      return side.map((length) => {
        sum += length;
        return start + sum;
      });
    });
    return bothSides(treads(edges[0], heights[0], data), treads(edges[1], heights[1], data));
  },

  stumps({ height, width, spacing }, start, data) {
    const gap = spacing - width;
    const count = periods(start, data.reach, width + gap);
    const edges = range(count, (i) => start + 0.5 * gap + (width + gap) * i);
    const both = edges.flatMap((edge) => [edge, edge + width]);
    const heights = both.map((_, i) => (i % 2 === 0 ? height : 0));
    const side = treads(both, heights, data);
    return bothSides(side, side);
  },

  ramps({ gradient, length }, start, { reach }) {
    const count = periods(start, reach, 4 * length);
    const at = (i) => [start + length * i, [0, 1, 1, 0][i % 4] * length * gradient];
    const side = range(4 * count, at);
    return bothSides(side, side);
  },
};

function range(count, make) {
  return Array.from({ length: count }, (_, i) => make(i));
}

function sloping(gradient) {
  return [
    [-1, -gradient],
    [1, gradient],
  ];
}

/** How many periods have room from `start` to `reach`, m. */
function periods(start, reach, period) {
  return Math.max(1, Math.floor((reach - start) / period));
}

/** Two half grounds, each of x > 0 outwards, as one, level at its ends. */
function bothSides(right, left) {
  const ended = (side) => [...side, [side.at(-1)[0] + 1, side.at(-1)[1]]];
  const mirrored = ended(left).map(([x, y]) => [-x, y]);
  return [...mirrored.reverse(), ...ended(right)];
}

/** Level treads of these heights, m, with steep faces whose middles are the edges, m. */
function treads(edges, heights, { steepness, leastRun }) {
  return edges.flatMap((edge, i) => {
    const before = i === 0 ? 0 : heights[i - 1];
    const run = Math.max(Math.abs(heights[i] - before) / steepness, leastRun);
    return [
      [edge - 0.5 * run, before],
      [edge + 0.5 * run, heights[i]],
    ];
  });
}
