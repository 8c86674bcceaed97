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
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.tasks.walking.walker_benchmark import walking_pid
from jansen_env.viewer.web.bench import SHEETS, bench_designs, write_bench
from jansen_env.viewer.web.engine_data import engine_of_page
from jansen_workshop.drawings.outlines import cut_parts
from jansen_workshop.drawings.sheets import nest

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
import { loadEngine } from "FOLDER/engine.js";
import { prepare } from "FOLDER/linkage.js";
import { legsFor } from "FOLDER/path_search.js";
const { designs, engine, layout, paths } = JSON.parse(readFileSync(0, "utf8"));
prepare(await loadEngine(Buffer.from(engine, "base64"), layout), designs);
const search = (path) => {
  const work = legsFor(designs, path, {});
  for (;;) {
    const { value, done } = work.next();
    if (done) return value;
  }
};
console.log(JSON.stringify(paths.map(search)));
"""


UNCUT = """
import { readFileSync } from "node:fs";
import { loadEngine } from "FOLDER/engine.js";
import { prepare, uncut } from "FOLDER/linkage.js";
const { designs, engine, layout, robots } = JSON.parse(readFileSync(0, "utf8"));
prepare(await loadEngine(Buffer.from(engine, "base64"), layout), designs);
console.log(JSON.stringify(robots.map(([name, lengths]) => uncut(designs[name], lengths))));
"""


@pytest.fixture(scope="module")
def searched():
    """A function of a path's name that returns legs."""
    names = ("built", "klann", "chebyshev", "trotbot", "strider")
    designs = {name: bench_designs()[name] for name in names}
    return cache(
        lambda name: in_node(
            SCRIPT, **engine_of_page(), designs=designs, paths=[PATHS[name].tolist()]
        )[0]
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(p, marks=[pytest.mark.slow] * (p != "flat below")) for p in PATHS]
)
def test_legs_are_as_near_as_they_say(searched, name):
    target = evenly(PATHS[name])
    legs = searched(name)
    assert legs[0]["error"] < 0.0125
    for leg in legs:
        path = toe_path(with_lengths(ROBOTS[leg["base"]](), leg["lengths"]))
        assert path_error(path, target) == pytest.approx(leg["error"], abs=1e-6)
        assert np.linalg.norm(path) == pytest.approx(np.linalg.norm(target))


def cut_fault(name, changed):
    """Which part of a design with other lengths cannot be drawn, "" for none; "Triangle.inertia"
    where a plate is too small for its foot, "--sheet" where a part does not fit one."""
    try:
        robot = with_lengths(ROBOTS[name](), changed)
        length, width = SHEETS[robot.material]
        nest(cut_parts(robot), 1e3 * complex(length, width))
    except ValueError as error:
        return str(error).removeprefix("holes of ").split(" ")[0]
    return ""


@pytest.mark.slow
def test_the_page_knows_what_cannot_be_cut(rng):
    """It agrees with the drawings on parts of all designs, from sizes without room for holes to
    sizes without a sheet.
    """
    asked = []
    faults = []
    refused = 0
    for name, make in ROBOTS.items():
        for scale in np.exp(rng.uniform(-3.5, 3.0, 40)):
            known = lengths(make()).items()
            size = {n: v if n == "frame_angle" else scale * v for n, v in known}
            sized = {n: v * rng.uniform(0.98, 1.02) for n, v in size.items()}
            asked.append((name, sized))
            faults.append(cut_fault(name, sized))
    told = in_node(UNCUT, **engine_of_page(), designs=bench_designs(), robots=asked)
    for (name, _), fault, body in zip(asked, faults, told, strict=True):
        # A linkage that does not close, or a frame without room for the holes of motor and brace,
        # of which the page does not know.
        if fault in ("joint", "frame"):
            continue
        if fault in ("Triangle.inertia", "lengths", "--sheet"):
            assert body, name
        else:
            assert body == fault, name
        refused += body != ""
    assert 100 < refused < len(asked) - 100


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.25, 0.1])
def test_legs_of_plywood_can_be_cut(size):
    """A path for the weekend robot has legs of its build, and at no size one that has no holes."""
    designs = {"weekend": bench_designs()["weekend"]}
    path = (size * PATHS["flat below"]).tolist()
    legs = in_node(SCRIPT, **engine_of_page(), designs=designs, paths=[path])[0]
    assert size < 0.25 or len(legs) > 2
    for leg in legs:
        assert leg["base"] == "weekend" and cut_fault("weekend", leg["lengths"]) == ""


def test_the_nearest_leg_walks(searched):
    leg = searched("flat below")[0]
    robot = with_lengths(ROBOTS[leg["base"]](), leg["lengths"])
    with gym.make("JansenWalker-v0", robot=robot, speed_command=0.3) as env:
        observation, _ = env.reset(seed=0)
        turn = 2.0 * math.pi / abs(advance_per_turn(robot))
        pid = walking_pid(lambda speed: turn * speed, env.unwrapped)
        memory = None
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
    first = says.text_content()
    base = page.input_value("#base")
    assert base in first and len(page.evaluate("location.hash").split("&")) > 10
    page.click("#next")
    assert page.input_value("#base") != base and "its toe is" in says.text_content()
    page.click("#undo")
    assert page.input_value("#base") == base


def test_the_bench_stays_in_the_chosen_build(open_window, tmp_path):
    """The weekend robot has legs of plywood, which differ from one another."""
    window = open_window(reduced_motion="reduce", viewport={"width": 1400, "height": 900})
    page = window.page
    page.goto(f"{write_bench(tmp_path / 'bench.html').as_uri()}#weekend")
    draw_path(page)
    links = []
    for _ in range(3):
        link = page.evaluate("location.hash.slice(1)")
        base, *changes = link.split("&")
        named = dict(change.split("=") for change in changes)
        degrees = math.radians(float(named.pop("frame_angle", math.degrees(0.1301))))
        changed = {name: 1e-3 * float(value) for name, value in named.items()}
        assert base == "weekend"
        assert cut_fault(base, {**changed, "frame_angle": degrees}) == ""
        links.append(link)
        page.click("#next")
    assert len({*links}) == 3
