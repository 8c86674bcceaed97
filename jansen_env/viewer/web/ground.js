// Generates grounds by name, level and seed with the kernels of jansen_env/engine/ground_lines.py.
//
// terrain_data.py writes `data`.

import { Random } from "./random_numbers.js";

/**
 * Return the points [x, y] of a ground, in m. `name` is one of data.generators, or "flat", which has
 * no levels. A name that is not one of data.kinds stands for a random kind.
 */
export function groundOf({ work }, data, name, level, seed) {
  if (name === "flat") return data.flat;
  return work.scratch(() => {
    const rng = new Random(work, seed);
    const { kinds, mixture, reach } = data;
    const kind = kinds.includes(name) ? name : mixture[Number(rng.integer(mixture.length))];
    const number = kinds.indexOf(kind);
    const values = work.filled("f8", data.levels[kind][level]);
    const fixed = work.array("b1", values.length);
    const call = (symbol, ...given) => work.call(`ground_lines_${symbol}`, number, ...given);
    call("choose_direction", rng.random(), fixed, values);
    const start = call("draw_start", call("has_start") ? rng.random() : 0);
    const place = [values, start, reach];
    const draws = rng.uniforms(call("count_draws", ...place));
    const points = work.array("f8", call("count_points", ...place), 2);
    call("put_ground", ...place, draws, points);
    return points.pairs();
  });
}

/** Return points with both ends extended, as the engine needs them, and the steepest slope. */
export function lineOf(memory, points) {
  return memory.scratch(() => {
    const line = memory.array("f8", points.length, 2);
    const steepest = memory.call("ground_lines_put_line", memory.rows("f8", points), line);
    return [line.pairs(), steepest];
  });
}
