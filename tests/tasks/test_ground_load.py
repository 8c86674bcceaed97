"""Load that the ground carries in windows of 20 ms, and time in which a robot is unsupported."""

import gymnasium as gym
import numpy as np
import pytest

from jansen_env.engine.ground_load import WINDOW
from jansen_env.engine.walk_reward import (
    HALF_LOAD,
    LONGEST_MEAN,
    SHORTEST_MEAN,
    STEPS_PER_TURN,
)
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.tasks.walking import JansenWalkerEnv, JansenWalkerVectorEnv


def walk(speed=3.5, seconds=4.0, **arguments):
    """Return an environment and the ``info`` of each step of a walk.

    Args:
        speed: Speed near which a controller holds the crank, in rad/s.
        seconds: Duration of the walk, in s.
        arguments: Arguments of the environment.
    """
    env = JansenWalkerEnv(**{"robot": "built", "speed_command": 0.3, **arguments})
    env.reset(seed=3)
    infos = []
    for _ in range(round(seconds / env.control_dt)):
        torque = 3.0 * (speed - env.task.world.crank_speed[0]) + 2.0
        *_, info = env.step([torque / 12.0])
        infos.append(info)
    return env, infos


def loads(infos):
    return np.array([info["ground_load"] for info in infos])


def test_the_load_of_a_control_step_of_one_window_is_that_of_its_toes():
    env, infos = walk()
    assert env.control_dt == WINDOW
    carried = [info["contact_force"][:, 1].sum() / env.weight for info in infos]
    assert loads(infos) == pytest.approx(carried, rel=1e-9, abs=1e-12)
    assert loads(infos).max() > 2.0 and loads(infos).min() < 0.5  # it hops


def test_windows_do_not_depend_on_the_control_period():
    """The same torques give the same loads if they are applied for 20 ms or twice for 10 ms.

    A control step of 40 ms contains two windows.
    """
    torques = 0.2 + 0.2 * np.sin(np.arange(100) / 5.0)
    known = {}
    for period, times in ((0.02, 1), (0.01, 2), (0.04, 1)):
        env = JansenWalkerEnv(robot="built", control_dt=period)
        env.reset(seed=1, options={"crank_angle": 0.0})
        known[period] = []
        for torque in torques[:: 2 if period == 0.04 else 1]:
            for _ in range(times):
                *_, info = env.step([torque])
            known[period].append(info["ground_load"])
    assert known[0.01] == pytest.approx(known[0.02], rel=1e-6)
    env = JansenWalkerEnv(robot="built", control_dt=0.02)
    env.reset(seed=1, options={"crank_angle": 0.0})
    single = [env.step([torque])[-1]["ground_load"] for torque in np.repeat(torques[::2], 2)]
    assert known[0.04] == pytest.approx(np.reshape(single, (-1, 2)).max(axis=1), rel=1e-6)


def test_a_robot_in_the_air_is_unsupported():
    env = JansenWalkerEnv(robot="built")
    env.reset(seed=0)
    state = env.task.get_state(0)
    state["record"]["state"][1] += 2.0
    env.task.set_state(0, state)
    *_, info = env.step([0.0])
    assert (info["unsupported"], info["ground_load"]) == (1.0, 0.0)
    standing = JansenWalkerEnv(robot="built").reset(seed=0)[1]
    assert standing["unsupported"] == 0.0 and standing["ground_load"] == pytest.approx(1.0, abs=0.2)


def test_support_and_load_do_not_depend_on_the_time_step():
    """Single walks are chaotic, but the means of 24 robots agree within their scatter."""
    shares = []
    largest = []
    for time_step in (1e-3, 5e-4):
        envs = JansenWalkerVectorEnv(24, robot="built", speed_command=0.2, time_step=time_step)
        observation, _ = envs.reset(seed=0)
        crank_speed = envs.task.columns["crank_speed"]
        infos = []
        for _ in range(200):
            torque = 2.0 * (2.0 - observation[:, crank_speed]) + 1.7
            observation, *_, info = envs.step(torque[:, None] / 12.0)
            infos.append(info)
        shares.append(np.mean([info["unsupported"] for info in infos[50:]]))
        largest.append(np.percentile([info["ground_load"] for info in infos[50:]], 99.0))
    recorded_share = 0.13  # of this code, as the next one
    recorded_load = 3.2  # weights
    assert shares == pytest.approx([recorded_share] * 2, abs=0.025)
    assert largest == pytest.approx([recorded_load] * 2, abs=0.4)


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["projection", "rigid_body"])
@pytest.mark.parametrize("robot", ["built", "paper"])  # compliant feet, rigid feet
def test_the_ground_carries_the_weight_in_the_mean(robot, plant):
    """By conservation of momentum, the mean load is 1.

    It may differ from 1 by the change of the vertical velocity divided by g and the time.
    """
    _, infos = walk(speed=1.0, seconds=2.0, robot=robot, plant=plant)
    assert np.mean(loads(infos)) == pytest.approx(1.0, abs=0.02)


def test_the_factor_of_the_load():
    _, infos = walk(load_weight=1.0)
    for load, info in zip(loads(infos), infos, strict=True):
        assert info["reward/load"] == pytest.approx(1.0 / (1.0 + ((load - 1.0) / HALF_LOAD) ** 2))
    _, free = walk(load_weight=0.0)
    assert {info["reward/load"] for info in free} == {1.0}


@pytest.mark.parametrize(
    ("control_dt", "command"), [(0.02, 0.3), (0.02, -0.3), (0.02, 0.0), (0.01, 0.3)]
)
def test_the_factor_of_the_mean_load_cost(control_dt, command):
    """The squared deviation of the load is averaged like the slip; all other values are the same.

    A control step has at most one window here. A step in which no window ends counts with the load
    of the last window.
    """
    arguments = {"control_dt": control_dt, "speed_command": command}
    env, infos = walk(mean_load_cost=True, **arguments)
    path = abs(advance_per_turn(env.robot)) / STEPS_PER_TURN
    duration = np.clip(path / max(abs(command), 1e-9), SHORTEST_MEAN, LONGEST_MEAN)
    fraction = 1.0 - np.exp(-control_dt / duration)
    _, default = walk(**arguments)
    mean = 0.0
    for k, (info, other) in enumerate(zip(infos, default, strict=True)):
        ended = control_dt == WINDOW or k > 0  # before the first window ends, the deviation is 0
        deviation = info["ground_load"] - 1.0 if ended else 0.0
        mean += fraction * (deviation**2 - mean)
        assert info["reward/load"] == pytest.approx(1.0 / (1.0 + mean / HALF_LOAD**2))
        for name in set(info) - {"reward/load"}:
            assert np.all(info[name] == other[name]), name


@pytest.mark.parametrize("env_id", ["JansenWalkerBuilt-v0", "JansenCrank-v0", "JansenGoal-v0"])
def test_every_step_says_whether_the_episode_is_a_success_so_far(env_id):
    env = gym.make(env_id)
    env.reset(seed=0)
    for _ in range(5):
        *_, info = env.step(env.action_space.sample())
        assert info["is_success"] in (True, False)
