"""Predictions of what a built machine would measure: of its copies, with their uncertainty."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from jansen_env.robot import ROBOTS
from jansen_env.robot.lengths import lengths
from jansen_env.tasks.walking.tuned import gains_of
from jansen_workshop import play_effect, walking_copies
from jansen_workshop.__main__ import main
from jansen_workshop.commands import predict

ECONOMY = ROBOTS["economy"]()
SIZES = [name for name in lengths(ECONOMY) if name != "frame_angle"]
NOMINAL = {"mass": 1.0, "bearings": 1.0, "feet": 1.0, "battery": 1.0}


def test_copies_differ_in_what_is_not_known():
    exact = walking_copies.copy_of(ECONOMY, NOMINAL, dict.fromkeys(SIZES, 0.0))
    assert lengths(exact) == pytest.approx(lengths(ECONOMY))
    assert exact.mass == pytest.approx(ECONOMY.mass) and exact.motor == ECONOMY.motor
    other = {"mass": 1.03, "bearings": 0.5, "feet": 1.5, "battery": 0.9}
    copy = walking_copies.copy_of(ECONOMY, other, dict.fromkeys(SIZES, 3e-4))
    assert copy.motor.no_load_speed == pytest.approx(0.9 * ECONOMY.motor.no_load_speed)
    assert copy.bearing_friction == pytest.approx(tuple(0.5 * np.array(ECONOMY.bearing_friction)))
    assert copy.pad_compliance.stiffness == pytest.approx(1.5 * ECONOMY.pad_compliance.stiffness)
    assert 1.03 < copy.mass / ECONOMY.mass < 1.04
    assert lengths(copy)["rocker"] == pytest.approx(lengths(ECONOMY)["rocker"] + 3e-4)


@pytest.mark.slow
def test_the_witnessed_walk_is_within_its_band(tmp_path, capsys):
    """Of the economy machine at 2 rad/s, as three simulators walk it (0.199 to 0.203 m/s)."""
    out = tmp_path / "economy.json"
    predict.main(["economy", "--speeds", "2", "--copies", "24", "--out", str(out)])
    content = json.loads(out.read_text())
    quantities = content["crank_speed"]["2"]
    assert quantities.keys() == walking_copies.UNITS.keys()
    speed, cost = quantities["speed"], quantities["cost_of_transport"]
    assert 0.19 < speed["low"] < 0.2024 < speed["high"] < 0.21
    assert 0.20 < cost["low"] < 0.2127 < cost["high"] < 0.23
    assert quantities["falls"]["median"] == 0.0
    for row in quantities.values():
        assert row["low"] <= row["median"] <= row["high"]
        assert sum(row["sources"].values()) <= 1.0
    assert "speed (m/s)" in capsys.readouterr().out


@pytest.mark.slow
def test_no_play_changes_nothing(monkeypatch):
    """Both walks of a copy begin in the same state, under the same controller."""
    monkeypatch.setattr(play_effect, "COPIES", 1)
    changes = play_effect.changes_by_play(ECONOMY, 4.0, 0.0)
    assert changes.keys() < walking_copies.UNITS.keys()
    for change in changes.values():
        assert change.with_play == change.without
    assert 0.35 < changes["speed"].without[0] < 0.45


@pytest.mark.slow
def test_the_effect_of_play_is_reported(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(play_effect, "COPIES", 1)
    out = tmp_path / "economy.json"
    arguments = ["--speeds", "4", "--copies", "2", "--joint-play", "0.0003", "--out", str(out)]
    predict.main(["economy", *arguments])
    found = json.loads(out.read_text())["joint_play"]
    assert found["play"] == 0.0003
    speed = found["crank_speed"]["4"]["speed"]
    assert speed["with_play"] != speed["without"]
    assert speed["with_play"] == pytest.approx(speed["without"], rel=0.2)
    assert "change by play" in capsys.readouterr().out


def test_predictions_are_kept_if_a_copy_with_play_stands_still(monkeypatch, tmp_path, capsys):
    def refuse(*arguments):
        raise ValueError("a copy stands still")

    row = {"low": 0.1, "median": 0.2, "high": 0.3, "sources": {}}
    monkeypatch.setattr(predict, "predict", lambda *arguments: {"speed": row})
    monkeypatch.setattr(play_effect, "changes_by_play", refuse)
    out = tmp_path / "economy.json"
    arguments = ["--speeds", "4", "--joint-play", "0.0003", "--out", str(out)]
    with pytest.raises(SystemExit):
        predict.main(["economy", *arguments])
    assert "joint_play" not in json.loads(out.read_text())
    printed = capsys.readouterr()
    assert "speed (m/s)" in printed.out and "a copy stands still" in printed.err


def test_changes_are_listed_beside_the_predicted_band():
    changes = {"speed": play_effect.Change([0.2, 0.4], [0.21, 0.38])}
    table = play_effect.table(changes, {"speed": {"low": 0.1, "high": 0.25}})
    cells = [cell.strip() for cell in table.splitlines()[-1].strip("|").split("|")]
    assert cells == ["speed (m/s)", "0.3", "-0.005", "-0.02", "0.01", "0.15"]


@pytest.mark.slow
def test_a_machine_that_is_its_mirror_image_climbs_backwards_as_well():
    known = {"friction": np.full(2, 0.8), "start": np.array([0.3, 1.8])}
    pid = gains_of(ECONOMY, "steady")
    ahead, back = (walking_copies.climb([ECONOMY] * 2, known, speed, pid) for speed in (2.0, -2.0))
    assert 0.0 < ahead.max() < walking_copies.STEPS[-1] and back == pytest.approx(ahead, abs=0.021)


def test_variance_is_shared_out():
    """To the inputs that cause it, of what is linear."""
    rng = np.random.default_rng(0)
    inputs = {"friction": rng.random((5000, 1)), "lengths": rng.random((5000, 2))}
    values = 3.0 * inputs["friction"][:, 0] + inputs["lengths"] @ [2.0, 1.0]
    sources = predict.summary(values, inputs)["sources"]
    assert sources == pytest.approx({"friction": 9 / 14, "lengths": 5 / 14}, abs=0.03)


def test_chance_explains_nothing():
    """Noise has no sources, however many inputs there are; too few copies give none."""
    rng = np.random.default_rng(0)
    inputs, noise = {"lengths": rng.random((256, 100))}, rng.random(256)
    assert abs(predict.summary(noise, inputs)["sources"]["lengths"]) < 0.15  # R^2 is 0.4
    few = {"lengths": inputs["lengths"][:101]}
    assert predict.summary(noise[:101], few)["sources"] == {}


def test_a_machine_that_stands_still_is_refused():
    """Its motor is too weak for its own friction."""
    stuck = replace(ECONOMY, motor=replace(ECONOMY.motor, friction=100.0))
    with pytest.raises(
        ValueError,
        match=r"every copy of the robot must walk, .*, got 4 of 4 that stand still at a crank",
    ):
        predict.predict(stuck, 2.0, 4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["predict", "built", "--copies", "1e10"], "must be a whole number from 1 to "),
        (["predict", "built", "--out", ""], "must be a path, got an empty string"),
        (["predict", "built", "--joint-play", "0.3"], "--joint-play must be "),
        (["drawings", "weekend", "--out", ""], "must be a path, got an empty string"),
        (["drawings", "chebyshev", "--out", __file__], "must be a folder"),
        (["draw"], "COMMAND must be one of"),
    ],
)
def test_the_command_refuses_wrong_arguments(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main(arguments)
    assert message in capsys.readouterr().err
    assert not [*tmp_path.iterdir()]


def test_a_missing_package_is_named_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    monkeypatch.delitem(sys.modules, "jansen_workshop.commands.drawings", raising=False)
    with pytest.raises(SystemExit, match="needs ezdxf: python -m pip install"):
        main(["drawings", "weekend"])
