"""Scores by terrain level."""

import json

import numpy as np

from agents import levels
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking.walker_benchmark import succeeded

ENV = "JansenWalker-v0"
ARGUMENTS = {"terrain": "stairs:rise=0.01", "max_episode_steps": 40}


class Idle:
    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.zeros((len(observation), 1), np.float32), None


def test_successes_walk_towards_their_command():
    env = make_env(ENV, {"max_episode_steps": 100})  # 2 s
    run = {
        "command": np.array([0.5, 0.5, -0.5, 0.5]),
        "distance": np.array([1.0, 0.7, -0.9, 1.0]),
        "fell": np.array([False, False, False, True]),
    }
    assert succeeded(run, env).tolist() == [1.0, 0.0, 1.0, 0.0]
    env.close()


def test_each_episode_has_its_options():
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


def test_scores_by_level_are_written(tmp_path, capsys):
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
    assert [row[0] for row in rows[4:]] == [
        f"terrain level {k}, {p}" for k in "09" for p in ("pid", "profile")
    ]
    found = json.loads((tmp_path / "levels.json").read_text())["terrain level"]
    assert set(found) == {"0", "9"} and set(found["9"]) == {"pid", "profile"}
    assert (tmp_path / "levels.png").stat().st_size > 10_000
    assert "95 % intervals over episodes" in capsys.readouterr().out
