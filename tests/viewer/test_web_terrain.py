"""Grounds that a page draws by name, level and seed are those of the package, bit for bit."""

import itertools

import numpy as np
import pytest
from browser import in_node

from jansen_env.terrain.generators import GENERATORS, HIGHEST, NamedGenerator
from jansen_env.viewer.web.walk_data import walk_data

SEEDS = (0, 1, 7, 2**32 + 5, 2**53 - 1)
SCRIPT = """
import { readFileSync } from "node:fs";
import { loadEngine } from "FOLDER/engine.js";
import { groundOf, lineOf } from "FOLDER/ground.js";
import { Random } from "FOLDER/random_numbers.js";
const { data, asked, seeds } = JSON.parse(readFileSync(0, "utf8"));
const engine = await loadEngine(Buffer.from(data.engine, "base64"), data.layout);
const grounds = asked.map(([name, level, seed]) => {
  const points = groundOf(engine, data.terrain, name, level, seed);
  return [points, ...lineOf(engine.work, points)];
});
const numbers = seeds.map((seed) => {
  const rng = new Random(engine.work, seed);
  const drawn = [rng.random(), rng.integer(7), rng.integer(3), rng.uniform(-2, 5), rng.integer(10)];
  const more = [rng.integer(2n ** 63n), rng.random(), rng.integer(2 ** 32), rng.integer(2 ** 40)];
  return [...drawn, ...more].map(String);
});
console.log(JSON.stringify([grounds, numbers]));
"""


@pytest.mark.slow
def test_a_page_draws_the_same_grounds():
    asked = [*itertools.product(GENERATORS, range(HIGHEST + 1), SEEDS)]
    grounds, numbers = in_node(SCRIPT, data=walk_data(), asked=asked, seeds=SEEDS)
    for (name, level, seed), (points, line, steepest) in zip(asked, grounds, strict=True):
        terrain = NamedGenerator(name)(np.random.default_rng(seed), level)
        assert [tuple(point) for point in points] == list(terrain.points), (name, level, seed)
        assert line == terrain.polyline.tolist(), (name, level, seed)
        assert steepest == terrain.steepest, (name, level, seed)
    for seed, drawn in zip(SEEDS, numbers, strict=True):
        rng = np.random.default_rng(seed)
        expected = [rng.random(), rng.integers(7), rng.integers(3), -2.0 + 7.0 * rng.random()]
        expected += [rng.integers(10), rng.integers(2**63), rng.random(), rng.integers(2**32)]
        expected.append(rng.integers(2**40))
        assert [*map(float, drawn)] == [*map(float, expected)], seed
        assert int(drawn[5]) == expected[5]
