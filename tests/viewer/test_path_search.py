"""A leg for a drawn path: as near as the page says, by the package's kinematics, and walking."""

import math
from functools import cache

import gymnasium as gym
import numpy as np
import pytest
from browser import draw_path, in_node

from agents.design.measures import evenly, path_error, toe_path
from jansen_env.robot import ROBOTS
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.lengths import with_lengths
from jansen_env.tasks.walking.walker_benchmark import walking_pid
from jansen_env.viewer.web.bench import design_of, write_bench

TURN = np.linspace(0.0, 2.0 * math.pi, 100, endpoint=False)
COS, SIN = np.cos(TURN), np.sin(TURN)
RISE = np.concatenate([np.zeros(40), np.arange(20), 20 - np.arange(20)]) / 20
PATHS = {  # x, y, m
    "ellipse": (0.15 * COS, 0.05 * SIN),
    "egg": (0.15 * COS, 0.06 * SIN * (1.0 + 0.3 * COS)),
    "bean": (0.15 * COS, 0.05 * SIN + 0.03 * np.cos(2.0 * TURN)),
    "half circle": (0.12 * COS, 0.12 * np.maximum(SIN, 0.0)),
    "flat below": (0.15 * COS, 0.08 * np.maximum(SIN, 0.0)),
    "triangle": (np.interp(np.arange(80), [0, 40, 80], [-0.15, 0.15, -0.15]), 0.1 * RISE),
}
PATHS = {name: np.stack(path, axis=1) for name, path in PATHS.items()}
SCRIPT = """
import { readFileSync } from "node:fs";
import { legsFor } from "FOLDER/path_search.js";
const { designs, paths } = JSON.parse(readFileSync(0, "utf8"));
const search = (path) => {
  const work = legsFor(designs, path, {});
  for (;;) {
    const { value, done } = work.next();
    if (done) return value;
  }
};
console.log(JSON.stringify(paths.map(search)));
"""


@pytest.fixture(scope="module")
def searched():
    """A function of a path's name that returns legs."""
    names = ("built", "klann", "chebyshev", "trotbot", "strider")
    designs = {name: design_of(ROBOTS[name]()) for name in names}
    return cache(lambda name: in_node(SCRIPT, designs=designs, paths=[PATHS[name].tolist()])[0])


@pytest.mark.parametrize(
    "name", [pytest.param(p, marks=[pytest.mark.slow] * (p != "flat below")) for p in PATHS]
)
def test_legs_are_as_near_as_they_say(searched, name):
    target, legs = evenly(PATHS[name]), searched(name)
    assert legs[0]["error"] < 0.0125
    for leg in legs:
        path = toe_path(with_lengths(ROBOTS[leg["base"]](), leg["lengths"]))
        assert path_error(path, target) == pytest.approx(leg["error"], abs=1e-6)
        assert np.linalg.norm(path) == pytest.approx(np.linalg.norm(target))


def test_the_nearest_leg_walks(searched):
    leg = searched("flat below")[0]
    robot = with_lengths(ROBOTS[leg["base"]](), leg["lengths"])
    with gym.make("JansenWalker-v0", robot=robot, speed_command=0.3) as env:
        observation, _ = env.reset(seed=0)
        turn = 2.0 * math.pi / abs(advance_per_turn(robot))
        pid, memory = walking_pid(lambda speed: turn * speed, env.unwrapped), None
        for step in range(250):
            action, memory = pid.predict(observation, memory, step == 0)
            observation, _, fallen, _, info = env.step(action)
            assert not fallen
    assert info["x_position"] > 1.0  # m, in 5 s at 0.3 m/s


def test_a_path_is_drawn_on_the_bench(open_window, tmp_path):
    window = open_window(reduced_motion="reduce", viewport={"width": 1400, "height": 900})
    page = window.page
    page.goto(f"{write_bench(tmp_path / 'bench.html').as_uri()}#paper")
    draw_path(page)
    says = page.locator("#message")
    first, base = says.text_content(), page.input_value("#base")
    assert base in first and len(page.evaluate("location.hash").split("&")) > 10
    page.click("#next")
    assert page.input_value("#base") != base and "its toe is" in says.text_content()
    page.click("#undo")
    assert page.input_value("#base") == base
