"""Robots of different lengths in one batch, and robots that a reset exchanges."""

import json
import pickle
from copy import deepcopy
from dataclasses import replace
from functools import partial

import gymnasium as gym
import pytest
from motions import SPRINGS
from side_by_side import walk

from jansen_env import Bar, Payload, Robot, built_robot, holy_numbers_robot, paper_robot
from jansen_env.robot import Leg
from jansen_env.viewer.recorder import Recorder
from jansen_env.viewer.recording import Recording

STEPS = 40
LONGER = replace(built_robot().with_bodies(coupler=Bar(0.2405, 0.11, 0.001)), payload=Payload(0.5))
LATER = Robot(legs=(Leg("fore"), Leg("fore", 3.0), Leg("back", 0.3), Leg("back", 3.5)))
SPRUNG = replace(paper_robot(), springs=SPRINGS)
ROBOTS = [paper_robot(), LONGER, SPRUNG, holy_numbers_robot(), built_robot(), LATER, LONGER]


def alone(robot, **arguments):
    env = gym.make("JansenWalker-v0", robot=robot, **arguments).unwrapped
    first, _ = env.reset(seed=5)
    return first, walk(env)


@pytest.mark.parametrize("terrain", ["flat", "rough"])
def test_each_moves_as_it_would_alone(terrain):
    """Lengths, masses, springs, feet and directions differ; made so, or exchanged at a reset."""
    arguments = {"terrain": terrain, "terrain_level": 0 if terrain == "flat" else 2}
    n = len(ROBOTS)
    made = gym.make_vec("JansenWalker-v0", n, robot=ROBOTS, **arguments)
    other = gym.make_vec("JansenWalker-v0", n, robot="built", **arguments)
    other.reset(seed=0)
    walk(other, 3)
    started = made.reset(seed=[5] * n)[0], other.reset(seed=[5] * n, options={"robot": ROBOTS})[0]
    walked = walk(made), walk(other)
    mixed = other.reset(seed=[5] * n, options={"robot": ROBOTS[::-1]})  # designs in other rows
    copy = deepcopy(other)
    assert (walk(copy) == walk(other)).all() and mixed[0].shape == started[1].shape
    for k, robot in enumerate(ROBOTS):
        first, states = alone(robot, **arguments)
        for start, many in zip(started, walked, strict=True):
            assert (start[k] == first).all() and (many[:, k] == states).all(), k


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["projection", "rigid_body"])
def test_a_reset_exchanges_the_robot_for_good(plant):
    """It walks as an environment made with it; its motor's torque is what action 1 means."""
    kwargs = {"plant": plant, "terrain": "flat", "render_mode": "rgb_array"}
    steps = STEPS if plant == "projection" else 2
    env = gym.make("JansenWalker-v0", **kwargs).unwrapped
    env.reset(seed=1)
    env.render()
    fresh = gym.make("JansenWalker-v0", robot="built", **kwargs).unwrapped
    for options in ({"robot": "built"}, {}):
        ours, theirs = env.reset(seed=2, options=options)[0], fresh.reset(seed=2)[0]
        assert (ours == theirs).all() and (walk(env, steps=steps) == walk(fresh, steps=steps)).all()
    assert env.robot == built_robot() and env.torque_limit == built_robot().motor.torque_limit
    assert env.weight == fresh.weight and (env.render() == fresh.render()).all()


def test_a_copy_goes_on_after_one_of_two_equal_robots_was_exchanged():
    envs = gym.make_vec("JansenWalkerBuilt-v0", 2).unwrapped
    envs.reset(seed=0, options={"robot": [LONGER, built_robot()]})
    copy = pickle.loads(pickle.dumps(envs))
    assert (walk(copy) == walk(envs)).all()


def test_pads_of_several_sizes_are_felt_alike():
    """Robots that lie on the ground, on joints that are no toes, whose pads alone differ."""
    robots = [replace(paper_robot(), pad_radius=radius) for radius in (0.005, 0.15)]
    arguments = {"fall_pitch": 9.0, "fall_contact": False, "terminate_when_fallen": False}

    def lie(envs, n):
        envs.reset(seed=[4] * n)
        for i in range(n):
            state = envs.get_state(i)
            state["record"]["state"][1:4] += 0.5, 2.4, 0.3
            envs.set_state(i, state)
        return walk(envs, 80)

    many = lie(gym.make_vec("JansenWalker-v0", 2, robot=robots, **arguments).unwrapped, 2)
    for k, robot in enumerate(robots):
        single = lie(gym.make_vec("JansenWalker-v0", 1, robot=[robot], **arguments).unwrapped, 1)
        assert (many[:, k] == single[:, 0]).all(), k


def test_draws_by_default_are_those_of_the_robot():
    """Default ranges are those of the robot that is there, not of the first one."""
    for first, then in (("built", "paper"), ("paper", "built")):
        env = gym.make("JansenWalkerHardcore-v0", robot=first).unwrapped
        fresh = gym.make("JansenWalkerHardcore-v0", robot=then).unwrapped
        env.reset(seed=0)
        ours, theirs = env.reset(seed=1, options={"robot": then}), fresh.reset(seed=1)
        assert (ours[0] == theirs[0]).all() and ours[1]["parameters"] == theirs[1]["parameters"]
        assert (walk(env) == walk(fresh)).all()


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["projection", "rigid_body"])
def test_a_state_holds_an_exchanged_robot(plant):
    """It does elsewhere, after JSON, and for later episodes; without an exchanged robot it is the
    first one.
    """
    steps = STEPS if plant == "projection" else 2
    make = partial(gym.make, "JansenWalkerBuilt-v0", plant=plant, terrain="flat")
    env, other = make().unwrapped, make().unwrapped
    env.reset(seed=1)
    first = env.get_state()
    env.reset(seed=2, options={"robot": LONGER, "lengths": {"rocker": 0.24}})
    state = env.get_state()
    held = {**state, "robot": json.loads(json.dumps(state["robot"]))}
    other.set_state(held)
    assert other.robot == env.robot and other.get_state()["robot"] == state["robot"]
    env.set_state(state)
    assert (walk(env, steps=steps) == walk(other, steps=steps)).all()
    env.reset(seed=3)
    other.reset(seed=3)
    assert other.robot == env.robot == LONGER
    assert (walk(env, steps=steps) == walk(other, steps=steps)).all()
    other.set_state(first)
    assert other.robot == built_robot() and "robot" not in other.get_state()


def test_a_recording_has_the_exchanged_robot():
    env = Recorder(gym.make("JansenWalkerBuilt-v0"))
    env.reset(seed=1, options={"robot": LONGER})
    for _ in range(2):  # in the next episode, too
        env.step([0.3])
        assert Recording.from_bytes(env.recording.to_bytes()).robot == LONGER
        state = env.unwrapped.get_state()
        env.reset(seed=1)
    env.reset(options={"robot": "built"})
    for expected in (built_robot(), LONGER):
        env.step([0.3])
        env.step([0.3])
        assert env.recording.robot == expected
        env.unwrapped.set_state(
            {**state, "record": {**state["record"], "elapsed": 5}}
        )  # another robot, another recording
