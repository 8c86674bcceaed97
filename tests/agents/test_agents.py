"""Walking baselines, scoring, and Stable-Baselines3's interface to them."""

import json
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from scipy.stats import kstest

from agents import tune
from jansen_env import ROBOTS
from jansen_env.cli import evaluate
from jansen_env.policies.pid import PID
from jansen_env.policies.policy import TorquePolicy
from jansen_env.scoring import metrics
from jansen_env.scoring.rollout import draw_episodes, make_env, run_episodes
from jansen_env.tasks.walking.tuned import DATA, measured, nearest_setting, setting_of
from jansen_env.tasks.walking.walker_benchmark import BASELINES, WALKER, walking_pid

OBSERVED = make_env("JansenWalker-v0", {}).unwrapped.observed
ONE_TO_ONE = nearest_setting(np.array([0.5, 1.0, 2.0]), np.array([[0.5], [1.0], [2.0]]))


def motor(torque_limit):
    """What the baselines read of an environment."""
    env = SimpleNamespace(
        torque_limit=torque_limit, control_dt=0.02, observed=OBSERVED, robot=ROBOTS["paper"]()
    )
    env.unwrapped = env
    return env


def observation(angle, speed, command):
    known = {
        "cos_crank_angle": np.cos(angle),
        "sin_crank_angle": np.sin(angle),
        "crank_speed": speed,
        "speed_command": command,
    }
    return np.array([known.get(entry.name, np.nan) for entry in OBSERVED])


def test_pid_is_equation_13():
    """The torque is that of the written-out formula, also when the crank passes pi twice.

    NaN in observations that the controller does not read changes nothing.
    """
    dt = 0.02
    gains = PID()
    controller = walking_pid(ONE_TO_ONE, motor(1e3))
    state = None
    integral = 0.0
    for k in range(500):
        t = k * dt
        angle = np.pi + 1.3 * t - 0.2 * t**2 / 10
        speed = 1.3 - 0.04 * t
        seen = observation(angle, speed, 1.0)[None]
        action, state = controller.predict(seen, state, np.array([k == 0]))
        error = (np.pi + t) - angle
        integral += error * dt
        expected = gains.kp * error + gains.ki * integral + gains.kd * (1.0 - speed)
        assert action[0, 0] * 1e3 == pytest.approx(expected, abs=1e-3)


def test_pid_starts_again_with_an_episode():
    controller = walking_pid(ONE_TO_ONE, motor(20.0))
    state = None
    seen = np.array([observation(0.1, 0.0, 1.0)] * 2)
    for _ in range(10):
        _, state = controller.predict(seen, state)
    fresh, _ = controller.predict(seen, None)
    action, _ = controller.predict(seen, state, np.array([True, False]))
    assert action[0] == fresh[0] and action[1] != fresh[1]


def test_speed_map_picks_the_nearest_and_mirrors():
    """The map returns the closest measured setting.

    Negative commands turn the crank back, and zero stands still. A setting that hits the command
    half the time loses to a steady one that is a little off.
    """
    assert ONE_TO_ONE(np.array([0.9, 1.6, -0.9, 0.0])) == pytest.approx([1, 2, -1, 0])
    measured = nearest_setting(np.array([1.0, 2.0]), np.array([[0.3, 0.0], [0.25, 0.26]]))
    assert measured(np.array([0.3])) == pytest.approx([2.0])


def test_the_measured_maps_are_what_tune_measures():
    shipped = json.loads(DATA.read_text())["paper"]
    for name, i in (("pid", 20), ("constant", 12)):
        setting = np.array(shipped[name]["settings"][i : i + 1])
        again = tune.measure(name, setting, 6)
        assert again["speeds"] == shipped[name]["speeds"][i : i + 1]


@pytest.mark.parametrize(
    ("env_id", "kwargs", "design"),
    [
        ("JansenWalker-v0", {}, "paper"),
        ("JansenWalker-v0", {"robot": "holy"}, "holy"),
        ("JansenWalker-v0", {"payload": 1.0, "motor": "mx_106"}, "paper"),
        ("JansenWalkerBuilt-v0", {"payload": 1.0, "motor": "mx_106"}, "built"),
        ("JansenWalkerHardcore-v0", {}, "built"),
    ],
)
def test_baselines_are_those_found_for_the_robot(env_id, kwargs, design):
    """Baselines are looked up by the links of a robot, whatever its motor and its load."""
    env = gym.make(env_id, **kwargs).unwrapped
    shipped = json.loads(DATA.read_text())
    assert measured("pid", env.robot) == shipped[design]["pid"]
    setting = setting_of("constant", env.robot)(np.array([0.3]))
    assert setting in shipped[design]["constant"]["settings"]


@pytest.mark.slow
def test_tuning_finds_gains_and_keeps_other_designs(tmp_path, monkeypatch):
    """Tuning returns the gains with the highest return of those tried, measured on the robot."""
    soft, stiff = (2.0, 0.5, 0.5), (100.0, 10.0, 10.0)
    monkeypatch.setattr(tune, "GAINS", (stiff, soft))
    monkeypatch.setattr(tune, "CRANK_SPEEDS", np.array([1.0, 2.5, 4.0]))
    (tmp_path / DATA.name).write_text('{"paper": {"pid": 1}}')
    tune.main(["pid", "--robot", "built", "--episodes", "2", "--out", str(tmp_path)])
    written = json.loads((tmp_path / DATA.name).read_text())
    assert written["paper"] == {"pid": 1}
    assert written["built"]["pid"]["gains"] == list(soft)
    assert written["built"]["pid"]["settings"] == [1.0, 2.5, 4.0]
    with pytest.raises(SystemExit):
        tune.main(["pid", "--robot", "bulit", "--out", str(tmp_path)])


def test_what_is_kept_of_an_episode():
    """An episode keeps the position after two seconds, slip and work from then on, and how much the
    torque changes, the first time from 0.
    """
    torques = [2.0, 2.0, -1.0, 3.0] + [2.5, 3.0] * 58
    left = iter(torques)
    policy = TorquePolicy(lambda seen, *_: (np.full(len(seen), next(left)), None), 20.0)
    kwargs = {"max_episode_steps": 120}
    env = gym.make("JansenWalker-v0", **kwargs)
    run = run_episodes(policy, "JansenWalker-v0", kwargs, np.array([0.2]), np.array([5]))
    robot = env.unwrapped
    robot.reset(seed=5, options={"speed_command": 0.2})
    infos = [robot.step(np.float32([torque / 20.0]))[4] for torque in torques]
    positions = [info["x_position"] for info in infos]
    assert run["early_distance"] == positions[99] and run["distance"] == positions[-1]
    changes = np.abs(np.diff([0.0, *torques]))
    scored = metrics.point_estimates(WALKER.metrics, run, env)
    assert scored["torque_change"] == pytest.approx(changes.mean(), rel=1e-6)
    error = abs((positions[-1] - positions[99]) / 0.4 - 0.2)
    assert scored["steady_speed_error"] == pytest.approx(error)
    way = positions[-1] - positions[99]
    slip = [info["slip"].sum() for info in infos]
    work = sum(abs(info["energy"]["motor_work"]) for info in infos[100:])
    assert scored["steady_slip_per_metre"] == pytest.approx(sum(slip[100:]) / way)
    assert scored["steady_cost_of_transport"] == pytest.approx(work / robot.weight / way)
    start_work = sum(abs(info["energy"]["motor_work"]) for info in infos[:100])
    assert scored["start_work"] == pytest.approx(start_work / robot.weight)
    assert scored["start_slip"] == pytest.approx(sum(slip[:100]))
    assert scored["start_lag"] == pytest.approx(0.4 - positions[99])


def made_episodes(n=40):
    run = dict.fromkeys(WALKER.aggregates, np.zeros(n))
    run["command"] = np.repeat([0.1, 0.2], n // 2)
    run["returns"] = np.arange(n, dtype=float)
    run["distance"] = np.where(run["command"] == 0.1, 1.0, 2.0)
    run["slip"] = np.full(n, 0.3)
    run["work"] = np.full(n, 30.0)
    run["duration"] = np.full(n, 10.0)
    return run


TEN_SECONDS = SimpleNamespace(
    get_wrapper_attr={
        "spec": SimpleNamespace(max_episode_steps=500),
        "control_dt": 0.02,
        "task": SimpleNamespace(world=SimpleNamespace(weight=[20.0])),
    }.__getitem__
)
"""What the walking metrics read of an environment."""


def test_scores_are_means_and_ratios_of_sums():
    summary = metrics.summarise(WALKER.metrics, made_episodes(), TEN_SECONDS)
    overall = summary["overall"]
    assert overall["return"][0] == pytest.approx(19.5)
    assert overall["slip_per_metre"][0] == pytest.approx(0.3 / 1.5)
    assert overall["cost_of_transport"][0] == pytest.approx(1.5 / 1.5)
    assert overall["speed_error"][0] == pytest.approx(0.0, abs=1e-12)
    assert overall["steady_speed_error"][0] == pytest.approx((0.025 + 0.05) / 2)  # from 0 in 8 s
    low, high = overall["return"][1:]
    # two groups of 20 consecutive numbers: standard error of the mean 5.77 / sqrt(40) = 0.91
    assert high - low == pytest.approx(2 * 1.96 * 0.91, rel=0.15)
    assert low < 19.5 < high
    plain = metrics.point_estimates(WALKER.metrics, made_episodes(), TEN_SECONDS)
    assert plain == {name: interval[0] for name, interval in overall.items()}
    assert summary["by_command"]["slip_per_metre"]["value"] == pytest.approx([0.3, 0.15])


def test_fractions_have_exact_intervals():
    """Intervals are over the episodes of all commands, and at each command.

    No fall in the sample does not mean that none ever happens.
    """
    run = made_episodes()
    run["fell"] = np.arange(40) == 39
    summary = metrics.summarise(WALKER.metrics, run, TEN_SECONDS)
    assert summary["overall"]["falls"] == [*metrics.proportion_with_interval(1, 40)]
    falls = summary["by_command"]["falls"]
    assert falls["value"] == [0.0, 0.05] and falls["low"][0] == 0.0
    assert falls["high"][0] == pytest.approx(1.0 - 0.025 ** (1 / 20))
    pooled = metrics.pooled(WALKER.metrics, run, TEN_SECONDS)
    assert pooled["overall"]["falls"] == summary["overall"]["falls"]


def test_bootstrap_resamples_within_each_command():
    def returned(run, seed=0):
        return metrics.summarise(WALKER.metrics, run, TEN_SECONDS, seed)["overall"]["return"]

    run = made_episodes()
    run["returns"] = np.where(run["command"] == 0.1, 0.0, 100.0)
    assert returned(run) == [50.0] * 3
    run["returns"] = np.random.default_rng(0).normal(size=40)
    assert returned(run, 1) == returned(run, 1) != returned(run, 2)
    few = {name: values[::20] for name, values in run.items()}
    assert returned(few)[1:] == [None] * 2


def test_an_evaluation_prints_five_metrics_or_all_and_writes_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    arguments = ["--policy=pid", "--episodes", "2", "--env-kwargs", "{max_episode_steps: 120}"]
    for all_of_them in (False, True):
        evaluate.main([*arguments, "--commands", "0.3", "0.4", *["--all"] * all_of_them])
        printed = capsys.readouterr().out
        assert ("change of torque" in printed) == ("95 % intervals" in printed) == all_of_them
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_baselines_walk_the_right_way_on_every_robot():
    """The holy designs turn their crank clockwise to walk forward; the baselines know nothing of
    it.
    """
    commands, seeds = np.array([0.3, 0.5, -0.4]), np.array([1, 2, 3])
    env = gym.make("JansenWalker-v0", robot="holy")
    for name, baseline in BASELINES.items():
        policy = baseline(env.unwrapped)
        run = run_episodes(policy, "JansenWalker-v0", {"robot": "holy"}, commands, seeds)
        assert (np.sign(commands) * run["distance"] > 1.5).all(), name


def test_commands_are_drawn_from_the_range_of_the_environment():
    """The same seed gives the same commands, which are distributed uniformly."""
    env = make_env("JansenWalkerBuilt-v0", {})
    (commands, _), (again, _), (other, _) = (draw_episodes(env, 60, seed) for seed in (0, 0, 1))
    assert np.array_equal(commands, again) and not np.array_equal(commands, other)
    assert kstest(commands, "uniform", args=(0.05, 0.75)).pvalue > 0.01
