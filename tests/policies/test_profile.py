"""The crank-speed profile: interpolation, symmetry, how it walks."""

import numpy as np
import pytest

from jansen_env.cli.named_policies import load_named
from jansen_env.policies.policy import TorquePolicy, columns
from jansen_env.scoring.metrics import point_estimates
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking.profile import READ, load_profile, profile_torque
from jansen_env.tasks.walking.walker_benchmark import WALKER

ENV = "JansenWalker-v0"
WALKER_ENV = make_env(ENV, {})
SEEN = WALKER_ENV.observation_space.shape[0]
COLUMNS = columns(WALKER_ENV, *READ)
COS_CRANK, SIN_CRANK, CRANK_SPEED, COMMAND, LAG = COLUMNS


def seen(commands, rng=None):
    rng = rng or np.random.default_rng(0)
    observation = rng.normal(size=(len(commands), SEEN))
    angle = rng.uniform(0.0, 2.0 * np.pi, len(commands))
    observation[:, COS_CRANK] = np.cos(angle)
    observation[:, SIN_CRANK] = np.sin(angle)
    observation[:, COMMAND] = commands
    observation[:, LAG] = rng.uniform(-0.5, 0.5, len(commands))
    return observation


def test_interpolation():
    """It hits the grid, is linear in between, and continuous from standing to beyond the grid."""
    shipped = load_profile()
    assert np.allclose(shipped.at(shipped.commands), shipped.numbers)
    assert np.allclose(shipped.at(-shipped.commands), shipped.numbers)
    middle = (shipped.commands[1:] + shipped.commands[:-1]) / 2.0
    assert np.allclose(shipped.at(middle), (shipped.numbers[1:] + shipped.numbers[:-1]) / 2.0)
    commands = np.linspace(-1.2, 1.2, 4801)
    observation = np.repeat(seen([0.3]), len(commands), axis=0)
    observation[:, COMMAND] = commands
    observation[:, LAG] *= np.where(commands < 0.0, -1.0, 1.0)
    torque = shipped.torque(observation, COLUMNS)
    forwards = torque[commands >= 0.0]
    assert np.abs(np.diff(forwards)).max() < 0.3  # N m, for 0.0005 m/s
    fast = shipped.at(np.array([1.6]))[0]
    assert fast[0] == pytest.approx(2.0 * shipped.numbers[-1, 0])
    assert np.allclose(fast[1:], shipped.numbers[-1, 1:])


def test_a_standing_robot_gets_no_torque():
    observation = seen(np.zeros(50))
    torque = load_profile().torque(observation, COLUMNS)
    assert np.all(torque * observation[:, CRANK_SPEED] < 0.0)
    observation[:, CRANK_SPEED] = 0.0
    assert np.all(load_profile().torque(observation, COLUMNS) == 0.0)


def test_the_mirror_image_gets_the_mirrored_torque():
    observation = seen(np.linspace(0.01, 0.9, 60))
    mirrored = observation.copy()
    mirrored[:, [COS_CRANK, CRANK_SPEED, COMMAND, LAG]] *= -1.0
    torque, other = (load_profile().torque(each, COLUMNS) for each in (observation, mirrored))
    assert other == pytest.approx(-torque, abs=1e-12)


def test_torque_is_the_documented_formula():
    numbers = np.array([1.2, 5.0, 2.0, 0.8, 0.3, -0.2, 0.1, 0.4])
    angle = 0.7
    speed = 0.9
    lag = 0.12
    observation = np.zeros((1, SEEN))
    observation[0, [COS_CRANK, SIN_CRANK, CRANK_SPEED]] = np.cos(angle), np.sin(angle), speed
    observation[0, [COMMAND, LAG]] = 0.3, lag
    shape = 0.3 * np.cos(1.4) - 0.2 * np.cos(2.8) + 0.1 * np.sin(1.4) + 0.4 * np.sin(2.8)
    expected = 5.0 * (1.2 * np.exp(shape + 0.8 * lag) - speed) + 2.0
    assert profile_torque(numbers[None], observation, COLUMNS) == pytest.approx(expected)


def test_it_walks_with_less_slip_than_the_pid():
    """At 0.1 and 0.3 m/s it does not fall and has a higher return than the PID; at 0.1 m/s it slips
    less than half as much.
    """
    env = make_env(ENV, {})
    commands = np.repeat([0.1, 0.3], 6)
    seeds = 91_000 + np.arange(12)
    scores = {}
    for name in ("pid", "profile"):
        run = run_episodes(load_named(name, env), ENV, {}, commands, seeds)
        for command in (0.1, 0.3):
            episodes = {key: values[commands == command] for key, values in run.items()}
            scores[name, command] = point_estimates(WALKER.metrics, episodes, env)
    for command in (0.1, 0.3):
        pid, profile = scores["pid", command], scores["profile", command]
        assert profile["falls"] == 0.0
        assert profile["return"] > pid["return"]
    assert scores["profile", 0.1]["slip_per_metre"] < 0.5 * scores["pid", 0.1]["slip_per_metre"]


def test_means_of_an_episode_end_with_its_fall():
    """The full torque throws some robots over: its mean square is its square, however soon they
    fall.
    """
    full = TorquePolicy(lambda seen, *_: (np.full(len(seen), 20.0), None), 20.0)
    run = run_episodes(full, ENV, {}, np.full(3, 0.3), np.arange(3))
    assert run["fell"].any() and not run["fell"].all()
    assert run["rms_torque"] == pytest.approx(np.full(3, 20.0))
    assert run["torque_change"] == pytest.approx(np.full(3, 20.0))  # once, from 0
