"""The task of CONTRIBUTING.md: copied, registered, checked, walked and trained."""

import re
import sys
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from side_by_side import compare

import train
from jansen_env import registration
from jansen_env.commands.evaluate import main as evaluate

ROOT = Path(__file__).parents[2]
ENV = "Level-v0"


@pytest.fixture
def level(tmp_path, monkeypatch):
    """The folder of the task, on the path and registered."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (page,) = re.findall(r"```py\n(.*?)```", text, re.DOTALL)
    (config,) = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    assert len(page.splitlines()) <= 80
    folder = tmp_path / "level"
    (folder / "training" / ENV).mkdir(parents=True)
    (folder / "__init__.py").write_text(page, encoding="utf-8")
    (folder / "training" / ENV / "ppo.yml").write_text(config, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registration, "IDS", registration.IDS)
    import level

    yield level
    registration.IDS.remove(ENV)
    del gym.registry[ENV], sys.modules["level"]


def test_a_new_task(level, tmp_path, capsys):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(gym.make(ENV).unwrapped)
    assert all("infinity" in str(warning.message) for warning in caught)
    together = gym.make_vec(ENV, 3, max_episode_steps=30)
    alone = gym.vector.SyncVectorEnv([lambda: gym.make(ENV, max_episode_steps=30)] * 3)
    assert compare(together, alone, 60) >= 3

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
    with pytest.raises(ValueError, match="half_pitch is -1, must be above 0"):
        gym.make(ENV, half_pitch=-1)

    run = train.main(["--env", ENV, "-n", "2000", "--eval-freq", "0", "--eval-episodes", "1",
                      "--no-progress", "--log-folder", str(tmp_path / "logs")])  # fmt: skip
    assert (run / "best_model.zip").exists() or (run / "final_model.zip").exists()
    evaluate(["--env", ENV, "--policy", str(run), "--episodes", "1"])
    assert "return" in capsys.readouterr().out
