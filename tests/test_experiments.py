"""Experiments: each script runs at a small size, and its page shows its data."""

import json
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SIZES = {"legs": "2"}
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
