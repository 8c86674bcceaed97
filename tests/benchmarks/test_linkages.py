"""The comparison of walking linkages: equal conditions, the saved controllers, the program."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks import linkages
from jansen_env.dynamics.reduced import body_sums, compile_robot
from jansen_env.gravity import GRAVITY
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.zoo import standing_height

DOCS = Path(__file__).parents[2] / "docs"


def test_linkages_are_equally_tall_and_heavy_with_four_toes_and_one_motor():
    robots = [linkages.as_tall(name) for name in linkages.LINKAGES]
    assert [standing_height(robot) for robot in robots] == pytest.approx([0.61188] * 6, abs=1e-5)
    assert [robot.mass for robot in robots] == pytest.approx([3.2] * 6)
    assert {(len(robot.toes), robot.motor, robot.pad_radius) for robot in robots} == {
        (4, robots[0].motor, 0.01)
    }


def test_pins_alone_cost_as_the_page_says():
    """Mean viscous friction on the crank at the speed that level feet without slip ask for."""
    costs = []
    for name in linkages.LINKAGES:
        robot = linkages.as_tall(name)
        psi = 2.0 * math.pi / 360 * np.arange(360)
        friction = body_sums(compile_robot(robot), psi).f.mean()  # N m s/rad
        crank = 2.0 * math.pi / advance_per_turn(robot)  # rad a metre
        costs.append(friction * crank**2 / (robot.mass * GRAVITY))
    assert costs == pytest.approx([4.5, 2.9, 0.79, 0.66, 0.76, 0.61], rel=0.02)


def test_a_shipped_profile_walks_as_the_table_says():
    numbers = json.loads((DOCS / "linkages" / "controllers.json").read_text(encoding="utf-8"))
    scores = json.loads((DOCS / "linkages" / "scores.json").read_text(encoding="utf-8"))
    assert list(numbers) == list(scores) == list(linkages.LINKAGES)
    robot = linkages.as_tall("chebyshev")
    own = linkages.controllers_of(numbers["chebyshev"], robot)["profile"]
    seen = linkages.watch({"robot": robot}, own, 0.3, linkages.FIRST_SEED)
    written = next(c for c in scores["chebyshev"]["profile"] if c["command"] == 0.3)
    assert seen["heave"] == pytest.approx(written["heave"], rel=0.3)
    assert sum(seen[name] for name in linkages.LOSSES) == pytest.approx(1.0)


def test_the_page_has_the_table_of_the_program():
    page = (DOCS / "linkages.md").read_text(encoding="utf-8")
    table = (DOCS / "linkages" / "scores.md").read_text(encoding="utf-8").split("\n\n")[2]
    assert table.strip() in page


@pytest.mark.slow
def test_linkages_run(tmp_path):
    linkages.main(["--quick", "--out", str(tmp_path)])
    scores = json.loads((tmp_path / "scores.json").read_text(encoding="utf-8"))
    assert list(scores) == [*linkages.LINKAGES][:3]
    for both in scores.values():
        assert [cell["command"] for cell in both["pid"]] == linkages.SPEEDS.tolist()
    numbers = json.loads((tmp_path / "controllers.json").read_text(encoding="utf-8"))
    assert all(np.shape(own["profile"]) == (8, 12) for own in numbers.values())
    for picture in ("comparison.png", "zoo.png", "klann.png"):
        assert (tmp_path / picture).stat().st_size > 10_000
