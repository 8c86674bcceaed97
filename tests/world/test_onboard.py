"""What a machine's own computer observes, and how fast its torque may change."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.engine.walk_reward import FURTHEST_TARGET, mean_time

ID = "JansenWalkerBuilt-v0"
NOISE = {"encoder": (0.001, 0.01), "gyro": (0.01, 0.005)}
ONBOARD = {"robot": "economy", "observe": "onboard", "torque_rate": 30.0}


def walk(env, steps, seed=3):
    """Observations by name, and information, of some steps with a crank at about 3 rad/s."""
    names = [entry.name for entry in env.unwrapped.observed]
    column = env.unwrapped.task.columns
    seen, _ = env.reset(seed=seed)
    rows = []
    for _ in range(steps):
        torque = 3.0 * (3.0 - seen[column["crank_speed"]]) + 1.0
        seen, _, ended, _, info = env.step([torque / 12.0])
        assert not ended
        rows.append((dict(zip(names, seen.tolist(), strict=True)), info))
    return rows


def test_nothing_is_observed_that_no_sensor_gives():
    """There are no toe loads, slip or height.

    Without noise, rates are exact and the velocity agrees within 10 %.
    """
    env = gym.make(ID, **ONBOARD)
    assert {*env.unwrapped.task.columns} == {
        "cos_crank_angle",
        "sin_crank_angle",
        "crank_speed",
        "sin_pitch",
        "cos_pitch",
        "pitch_rate",
        "crank_axis_x_velocity",
        "acceleration_x",
        "acceleration_y",
        "crank_torque",
        "speed_command",
        "last_action",
        "lag",
        "mean_speed",
    }
    rows = walk(env, 150)
    before = None
    for seen, info in rows:
        state = np.array([info["crank_angle"], info["pitch"]])
        if before is not None:
            rates = (state - before) / env.unwrapped.control_dt
            assert [seen["crank_speed"], seen["pitch_rate"]] == pytest.approx(rates, abs=1e-4)
        assert abs(np.arctan2(seen["sin_pitch"], seen["cos_pitch"]) - info["pitch"]) < 0.05
        assert seen["crank_torque"] == pytest.approx(info["crank_torque"])
        before = state
    estimated = np.mean([seen["crank_axis_x_velocity"] for seen, _ in rows[50:]])
    assert estimated == pytest.approx(np.mean([i["x_velocity"] for _, i in rows[50:]]), rel=0.1)
    x, y = np.mean([[seen["acceleration_x"], seen["acceleration_y"]] for seen, _ in rows], axis=0)
    assert abs(x) < 0.5 and y == pytest.approx(GRAVITY, abs=0.1)


@pytest.mark.parametrize("tilt", [0.0, 0.1])
def test_gravity_gives_the_pitch_at_rest(tilt):
    """It does on a slope, too, which a machine feels as pitch; errors come from gyro and
    accelerometer.
    """
    env = gym.make(ID, **ONBOARD, randomize={"tilt": (tilt, tilt)} if tilt else None)
    seen, info = env.reset(seed=1)
    pitch = tilt + info["pitch"]
    column = env.unwrapped.task.columns
    assert seen[column["sin_pitch"]] == pytest.approx(np.sin(pitch), abs=1e-6)
    assert seen[column["cos_pitch"]] == pytest.approx(np.cos(pitch), abs=1e-6)
    acceleration = seen[column["acceleration_x"]], seen[column["acceleration_y"]]
    assert np.hypot(*acceleration) == pytest.approx(GRAVITY, rel=1e-6)
    noisy = gym.make(ID, **ONBOARD, noise=NOISE)
    start, told = noisy.reset(seed=1)
    error = (start - told["true_observation"])[column["sin_pitch"]]
    assert 0.0 < abs(error) < 0.15


def test_a_state_of_other_filters_is_refused():
    env = gym.make(ID, **ONBOARD, noise=NOISE, delay=(0.0, 0.02)).unwrapped
    check_env(env, skip_render_check=True)
    walk(env, 20)
    state = env.get_state()
    with pytest.raises(ValueError, match="'onboard'"):
        env.set_state({**state, "record": {**state["record"], "onboard": {"estimates": [1.0]}}})


def test_the_torque_changes_no_faster_than_its_rate():
    env = gym.make(ID, **ONBOARD)
    env.reset(seed=0)
    last = 0.0
    most = 30.0 * 0.02 / 12.0
    for asked in [1.0] * 25 + [-5.0] * 45 + [-0.98]:
        action = env.step([asked])[0][env.unwrapped.task.columns["last_action"]]
        change = most * np.clip(np.clip(asked, -1, 1) - last, -1, 1)
        assert action - last == pytest.approx(change, abs=1e-6)
        last = action
    many = gym.make_vec(ID, 2, torque_rate=1.0)
    many.reset()
    with pytest.raises(ValueError, match="must be finite"):
        many.step(np.array([[0.0], [np.inf]]))
    for wrong in ({"torque_rate": 0.0}, {"observe": "some"}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            gym.make(ID, **wrong)


def test_lag_and_mean_speed_are_the_rewards_of_the_observed_velocity():
    """One formula for the means, whether the velocity is exact or estimated."""
    env = gym.make(ID, **ONBOARD)
    rows = walk(env, 100)
    period = env.unwrapped.control_dt
    path = env.unwrapped.task.data["mean_path"][0]
    lag = mean = 0.0
    for seen, _ in rows:
        command = seen["speed_command"]
        velocity = seen["crank_axis_x_velocity"]
        lag = np.clip(lag + (command - velocity) * period, -FURTHEST_TARGET, FURTHEST_TARGET)
        mean -= np.expm1(-period / mean_time(command, path)) * (velocity - mean)
        assert seen["lag"] == pytest.approx(lag, abs=1e-6)
        assert seen["mean_speed"] == pytest.approx(mean, abs=1e-6)
