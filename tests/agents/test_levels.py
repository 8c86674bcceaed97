"""Scores by terrain level."""

from __future__ import annotations

import json

import numpy as np
import pytest

from agents import levels
from jansen_env.scoring.benchmarks import WALKER
from jansen_env.scoring.rollout import make_env, run_episodes

ENV = "JansenWalker-v0"
ARGUMENTS = {"terrain": "stairs:rise=0.01", "max_episode_steps": 40}


class Idle:
    """No torque."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.zeros((len(observation), 1), np.float32), None


def test_shares_have_exact_intervals():
    """8 of 10: 0.444 to 0.975 in tables of Clopper and Pearson."""
    assert levels.share(np.arange(10) < 8) == pytest.approx((0.8, 0.4439, 0.9748), abs=1e-4)


def test_numbers_of_a_level():
    """From what is kept of episodes; a walk backwards is measured towards its command."""
    env = make_env(ENV, {"max_episode_steps": 100})  # 2 s
    n = 4
    run = {name: np.zeros(n) for name in WALKER.aggregates} | {
        "command": np.array([0.5, 0.5, -0.5, 0.5]),
        "distance": np.array([1.0, 0.7, -0.9, 1.0]),
        "fell": np.array([False, False, False, True]),
        "slip": np.full(n, 0.09),
        "work": env.unwrapped.weight * np.full(n, 0.36),
    }
    found = levels.score(run, env)
    env.close()
    assert found.success[0] == 0.5 and found.falls[0] == 0.25
    assert found.slip == pytest.approx(0.36 / 3.6) and found.transport == pytest.approx(0.4)


def test_each_episode_has_its_options():
    """Levels differ side by side as they do alone."""
    seeds, commands = np.array([5, 6, 7]), np.full(3, 0.4)
    arguments = {"terrain": "slope", "max_episode_steps": 30}
    wanted = np.array([0, 4, 9])
    options = {"terrain_level": wanted}
    run = run_episodes(Idle(), ENV, arguments, commands, seeds, options=options)
    for i, level in enumerate(wanted):
        alone = run_episodes(
            Idle(), ENV, arguments, commands[:1], seeds[i : i + 1],
            options={"terrain_level": np.array([level])},
        )  # fmt: skip
        assert alone["distance"][0] == run["distance"][i]
    assert len(set(np.abs(run["distance"]))) == 3


def test_policies_meet_the_same_episodes():
    """Spread over the commands, as many at each level; another seed has others."""
    scored = [levels.score_levels(Idle(), ENV, ARGUMENTS, [0, 9], 4, seed) for seed in (0, 0, 1)]
    assert list(scored[0]) == [0, 9]
    assert scored[0] == scored[1] and scored[0][9].success[0] == 0.0
    assert scored[0][9].slip != scored[2][9].slip


def test_scores_by_level_are_written(tmp_path, capsys):
    """One command: table, numbers and figure."""
    levels.main([
        "--env", ENV, "--env-kwargs", "{terrain: stairs, max_episode_steps: 30}",
        "--policy", "pid", "--policy", "profile", "--levels", "0", "9", "--episodes", "3",
        "--commands", "0.3", "0.5", "--out", str(tmp_path),
    ])  # fmt: skip
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in (tmp_path / "levels.md").read_text().splitlines()
        if line.startswith("|") and "--" not in line
    ]
    assert rows[0] == ["level", "pid", "profile", "any of them"]
    assert [row[0] for row in rows[1:3]] == ["0", "9"]
    assert [row[:2] for row in rows[4:]] == [[k, p] for k in "09" for p in ("pid", "profile")]
    assert rows[4][2] == rows[1][1] and rows[7][2] == rows[2][2]
    found = json.loads((tmp_path / "levels.json").read_text())
    assert set(found) == {"pid", "profile"} and set(found["pid"]) == {"0", "9"}
    assert (tmp_path / "levels.png").stat().st_size > 10_000
    assert "exact 95 % intervals" in capsys.readouterr().out
