"""The robot that could be built: masses from dimensions, its list of parts, what it carries."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import built_robot as measured
from jansen_env import MOTORS, Terrain, built, built_robot
from jansen_env.motor import AK80_6, MX_106, XM540_W270
from jansen_env.plants.make import make_plant
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.robot import BEARING_LOADS, BODIES, Triangle

PAGE = Path(__file__).parents[1] / "docs" / "built_robot.md"


def moments(inside, low, high, cells=2000):
    """Area and polar moment about the origin of where ``inside(x, y)`` holds, by a fine grid."""
    x, y = (a + (b - a) * (np.arange(cells) + 0.5) / cells for a, b in zip(low, high, strict=True))
    X, Y = np.meshgrid(x, y)
    cell = (high[0] - low[0]) * (high[1] - low[1]) / cells**2
    mask = inside(X, Y)
    return cell * mask.sum(), cell * (mask * (X**2 + Y**2)).sum()


def test_a_flat_bar_is_a_rectangle_with_round_ends():
    """Mass and inertia by a grid, 1e-4; end masses add m and m L^2 / 4 each."""
    length, width = 0.2, 0.04

    def inside(x, y):
        beyond = np.maximum(np.abs(x) - 0.5 * length, 0.0)
        return beyond**2 + y**2 <= (0.5 * width) ** 2

    area, polar = moments(inside, (-0.12, -0.02), (0.12, 0.02))
    areal = built.DENSITY * built.BAR_THICKNESS
    bare = built.flat_bar(length, width, 0.0)
    assert bare == pytest.approx((areal * area, areal * polar), rel=1e-4)
    loaded = built.flat_bar(length, width, 0.3)
    assert loaded.mass - bare.mass == pytest.approx(0.6)
    assert loaded.inertia - bare.inertia == pytest.approx(2.0 * 0.3 * 0.1**2)


def test_a_plate_is_a_triangle_with_a_hole():
    """Mass and inertia about the pins' centroid by a grid, 1e-3; masses on the pins as points."""
    corners = np.array([[0.0, 0.0], [0.3, 0.0], [0.1, 0.2]])
    corners -= corners.mean(axis=0)
    sides = tuple(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1))

    def within(scale, x, y):
        result = np.ones(x.shape, bool)
        for a, b in zip(scale * corners, scale * np.roll(corners, -1, axis=0), strict=True):
            result &= (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) >= 0.0
        return result

    def inside(x, y):
        return within(built.OUTLINE, x, y) & ~within(built.WINDOW, x, y)

    area, polar = moments(inside, (-0.25, -0.15), (0.25, 0.2))
    areal = built.DENSITY * built.PLATE_THICKNESS
    bare = built.triangular_plate(sides, 0.0)
    assert bare == pytest.approx((areal * area, areal * polar), rel=1e-3)
    loaded = built.triangular_plate(sides, 0.02)
    assert loaded.inertia - bare.inertia == pytest.approx(0.02 * (corners**2).sum())


@pytest.mark.parametrize("phases", [1, 2, 3])
def test_the_list_of_parts_adds_up_to_the_robot(phases):
    robot = built_robot(phases)
    parts = measured.bill_of_materials(robot)
    assert sum(part.mass for part in parts) == pytest.approx(robot.mass, rel=1e-12)
    assert all(part.number > 0 and part.each > 0.0 for part in parts)


def test_the_documented_list_is_that_of_the_code():
    assert measured.parts_table(built_robot()) in PAGE.read_text(encoding="utf-8")


def test_links_are_no_longer_heavier_than_they_look():
    """Every radius of gyration fits into the link; the paper's, 1 m, is 2 to 9 times its length."""
    for name in BODIES:
        link = getattr(built_robot(), name)
        reach = max(link.sides) if isinstance(link, Triangle) else link.length
        assert (link.inertia / link.mass) ** 0.5 < 0.55 * reach


@pytest.fixture(scope="module")
def walked():
    """Six seconds at 2 rad/s, traced."""
    return measured.loads_of_walks(built_robot(), (2.0,), 6.0)[2.0]


def test_bearings_have_the_friction_of_their_mean_load(walked):
    """The loads that the code has are those of a walk, within 1.5 N; mu r F, in tenths of mN m."""
    robot = built_robot()
    size = walked.forces.magnitude.mean(axis=(0, 1))
    found = [size[measured.pin_of(pair)] for pair in measured.BEARINGS]
    np.testing.assert_allclose(BEARING_LOADS, found, atol=1.5)
    for torque, load in zip(robot.bearing_friction, BEARING_LOADS, strict=True):
        assert torque == pytest.approx(0.11 * 3e-3 * load, abs=5.1e-5)


def test_rods_hold(walked):
    """At 2 rad/s: twice safe against buckling and ten times against the largest force's pull."""
    robot = built_robot()
    for name in measured.RODS:
        pushed = measured.largest_compression(walked.forces, name)
        assert built.buckling_load(getattr(robot, name).length) > 2.0 * pushed
    assert built.yield_load() > 10.0 * walked.forces.bearing.max()


@pytest.mark.parametrize("speed", [1.0, pytest.param(1.5, marks=pytest.mark.slow)])
def test_it_walks_under_the_papers_pid(speed):
    """Forwards, upright, the crank kept within 2 %; on both plants as fast, as dear, sliding as
    much: 10 %."""
    found = [
        measured.walk(make_plant(plant, built_robot(), Terrain.flat()), speed, 4.0)
        for plant in ("projection", "rigid_body")
    ]
    for one in found:
        assert not one.fell and one.crank_speed == pytest.approx(speed, rel=0.02)
        assert one.speed > 0.05 * speed and one.electrical > one.mechanical > 0.0
    for name in ("speed", "slip", "rms_torque", "mechanical", "electrical"):
        assert getattr(found[0], name) == pytest.approx(getattr(found[1], name), rel=0.1)


@pytest.mark.parametrize("name", [name for name in MOTORS if name != "ideal"])
def test_every_motor_carries_it(name):
    """At 1 rad/s the crank is kept within 5 %, below the motor's torque limit."""
    robot = replace(built_robot(), motor=MOTORS[name])
    found = measured.walk(ProjectionPlant(robot, Terrain.flat()), 1.0, 6.3)
    assert not found.fell and found.crank_speed == pytest.approx(1.0, rel=0.05)
    assert found.peak_torque < robot.motor.torque_limit


def test_motors_are_those_of_the_sheets():
    """Efficiency from stall current and no-load speed; armatures; the motor constant."""
    for motor, volts, amperes in ((MX_106, 12.0, 5.2), (XM540_W270, 12.0, 4.4)):
        share = motor.stall_torque / amperes / (volts / motor.no_load_speed)
        assert motor.efficiency == pytest.approx(share, abs=0.002)
    for motor, speed in ((MX_106, 45.0), (XM540_W270, 30.0)):
        assert motor.no_load_speed == pytest.approx(speed * np.pi / 30.0, abs=0.005)
    assert MX_106.rotor_inertia * MX_106.gear_ratio**2 == pytest.approx(0.0266, rel=1e-2)
    assert AK80_6.winding == pytest.approx(1.0 / (6.0 * 0.2206) ** 2, rel=1e-3)
