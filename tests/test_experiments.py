"""Experiments: each script runs at a small size, and its page shows its data."""

import json
import subprocess
import sys
from dataclasses import asdict
from importlib import import_module
from pathlib import Path

import pytest

from jansen_env.robot.robot_file import read_robot

ROOT = Path(__file__).parents[1]
SIZES = {"joint_play": "0.001", "legs": "2", "reference_problems": "2", "springs": "2"}
"""Arguments with which each experiment takes seconds."""


def test_all_experiments_are_tried() -> None:
    assert {path.stem for path in (ROOT / "experiments").glob("*.py")} == {*SIZES}


@pytest.mark.slow
@pytest.mark.parametrize("name", SIZES)
def test_experiment_runs(name: str, tmp_path: Path) -> None:
    """It writes every file that its page uses."""
    command = [sys.executable, ROOT / "experiments" / f"{name}.py", SIZES[name], tmp_path]
    subprocess.run(command, check=True, env={"MPLBACKEND": "Agg"}, cwd=tmp_path)
    published = {path.name for path in (ROOT / "docs" / name).iterdir()}
    assert {path.name for path in tmp_path.iterdir()} == published


def test_the_page_about_legs_shows_its_data(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "experiments"))
    results = json.loads((ROOT / "docs" / "legs" / "legs.json").read_text(encoding="utf-8"))
    page = (ROOT / "docs" / "legs.md").read_text(encoding="utf-8")
    legs = import_module("legs")
    controllers = {name: results[name] for name in ("policy", "pid")}
    for metric in legs.METRICS:
        assert legs.table(controllers, metric) in page, metric


def test_the_page_about_springs_shows_its_data(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "experiments"))
    results = json.loads((ROOT / "docs" / "springs" / "springs.json").read_text(encoding="utf-8"))
    page = (ROOT / "docs" / "springs.md").read_text(encoding="utf-8")
    springs = import_module("springs")
    assert springs.spring_table(results["robots"]) in page
    for metric in springs.METRICS:
        assert springs.pid_table(results["robots"], metric) in page, metric


def test_the_page_about_reference_problems_shows_its_data(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "experiments"))
    folder = ROOT / "docs" / "reference_problems"
    rows = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    page = (ROOT / "docs" / "reference_problems.md").read_text(encoding="utf-8")
    problems = import_module("reference_problems")
    assert problems.table([problems.Row(**row) for row in rows]) in page


def test_the_robot_files_of_the_page_about_springs_are_its_robots() -> None:
    folder = ROOT / "docs" / "springs"
    results = json.loads((folder / "springs.json").read_text(encoding="utf-8"))
    for name, values in results["robots"].items():
        for goal in ("peak", "rms"):
            (spring,) = read_robot(folder / f"{name}_{goal}.json").springs
            assert asdict(spring) == {
                **values[goal]["springs"][0],
                "anchor": tuple(values[goal]["springs"][0]["anchor"]),
            }


def test_the_page_about_joint_play_shows_its_data(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "experiments"))
    path = ROOT / "docs" / "joint_play" / "joint_play.json"
    walks = json.loads(path.read_text(encoding="utf-8"))["walks"]
    page = (ROOT / "docs" / "joint_play.md").read_text(encoding="utf-8")
    joint_play = import_module("joint_play")
    for controller in joint_play.CONTROLLERS:
        assert joint_play.table(walks, controller) in page, controller
