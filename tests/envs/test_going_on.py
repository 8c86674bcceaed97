"""Saved states, copies and pickles continue as the original does, bit for bit."""

import copy
import json
import pickle
from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from courses import COURSE
from side_by_side import random_walk, same

from agents.training.training_state import plain
from jansen_env import Compliance
from jansen_env.plants.rigid.rigid_batch import RigidBodyBatch
from jansen_env.registration import IDS

WALKER = "JansenWalker-v0"
FEET = Compliance(2e4, 50.0)


@dataclass(frozen=True)
class Case:
    """An environment that is saved after some steps.

    Attributes:
        env_id: Id of the environment.
        arguments: Arguments of the environment.
        before: Number of steps before it is saved.
        steps: Number of steps after it, in two episodes each.
        batch: Whether its state is put into a robot of a batch, too.
    """

    env_id: str = WALKER
    arguments: dict[str, Any] = field(default_factory=dict)
    before: int = 60
    steps: int = 100
    batch: bool = True


def on_course(steps=20, batch=True, **arguments):
    return Case(WALKER, {"terrain": COURSE, **arguments}, steps, steps, batch)


CASES = {
    **{env_id: Case(env_id) for env_id in IDS},
    "shapes, rigid feet": on_course(),
    "shapes, compliant feet": on_course(pad_compliance=FEET),
    "shapes, rigid bodies": on_course(3, batch=False, plant="rigid_body"),
    "shapes, rigid bodies, compliant feet": on_course(
        3, batch=False, plant="rigid_body", pad_compliance=FEET
    ),
    "shapes, joint forces": on_course(batch=False, track_joint_forces=True),
    "onboard filters, noise and a delay": Case(
        "JansenWalkerBuilt-v0",
        {
            "robot": "economy",
            "observe": "onboard",
            "torque_rate": 30.0,
            "noise": {"encoder": (0.001, 0.01), "gyro": (0.01, 0.005)},
            "delay": (0.0, 0.02),
        },
        before=20,
        steps=40,
    ),
    "amid a window of the ground load": Case(
        "JansenWalkerBuilt-v0",
        {"control_dt": 0.005},
        before=6,
        steps=20,
    ),
}


@pytest.fixture(params=CASES)
def case(request):
    return CASES[request.param]


@pytest.fixture
def env(case):
    """An environment after some steps of random actions."""
    env = gym.make(case.env_id, **case.arguments).unwrapped
    env.reset(seed=5)
    random_walk(env, case.before)
    return env


def saved(env):
    """Return the state after it was written to JSON and read again."""
    return json.loads(json.dumps(plain(env.get_state())))


def is_rigid(env):
    return isinstance(env.task.world.plant, RigidBodyBatch)


def restored(env):
    """Let rigid bodies continue as from a saved state, which closes the gaps in their joints."""
    if is_rigid(env):
        env.set_state(env.get_state())
    return env


def check_continues(other, env, steps, rounding=0.0):
    """Check that an environment and another one walk alike, and start the next episode alike.

    Copies of rigid bodies, which pymunk moves, are exact but for rounding.
    """
    walked, infos = random_walk(env, steps, seed=6)
    again, others = random_walk(other, steps, seed=6)
    np.testing.assert_allclose(again, walked, rtol=rounding, atol=rounding)
    if not rounding:
        for info, expected in zip(others, infos, strict=True):
            assert info.keys() == expected.keys()
            for name in info:
                same(info[name], expected[name], name)
    assert np.array_equal(env.reset()[0], other.reset()[0])


def test_an_environment_continues_from_a_saved_state(case, env):
    """The state is put into another environment, which shows the last observation at once."""
    other = gym.make(case.env_id, **case.arguments).unwrapped
    other.reset(seed=99)
    state = saved(env)
    last = restored(env).task.observation[0]
    assert np.array_equal(other.set_state(state), last)
    check_continues(other, env, case.steps)


@pytest.mark.parametrize("duplicate", ["copy", "pickle"])
def test_a_copy_continues(case, env, duplicate):
    other = copy.deepcopy(env) if duplicate == "copy" else pickle.loads(pickle.dumps(env))
    rounding = 1e-6 if is_rigid(env) else 0.0
    check_continues(other, restored(env), case.steps, rounding=rounding)


BATCHED = [name for name in CASES if CASES[name].batch]


@pytest.mark.parametrize("case", BATCHED, indirect=True)
def test_a_robot_of_a_batch_continues_from_a_saved_state(case, env):
    """The state of a single robot continues in a batch, whose copies continue as it does."""
    batch = gym.make_vec(case.env_id, 3, **case.arguments).unwrapped
    batch.reset(seed=8)
    shown = batch.set_state(1, saved(env))
    assert np.array_equal(shown, env.task.observation[0])
    copies = copy.deepcopy(batch), pickle.loads(pickle.dumps(batch))
    action = np.full((3, 1), 0.3, np.float32)
    for _ in range(5):
        seen, rewards, *_ = batch.step(action)
        for other in copies:
            again, others, *_ = other.step(action)
            assert np.array_equal(seen, again) and np.array_equal(rewards, others)
        observation, reward, *_ = env.step(action[1])
        assert np.array_equal(observation, seen[1]) and reward == rewards[1]
