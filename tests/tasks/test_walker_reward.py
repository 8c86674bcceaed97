"""The walking task's reward: its factors, the moving target, and commands that change."""

import math

import gymnasium as gym
import numpy as np
import pytest

from jansen_env.engine.walk_reward import HALF_CHANGE, HALF_EFFORT, REWARD
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.tasks.walking import JansenWalkerEnv

FACTORS = REWARD.names
COMMAND = JansenWalkerEnv().task.columns["speed_command"]


def plain_factors(env, infos, actions):
    """The reward's factors of each step, worked out once more in plain Python, and the lag."""
    dt = env.control_dt
    weight = env.weight
    path = advance_per_turn(env.robot) / 4.0
    lag = speed = slip = power = square = x = last = 0.0
    for info, action in zip(infos, actions, strict=True):
        command = info["command"]  # of the step, not after it
        v = (info["x_position"] - x) / dt
        lag = np.clip(lag + (command - v) * dt, -0.5, 0.5)
        share = 1.0 - math.exp(-dt / np.clip(path / abs(command or 1e-9), 0.2, 3.4))
        speed += share * (v - speed)
        slip += share * (info["slip"].sum() / dt - slip)
        power += share * (abs(info["energy"]["motor_work"]) / dt - power)
        square += share * ((20.0 * action) ** 2 - square)
        pace = max(abs(command), 0.05)
        progress = 1.0 - min(1.0, abs(speed) / 0.05)
        if command:
            ratio = speed / command
            progress = np.clip(ratio, 0, 1) if ratio < 2.0 else 2.0 / ratio
        factors = {
            "tracking": 0.3 + 0.7 / (1 + (lag / 0.2) ** 2),
            "progress": progress,
            "slip": 1 / (1 + slip / pace / 0.2),
            "energy": 1 / (1 + power / (weight * pace) / 4.0),
            "effort": 1 / (1 + square / (weight * HALF_EFFORT) ** 2),
            "smoothness": 1 / (1 + ((action - last) / HALF_CHANGE) ** 2),
            "posture": 1 / (1 + (info["pitch"] / 0.4) ** 2),
            "load": 1 / (1 + ((info["ground_load"] - 1) / 0.8) ** 2),
        }
        yield lag, factors
        x = info["x_position"]
        last = action


@pytest.mark.parametrize("commands", [(0.3,), (-0.1,), (0.0,), (0.5, -0.2, 0.0, 0.05)])
def test_the_reward_is_what_is_documented(commands):
    """Target, means and factors are recomputed; each factor is within 0 and 1, and their product is
    the reward.
    """
    env = JansenWalkerEnv()
    rng = np.random.default_rng(2)
    env.reset(seed=2, options={"speed_command": commands[0]})
    infos = []
    actions = []
    rewards = []
    for k in range(200):
        command = commands[k * len(commands) // 200]
        env.set_parameters(command=command)
        actions.append(float(np.float32(np.clip(0.1 + 0.3 * rng.normal(), -1.0, 1.0))))
        _, reward, *_, info = env.step(np.array([actions[-1]], np.float32))
        rewards.append(reward)
        infos.append({**info, "command": command})
    expected = plain_factors(env, infos, actions)
    for info, reward, (lag, factors) in zip(infos, rewards, expected, strict=True):
        assert info["lag"] == pytest.approx(lag, abs=1e-12)
        for name, value in factors.items():
            assert info[f"reward/{name}"] == pytest.approx(value, abs=1e-9), name
            assert 0.0 <= value <= 1.0 and (value > 0.0 or name == "progress")
        assert set(factors) == set(FACTORS)
        assert reward == pytest.approx(math.prod(factors.values()), abs=1e-9)


@pytest.mark.parametrize("command", [0.05, 0.1, 0.2, 0.4, 0.8, -0.05, -0.3, 0.01, 2.0])
def test_standing_still_earns_next_to_nothing(command):
    """It earns at most 1 % of what could be had in 10 s; at the command 0 it earns nearly all of
    it.
    """
    env = JansenWalkerEnv(reset_noise_scale=0.0)
    returns = []
    for asked in (command, 0.0):
        env.reset(seed=0, options={"speed_command": asked})
        returns.append(sum(env.step(np.zeros(1, np.float32))[1] for _ in range(500)))
    assert returns[0] < 5.0 and returns[1] > 450.0


def test_the_target_waits():
    """However long the robot stands, or if it runs ahead, the target is 0.5 m away at most."""
    env = JansenWalkerEnv()
    for command, torque, end in ((0.8, 0.0, 0.5), (-0.8, 0.0, -0.5), (0.05, 10.0, -0.5)):
        env.reset(seed=0, options={"speed_command": command, "crank_angle": 1.0})
        for _ in range(150):
            *_, info = env.step(np.array([torque / 20.0]))
        assert info["lag"] == end and info["reward/tracking"] < 0.4


def test_weights_are_exponents():
    names = ("slip", "energy", "effort", "smoothness", "posture", "load")
    infos = []
    for weight in (1.0, 2.0, 0.0):
        env = JansenWalkerEnv(**{f"{name}_weight": weight for name in names})
        env.reset(seed=0)
        for action in (0.5, 0.2, 0.6):
            *_, info = env.step(np.array([action], np.float32))
        infos.append(info)
    for name in names:
        linear, squared, none = (info[f"reward/{name}"] for info in infos)
        assert 0.0 < linear < 1.0 and squared == pytest.approx(linear**2) and none == 1.0


def test_rough_ground_has_smaller_weights():
    names = ("slip", "energy", "effort", "smoothness", "posture", "load")
    flat, rough = (1.0,) * 6, (0.2, 0.2, 0.2, 0.5, 0.2, 0.2)
    for name, expected in (("", flat), ("Built", flat), ("Rough", rough), ("Hardcore", rough)):
        weights = gym.make(f"JansenWalker{name}-v0").unwrapped.task.world.reward_settings
        assert tuple(weights[0][factor] for factor in names) == expected, name


def test_commands_change_within_an_episode():
    """They change every 0.1 s by the interval, sampled from the range, and from the next step on if
    set by hand.
    """
    env = JansenWalkerEnv(speed_command=(-0.2, 0.3), command_interval=0.1)
    observation, info = env.reset(seed=4)
    seen = [info["speed_command"]]
    for _ in range(50):
        observation, *_, info = env.step(np.zeros(1, np.float32))
        seen.append(info["speed_command"])
        assert observation[COMMAND] == np.float32(seen[-1])
    changes = np.flatnonzero(np.diff(seen)) + 1
    assert changes.tolist() == list(range(5, 51, 5))
    assert min(seen) >= -0.2 and max(seen) <= 0.3 and min(seen) < 0.0 < max(seen)
    env = JansenWalkerEnv(speed_command=0.3)
    env.reset(seed=0)
    env.set_parameters(command=-0.1)
    observation, *_, info = env.step(np.zeros(1, np.float32))
    assert info["speed_command"] == -0.1 and observation[COMMAND] == np.float32(-0.1)
    assert info["lag"] == pytest.approx(-0.1 * env.dt - info["x_position"], abs=1e-12)
    assert env.reset(seed=1)[1]["speed_command"] == 0.3
    with pytest.raises(ValueError, match=r"command must be .*, got 3"):
        env.set_parameters(command=3.0)
