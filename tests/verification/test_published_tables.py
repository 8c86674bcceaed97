"""Numbers that others have published of these linkages, by their own definitions.

Sources and verdicts: docs/published.md. Jansen's are in units of his "holy numbers". Names that
begin with ``published`` hold the numbers of the sources; those that begin with ``recorded`` hold
results of this code, against which later versions are compared.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from jansen_env import holy_numbers_robot, robot_from_joints
from jansen_env.robot import JANSEN, Leg, Triangle
from jansen_env.robot.kinematics import toe_positions
from jansen_env.robot.linkage import Dyad
from jansen_env.robot.zoo import klann_robot


def holy_path(samples):
    robot = holy_numbers_robot(1)
    psi = 2.0 * math.pi / samples * np.arange(samples)
    return toe_positions(robot, psi)[:, 0] / robot.bodies[1].length * 15.0


def longest_run(on):
    """Indices of the longest cyclic run that is True."""
    n = len(on)
    runs = [(0, 0)]
    for start in np.flatnonzero(on & ~np.roll(on, 1)):
        length = next(k for k in range(1, n + 1) if not on[(start + k) % n])
        runs.append((length, start))
    length, start = max(runs)
    return (start + np.arange(length)) % n


def test_strandbeest_evolutions_gait_of_jansens_leg():
    """It has 180 samples; a foot is on the ground up to 1.5 % of the path's width above its lowest
    point.
    """
    x, y = holy_path(180).T
    width = np.ptp(x)
    stance = longest_run(y <= y.min() + 0.015 * width)
    measures = width, np.ptp(y), np.ptp(x[stance]), len(stance) / 180
    published = 67.89875413151022, 22.45683436986971, 57.08132601641949, 0.43333333333333335
    assert measures == pytest.approx(published, rel=1e-12)


def test_strandbeest_evolutions_stroke_has_not_converged():
    """57.08 is a value of 180 samples: with 72,000 the same definition gives 57.67."""
    x, y = holy_path(72_000).T
    stance = longest_run(y <= y.min() + 0.015 * np.ptp(x))
    recorded = 57.66957
    assert np.ptp(x[stance]) == pytest.approx(recorded, abs=1e-5)


def test_strandbeest_evolutions_quasi_static_torque():
    """12 massless legs bear 50 kg and a drag of 5 % of it; legs within one unit of the lowest walk.

    Its body-height term has the opposite sign; with the right one the peak is 14.07.
    """
    legs = 12
    unit = 0.02
    mass = 50.0
    h = 1e-4
    samples = 240
    robot = holy_numbers_robot(1)
    psi = 2.0 * math.pi * np.arange(samples) / samples
    phase = 2.0 * math.pi * np.arange(legs) / legs

    def feet(ahead):
        at = toe_positions(robot, psi[:, None] + phase + ahead)[..., 0, :]
        return at / robot.bodies[1].length * 15.0

    now = feet(0.0)
    after = feet(h)
    before = feet(-h)
    low = now[..., 1].min(axis=1)
    walks = now[..., 1] <= low[:, None] + 1.0
    back = (after[..., 0] - before[..., 0]) / (2.0 * h)  # the crank turns clockwise
    advance = unit * (back * walks).sum(axis=1) / walks.sum(axis=1)
    rise = unit * (after[..., 1].min(axis=1) - before[..., 1].min(axis=1)) / (2.0 * h)
    weight = mass * 9.81
    as_coded, corrected = (0.05 * weight * advance + sign * weight * rise for sign in (-1.0, 1.0))
    published_stride = 2.667747
    assert advance.sum() * 2.0 * math.pi / samples == pytest.approx(published_stride, abs=1e-6)
    strides = [
        unit * ((back * near).sum(axis=1) / near.sum(axis=1)).mean() * 2.0 * math.pi
        for near in (now[..., 1] <= low[:, None] + band for band in (0.1, 2.0))
    ]  # by how near to the lowest a foot counts as standing
    recorded_strides = [2.81, 2.50]
    assert strides == pytest.approx(recorded_strides, abs=6e-3)
    published = [10.423653, 14.711717]
    assert [as_coded.mean(), as_coded.max()] == pytest.approx(published, abs=1e-6)
    recorded = [10.402249, 14.072458]
    assert [corrected.mean(), corrected.max()] == pytest.approx(recorded, abs=1e-6)


def test_legsynths_gait_of_jansens_leg():
    """It has 1440 samples; a foot is on the ground in the lowest 1 % of the path's height."""
    x, y = holy_path(1440).T
    ground = y.min() + 0.01 * np.ptp(y)
    stance = longest_run(y <= ground)
    step = np.ptp(x[stance])
    published_step = 43.408629
    published_clearance = 22.232376
    published_flatness = 0.00111946
    published_duty = 0.311806
    assert step == pytest.approx(published_step, abs=1e-6)
    assert y.max() - ground == pytest.approx(published_clearance, abs=1e-6)
    assert y[stance].std() / step == pytest.approx(published_flatness, abs=1e-8)
    assert len(stance) / 1440 == pytest.approx(published_duty, abs=1e-6)


def stance_measures(robot):
    """Return step, clearance, duty, flatness and ripple of a leg, as docs/design/held_leg.md."""
    psi = 2.0 * math.pi / 360 * np.arange(360)
    x, y = toe_positions(robot, psi)[:, 0].T / robot.bodies[1].length * 15.0
    stance = y <= y.min() + 0.15 * np.ptp(y)
    step = np.ptp(x[stance])
    speed = (np.roll(x, -1) - np.roll(x, 1))[stance]
    ripple = speed.std() / abs(speed.mean())
    return step, y.max() - y[stance].mean(), stance.mean(), y[stance].std() / step, ripple


def test_table_4_of_arxiv_2606_22129_is_that_of_another_assembly():
    """The upper triangle is turned over: B lies on the other side of the line from A to P."""
    jansen = holy_numbers_robot(1)
    unit = jansen.bodies[1].length / 15.0
    turned = replace(
        JANSEN,
        bodies=tuple(
            (name, "PDB" if name == "upper_triangle" else joints) for name, joints in JANSEN.bodies
        ),
        dyads=(Dyad("B", "A", "P", 1), *JANSEN.dyads[1:]),
    )
    bodies = list(jansen.bodies)
    sides = (40.1 * unit, 55.8 * unit, 41.5 * unit)
    bodies[JANSEN.names.index("upper_triangle")] = Triangle.from_sides(*sides, mass=0.1)
    robot = replace(jansen, linkage=turned, bodies=tuple(bodies))
    step, clearance, duty, flatness, ripple = stance_measures(robot)
    published_step = 43.3
    published_clearance = 25.7
    published_duty = 0.20
    published_flatness = 0.0281
    published_ripple = 0.0956
    assert step == pytest.approx(published_step, abs=0.05)
    assert clearance == pytest.approx(published_clearance, abs=0.05)
    assert duty == pytest.approx(published_duty, abs=0.005)
    assert flatness == pytest.approx(published_flatness, abs=5e-5)
    assert ripple == pytest.approx(published_ripple, abs=5e-5)
    recorded = (67.858, 21.705, 0.614, 0.01412, 0.3832)
    assert stance_measures(jansen) == pytest.approx(recorded, rel=1e-3)


def test_klanns_path_in_the_patents_assembly():
    """It has three times the patent's lengths and 48 samples; leggedsnake's assembly gives 3.40 x
    1.59.
    """
    robot = klann_robot(1)
    path = toe_positions(robot, 2.0 * math.pi / 48 * np.arange(48))[:, 0]
    unit = robot.bodies[1].distance(0, 1) / 0.268
    recorded = [3.02, 1.58]
    assert 3.0 / unit * np.ptp(path, axis=0) == pytest.approx(recorded, abs=6e-3)


def test_leggedsnakes_boxes_of_foot_paths():
    """They have 48 samples, of Jansen's leg and of a lambda linkage whose foot is its
    rocker's pin.
    """
    published = [67.83, 22.18]
    assert np.ptp(holy_path(48), axis=0) == pytest.approx(published, abs=6e-3)
    lambda_linkage = robot_from_joints(
        {
            "frame": {"O": (0.0, 0.0), "Q": (3.0, 0.0)},
            "crank": {"O": (0.0, 0.0), "A": (0.75, 0.0)},
            "coupler": {"A": (0.0, 0.0), "B": (3.75, 0.0)},
            "rocker": {"Q": (0.0, 0.0), "B": (3.75, 0.0)},
        },
        [("B", "A", "Q", -1)],
        "B",
        [Leg("fore")],
    )
    path = toe_positions(lambda_linkage, 2.0 * math.pi / 48 * np.arange(48))[:, 0]
    published = [1.87, 0.79]
    assert np.ptp(path, axis=0) == pytest.approx(published, abs=6e-3)
    radius = np.hypot(*(path - (3.0, 0.0)).T)
    assert radius == pytest.approx(3.75, abs=1e-12)
