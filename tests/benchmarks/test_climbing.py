"""What can be climbed: the benchmark's grounds and tables, and walks over steep faces."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from benchmarks import climbing
from jansen_env import Terrain
from jansen_env.plants.plant import PLANTS
from jansen_env.tasks.walking.walker_benchmark import BASELINES
from jansen_env.terrain.generators import LEVELS, at_level

DOCS = Path(__file__).parents[2] / "docs" / "terrain"


def test_the_documented_levels_are_those_of_the_code():
    lines = (DOCS / "levels.md").read_text(encoding="utf-8").splitlines()
    rows = dict(line[1:-1].split("|", 1) for line in lines if line.startswith('| `"'))
    for name, parameters in LEVELS.items():
        for key, (low, high) in parameters.items():
            row = next(rows.pop(label) for label in [*rows] if f'"{name}"`, `{key}`' in label)
            shown = [float(cell) for cell in row.split("|") if cell.strip()]
            levels = range(10) if low < high else (0,)
            assert shown == pytest.approx([at_level(name, k)[key] for k in levels], rel=5e-3)
    assert not rows


def test_limits_of_shares():
    ok = np.zeros((12, 2, 4), bool)
    ok[:5, 1] = True
    ok[5, 1, :2] = ok[8, 1] = True
    share = climbing.best(ok)
    assert share[:7] == pytest.approx([1, 1, 1, 1, 1, 0.5, 0])
    grown = climbing.sizes("slope down")
    assert climbing.last(grown, share) == f"{abs(grown[5]):.3g}"
    assert climbing.last(grown, np.zeros(12)) == "-"
    assert climbing.last(grown, np.ones(12)) == f">= {abs(grown[-1]):.3g}"
    other = np.zeros_like(ok)
    other[6, 0, :1] = True
    share = climbing.by_any_policy({"a": ok, "b": other})
    assert share[5:9] == pytest.approx([0.5, 0.25, 0.0, 1.0])


@pytest.mark.slow
def test_climbing_runs(tmp_path):
    climbing.main(["--quick", "--out", str(tmp_path)])
    text = (tmp_path / "climbing.md").read_text()
    assert "| one step, height (m) |" in text and "profile" in text


@pytest.mark.slow
@pytest.mark.parametrize("plant", sorted(PLANTS))
def test_walks_over_faces_do_not_diverge(plant):
    """5 s over stumps of 3 cm: nothing is refused, joints stay shut, and it gets there."""
    terrain = Terrain.stumps(height=0.03, width=0.2, spacing=0.6)
    env = gym.make("JansenWalker-v0", terrain=terrain, plant=plant, speed_command=0.45)
    policy = BASELINES["profile"](env.unwrapped)
    observation, _ = env.reset(seed=1)
    state, starts = None, np.ones(1, bool)
    for _ in range(250):
        action, state = policy.predict(observation[None], state, starts, True)
        starts = np.zeros(1, bool)
        observation, _, terminated, _, info = env.step(action[0])
        assert not info["diverged"] and not terminated and info["joint_gap"] < 1e-3
    assert info["x_position"] > 1.6
    env.close()
