"""Baselines of JansenCrank-v0, what it is scored by, and that learning beats the paper's PID."""

import json

import gymnasium as gym
import numpy as np
import pytest

import train
from jansen_env.dynamics.inverse import crank_torque
from jansen_env.policies.pid import PID
from jansen_env.policies.policy import still
from jansen_env.scoring.rollout import run_episodes
from jansen_env.tasks.crank.crank_benchmark import BASELINES, CRANK, inverse_dynamics

ENV = "JansenCrank-v0"
PAPER_START = {"crank_angle": np.pi, "crank_speed": 0.0, "speed_command": 1.0}


@pytest.fixture(scope="module")
def env():
    return gym.make(ENV)


def follow(env, policy, seconds=10.0, **options):
    """Tracking errors (n,) rad, torques (n,) N m, and energies of a run from the paper's start."""
    seen, _ = env.reset(seed=0, options={**PAPER_START, **options})
    state = None
    infos = []
    for k in range(round(seconds / env.unwrapped.control_dt)):
        action, state = policy.predict(seen[None], state, np.array([k == 0]), True)
        seen, *_, info = env.step(action[0])
        infos.append(info)
    error, torque = (np.array([i[k] for i in infos]) for k in ("tracking_error", "crank_torque"))
    return error, torque, [i["energy"] for i in infos]


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def test_the_papers_pid_does_what_the_paper_does(env):
    error, torque, _ = follow(env, BASELINES["pid"](env.unwrapped))
    assert rms(error) == pytest.approx(0.1154, abs=1e-4)
    assert rms(torque) == pytest.approx(1.676, abs=1e-3)
    assert np.abs(torque).max() == pytest.approx(2.685, abs=1e-3)
    settled = torque[300:]
    measured = [settled.min(), settled.max(), settled.mean()]
    assert measured == pytest.approx([0.919, 2.088, 1.525], abs=1e-3)


def test_inverse_dynamics_needs_no_feedback_once_it_follows(env):
    error, torque, _ = follow(env, BASELINES["inverse"](env.unwrapped))
    assert rms(error) == pytest.approx(0.0476, abs=1e-4)
    assert rms(torque) == pytest.approx(1.675, abs=1e-3)
    assert rms(error[300:]) < 1e-3
    blind = inverse_dynamics(env.unwrapped, PID(kp=0.0, kd=0.0))
    seen = np.array([np.cos(2.0), np.sin(2.0), 0.3, 0.7, 1.5])
    expected = crank_torque(env.unwrapped.robot, 2.0, 1.5).total
    assert 5.0 * blind.predict(seen)[0] == pytest.approx(np.array([float(expected)]), rel=1e-6)


def test_scores_are_those_of_the_episodes(env):
    """Each total and metric is that of a run stepped here; a crank left alone is lost."""
    policy = BASELINES["pid"](env.unwrapped)
    run = run_episodes(policy, ENV, {"reset_noise_scale": 0.0}, np.array([1.0]), np.zeros(1, int))
    error, torque, energies = follow(env, policy)
    work = sum(e["motor_work"] for e in energies)
    expected = {
        "rms_error": rms(error),
        "peak_error": np.abs(error).max(),
        "rms_torque": rms(torque),
        "peak_torque": np.abs(torque).max(),
        "power": work / 10.0,
        "success": 1.0,
        "lost": 0.0,
    }
    measured = {name: float(metric.function(run, env)[0]) for name, metric in CRANK.metrics.items()}
    del measured["return"]
    assert measured == pytest.approx(expected)
    left = run_episodes(still(env.unwrapped), ENV, {}, np.array([1.0]), np.zeros(1, int))
    assert left["lost"][0] and 3.0 < left["duration"][0] < 3.5


@pytest.mark.slow
def test_trained_policy_beats_the_papers_pid(tmp_path):
    """With the shipped configuration it has less RMS tracking error at no more RMS torque."""
    folder = train.main(["--env", ENV, "--no-progress", "--log-folder", str(tmp_path)])
    result = json.loads((folder / "scores.json").read_text())
    ours, pid = (result[name]["overall"] for name in (f"ppo/{ENV}_1", "pid"))
    assert ours["rms_error"][0] < 0.8 * pid["rms_error"][0]
    assert ours["rms_torque"][0] <= pid["rms_torque"][0]
