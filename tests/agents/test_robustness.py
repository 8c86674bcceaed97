"""Scores over friction, foot stiffness and terrain levels."""

import json
import math

import pytest

from jansen_env import built_robot, paper_robot
from jansen_env.cli import evaluate
from jansen_env.cli.named_policies import load_named
from jansen_env.robot import RIGID
from jansen_env.scoring.rollout import make_env

SHORT = {"max_episode_steps": 150}  # 3 s


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(evaluate, "FRICTIONS", (0.3, 0.8))
    monkeypatch.setattr(evaluate, "STIFFNESSES", (20, math.inf))


def test_feet_are_scaled():
    pads = built_robot().pad_compliance
    assert evaluate.feet(built_robot(), pads.stiffness) == pads
    softer = evaluate.feet(built_robot(), 0.1 * pads.stiffness)
    assert softer.tangential_stiffness == pytest.approx(0.1 * pads.tangential_stiffness)
    assert softer.damping == pytest.approx(math.sqrt(0.1) * pads.damping)  # the same loss factor
    assert evaluate.feet(paper_robot(), 0.1 * pads.stiffness) == softer
    assert evaluate.feet(built_robot(), math.inf) == RIGID


@pytest.mark.slow
def test_conditions_are_what_they_are_called(few):
    """From the same starts, a robot at its own friction and with its own feet walks as it does
    without a condition.
    """
    env_id = "JansenWalker-v0"
    plain = {}
    policies = {"pid": load_named("pid", make_env(env_id, SHORT))}
    scores = evaluate.score_conditions([(policies, SHORT)], env_id, 8, 0)
    for sweep, (other, usual) in (("friction", ("0.3", "0.8")), (evaluate.FEET, ("20", "rigid"))):
        plain[sweep] = scores[sweep][usual]["pid"]
        assert plain[sweep]["overall"]["return"] != scores[sweep][other]["pid"]["overall"]["return"]
    assert plain["friction"] == plain[evaluate.FEET]
    drawn = evaluate.evaluate(policies, env_id, SHORT, episodes=8, drawn=True)["pid"]
    assert plain["friction"]["overall"] == drawn["overall"]


@pytest.mark.slow
def test_robustness_command(few, tmp_path, capsys):
    """It scores each policy on each plant under each condition, with fewer episodes on the slow
    plant.
    """
    command = "--robustness --policy pid --policy profile --episodes 3"
    command += " --plant projection --plant rigid_body"
    given = ["--env-kwargs", "{max_episode_steps: 4}", "--out", str(tmp_path)]
    evaluate.main([*command.split(), *given])
    sweeps = json.loads((tmp_path / "robustness.json").read_text())
    conditions = {sweep: [*scores] for sweep, scores in sweeps.items()}
    assert conditions == {"friction": ["0.3", "0.8"], evaluate.FEET: ["20", "rigid"]}
    for scores in (scores for sweep in sweeps.values() for scores in sweep.values()):
        assert [score["episodes"] for score in scores.values()] == [3, 3, 1, 1]
    printed = capsys.readouterr().out
    assert "| friction 0.3 " in printed and "[" not in printed
    assert "| friction 0.3, pid on projection " in (tmp_path / "robustness.md").read_text()
    assert (tmp_path / "robustness.png").stat().st_size > 10_000


@pytest.mark.slow
def test_scores_by_level(tmp_path, capsys):
    """The report has a row for each level, and all levels are scored on the same commands."""
    command = "--env JansenWalkerRough-v0 --policy pid --policy constant --levels 0 9 --episodes 3"
    given = ["--env-kwargs", "{terrain: stairs}", "--out", str(tmp_path)]
    evaluate.main([*command.split(), *given])
    levels = json.loads((tmp_path / "levels.json").read_text())["terrain level"]
    assert [*levels] == ["0", "9"] and [*levels["9"]] == ["pid", "constant"]
    easy, hard = (levels[level]["pid"]["raw"] for level in levels)
    assert easy["command"] == hard["command"] and easy["returns"] != hard["returns"]
    assert "| terrain level 9 " in capsys.readouterr().out
    assert (tmp_path / "levels.png").stat().st_size > 10_000
