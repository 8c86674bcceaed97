"""The task of CONTRIBUTING.md: copied, registered, checked, walked and trained."""

import argparse
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from side_by_side import compare
from stable_baselines3 import PPO

import train
from jansen_env import registration
from jansen_env.cli import evaluate
from jansen_env.cli.flags import imported_env_id

ROOT = Path(__file__).parents[2]
ENV = "Level-v0"


@pytest.fixture
def folder(tmp_path):
    """The folder of the task."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (page,) = re.findall(r"```py\n(.*?)```", text, re.DOTALL)
    (config,) = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    assert len(page.splitlines()) <= 80
    folder = tmp_path / "level"
    (folder / "training" / ENV).mkdir(parents=True)
    (folder / "__init__.py").write_text(page, encoding="utf-8")
    (folder / "training" / ENV / "ppo.yml").write_text(config, encoding="utf-8")
    return folder


@pytest.fixture
def level(folder, monkeypatch):
    """The task, on the path and registered."""
    monkeypatch.syspath_prepend(folder.parent)
    import level

    yield level
    registration.IDS.remove(ENV)
    del gym.registry[ENV], sys.modules["level"]


def test_a_new_task(level):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(gym.make(ENV).unwrapped)
    assert all("infinity" in str(warning.message) for warning in caught)
    together = gym.make_vec(ENV, 3, max_episode_steps=30)
    alone = gym.vector.SyncVectorEnv([lambda: gym.make(ENV, max_episode_steps=30)] * 3)
    assert sum(compare(together, alone, 60)) >= 3

    env = gym.make(ENV, half_pitch=0.2, noise={})
    env.reset(seed=0)
    for _ in range(20):
        _, reward, *_, info = env.step(np.full(1, 0.3, np.float32))
        assert reward == info["reward/levelness"] * info["reward/speed"]
    pitch = info["pitch"]
    assert info["reward/levelness"] == pytest.approx(1.0 / (1.0 + (pitch / 0.2) ** 2))
    state = env.unwrapped.get_state()
    again = gym.make(ENV, half_pitch=0.2, noise={}).unwrapped
    assert (again.set_state(state) == env.unwrapped.task.observation[0]).all()
    with pytest.raises(ValueError, match="half_pitch must be above 0, got -1"):
        gym.make(ENV, half_pitch=-1)


@pytest.mark.slow
def test_a_new_task_is_trained_from_the_shell_resumed_and_evaluated(folder, level, capsys):
    environ = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder.parent), str(ROOT)])}
    name = ["--env", f"level:{ENV}"]
    run = folder.parent / "logs" / "ppo" / f"{ENV}_1"
    given = [*name, "--eval-freq", "0", "--eval-episodes", "1", "--no-progress"]
    command = [sys.executable, str(ROOT / "train.py"), *given]
    done = subprocess.run(command, env=environ, cwd=folder.parent, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert PPO.load(run / "final_model.zip").num_timesteps >= 2000
    train.main([*given, "--resume", str(run), "-n", "2500"])
    assert PPO.load(run / "final_model.zip").num_timesteps >= 2500
    evaluate.main([*name, "--policy", str(run), "--episodes", "1"])
    assert "return" in capsys.readouterr().out


def test_an_id_that_is_not_registered_is_refused():
    for text, message in (
        ("nowhere:Level-v0", "cannot be imported: No module named 'nowhere'"),
        (".:Level-v0", "cannot be imported"),
        ("json:CartPole-v1", r"must be one of \[.*'JansenWalker-v0'"),
    ):
        with pytest.raises(argparse.ArgumentTypeError, match=message):
            imported_env_id(text)
