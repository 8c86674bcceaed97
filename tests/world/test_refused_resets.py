"""A reset that is refused changes nothing: pairs of options, both plants, one robot and many."""

import math
from copy import deepcopy
from dataclasses import replace
from itertools import product

import gymnasium as gym
import numpy as np
import pytest
from side_by_side import same

from jansen_env import Bar, Compliance, LinkageError, Motor, Payload, built_robot, paper_robot
from jansen_env.plants.rigid.rigid_batch import RigidBodyBatch
from jansen_env.robot.robot_file import FORMAT, robot_to_json

HEAVIER = replace(built_robot(), payload=Payload(0.5))
OPEN = built_robot().with_bodies(crank=Bar(0.2))  # it does not close
STIFF = replace(HEAVIER, pad_compliance=Compliance(1e9, 10.0))  # for the rigid-body plant
GOOD = {
    "crank_angle": 1.0,
    "lengths": {"crank": 0.10834, "rocker": 0.236},  # with which `OPEN` would turn
    "robot": HEAVIER,
    "friction": 0.5,
    "payload": 1.0,
    "delay": 0.01,
    "pushes": [(0.1, 0.5, 0.0)],
    "speed_command": 0.3,
    "foot_stiffness_scale": 1.5,
}
BAD = {
    "crank_angle": np.nan,
    "lengths": {"crank": 0.3},
    "robot": OPEN,
    "friction": -1.0,
    "payload": 1e9,
    "delay": 9.0,
    "pushes": [(0.1, np.nan, 0.0)],
    "speed_command": 9.0,
    "foot_stiffness_scale": 1e-9,
    "tilt": 9.0,
    "hops": 1.0,
}
PAIRS = [{good: GOOD[good], bad: BAD[bad]} for good, bad in product(GOOD, BAD) if good != bad]
TOO_STIFF = [{good: GOOD[good], "foot_stiffness_scale": 100.0} for good in GOOD if good != "robot"]
TOO_STIFF += [{"robot": STIFF, "lengths": {"rocker": 0.236}}]


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["projection", "rigid_body"])
def test_one_robot(plant):
    arguments = {"delay": (0.0, 0.02), "plant": plant, "randomize": {"friction": (0.4, 0.9)}}
    env, twin = (gym.make("JansenWalkerBuilt-v0", **arguments).unwrapped for _ in range(2))
    action = np.full(1, 0.5, np.float32)
    for walker in (env, twin):
        walker.reset(seed=3, options={"lengths": {"rocker": 0.235}})
        walker.step(action)
    for options in PAIRS + TOO_STIFF * (plant == "rigid_body"):
        with pytest.raises(ValueError):
            env.reset(seed=5, options=options)
        assert env.robot == twin.robot and same(env.get_state(), twin.get_state()), options
    for _ in range(3):
        seen, *ours, info = env.step(action)
        expected, *theirs, other = twin.step(action)
        assert (seen == expected).all() and ours == theirs and same(info, other)
    assert (env.reset()[0] == twin.reset()[0]).all() and same(env.get_state(), twin.get_state())


@pytest.mark.slow
def test_many_robots():
    """One of three robots is refused, with the first one masked."""
    pair = [gym.make_vec("JansenWalkerBuilt-v0", 3, randomize={"lengths": 0.02}) for _ in range(2)]
    envs, twins = (batch.unwrapped for batch in pair)
    actions = np.full((3, 1), 0.5, np.float32)
    mask = np.array([False, True, True])
    for batch in pair:
        batch.reset(seed=3)
        batch.step(actions)
    names = [*GOOD, "tilt"]
    for options in PAIRS:
        (good, value), (bad, wrong) = options.items()
        given = {good: [value] * 3}
        if bad in names:  # an unknown one is unknown to all
            given[bad] = [{**GOOD, "tilt": 0.0}[bad]] * 2 + [wrong]
        else:
            given[bad] = wrong
        with pytest.raises(ValueError):
            envs.reset(seed=5, options={**given, "reset_mask": mask})
        assert envs.get_attr("robot") == twins.get_attr("robot")
        assert same(envs.get_state(2), twins.get_state(2)), options
    for _ in range(5):
        assert (envs.step(actions)[0] == twins.step(actions)[0]).all()
    assert (envs.reset()[0] == twins.reset()[0]).all()


def test_a_robot_that_diverges_where_it_is_placed(monkeypatch):
    env, twin = (gym.make("JansenWalkerBuilt-v0", plant="rigid_body").unwrapped for _ in range(2))
    for walker in (env, twin):
        walker.reset(seed=3)

    def diverge(plant, *_):
        plant.lookahead()
        raise plant.refusal(0.0)

    with monkeypatch.context() as patch:
        patch.setattr(RigidBodyBatch, "place", diverge)
        with pytest.raises(FloatingPointError):
            env.reset(options={"robot": HEAVIER, "friction": 0.5})
    assert env.robot == twin.robot and same(env.get_state(), twin.get_state())
    action = np.full(1, 0.5, np.float32)
    assert (env.step(action)[0] == twin.step(action)[0]).all()


@pytest.mark.parametrize("as_state", [False, True])
def test_a_copy_sees_its_ground_after_a_refusal(as_state):
    """The refusal puts a copy's terrain back at another place, in a longer array."""
    envs = gym.make_vec("JansenWalkerRough-v0", 3).unwrapped
    envs.reset(seed=3)
    copy = deepcopy(envs)
    with pytest.raises(LinkageError, match="does not close"):
        if as_state:
            copy.set_state(1, {**copy.get_state(1), "lengths": {"crank": 0.2}})
        else:
            copy.reset(options={"lengths": {"crank": 0.2}})
    for _ in range(5):
        expected, observed = (batch.step(np.full((3, 1), 0.5))[0] for batch in (envs, copy))
        assert (observed == expected).all()


def test_a_refused_reset_keeps_the_level_of_a_curriculum(monkeypatch):
    """`set_parameters` set the level, which no episode has had yet."""
    env = gym.make("JansenWalker-v0", terrain="mixed", curriculum=True).unwrapped
    env.reset(seed=3)
    env.set_parameters(terrain_level=4)
    before = env.get_state()

    def diverge(*_):
        raise FloatingPointError

    monkeypatch.setattr(type(env.task.world.plant), "place", diverge)
    with pytest.raises(FloatingPointError):
        env.reset()
    assert before["level"] == 4 and same(env.get_state(), before)


@pytest.mark.parametrize("plant", ["projection", "rigid_body"])
def test_a_state_that_the_plant_refuses_changes_nothing(plant):
    env = gym.make("JansenWalkerBuilt-v0", plant=plant).unwrapped
    env.reset(seed=3)
    before = env.get_state()
    state = {**deepcopy(before), "lengths": {"rocker": 0.236}}
    state["record"]["parameters"]["foot_stiffness_scale"] = 100.0
    with pytest.raises(ValueError, match=r"time_step must be at most .* got 0\.00"):
        env.set_state(state)
    assert env.robot == built_robot() and same(env.get_state(), before)


@pytest.mark.parametrize(
    ("robot", "arguments", "message"),
    [
        (
            replace(built_robot(), motor=Motor(torque_limit=12.0)),
            {"randomize": {"rotor_inertia_scale": (0.5, 2.0)}},
            "that has an effect here, .*, got '.*_scale'",
        ),
        (built_robot(), {"robot": "paper", "restitution": 0.3}, "restitution must be 0 with"),
    ],
)
def test_a_state_whose_robot_could_have_no_later_episode_changes_nothing(robot, arguments, message):
    env = gym.make("JansenWalkerBuilt-v0", **arguments).unwrapped
    env.reset(seed=3)
    before, machine = env.get_state(), env.robot
    state = {**deepcopy(before), "robot": robot_to_json(robot)}
    state["record"]["parameters"]["restitution"] = 0.0
    with pytest.raises(ValueError, match=message):
        env.set_state(state)
    assert env.robot == machine and same(env.get_state(), before)


@pytest.mark.parametrize(
    ("robot", "error", "match"),
    [
        (OPEN, LinkageError, "does not close"),
        (paper_robot(3), ValueError, "must be on"),
        ("hopper", ValueError, r"options\['robot'\] must be .*, got 'hopper'"),
        ("klann", ValueError, "a robot must have the linkage with the bodies"),
    ],
)
def test_robots_are_refused_by_name(robot, error, match):
    envs = gym.make_vec("JansenWalkerBuilt-v0", 2)
    with pytest.raises(error, match=match):
        envs.reset(options={"robot": [HEAVIER, robot]})


def test_a_robot_is_checked_with_the_lengths_that_are_drawn_later():
    """The given crank is good; its own is so long that no drawn one turns."""
    long = built_robot().with_bodies(crank=Bar(0.15))
    env = gym.make("JansenWalkerBuilt-v0", randomize={"lengths": {"crank": (1.09, 1.1)}})
    with pytest.raises(ValueError, match=r"randomize\['lengths'\] must allow robots"):
        env.reset(options={"robot": long, "lengths": {"crank": 0.11}})


def test_a_start_that_no_observation_can_have():
    for env_id, name in (("JansenWalker-v0", "crank_angle"), ("JansenCrank-v0", "crank_speed")):
        with pytest.raises(ValueError, match=rf"^options\['{name}'\] must be between .* 1e\+300"):
            gym.make(env_id).reset(options={name: 1e300})
        with pytest.raises(ValueError, match=r"^reset_noise_scale must be between .*, got 1e\+300"):
            gym.make(env_id, reset_noise_scale=1e300)


NO_NUMBERS = [10**400, 1e300, "x", {"a": 1}, None, [10**400] * 8, [[1, 2], [3]]]
ENTRIES = {
    "JansenWalkerBuilt-v0": {
        **dict.fromkeys(
            (
                "generator",
                "record",
                "record.state",
                "record.load",
                "record.contact_force",
                "record.seed",
                "record.random_pushes",
                "record.ground_load.steps",
                "record.statistics.impulse",
                "record.parameters",
                "record.task.covered",
                "record.task.info.mean_speed",
                "record.task.info.fallen",
            ),
            NO_NUMBERS,
        ),
        "version": [None, 0, 2, "1"],
        "in_contact": NO_NUMBERS[:4] + NO_NUMBERS[5:],
        "record.action": [*NO_NUMBERS, 1.5],
        "record.torques": [*NO_NUMBERS, [1e300, 0.0], [math.inf, 0.0], [0.0] * 3],
        "record.ground_load.impulse": [*NO_NUMBERS, -1.0],
        "record.ground_load.unevenness": [*NO_NUMBERS, -1.0],
        "record.task.mean_unevenness": [*NO_NUMBERS, -1.0],
        "record.parameters.friction": [*NO_NUMBERS, -0.1],
        "record.parameters.delay": [0.5],
        "record.parameters.grip": [1.0],
        "record.schedule": [1.0, [[0.0, 1.0]], [[0.0, math.nan, 0.0]], [[-1.0, 0.0, 0.0]]],
        "record.statistics.deflection": [
            *NO_NUMBERS, [[0.0, 1e300]] * 22, [[1e300, 0.0]] * 22, [[0.0, 0.0]] * 21,
        ],
        "record.properties": [{}],
        "record.onboard.estimates": [[0.0] * 7],
        "robot": [
            {},
            None,
            {"format": FORMAT, "design": "paper", "lengths": {"crank": 0.2}},
            {"format": FORMAT, "design": "klann", "lengths": {}},
        ],
        "lengths": [0.1, {"tail": 0.1}, {"crank": 0.2}],
        "tail": [1.0],
    },
    "JansenWalkerHardcore-v0": {
        "terrain": [0, {}, {"points": [(0.0, 0.0)]}],
        "terrain.friction": [1.0j, math.nan, "a"],
        "terrain.restitution": [2.0, math.nan],
        "terrain.points": [0, [1.0], (math.nan, 0.0), "ab"],
        "record.task.measured": [3.0, {"delay": 0.0}],
        "record.task.measured.lag": [0.6, "much", -0.6],
        "record.task.measured.mean_slip": [-0.1],
    },
    "JansenCrank-v0": {
        "record.state": [np.zeros(2), np.ones(8)],
        "record.elapsed": [10**400, -1, 0.5],
        "record.task.info.speed_command": [11.0],
        "robot": [robot_to_json(paper_robot())],
        "lengths": [0.1, {"tail": 0.1}, {"crank": 0.2}],
    },
    "JansenGoal-v0": {
        "record.task.info.goal": [math.nan, 3.1],
        "record.task.info.held": [-5.0],
    },
}  # fmt: skip
"""Entries of states, by path, that are none, of whatever kind, also what overflows a float or,
observed, a float32."""
MESSAGES = {
    "points": "points|terrain",
    "restitution": "restitution",
    "robot": "robot|does not close",
    "lengths": "lengths|does not close",
}


def replaced(state, path, value):
    """A copy of a state with another value of an entry, whose path is a list of names."""
    first, *rest = path
    return {**state, first: replaced(state[first], rest, value) if rest else value}


@pytest.mark.parametrize(
    ("env_id", "path", "value"),
    [
        (env_id, path, value)
        for env_id, entries in ENTRIES.items()
        for path, values in entries.items()
        for value in values
    ],
)
def test_an_entry_of_a_state_that_is_none(env_id, path, value):
    env = gym.make(env_id).unwrapped
    env.reset(seed=3)
    before = env.get_state()
    *_, name = names = path.split(".")
    with pytest.raises(ValueError, match=f"(?i){MESSAGES.get(name, name)}"):
        env.set_state(replaced(before, names, value))
    assert same(env.get_state(), before)


def test_a_state_that_lacks_entries_is_refused():
    env = gym.make("JansenCrank-v0").unwrapped
    env.reset(seed=0)
    state = {k: v for k, v in env.get_state().items() if k not in ("record", "level")}
    with pytest.raises(
        ValueError, match=r"state must come from .*, got one without \['level', 'record'\]"
    ):
        env.set_state(state)
    state = replaced(env.get_state(), ["record"], {})
    with pytest.raises(ValueError, match="got one without 'state'"):
        env.set_state(state)


def paths_of(record, *names):
    """The paths of all fields of a saved record."""
    for name, value in record.items():
        yield [*names, name]
        if isinstance(value, dict):
            yield from paths_of(value, *names, name)


def without(record, path):
    """A copy of a saved record without one of its fields."""
    first, *rest = path
    others = {name: value for name, value in record.items() if name != first}
    return {**others, first: without(record[first], rest)} if rest else others


@pytest.mark.parametrize("env_id", ["JansenWalkerHardcore-v0", "JansenCrank-v0", "JansenGoal-v0"])
def test_a_field_that_a_state_lacks_is_as_at_the_beginning(env_id):
    """Also where the environment is elsewhere; the other fields are those of the state."""
    env, other = gym.make(env_id).unwrapped, gym.make(env_id).unwrapped
    env.reset(seed=3)
    for action in (0.5, -0.2, 0.9):
        env.step([action])
    state = env.get_state()
    nominal = {
        **dict.fromkeys(("gravity_scale", "mass_scale", "motor_strength"), 1.0),
        "elapsed": 0,
        "action": 0.0,
        "tilt": 0.0,
        "terrain_level": 0.0,
        "random_pushes": True,
    }
    fields = [path for path in paths_of(state["record"]) if path != ["state"]]
    assert {"info", "statistics", "task", "torques", "seed"} <= {path[0] for path in fields}
    for path in fields:
        other.reset(seed=8)
        other.step([0.3])
        other.set_state({**state, "record": without(state["record"], path)})
        now = other.get_state()["record"]
        assert now.keys() == state["record"].keys()
        # Information on the robot and the task may follow from a field.
        others = now.keys() - {path[0], "info", "task"}
        assert all(same(now[name], state["record"][name]) for name in others), path
        value = now
        for name in path:
            value = value[name]
        if path[-1] in nominal:
            assert value == nominal[path[-1]], path
    other.step([0.3])
