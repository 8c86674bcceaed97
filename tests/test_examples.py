"""Each example runs, at a small size."""

import json
import os
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
SIZES = {  # the arguments that make it short, and a word of what it prints
    "codesign": ("train 8192 new economy", "economy"),
    "front": ("1 1", "| map"),
    "joint_loads": ("20", "largest"),
    "linkage_map": ("0", "kept"),
    "log_to_wandb": ("4096", "logged to"),
    "minari_data": ("1 16384 JansenWalkerBuilt-v0", "pid-v0"),
    "offline_learning": ("10 jansen/JansenWalkerBuilt/pid-v0", "cloned"),
    "hindsight_replay": ("1501 1", "goals reached"),
    "headroom": ("JansenWalkerBuilt-v0 0.3 1 1", "| all |"),
    "find_a_way": ("JansenWalkerRough-v0 9 2 8", "can be walked"),
    "custom_linkage": ("20", "does not close"),
    "custom_terrain_and_reward": ("20", "return"),
    "obstacle_course": ("30", "course.png"),
    "share_on_hub": ("", "README.md"),
    "skrl_ppo": ("20000", "curves"),
    "surrogate": ("1", "R2"),
    "thousand_robots": ("8", "steps/s"),
    "torchrl_ppo": ("5000", "mean return"),
    "train_and_watch": ("1", "return"),
    "tune_with_optuna": ("ppo 1 4000", "best return"),
    "typed_walk": ("20", "8 robots"),
    "walk_with_pid": ("20", " m in "),
    "whole_package": ("16384 0.1", "toe slip"),
}
ELSEWHERE = {"rllib_ppo"}  # by test_rllib.py, where Ray is installed


def test_all_examples_are_tried() -> None:
    assert {path.stem for path in EXAMPLES.glob("*.py")} == {*SIZES, *ELSEWHERE}


NEEDS = {  # beside the extras
    "log_to_wandb": "wandb",
    "minari_data": "minari",
    "offline_learning": "minari",
    "share_on_hub": "huggingface_hub",
    "skrl_ppo": "skrl",
    "torchrl_ppo": "torchrl",
    "tune_with_optuna": "optuna",
}


SLOW = (
    "codesign",
    "find_a_way",
    "front",
    "hindsight_replay",
    "headroom",
    "joint_loads",
    "linkage_map",
    "minari_data",
    "offline_learning",
    "surrogate",
    "train_and_watch",
    "typed_walk",
    "whole_package",
)
NAMES = [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in SIZES]


def run_example(name: str, arguments: str, folder: Path) -> str:
    """Run an example in a folder, without a display, and return what it prints."""
    headless = {"SDL_VIDEODRIVER": "dummy", "MPLBACKEND": "Agg"}
    shared = {"MINARI_DATASETS_PATH": str(folder.parent / "minari")}  # of one for the next
    run = subprocess.run(
        [sys.executable, EXAMPLES / f"{name}.py", *arguments.split()],
        cwd=folder,
        env={**os.environ, **headless, **shared},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.mark.parametrize("name", NAMES)
def test_example(name: str, tmp_path: Path) -> None:
    size, printed = SIZES[name]
    if name in NEEDS and find_spec(NEEDS[name]) is None:
        pytest.skip(f"{NEEDS[name]} is not installed")
    assert printed in run_example(name, size, tmp_path)
    source = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    for word in source.split('"""')[1].split():  # the files that its docstring promises
        if word.strip(".").endswith((".gif", ".png")):
            assert (tmp_path / word.strip(".")).stat().st_size > 1000


@pytest.mark.slow
def test_codesign_searches(tmp_path: Path) -> None:
    assert "design_0" in run_example("codesign", "search 16384 new economy 1", tmp_path)


def test_linkages_of_the_map_walk_as_published(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    map_ = import_module("linkage_map")
    data = map_.load()
    rows = np.linspace(0, len(data["cost"]) - 1, 4).astype(int)
    made = [map_.turning(np.array([data[name][k] for name in map_.NAMES])) for k in rows]
    walker = map_.Walker("JansenWalkerBuilt-v0", map_.WORLD, map_.SPEED, 1, len(rows))
    walks = walker.walk([robot for robot, _ in made])
    for k, (_, shape), walk in zip(rows, made, walks, strict=True):
        published = [data[name][k] for name in ("cost", "slip", "opening", "height")]
        walked = walk["steady_cost_of_transport"], walk["steady_slip_per_metre"]
        expected = [*walked, shape["opening"], shape["height"]]
        np.testing.assert_allclose(published, expected, atol=0.501 * map_.UNIT)
        np.testing.assert_allclose(map_.toe_path(data, k)[:, 1].min(), -data["height"][k], atol=0.1)
    assert len(map_.elites(data)) > 10_000
    assert 0.05 < map_.is_test(data).mean() < 0.15


@pytest.mark.parametrize("name", ["six_questions", "walk_and_train"])
def test_notebook_is_stored_without_output(name: str) -> None:
    cells = json.loads((EXAMPLES / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert code and not any(cell["outputs"] or cell["execution_count"] for cell in code)
