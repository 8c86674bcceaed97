"""The benchmark of feet that give: the mass they feel, their pads, and that it runs to its end."""

import math
from dataclasses import replace

import pytest

from benchmarks import compliant_feet
from jansen_env import Robot
from jansen_env.robot import Compliance


def test_pads_have_the_damping_ratio_asked_for():
    """d = 2 D sqrt(k m), of the mass that a toe feels like; none at infinite stiffness."""
    mass = compliant_feet.toe_mass(Robot())
    pads = compliant_feet.pads(Robot(), 2e4, 0.3)
    assert pads.damping == pytest.approx(0.6 * math.sqrt(2e4 * mass))
    assert pads.tangential_damping == pads.damping
    assert compliant_feet.pads(Robot(), math.inf) == Compliance()


def test_stiffer_feet_carry_larger_touchdowns():
    """At 4 rad/s: the force of a touchdown grows with the stiffness, and a pin bears some of it."""
    forces = [
        compliant_feet.walk(
            replace(Robot(), pad_compliance=compliant_feet.pads(Robot(), k)), 4.0, 1
        ).force
        for k in (1e4, 1e5)
    ]
    assert 50.0 < forces[0] < forces[1] < 2000.0


def test_command(tmp_path):
    compliant_feet.main(["--quick", "--out", str(tmp_path)])
    page = (tmp_path / "compliant_feet.md").read_text()
    assert "rigid" in page and "100 kN/m" in page and "0 of 2" in page


def test_a_touchdown_depends_on_the_start():
    """So one start is not a number: the table has the range over all of them, and who fell."""
    walks = [compliant_feet.Walk(1.0, 0.01, 300.0 + k, k == 2) for k in range(3)]
    found = compliant_feet.cells(walks, 100.0)
    assert found == ("1 of 3", "1.00", "0.010", "0.010", "300 to 301", "3.0")
    assert compliant_feet.cells(walks[2:], 100.0) == ("1 of 1", *[""] * 5)
    robot = replace(Robot(), pad_compliance=compliant_feet.pads(Robot(), 1e4))
    one, other = (compliant_feet.walk(robot, 4.0, 1, angle=angle) for angle in (0.0, 1.0))
    assert one.force != pytest.approx(other.force, rel=1e-3)
