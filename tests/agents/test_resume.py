"""A run that was killed and resumed is, bit for bit, the one that was not."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from small_runs import go_on, outcome, same, small_run

from agents.training import callbacks, models
from agents.training import train_model as training
from agents.training.training_state import read_state
from jansen_env.sb3.model_files import read_training_state

DRIVER = Path(__file__).parents[1] / "kill_runs.py"
CASES = {
    "ppo": small_run(),
    "noise of a whole rollout": small_run(hyperparameters={"use_sde": True, "sde_sample_freq": -1}),
    "lasting noise": small_run(hyperparameters={"use_sde": True, "sde_sample_freq": 8}),
    "delay, slope, commands": small_run(
        env_kwargs={"terrain": "slope:0.05", "delay": [0.0, 0.03], "command_interval": 0.12}
    ),
    "all that is drawn": small_run(env_id="JansenWalkerHardcore-v0"),
    "crank": small_run(env_id="JansenCrank-v0"),
    "lengths": small_run(
        env_kwargs={"randomize": {"lengths": 0.1}, "observe_lengths": True, "max_episode_steps": 9}
    ),
    "single environments": small_run(
        timesteps=96,
        n_envs=2,
        training_variants=[{}],
        env_kwargs={"track_joint_forces": True, "max_episode_steps": 9},
    ),
    "sac": small_run("sac"),
    "sac, noise of a whole rollout": small_run("sac", hyperparameters={"sde_sample_freq": -1}),
}


@pytest.fixture(autouse=True)
def few_episodes(monkeypatch):
    """One episode for each evaluation's command."""
    monkeypatch.setattr(callbacks, "EPISODES", 1)


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=[pytest.mark.slow] * (case == "single environments"))
        for case in CASES
    ],
)
def test_a_killed_run_ends_as_if_it_had_not_been(case, tmp_path):
    """Before its first checkpoint, in the middle of a rollout, and shortly before its end."""
    settings = CASES[case]
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    for folder in (whole, killed):
        folder.mkdir()
    go_on(settings, whole)
    for part in (0.1, 0.43, 0.57, 0.1):
        go_on(settings, killed, killed_after=part * settings["timesteps"])
    go_on(settings, killed)
    assert same(outcome(whole), outcome(killed))


def test_what_many_robots_saved_can_be_read(tmp_path):
    """A noise of their own for each, and more episodes than a file may have lists."""
    many = {"use_sde": True, "sde_sample_freq": -1, "stats_window_size": 200_000}
    settings = small_run(n_envs=2000, hyperparameters=many)
    settings["policy_kwargs"]["net_arch"] = [64]
    model = training.prepare(settings)
    model._setup_learn(1)
    model.policy.reset_noise(2000)
    model.ep_info_buffer.extend([{"r": 1.5, "l": 2, "t": 0.5}] * 150_000)
    state = read_state(model)
    models.save_model(model, tmp_path / "model.zip", {}, state)
    assert read_training_state(tmp_path / "model.zip") == json.loads(json.dumps(state))


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["ppo", "sac"])
@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes that are loaded already take a fork")
def test_twenty_kills(algo, tmp_path):
    command = [sys.executable, str(DRIVER), str(tmp_path / "runs"), "--algo", algo]
    done = subprocess.run(command, capture_output=True, text=True, cwd=DRIVER.parents[1])
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].startswith("20 kills of ")
