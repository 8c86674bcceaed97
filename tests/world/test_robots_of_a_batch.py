"""Robots of different lengths in one batch, and robots that a reset exchanges."""

import pickle
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from jansen_env import Bar, LinkageError, Payload, built_robot, holy_numbers_robot, paper_robot
from jansen_env.dynamics.reduced import compile_robot
from jansen_env.plants.design_tables import DesignTables
from jansen_env.robot import Leg

STEPS = 40
LONGER = replace(built_robot(), coupler=Bar(0.2405, 0.11, 0.001), payload=Payload(0.5))
LATER = replace(
    paper_robot(), legs=(Leg("fore"), Leg("fore", 3.0), Leg("back", 0.3), Leg("back", 3.5))
)
ROBOTS = [paper_robot(), LONGER, holy_numbers_robot(), built_robot(), LATER, LONGER]


def walk(env, shape=(1,), steps=STEPS):
    """(steps, ...) observations under one torque."""
    return np.array([env.step(np.full(shape, 0.35, np.float32))[0] for _ in range(steps)])


def alone(robot, **arguments):
    env = gym.make("JansenWalker-v0", robot=robot, **arguments).unwrapped
    first, _ = env.reset(seed=5)
    return first, walk(env)


@pytest.mark.parametrize("terrain", ["flat", "rough"])
def test_each_moves_as_it_would_alone(terrain):
    """Lengths, masses, phases, feet and directions differ; made so, or exchanged at a reset."""
    arguments = {"terrain": terrain, "terrain_level": 0 if terrain == "flat" else 2}
    n = len(ROBOTS)
    made = gym.make_vec("JansenWalker-v0", n, robot=ROBOTS, **arguments)
    other = gym.make_vec("JansenWalker-v0", n, robot="built", **arguments)
    other.reset(seed=0)
    walk(other, (n, 1), 3)
    started = made.reset(seed=[5] * n)[0], other.reset(seed=[5] * n, options={"robot": ROBOTS})[0]
    walked = walk(made, (n, 1)), walk(other, (n, 1))
    again = pickle.loads(pickle.dumps(other.task.world.plant))
    assert again.robots == ROBOTS and (again.designs.number == [0, 1, 2, 3, 4, 1]).all()
    for k, robot in enumerate(ROBOTS):
        first, states = alone(robot, **arguments)
        for start, many in zip(started, walked, strict=True):
            assert (start[k] == first).all() and (many[:, k] == states).all(), k


@pytest.mark.parametrize("plant", ["projection", "rigid_body"])
def test_a_reset_exchanges_the_robot_for_good(plant):
    """It walks as an environment made with it; its motor's torque is what action 1 means."""
    kwargs = {"plant": plant, "terrain": "flat"}
    steps = STEPS if plant == "projection" else 2
    env = gym.make("JansenWalker-v0", **kwargs).unwrapped
    env.reset(seed=1)
    fresh = gym.make("JansenWalker-v0", robot="built", **kwargs).unwrapped
    for options in ({"robot": "built"}, {}):
        ours, theirs = env.reset(seed=2, options=options)[0], fresh.reset(seed=2)[0]
        assert (ours == theirs).all() and (walk(env, steps=steps) == walk(fresh, steps=steps)).all()
    assert env.robot == built_robot() and env.torque_limit == built_robot().motor.torque_limit
    assert env.weight == fresh.weight


@pytest.mark.parametrize(
    ("robot", "error", "match"),
    [
        (replace(paper_robot(), crank=Bar(0.2)), LinkageError, "does not close"),
        (paper_robot(3), ValueError, "must be on"),
        ("klann", ValueError, r"options\['robot'\] is 'klann', must be a Robot or one of"),
        (paper_robot(), ValueError, "friction"),  # with another option that is refused
    ],
)
def test_after_a_refusal_all_goes_on_as_before(robot, error, match):
    """Robots, parameters that were drawn, and states, of feet that give, too."""
    randomize = {"payload": (0.0, 1.0), "friction": (0.4, 0.9)}
    pair = [gym.make_vec("JansenWalkerBuilt-v0", 2, randomize=randomize) for _ in range(2)]
    for envs in pair:
        envs.reset(seed=3)
        walk(envs, (2, 1), 5)
    options = {"robot": [LONGER, robot]}
    if robot == paper_robot():
        options["friction"] = [0.5, -1.0]
    with pytest.raises(error, match=match):
        pair[0].reset(options=options)
    assert (walk(pair[0], (2, 1)) == walk(pair[1], (2, 1))).all()
    assert pair[0].get_attr("robot") == pair[1].get_attr("robot")


def test_equal_designs_share_their_tables():
    """Rows that no robot has any more are used again; the arrays grow when there are none."""
    lengths = [replace(paper_robot(), coupler=Bar(0.239 + 1e-4 * k)) for k in range(4)]
    tables = [compile_robot(robot) for robot in lengths]
    designs = DesignTables([tables[0]] * 3)
    assert len(designs.depths) == 1
    designs.set(1, tables[1])
    assert designs.number.tolist() == [0, 1, 0] and len(designs.depths) == 2
    designs.set(1, tables[2])  # in place of what nobody has
    designs.set(2, tables[2])
    assert designs.number.tolist() == [0, 1, 1] and len(designs.depths) == 2
    designs.set(0, tables[3])
    designs.set(2, tables[0])
    assert len(designs.depths) == 4 and len(set(designs.number.tolist())) == 3
    for row, own in zip(designs.number, (tables[3], tables[2], tables[0]), strict=True):
        assert (designs.model.body[row] == own.body).all()
        assert (designs.model.pads[row] == own.pads).all()
