"""Robots walk in a page as in Python, bit for bit; Node.js runs the page's modules."""

import base64
import contextlib
import gzip
import itertools
import json
import math
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import browser
import numpy as np
import pytest

from jansen_env.cli.replay import main
from jansen_env.dynamics.reduced import compile_robot
from jansen_env.engine import kernel
from jansen_env.plants.design_tables import DesignTables
from jansen_env.plants.parameters import TABLE
from jansen_env.policies import pretrained
from jansen_env.robot import ROBOTS
from jansen_env.robot.kinematics import LinkageError, advance_per_turn, world_joints
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.robot.robot_file import robot_to_json
from jansen_env.robot.zoo import standing_height
from jansen_env.tasks.walking.presets import ROUGH
from jansen_env.tasks.walking.tuned import rolling
from jansen_env.tasks.walking.walker_benchmark import BASELINES, walking_pid
from jansen_env.tasks.walking.walker_env import JansenWalkerEnv, WalkerTask
from jansen_env.terrain import Terrain
from jansen_env.terrain.generators import GENERATORS, NamedGenerator
from jansen_env.viewer.saved_walk import walk_again
from jansen_env.viewer.web.geometry import scene_of_robot
from jansen_env.viewer.web.page import FOLDER
from jansen_env.viewer.web.walk_data import (
    ENVIRONMENTS,
    engine_data,
    page_policies,
    policy_data,
    task_data,
    walk_data,
)
from jansen_env.world.observations import Noise, Observed

POLICIES = {policy_data(e, n)[0]: (e, n) for e in ENVIRONMENTS for n in page_policies(e)}
CONTROLS = ("hand", "constant speed", "pid", *POLICIES)
pytestmark = [
    pytest.mark.skipif(shutil.which("node") is None, reason="Node.js is not installed"),
    pytest.mark.filterwarnings("ignore:.*diverged"),
]


@cache
def data():
    return walk_data()


def in_node(robots, walks=(), saved=(), page=None):
    """What the page's modules make of robots and walks."""
    asked = {"data": page or data(), "robots": robots, "walks": walks, "saved": saved}
    asked = json.dumps(asked)
    command = ["node", Path(__file__).parent / "walk.mjs", FOLDER]
    done = subprocess.run(command, input=asked, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def numbers(text):
    return np.frombuffer(base64.b64decode(text))


def other_lengths(name, rng, spread):
    return {k: v * rng.uniform(1 - spread, 1 + spread) for k, v in lengths(ROBOTS[name]()).items()}


def test_the_engine_is_small_and_imports_nothing():
    library = kernel.built_library("wasm")
    assert len(gzip.compress(library.read_bytes())) < 120_000
    script = "new WebAssembly.Instance(new WebAssembly.Module(fs.readFileSync(process.argv[1])))"
    subprocess.run(["node", "-e", script, library], check=True)


@pytest.mark.slow
def test_tables_of_every_robot_are_the_same():
    answers = in_node([[name, None] for name in ROBOTS])
    for name, told in zip(ROBOTS, answers["tables"], strict=True):
        robot = ROBOTS[name]()
        tables = compile_robot(robot)
        designs = DesignTables([robot])
        expected = {
            "body": tables.body,
            "pads": tables.pads,
            "bearings": tables.bearings,
            "springs": tables.springs,
            "depths": designs.depths[0],
            "farthest": designs.farthest[0],
            "extent, advance, height": [
                designs.extent[0],
                advance_per_turn(robot),
                standing_height(robot),
            ],
        }
        for (part, values), text in zip(expected.items(), told, strict=True):
            assert np.array_equal(numbers(text), np.ravel(values)), (name, part)


def test_robots_with_other_lengths_are_the_same():
    rng = np.random.default_rng(1)
    asked = []
    for name in ROBOTS:
        every = other_lengths(name, rng, 0.02)
        asked += [[name, every], [name, dict(itertools.islice(every.items(), 2, 4))]]
    answers = in_node(asked)
    each = zip(asked, answers["robots"], answers["tables"], strict=True)
    for (name, changed), told, tables in each:
        robot = with_lengths(ROBOTS[name](), changed)
        expected = json.loads(json.dumps(robot_to_json(robot)))
        assert {key: told[key] for key in expected} == expected, name
        try:
            body = compile_robot(robot).body.ravel()
        except LinkageError as error:
            assert tables == str(error)
        except ValueError as error:
            assert "dead point" in tables and "dead point" in str(error), name
        else:
            assert np.array_equal(numbers(tables[0]), body), name


def test_a_robot_that_cannot_stand_is_refused():
    (told,) = in_node([["paper", {"frame_angle": 3.3}]])["tables"]
    assert "robot cannot stand: its lowest toe must lie below the crank axis" in told


class Walk:
    """A walk in Python, and how a page is asked for the same."""

    def __init__(self, number, steps):
        self.rng = rng = np.random.default_rng(number)
        name = [*ROBOTS][number % len(ROBOTS)]
        control = CONTROLS[number % len(CONTROLS)]
        ground = ("flat", *GENERATORS)[number % (1 + len(GENERATORS))]
        level = int(rng.integers(6))
        drawn = Terrain.flat() if ground == "flat" else NamedGenerator(ground)(rng, level)
        self.robot = [name, other_lengths(name, rng, 0.005) if number % 5 == 4 else None]
        made = with_lengths(ROBOTS[name](), self.robot[1]) if self.robot[1] else ROBOTS[name]()
        bounces = 0.4 if made.pad_compliance.rigid and number % 3 == 1 else 0.0
        numbers = {"friction": float(rng.uniform(0.4, 1.0)), "restitution": bounces}
        self.terrain = {"points": drawn.points, **numbers}
        self.env = JansenWalkerEnv(
            robot=made,
            terrain=drawn,
            height_scan=ROUGH["height_scan"],
            terminate_when_fallen=False,
            noise=Noise() if number % 4 == 2 else None,
            **numbers,
        )
        self.settings = {"noise_level": 1.0} if number % 4 == 2 else {}
        self.control = control
        self.events = self.draw_events(steps)
        self.rows = []
        self.actions = []
        self.diverged = False
        self.walk(steps, float(rng.choice([-0.3, 0.0, 0.2, 0.5, 0.8])))

    def draw_events(self, steps):
        rng = self.rng
        changes = [
            {"friction": 0.3},
            {"payload": 2.0},
            {"tilt": 0.1, "motor_strength": 0.7},
            {"mass_scale": 1.2, "friction": 0.9},
            {"command": -0.2},
            {"command": 0.6},
            {"gravity_scale": 0.7},
            *([{"noise_level": 2.0}] if self.settings else []),
        ]
        tried = {name for change in changes for name in change} | {"noise_level", "restitution"}
        changes += [
            {row.name: row.slider[1]} for row in TABLE if row.slider and row.name not in tried
        ]
        at = np.sort(rng.integers(steps, size=len(changes))).tolist()
        pushes = [[k, "push", rng.uniform(-1.0, 1.0, 2).tolist()] for k in (10, 12, steps // 2)]
        # Refused, or by soft feet; and a push that no simulation bears.
        wrong = ({"friction": -1.0, "tilt": 0.0}, {"payload": 1e3}, {"restitution": 0.5})
        changes += wrong
        at += [steps - 8] * len(wrong)
        pushes += [[steps - 5, "push", [1e7, 0.0]]] if self.control == "hand" else []
        return [[k, "change", [c]] for k, c in zip(at, changes, strict=True)] + pushes

    def policy(self):
        if self.control in POLICIES:
            return pretrained.load(*POLICIES[self.control]).on(self.env)
        if self.control == "pid":
            return BASELINES["pid"](self.env)
        return walking_pid(rolling(self.env.robot), self.env)

    def walk(self, steps, command):
        env = self.env
        policy = self.policy()
        memory = None
        seen, info = env.reset(seed=int(self.rng.integers(100)), options={"speed_command": command})
        state = env.task.world.plant.states[0]
        nested = "slip", "contact_force", "energy", "true_observation"
        self.start = {"crankAngle": state[3], "crankSpeed": state[7], "command": command}
        self.start["episodeSeed"] = str(env.task.world.seeds[0])
        plain = [["", name] for name in info if name not in nested and "/" not in name]
        terms = [["rewards", name[7:]] for name in info if name.startswith("reward/")]
        self.names = [*plain, *terms, *(["energy", name] for name in info["energy"])]
        # What a task fills in NumPy is not on the page.
        by_kernels = {e.name for e in env.task.world.observations} | {*env.task.COMPILED}
        self.seen = [k for k, e in enumerate(env.task.observed) if e.name in by_kernels]
        self.keep(0.0, 0.0, seen, info)
        for step in range(steps):
            for at, method, given in self.events:
                if at == step and method == "push":
                    env.push(given)
                elif at == step:
                    with contextlib.suppress(ValueError):
                        env.set_parameters(**given[0])
            if self.control == "hand":
                action = np.float32([math.sin(0.1 * step) + self.rng.uniform(-0.5, 0.5)])
            else:
                action, memory = policy.predict(env.task.observation[0], memory, step == 0)
            seen, reward, _, _, info = env.step(action)
            self.actions.append(float(action[0]))
            self.diverged |= info["diverged"]
            self.keep(self.actions[-1], reward, seen, info)

    def keep(self, action, reward, seen, info):
        of = {"": info, "energy": info["energy"]}
        told = [info[f"reward/{n}"] if g == "rewards" else of[g][n] for g, n in self.names]
        state = self.env.task.world.plant.states[0]
        force = info["contact_force"].ravel()
        self.rows.append([action, *state, reward, *seen[self.seen], *told, *info["slip"], *force])

    def asked(self, robot):
        names = ("control", "actions", "settings", "start", "events", "names", "terrain")
        return {"robot": robot, **{name: getattr(self, name) for name in names}}


@pytest.mark.parametrize("count, steps", [(22, 60), pytest.param(100, 500, marks=pytest.mark.slow)])
def test_walks_are_the_same(count, steps):
    walks = [Walk(number, steps) for number in range(count)]
    robots = [walk.robot for walk in walks]
    asked = [walk.asked(k) for k, walk in enumerate(walks)]
    for walk, told in zip(walks, in_node(robots, asked)["walks"], strict=True):
        expected = np.array(walk.rows)
        label = (walk.robot, walk.control)
        rows = numbers(told["numbers"]).reshape(expected.shape)
        for step, (row, wanted) in enumerate(zip(rows, expected, strict=True)):
            assert np.array_equal(row, wanted), (*label, step, np.flatnonzero(row != wanted))
        check_picture(walk.env, told)
    assert any(walk.diverged for walk in walks) and not all(walk.diverged for walk in walks)


def check_picture(env, told):
    """Check what is drawn: nearly the same, as poses are no part of a walk."""
    task = env.task
    scene = scene_of_robot(task.scene(0)["robot"], float(task.world.weight[0]))
    frame = env.task.frame(0)
    pose = told["pose"]
    for key in ("style", "bodies", "phases", "toes", "payload", "weight"):
        assert told["scene"][key] == json.loads(json.dumps(scene[key])), key
    assert told["scene"].get("springs") == json.loads(json.dumps(scene.get("springs")))
    joints = world_joints(env.robot, frame.q)
    assert np.allclose(pose["joints"], joints.ravel(), rtol=0.0, atol=1e-12)
    for key, wanted in (("point", frame.contact_point), ("force", frame.contact_force)):
        assert np.allclose([toe[key] for toe in pose["toes"]], wanted, rtol=0.0, atol=1e-9), key
    assert [toe["contact"] for toe in pose["toes"]] == frame.contact.tolist()


def test_a_page_lacks_what_no_kernel_observes(monkeypatch):
    """An observation that the walker fills in NumPy leaves all others where they are."""
    added = Observed("crank_torque", "N m", -np.inf, np.inf, "exact")
    before = task_data(ROBOTS["paper"]())
    monkeypatch.setattr(WalkerTask, "OBSERVED", (*WalkerTask.OBSERVED, added))
    observe = WalkerTask.observe
    monkeypatch.setattr(
        WalkerTask,
        "observe",
        lambda self: {**observe(self), added.name: self.world.crank_torque},
    )
    after = task_data(ROBOTS["paper"]())
    assert after["observed"] == [*before["observed"], ""]
    assert after["observing"]["columns"] == before["observing"]["columns"]
    assert engine_data()["world"]["fully_compiled"]


def test_a_seed_gives_the_start_of_an_environment():
    """The page draws the random numbers of a reset in the order of Python."""
    script = """
        import { readFileSync } from "node:fs";
        import { loadEngine } from "FOLDER/engine.js";
        import { Walker } from "FOLDER/walker.js";
        const { data, seeds } = JSON.parse(readFileSync(0, "utf8"));
        const engine = await loadEngine(Buffer.from(data.engine, "base64"), data.layout);
        const { robots, terrain } = data;
        const walker = await Walker.create(engine, data, robots.paper, terrain.flat, "hand");
        const starts = seeds.map((seed) => {
          walker.start(seed, {}, 0.4);
          const { states, robots } = walker.machine;
          return [states.view[3], String(robots.field("seed").view[0])];
        });
        console.log(JSON.stringify(starts));
    """
    seeds = [0, 1, 7, 2**32 - 1]
    env = JansenWalkerEnv()
    for seed, (angle, stream) in zip(
        seeds, browser.in_node(script, data=data(), seeds=seeds), strict=True
    ):
        env.reset(seed=seed, options={"speed_command": 0.4})
        assert angle == env.task.world.plant.states[0][3], seed
        assert int(stream) == env.task.world.seeds[0], seed


def test_a_refused_change_has_the_same_words_as_in_python():
    script = """
        import { readFileSync } from "node:fs";
        import { loadEngine } from "FOLDER/engine.js";
        import { Machine } from "FOLDER/machine.js";
        const { data, changes } = JSON.parse(readFileSync(0, "utf8"));
        const engine = await loadEngine(Buffer.from(data.engine, "base64"), data.layout);
        const machine = await Machine.create(engine, data.robots.built, null);
        const refusal = (change) => {
          try {
            machine.change(change);
          } catch (error) {
            return error.message;
          }
        };
        console.log(JSON.stringify(changes.map(refusal)));
    """
    changes = [{"restitution": 0.5}, {"payload": 1000.0}, {"friction": -1.0}, {"friction": 2e9}]
    env = JansenWalkerEnv(robot="built")
    env.reset(seed=0)
    answers = browser.in_node(script, data=data(), changes=changes)
    for change, told in zip(changes, answers, strict=True):
        with pytest.raises(ValueError, match=r"must .*, got") as error:
            env.set_parameters(**change)
        assert words_of(told) == words_of(str(error.value))


def words_of(message):
    """What a message allows, with numbers as Python writes them."""
    words = message.partition(" must ")[2].partition(", got ")[0]
    return re.sub(r"\d+(\.\d+)?(e[+-]?\d+)?", lambda number: f"{float(number[0]):g}", words)


@pytest.mark.slow
def test_a_saved_walk_is_the_same_again(tmp_path):
    rng = np.random.default_rng(3)
    robots = [["paper", None], ["built", other_lengths("built", rng, 0.005)], ["strider", None]]
    grounds = ["stairs", "rough", "waves"]
    controls = ["hand", "pid", "rough policy"]
    asked = [
        {"robot": k, "ground": NamedGenerator(ground)(rng, 2).points, "control": control}
        for k, (ground, control) in enumerate(zip(grounds, controls, strict=True))
    ]
    for number, saved in enumerate(in_node(robots, saved=asked)["saved"]):
        path = tmp_path / f"{number}.json"
        path.write_text(json.dumps(saved["file"]))
        recording = walk_again(path)
        assert np.array_equal(recording.state, saved["states"]), number
    main(["--recording", str(path), "--out", str(tmp_path / "page.html")])
    assert "a walk" in (tmp_path / "page.html").read_text()


@pytest.mark.slow
def test_a_page_of_other_robots_has_their_controllers(tmp_path):
    """A design by another name, and one that has no name, are there without the built-in robots
    beside them.
    """
    robots = {"mine": ROBOTS["built"](), "klann": ROBOTS["klann"](1)}
    page = walk_data(robots)
    assert [*page["control"]["baselines"]] == ["mine"]
    assert page["control"]["baselines"]["mine"] == data()["control"]["baselines"]["built"]
    asked = [{"robot": k, "ground": page["terrain"]["flat"], "control": "pid"} for k in range(2)]
    told = in_node([[name, None] for name in robots], saved=asked, page=page)["saved"]
    for saved in told:
        path = tmp_path / "walk.json"
        path.write_text(json.dumps(saved["file"]))
        assert np.array_equal(walk_again(path).state, saved["states"])
