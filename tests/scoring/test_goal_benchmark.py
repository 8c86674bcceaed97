"""``JansenGoal-v0`` is scored like the others; its commands are goals."""

import json

import pytest

from jansen_env.cli import evaluate


def test_goals_are_scored(tmp_path, capsys):
    """The score is the success with its exact interval; an episode without success counts with its
    time limit.
    """
    arguments = ["--env", "JansenGoal-v0", "--policy", "pid", "--commands", "0.01", "2.5", "-3"]
    arguments += ["--episodes", "1", "--random-commands", "3", "--out", str(tmp_path)]
    evaluate.main([*arguments, "--env-kwargs", "{max_episode_steps: 200}"])
    score = json.loads((tmp_path / "scores.json").read_text())["pid"]
    by_goal = score["by_command"]
    assert by_goal["success"]["command"] == by_goal["time"]["command"] == [-3.0, 0.01, 2.5]
    assert by_goal["success"]["value"] == [0.0, 1.0, 0.0]
    assert score["overall"]["success"] == pytest.approx([1 / 3, 0.0084, 0.9057], abs=1e-4)
    assert by_goal["time"]["value"][0] == by_goal["time"]["value"][2] == 4.0
    assert 0.9 < by_goal["time"]["value"][1] < 4.0  # a second at the goal
    assert max(map(abs, score["drawn"]["raw"]["command"])) > 0.8
    assert "commands 0.01 2.5 -3 m, episodes at each 1" in capsys.readouterr().out
