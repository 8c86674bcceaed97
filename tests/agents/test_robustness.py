"""Scores over friction and foot stiffness."""

import json
import math

import pytest

from jansen_env import built_robot, paper_robot
from jansen_env.commands import evaluate
from jansen_env.commands.named_policies import load_named
from jansen_env.robot import RIGID
from jansen_env.scoring.rollout import make_env

SHORT = {"max_episode_steps": 150}  # 3 s


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(evaluate, "FRICTIONS", (0.3, 0.8))
    monkeypatch.setattr(evaluate, "STIFFNESSES", (20, math.inf))


def test_feet_are_scaled():
    own = built_robot().pad_compliance
    assert evaluate.feet(built_robot(), own.stiffness) == own
    softer = evaluate.feet(built_robot(), 0.1 * own.stiffness)
    assert softer.tangential_stiffness == pytest.approx(0.1 * own.tangential_stiffness)
    assert softer.damping == pytest.approx(math.sqrt(0.1) * own.damping)  # the same loss factor
    assert evaluate.feet(paper_robot(), 0.1 * own.stiffness) == softer
    assert evaluate.feet(built_robot(), math.inf) == RIGID


def test_conditions_are_what_they_are_called(few):
    """On the same starts: at its own friction and feet a robot walks as it does without."""
    env_id, plain = "JansenWalker-v0", {}
    policies = {"pid": load_named("pid", make_env(env_id, SHORT))}
    scores = evaluate.score_conditions([(policies, SHORT)], env_id, 8, 0)
    for sweep, (other, own) in (("friction", ("0.3", "0.8")), (evaluate.FEET, ("20", "rigid"))):
        plain[sweep] = scores[sweep][own]["pid"]
        assert plain[sweep]["overall"]["return"] != scores[sweep][other]["pid"]["overall"]["return"]
    assert plain["friction"] == plain[evaluate.FEET]
    drawn = evaluate.evaluate(policies, env_id, SHORT, episodes=8, drawn=True)["pid"]
    assert plain["friction"]["overall"] == drawn["overall"]


def test_robustness_command(few, tmp_path, capsys):
    evaluate.main([
        "--robustness", "--policy", "pid", "--policy", "profile", "--plant", "projection",
        "--plant", "rigid_body", "--episodes", "3", "--env-kwargs", "{max_episode_steps: 4}",
        "--out", str(tmp_path),
    ])  # fmt: skip
    found = json.loads((tmp_path / "robustness.json").read_text())
    assert {sweep: list(own) for sweep, own in found.items()} == {
        "friction": ["0.3", "0.8"], evaluate.FEET: ["20", "rigid"]
    }  # fmt: skip
    for own in (one for sweep in found.values() for one in sweep.values()):
        assert [one["episodes"] for one in own.values()] == [3, 3, 1, 1]
        assert own["pid on projection"]["overall"]["falls"] == [
            0.0,
            0.0,
            pytest.approx(0.7076, 1e-3),
        ]
    printed = capsys.readouterr().out
    assert "| friction 0.3 " in printed and "[" not in printed
    table = (tmp_path / "robustness.md").read_text()
    assert "| friction 0.3, pid on projection " in table
    assert "| foot stiffness (kN/m) rigid, profile on rigid_body " in table
    assert (tmp_path / "robustness.png").stat().st_size > 10_000
