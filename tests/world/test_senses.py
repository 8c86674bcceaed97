"""What a walker senses and what disturbs it: height scan, noise, pushes; alone and side by side."""

from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from side_by_side import DISTURBED, ROUGH, WORLD

from jansen_env import Noise, paper_robot
from jansen_env.engine import walk_reward
from jansen_env.engine.sensors import add_errors, sample_errors
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.tasks.walking import JansenWalkerEnv
from jansen_env.world.observations import SENSORS, sensor_errors

SCAN = DISTURBED["height_scan"]
ALL = {**WORLD, **DISTURBED}
OBSERVED = JansenWalkerEnv(height_scan=(0.0, 0.5, 3)).observed
NAMES = [entry.name for entry in OBSERVED]
EXACT = ("speed_command", "last_action", "lag", "mean_", "rms_torque")  # while the robot stands
ACCOUNTS = walk_reward.ACCOUNTS.names
LAG = NAMES.index("lag")


def walker(**arguments):
    return gym.make("JansenWalker-v0", **arguments).unwrapped


def walk(env, steps, seed, first=None):
    """Observations, and information of each step; actions are drawn from the seed."""
    rng = np.random.default_rng(seed)
    seen = [] if first is None else [first]
    infos = []
    for _ in range(steps):
        observation, _, _, _, info = env.step(rng.uniform(-0.5, 0.5, 1).astype(np.float32))
        seen.append(observation)
        infos.append(info)
    return np.array(seen), infos


def erring(noise, count, level=1.0, truth=None, elapsed=0):
    """What (count, d) robots with seeds of their own observe of the same."""
    out = np.full((count, len(OBSERVED)), 0.6, np.float32) if truth is None else truth.copy()
    deviation, speeds, angles, low, high, *_ = sensor_errors(noise, OBSERVED, count)
    bias, error = np.zeros((2, len(OBSERVED)))
    parameters = SimpleNamespace(noise_level=level)
    with np.errstate(over="ignore"):  # the stages run as plain Python here
        for i in range(count):
            robot = SimpleNamespace(seed=10 * i, elapsed=elapsed, parameters=parameters)
            sample_errors(robot, deviation, speeds, True, bias, error)
            add_errors(error, angles, low, high, out[i])
    return out


def mean_speeds(observations, command, dt):
    """Mean speeds (k,) of axis, m/s, and crank, rad/s, that lag and means tell; NaN for nothing."""
    kept = dict(zip(ACCOUNTS, observations[:, LAG : LAG + 5].T.astype(float), strict=True))
    velocity = command - np.diff(kept["lag"]) / dt
    velocity[np.abs(kept["lag"][1:]) > 0.499] = np.nan
    path = abs(advance_per_turn(paper_robot())) / 4.0
    share = -np.expm1(-dt / walk_reward.mean_time(command, path))
    power = kept["mean_power"][:-1] + np.diff(kept["mean_power"]) / share
    square = kept["rms_torque"] ** 2
    square = square[:-1] + np.diff(square) / share
    torque = np.sqrt(np.where(square > 4.0, square, np.nan))
    return velocity, power / torque


def test_the_scan_is_the_height_over_the_ground_below_each_place():
    env, plain = walker(terrain=ROUGH, height_scan=SCAN), walker(terrain=ROUGH)
    seen, _ = walk(env, 30, 1, env.reset(seed=4)[0])
    without, _ = walk(plain, 30, 1, plain.reset(seed=4)[0])
    np.testing.assert_array_equal(seen[:, :-5], without)  # the rest stays as it is
    assert [entry.name for entry in env.observed[-5:]] == [f"height_scan_{i}" for i in range(5)]
    x, y = env.get_state()["record"]["state"][:2]
    expected = y - ROUGH.height(x + np.linspace(-0.4, 0.8, 5))
    np.testing.assert_array_equal(seen[-1, -5:], expected.astype(np.float32))
    assert np.ptp(seen[-1, -5:]) > 0.005  # it is no flat ground


@pytest.mark.slow
def test_every_sensor_has_its_noise():
    """By default, the noise of each column is that of its sensor."""
    noise = Noise()
    count = 4000
    error = erring(noise, count) - np.float32(0.6)
    expected = np.hypot(*noise.deviations(OBSERVED).T)
    for i, name in enumerate(NAMES):
        if name.startswith(EXACT):
            assert not error[:, i].any()
        elif name.startswith(("cos", "sin")):
            assert error[:, i].all()  # see the test of angles
        else:
            assert np.std(error[:, i]) == pytest.approx(expected[i], rel=4.0 / np.sqrt(2 * count))
            limit = 4.0 * expected[i] / np.sqrt(count)
            assert np.mean(error[:, i]) == pytest.approx(0.0, abs=limit)
    free = [i for i in range(len(NAMES)) if error[:, i].any() and not NAMES[i].startswith("cos")]
    correlations = np.corrcoef(error[:, free].T) - np.eye(len(free))
    assert np.abs(correlations).max() < 5.0 / np.sqrt(count)


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_sensor_alone_errs_in_its_own_observations(sensor):
    touched = (erring(Noise.only(**{sensor: 0.05}), 3) != np.float32(0.6)).all(axis=0)
    wanted = {
        "encoder": {"cos_crank_angle", "sin_crank_angle"},
        "crank_speed": {"crank_speed"},
        "pitch": {"sin_pitch", "cos_pitch"},
        "gyro": {"pitch_rate"},
        "velocity": {"crank_axis_x_velocity", "crank_axis_y_velocity"},
        "height": {"crank_axis_height"},
        "loads": {name for name in NAMES if name.startswith("toe_load_")},
        "height_scan": {name for name in NAMES if name.startswith("height_scan")},
        "accelerometer": set(),  # onboard alone
        "torque": set(),  # onboard alone
    }
    assert {name for name, errs in zip(NAMES, touched, strict=True) if errs} == wanted[sensor]
    assert {*wanted} == {*SENSORS}


@pytest.mark.slow
def test_bias_stays_for_an_episode_and_noise_does_not():
    noise = Noise.only(gyro=(0.03, 0.5), height=(0.0, 0.2))
    gyro, height = NAMES.index("pitch_rate"), NAMES.index("crank_axis_height")
    steps = np.array([erring(noise, 500, elapsed=step) for step in range(40)])
    assert (steps[:, :, height] == steps[:1, :, height]).all()
    assert np.std(steps[0, :, height]) == pytest.approx(0.2, rel=0.15)
    assert np.std(steps[:, :, gyro], axis=0).mean() == pytest.approx(0.03, rel=0.05)
    assert np.std(steps[:, :, gyro].mean(axis=0)) == pytest.approx(0.5, rel=0.15)
    alone = (steps - steps.mean(axis=0))[:, :, gyro]
    assert abs(np.corrcoef(alone[1:].ravel(), alone[:-1].ravel())[0, 1]) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "cos", "sin"), [("encoder", 0, 1), ("pitch", 4, 3)], ids=["encoder", "pitch"]
)
def test_an_angle_errs_in_sine_and_cosine_alike(sensor, cos, sin):
    count = 3000
    angles = np.linspace(-3.0, 3.0, 3000)
    truth = np.zeros((count, len(OBSERVED)), np.float32)
    truth[:, cos] = np.cos(angles)
    truth[:, sin] = np.sin(angles)
    seen = erring(Noise.only(**{sensor: (0.03, 0.04)}), count, truth=truth).astype(float)
    np.testing.assert_allclose(np.hypot(seen[:, cos], seen[:, sin]), 1.0, atol=3e-7)
    error = np.angle(np.exp(1j * (np.arctan2(seen[:, sin], seen[:, cos]) - angles)))
    assert np.std(error) == pytest.approx(0.05, rel=0.06)
    assert np.mean(error) == pytest.approx(0.0, abs=4.0 * 0.05 / np.sqrt(count))


def test_noise_scales_with_its_level_and_stays_within_the_space():
    noise = Noise.only(loads=0.1, velocity=0.1)
    truth = np.zeros((200, len(OBSERVED)), np.float32)
    single, double = (erring(noise, 200, level, truth).astype(float) for level in (1.0, 2.0))
    np.testing.assert_allclose(double, 2.0 * single, atol=1e-6)
    assert not erring(noise, 200, 0.0, truth).any()
    loads = single[:, [place for place, name in enumerate(NAMES) if name.startswith("toe_load_")]]
    assert loads.min() == 0.0 and (loads > 0.0).mean() == pytest.approx(0.5, abs=0.1)
    truth[:, NAMES.index("cos_crank_angle")] = 1.0
    turned = erring(Noise.only(encoder=1e-4), 200, truth=truth)
    assert np.abs(turned[:, :2]).max() <= 1.0


def test_the_truth_is_told_and_the_physics_does_not_notice():
    env, exact = walker(noise=Noise(), height_scan=SCAN), walker(height_scan=SCAN)
    observation, info = env.reset(seed=3)
    true, _ = exact.reset(seed=3)
    np.testing.assert_array_equal(info["true_observation"], true)
    assert (observation != true).any() and env.observation_space.contains(observation)
    seen, infos = walk(env, 30, 5)
    expected, others = walk(exact, 30, 5)
    np.testing.assert_array_equal([noisy["true_observation"] for noisy in infos], expected)
    assert (seen != expected).any(axis=1).all() and "true_observation" not in others[0]
    for noisy, plain in zip(infos, others, strict=True):  # rewards, lag and means among it
        assert all(np.array_equal(noisy[name], value) for name, value in plain.items())
    check_env(env, skip_render_check=True)


def test_lag_and_means_tell_no_more_than_the_sensors():
    """Their changes give the speeds: exactly without noise, and with it no better than measured."""
    deviations = (0.06, 0.3)
    command = 0.3
    errors = []
    read = [NAMES.index(name) for name in ("crank_axis_x_velocity", "crank_speed")]
    env = walker(noise=Noise(velocity=deviations[0], crank_speed=deviations[1]))
    for seed in range(30):
        env.reset(seed=seed, options={"speed_command": command})
        infos = []
        seen = []
        for _ in range(60):
            observation, _, _, _, info = env.step(np.full(1, 0.35, np.float32))
            infos.append(info)
            seen.append(observation)
        seen, true = np.array(seen), np.array([info["true_observation"] for info in infos])
        work = np.array([info["energy"]["motor_work"] for info in infos])
        turned = work / env.control_dt / [info["crank_torque"] for info in infos]
        turned[turned < 1.5] = np.nan  # of the power's size alone nobody knows which way it turns
        exact = np.array([[info["x_velocity"] for info in infos], turned])[:, 1:]
        told, undone = (mean_speeds(each, command, env.control_dt) for each in (seen, true))
        errors.append([told - exact, undone - exact, (seen - true)[1:, read].T])
    found = np.concatenate(errors, axis=-1)
    for error, without, reading, deviation in zip(*found, deviations, strict=True):
        assert np.isfinite(error).sum() > 500
        assert np.nanmax(np.abs(without)) < 1e-4 < 0.95 * deviation < np.nanstd(error)
        assert np.nanstd(error - reading) > 0.95 * deviation  # or their difference would be exact
        for weight in np.linspace(0.0, 1.0, 11):  # nor is any mean of both better
            assert np.nanstd(weight * error + (1.0 - weight) * reading) > 0.95 * deviation


def test_at_level_0_lag_and_means_are_true_but_slip_is_not_sensed():
    env = walker(noise=Noise(), randomize={"noise_level": (0.0, 0.0)})
    env.reset(seed=0)
    seen, infos = walk(env, 60, 2)
    true = np.array([info["true_observation"] for info in infos])
    slip = NAMES.index("mean_slip")
    assert true[:, slip].max() > 0.005 and not seen[:, slip].any()
    np.testing.assert_array_equal(np.delete(seen, slip, 1), np.delete(true, slip, 1))


def test_describing_a_step_again_changes_nothing():
    """Its noise and the measured means stay; the next steps continue alike."""
    env, other = walker(noise=Noise()), walker(noise=Noise())
    env.reset(seed=3), other.reset(seed=3)
    walk(env, 20, 1), walk(other, 20, 1)
    before = env.task.observation[0].copy()
    for _ in range(3):
        env.set_parameters(command=0.2)
    other.set_parameters(command=0.2)
    before[NAMES.index("speed_command")] = 0.2
    np.testing.assert_array_equal(env.task.observation[0], before)
    np.testing.assert_array_equal(walk(env, 20, 2)[0], walk(other, 20, 2)[0])


def test_a_reset_forgets_what_was_measured():
    env = walker(noise=Noise())
    env.reset(seed=0)
    assert walk(env, 20, 1)[0][-1, LAG : LAG + 5].any()
    assert not env.reset()[0][LAG : LAG + 5].any()


def test_pushes_at_random_come_from_the_argument_and_only_from_it():
    push = {"impulse": 2.0, "duration": 0.05, "interval": 0.1}
    for arguments, options, pushed in (
        ({"push": push}, None, True),
        ({"push": push}, {"pushes": []}, False),
        ({}, None, False),
    ):
        env = walker(**arguments)
        env.reset(seed=0, options=options)
        _, infos = walk(env, 10, 0)
        assert any(info["energy"]["push_work"] for info in infos) == pushed
    env.reset(options={"pushes": [(0.0, 1.0, 0.0)]})
    env.reset()  # the option is of one episode
    _, infos = walk(env, 10, 0)
    assert not any(info["energy"]["push_work"] for info in infos)
