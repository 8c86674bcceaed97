"""Experiments: each script runs in a tiny setting, and its page shows its data."""

import json
import os
import subprocess
import sys
from dataclasses import asdict
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from jansen_env.robot import ROBOTS
from jansen_env.robot.robot_file import read_robot

ROOT = Path(__file__).parents[1]
SCRIPTS = {
    path.stem
    for path in (ROOT / "experiments").glob("*.py")
    if "\ndef main(" in path.read_text(encoding="utf-8")
}
"""Experiments; the other modules of the folder belong to several of them."""
SIZES = {"joint_play": "0.001", "reference_problems": "2"}
"""Arguments with which experiments with a command line of their own take seconds."""
IN_MUJOCO = {"closed_loops", "mujoco_witness", "spring_witness", "transfer"}
TRAINING = {
    "algorithms",
    "gentle_terrain",
    "longer_training",
    "lowest_load",
    "mean_load_cost",
    "serial_chain",
    "springs",
}


def run(name: str, *arguments: str | Path, folder: Path) -> None:
    command = [sys.executable, ROOT / "experiments" / f"{name}.py", *arguments]
    subprocess.run(command, check=True, env={**os.environ, "MPLBACKEND": "Agg"}, cwd=folder)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(SCRIPTS - {*SIZES}))
def test_experiment_runs(name: str, tmp_path: Path) -> None:
    """It writes its data, and every file that it writes is published, except runs in logs."""
    if name in IN_MUJOCO:
        pytest.importorskip("mujoco")
    if name in TRAINING:
        pytest.importorskip("stable_baselines3")
    run(name, "--quick", "--out", tmp_path, folder=tmp_path)
    files = {path.relative_to(tmp_path) for path in tmp_path.rglob("*") if path.is_file()}
    written = {path for path in files if path.parts[0] != "logs"}
    assert Path(import_module(name).DATA) in written
    assert all((ROOT / "docs" / path).exists() for path in written)


@pytest.mark.slow
@pytest.mark.parametrize("name", SIZES)
def test_experiment_with_its_own_command_line_runs(name: str, tmp_path: Path) -> None:
    """It writes every file that its page uses."""
    run(name, SIZES[name], tmp_path, folder=tmp_path)
    published = {path.name for path in (ROOT / "docs" / name).iterdir()}
    assert {path.name for path in tmp_path.iterdir()} == published


@pytest.mark.slow
def test_figures_of_the_geometry_are_published(tmp_path: Path) -> None:
    run("geometry_figures", "--out", tmp_path, folder=tmp_path)
    drawn = [*tmp_path.rglob("*.png")]
    assert len(drawn) == 10
    for path in drawn:
        assert (ROOT / "docs" / path.relative_to(tmp_path)).exists()


@pytest.mark.parametrize("name", sorted(SCRIPTS - {*SIZES}))
def test_pages_show_the_data(name: str) -> None:
    """Each page has all tables of the data in their order, and names the command."""
    if name in IN_MUJOCO:
        pytest.importorskip("mujoco")
    if name in TRAINING:
        pytest.importorskip("stable_baselines3")
    experiment = import_module(name)
    results = json.loads((ROOT / "docs" / experiment.DATA).read_text(encoding="utf-8"))
    for page, tables in experiment.tables(results).items():
        text = (ROOT / "docs" / page).read_text(encoding="utf-8")
        assert f"python experiments/{name}.py" in text, page
        assert import_module("pages").with_tables(text, tables) == text, page


def test_return_and_success_are_those_of_the_result_files() -> None:
    """A new result file on these tracks changes the comparison."""
    experiment = import_module("return_and_success")
    files = sorted(experiment.RESULTS.glob("*.json"))
    shown = json.loads((ROOT / "docs" / experiment.DATA).read_text(encoding="utf-8"))
    assert shown.keys() == {*experiment.NAMES}
    for track, data in shown.items():
        found = experiment.compare(track, files)
        assert [[*pair] for pair in found["differ"]] == data["differ"]
        assert found["policies"].keys() == data["policies"].keys()
        for name, scores in found["policies"].items():  # sums differ between processors
            assert scores == pytest.approx(data["policies"][name]), name


def test_a_table_takes_the_place_of_the_one_with_the_same_headings() -> None:
    pages = import_module("pages")
    old = pages.table(["speed", "slip"], [["1", "2"], ["3", "4"]])
    new = pages.table(["speed", "slip"], [["5", "6"]])
    page = f"Before.\n\n{old}\n\nBetween.\n\n{old}\n\nAfter.\n"
    assert pages.with_tables(page, [old, new]) == (
        f"Before.\n\n{old}\n\nBetween.\n\n{new}\n\nAfter.\n"
    )
    with pytest.raises(ValueError, match="must have a table with the headings"):
        pages.with_tables(page, [old, new, new])


def test_a_tiny_experiment_does_not_replace_published_data(monkeypatch: pytest.MonkeyPatch) -> None:
    pages = import_module("pages")
    for arguments, folder in (
        ([], pages.DOCS),
        (["--quick"], ROOT / "logs" / "quick"),
        (["--quick", "--out", "here"], Path("here")),
    ):
        monkeypatch.setattr(sys, "argv", ["experiment.py", *arguments])
        assert pages.options(None).out == folder


@pytest.mark.parametrize("name", ["serial_chain", "springs"])
def test_pages_show_the_scores_of_trained_policies(name: str) -> None:
    """They have a data file of their own, which an experiment without training does not change."""
    experiment = import_module(name)
    scores = json.loads((ROOT / "docs" / experiment.POLICIES).read_text(encoding="utf-8"))
    page = (ROOT / "docs" / experiment.PAGE).read_text(encoding="utf-8")
    tables = experiment.policy_tables(scores)
    assert import_module("pages").with_tables(page, tables) == page


def test_a_policy_of_another_robot_or_configuration_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The experiment neither uses the policy nor replaces the description of its robot."""
    pytest.importorskip("stable_baselines3")
    train_model = import_module("agents.training.train_model")
    trained = import_module("trained_policies")

    def train(model: None, config: object, folder: Path, **options: object) -> None:
        (folder / "final_model.zip").touch()

    monkeypatch.setattr(train_model, "prepare", lambda config: None)
    monkeypatch.setattr(train_model, "train", train)
    folder = tmp_path / "run"
    stroller = ROBOTS["stroller"]()
    file = trained.train_policy(folder, stroller, 0, "", quick=False)
    assert trained.train_policy(folder, stroller, 0, "", quick=False) == file
    with pytest.raises(ValueError, match="must be the robot of this run"):
        trained.train_policy(folder, ROBOTS["built"](), 0, "", quick=False)
    assert read_robot(folder / "robot.json") == stroller
    with pytest.raises(ValueError, match="must be a run with the present configuration"):
        trained.train_policy(folder, stroller, 1, "", quick=False)


def test_a_metric_that_no_episode_has_is_called_none() -> None:
    joint_play = import_module("joint_play")
    row = {
        "plant": "projection",
        "time_step": 1.0,
        "play": 0.0,
        **dict.fromkeys(joint_play.METRICS),
        "falls": 0.5,
    }
    cells = joint_play.episode_table([row]).splitlines()[-1].strip("| ").split(" | ")
    assert cells == ["projection", "1", "0", "none", "none", "none", "none", "0.5"]


def test_the_page_about_reference_problems_shows_its_data() -> None:
    folder = ROOT / "docs" / "reference_problems"
    rows = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    page = (ROOT / "docs" / "reference_problems.md").read_text(encoding="utf-8")
    problems = import_module("reference_problems")
    assert problems.table([problems.Row(**row) for row in rows]) in page


@pytest.mark.parametrize(("problem", "moment"), [("A03", 0.03), ("A02", 10.0)])
def test_the_files_for_the_library_have_the_published_values(problem: str, moment: float) -> None:
    """The rows at all times are there, and one of them has a published position."""
    problems = import_module("reference_problems")
    rows = np.loadtxt(ROOT / "docs" / "reference_problems" / f"{problem}.txt", comments="%")
    assert rows[:, 0] == pytest.approx(problems.SUBMITTED_TIMES[problem])
    _, x, y, angle, speed, _ = rows[np.argmin(np.abs(rows[:, 0] - moment))]
    if problem == "A03":
        assert angle == pytest.approx(problems.SQUEEZER_END, abs=1e-8)
        assert speed == pytest.approx(problems.SQUEEZER_SPEED, rel=1e-9)
    else:
        assert (x, y) == pytest.approx(problems.FOUR_BAR_END, abs=1e-9)


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


def test_the_page_about_joint_play_shows_its_data() -> None:
    path = ROOT / "docs" / "joint_play" / "joint_play.json"
    results = json.loads(path.read_text(encoding="utf-8"))
    walks = results["walks"]
    page = (ROOT / "docs" / "joint_play.md").read_text(encoding="utf-8")
    joint_play = import_module("joint_play")
    assert joint_play.episode_table(results["episodes"]) in page
    assert joint_play.step_table(walks) in page
    for controller in joint_play.CONTROLLERS:
        assert joint_play.walk_table(walks, controller) in page, controller
