"""Motions are the same, bit for bit, in every version of Python: what rounds otherwise in some."""

import builtins
import sys

import gymnasium as gym
import numpy as np
import pytest
from known_designs import DESIGNS

from jansen_env import Payload
from jansen_env.dynamics.reduced import _compile


@pytest.fixture
def no_sums_of_floats(monkeypatch):
    """The built-in ``sum`` compensates its rounding from Python 3.12 on."""
    plain = builtins.sum

    def checked(values, /, start=0):
        values = [*values]
        own = sys._getframe(1).f_globals["__name__"].startswith("jansen_env")
        assert not (own and any(isinstance(value, float) for value in values)), "use math.fsum"
        return plain(values, start)

    monkeypatch.setattr(builtins, "sum", checked)
    _compile.cache_clear()


@pytest.mark.parametrize(
    ("env_id", "arguments"),
    [
        *(("JansenWalker-v0", {"robot": robot}) for robot in DESIGNS.values()),
        ("JansenWalker-v0", {"plant": "rigid_body", "payload": Payload(2.0)}),
        ("JansenWalker-v0", {"randomize": {"lengths": 0.02}}),
        ("JansenWalkerHardcore-v0", {}),
        ("JansenGoal-v0", {}),
        ("JansenCrank-v0", {"robot": "paper_slender"}),
    ],
)
def test_no_motion_depends_on_the_built_in_sum(env_id, arguments, no_sums_of_floats):
    env = gym.make(env_id, **arguments)
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.full(1, 0.3, np.float32))
    env.unwrapped.robot.with_slender_inertias()
