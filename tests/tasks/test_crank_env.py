"""JansenCrank-v0 as a Gymnasium environment: contract, observation, reward, state, rendering."""

import math
import re

import gymnasium as gym
import numpy as np
import pytest

from jansen_env.tasks.crank import JansenCrankEnv
from jansen_env.tasks.crank.crank_env import TRACKING_WIDTH


@pytest.fixture
def env():
    return gym.make("JansenCrank-v0")


def test_observation_is_the_documented_table(env):
    """Each entry is recomputed from the state and the clock; the observation is float32, within its
    space.
    """
    env.reset(seed=1, options={"speed_command": -2.5})
    for k in range(1, 30):
        obs, *_, info = env.step(np.array([-0.6], np.float32))
        psi, n = env.unwrapped.plant.state[[3, 7]]
        error = math.pi - 2.5 * k * 0.01 - psi
        expected = np.array([math.cos(psi), math.sin(psi), n, error, -2.5], np.float32)
        assert obs == pytest.approx(expected, abs=1e-6) and obs.dtype == np.float32
        assert env.observation_space.contains(obs)
        assert [info["crank_angle"], info["crank_speed"]] == [psi, n]
        assert info["tracking_error"] == pytest.approx(error, abs=1e-12)
        assert info["crank_torque"] == pytest.approx(-0.6 * 5.0, rel=1e-6)
        assert info["speed_command"] == -2.5
    assert env.action_space == gym.spaces.Box(-1.0, 1.0, (1,), np.float32)


def test_start_is_random_seeded_and_documented():
    """The crank angle is pi and the speed 0, each within +-0.1 and using most of it; the command is
    in its range.
    """
    env = JansenCrankEnv(speed_command=(0.5, 2.0))
    infos = [env.reset(seed=seed)[1] for seed in range(200)]
    for name, low, high in (
        ("crank_angle", math.pi - 0.1, math.pi + 0.1),
        ("crank_speed", -0.1, 0.1),
        ("speed_command", 0.5, 2.0),
    ):
        drawn = [info[name] for info in infos]
        assert low <= min(drawn) and max(drawn) <= high and np.ptp(drawn) > 0.9 * (high - low)
    assert all(info["tracking_error"] == math.pi - info["crank_angle"] for info in infos)
    exact = JansenCrankEnv(reset_noise_scale=0.0).reset(seed=3)[0]
    assert exact == pytest.approx([-1.0, 0.0, 0.0, 0.0, 1.0], abs=1e-7)


@pytest.mark.parametrize("action", [-2.0, -0.3, 0.0, 0.7, 1.0, 5.0])
def test_reward_is_its_documented_terms(action):
    """It is tracking_weight / (1 + (e / width)^2), with e after the step, less torque_weight *
    share^2.
    """
    env = JansenCrankEnv(tracking_weight=3.0, torque_weight=0.7)
    env.reset(seed=0)
    for _ in range(20):
        _, reward, terminated, _, info = env.step(np.array([action]))
        share = min(1.0, max(-1.0, action))
        tracking = 3.0 / (1.0 + (info["tracking_error"] / TRACKING_WIDTH) ** 2)
        assert info["reward/tracking"] == pytest.approx(tracking, abs=1e-12)
        assert info["reward/torque"] == pytest.approx(-0.7 * share**2, abs=1e-12)
        terms = {key for key in info if key.startswith("reward/")}
        assert terms == {"reward/tracking", "reward/torque"}
        assert reward == pytest.approx(sum(info[key] for key in terms), abs=1e-12)
        assert info["crank_torque"] == share * 5.0 and not terminated
    numbers = re.findall(r"\d+(?:\.\d+)?", JansenCrankEnv.__doc__ or "")
    weights = [JansenCrankEnv.defaults()[f"{name}_weight"] for name in ("tracking", "torque")]
    for value in (TRACKING_WIDTH, *weights):
        assert f"{value:g}" in numbers, f"the documentation has no {value:g}"


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_losing_the_reference_ends_the_episode(direction):
    """It is terminated in the first step whose tracking error exceeds pi, on either side."""
    env = JansenCrankEnv(speed_command=-direction * 5.0)
    env.reset(seed=0)
    errors = []
    terminated = False
    while not terminated:
        _, _, terminated, truncated, info = env.step(np.array([0.5 * direction]))
        errors.append(abs(info["tracking_error"]))
        assert not truncated
    assert errors[-1] > math.pi >= max(errors[:-1]) and type(terminated) is bool


def test_joint_forces(env):
    """``joint_force_max`` is the largest of joint_forces() after the step; off by default."""
    tracked = JansenCrankEnv(track_joint_forces=True)
    for single in (env, tracked):
        single.reset(seed=0)
    for share in (0.0, 1.0, -1.0):
        *_, info = env.step(np.array([share], np.float32))
        *_, more = tracked.step(np.array([share], np.float32))
        assert more.keys() - info.keys() == {"joint_force_max"}
        forces = env.unwrapped.joint_forces()
        assert more["joint_force_max"] == forces.largest()[0] > 1.0
        assert forces.torque == pytest.approx(share * 5.0, abs=1e-9)
        assert more["crank_angle"] == info["crank_angle"]


def test_reset_options():
    """Each option fixes its own value and leaves the other samples as they were; other options are
    refused.
    """
    env = JansenCrankEnv(speed_command=(0.5, 2.0))
    names = ("speed_command", "crank_angle", "crank_speed")
    _, drawn = env.reset(seed=0)
    for name, value in zip(names, (-3.0, 2.0, 4.0), strict=True):
        obs, info = env.reset(seed=0, options={name: value})
        assert info[name] == value
        assert all(info[other] == drawn[other] for other in names if other != name)
        error = obs[env.task.columns["tracking_error"]]
        assert error == np.float32(math.pi - info["crank_angle"]) and env.reference == math.pi
    for bad, message in (
        ({"speed_command": 11.0}, "speed_command"),
        ({"crank_angle": 6.3}, "crank_angle"),
        ({"crank_speed": math.inf}, "crank_speed"),
        ({"sped": 1.0}, "a reset option must be one of .*, got 'sped'"),
    ):
        with pytest.raises(ValueError, match=message):
            env.reset(options=bad)
