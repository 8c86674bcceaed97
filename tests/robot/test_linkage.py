"""Linkages: which data are refused, and properties of the built-in ones."""

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import PLANTS
from walks import walk

from jansen_env import LinkageError, Terrain, paper_robot, phased_legs, robot_from_joints
from jansen_env.dynamics import projection as pr
from jansen_env.dynamics.reduced import compile_robot, mass_matrix
from jansen_env.robot import JANSEN, ROBOTS, Linkage
from jansen_env.robot.kinematics import joint_positions, nearest_dead_point, toe_positions
from jansen_env.robot.zoo import ZOO, standing_height

FOUR_BAR = {
    "frame": {"O": (0.0, 0.0), "P": (0.4, 0.1)},
    "crank": {"O": (0.0, 0.0), "A": (0.1, 0.0)},
    "rocker": {"P": (0.0, 0.0), "B": (0.35, 0.0)},
    "foot": {"A": (0.0, 0.0), "B": (0.45, 0.0), "T": (0.25, -0.6)},
}
DYADS = [("B", "A", "P", -1)]


def four_bar(dyads=DYADS, toes="T", **bodies):
    return robot_from_joints({**FOUR_BAR, **bodies}, dyads, toes, phased_legs(2))


def upside_down(**given):
    feet = {"A": (0.0, 0.0), "B": (0.45, 0.0), "T": (0.25, 0.9)}
    return robot_from_joints({**FOUR_BAR, "foot": feet}, DYADS, "T", phased_legs(2), **given)


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: four_bar(dyads=[]), "Linkage.dyads must have 1 or more entries, got 0"),
        (
            lambda: four_bar(tie={"P": (0.0, 0.0), "S": (1.0, 0.0)}),
            r"joints\[\d\] must be a joint whose position is known, .* got 'S'",
        ),
        (
            lambda: four_bar(dyads=[("B", "A", "T", -1)]),
            r"dyads\[0\] must be a dyad whose start and end are known.*end='T'",
        ),
        (
            lambda: four_bar(dyads=[*DYADS, ("T", "A", "B", 1)]),
            r"dyads\[1\] must be a dyad whose joint is not known yet.*joint='T'",
        ),
        (
            lambda: four_bar(dyads=[("B", "A", "P", 0)]),
            r"dyads\[0\] must be a dyad whose branch is 1 or -1, got .*branch=0",
        ),
        (
            lambda: four_bar(dyads=[("B", "A", "O", 1)]),
            "must be a dyad of two different bodies, .*end='O'",
        ),
        (lambda: four_bar(toes="X"), r"toes\[0\] must be a joint of the linkage.*got 'X'"),
        (
            lambda: four_bar(crank={"A": (0.0, 0.0), "O": (0.1, 0.0)}),
            r"bodies\[1\] must be the crank, whose first joint must be.*'AO'",
        ),
        (
            lambda: four_bar(tie={"P": (0.0, 0.0), "T": (0.5, 0.0)}),
            "must have 1 degree of freedom, got 0",
        ),
        (
            lambda: four_bar(rocker={"P": (0.0, 0.0)}),
            "must be two or more different letters, got 'P'",
        ),
        (
            lambda: four_bar(dyads=[("B", "A", "A", -1)]),
            "must be a dyad of two different bodies, .*end='A'",
        ),
        (lambda: four_bar(rocker={"P": (0.0, 0.0), "B": (0.3,)}), r"\['B'\] must be.*got \(0.3,\)"),
        (
            lambda: four_bar(rocker={"P": (0.0, 0.0), 3: (0.3, 0.0)}),
            "joint .* must be a letter, got 3",
        ),
        (lambda: upside_down(height=0.5), r"height must be None because the toes are .* got 0\.5"),
        (
            lambda: replace(JANSEN, toes="E"),
            r"pads\[\d\] must be a joint and .* must be neither a toe nor .*'E'",
        ),
        (lambda: replace(JANSEN, pins=JANSEN.pins[1:]), "must hold all bodies together at each"),
        (
            lambda: replace(JANSEN, pins=(*JANSEN.pins[:-1], ("E", 8, 6))),
            r"pins\[9\] must be a pin at a joint that both .* have, got \('E', 8, 6\)",
        ),
        (
            lambda: replace(JANSEN, pins=(*JANSEN.pins[:-1], ("E", 8, 9))),
            r"pins\[9\] must be a pin at a joint that both .* have, got \('E', 8, 9\)",
        ),
        (
            lambda: replace(JANSEN, damped=((1, 1),)),
            r"damped\[0\] must be the numbers of two different bodies.*got \(1, 1\)",
        ),
        (
            lambda: replace(JANSEN, pads=(("X", 8),)),
            r"pads\[0\] must be a joint and the number of a body .*got \('X', 8\)",
        ),
        (
            lambda: replace(JANSEN, toes="TT"),
            r"toes\[1\] must be .* that is not already a toe, got 'T'",
        ),
        (
            lambda: replace(JANSEN, bearings=((1, 9),)),
            r"bearings\[0\] must be the numbers of two different bodies",
        ),
        (lambda: replace(JANSEN, damped=((1, 2**70),)), r"damped must have rows .*, got \(1, 11"),
        (lambda: replace(JANSEN, joints="ABC"), "Linkage.joints must be.*got 'ABC'"),
        (
            lambda: Linkage((("frame", "OP"),), (), "P"),
            "Linkage.bodies must have 2 or more entries, got 1",
        ),
        (lambda: paper_robot().with_bodies(knee=None), "body must be one of.*got 'knee'"),
        (lambda: paper_robot().body("knee"), "body must be one of.*got 'knee'"),
    ],
)
def test_what_is_no_leg_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_leg_that_cannot_turn_is_refused_with_joint_and_angle():
    with pytest.raises(LinkageError, match=r"joint B does not close at crank angle -?\d"):
        compile_robot(four_bar(rocker={"P": (0.0, 0.0), "B": (0.05, 0.0)}))


def test_a_dead_point_is_named_with_joint_and_angle():
    """A rocker just reaches: the links that meet in B are all but in line at one angle."""
    near = four_bar(rocker={"P": (0.0, 0.0), "B": (0.138, 0.0)})
    sine, joint, angle = nearest_dead_point(near)
    assert sine < 0.1 and joint == "B"
    with pytest.raises(ValueError, match=f"crank angle {angle:.3f} rad the links that meet in B"):
        compile_robot(near)


@pytest.mark.parametrize("name", ZOO)
def test_the_zoo_is_as_high_and_heavy_as_the_paper(name):
    robot = ZOO[name]()
    paper = paper_robot()
    assert robot.mass == pytest.approx(paper.mass, rel=1e-12)
    assert standing_height(robot) == pytest.approx(standing_height(paper), rel=1e-12)
    assert len(robot.toes) == len(paper.toes)
    assert nearest_dead_point(robot)[0] > 0.35


def test_klanns_joints_are_the_patents():
    """In US 6,260,862 the crank is at half a turn; joints 27, 35, 37 and 33 are relative to the
    crank axis 15.
    """
    robot = ZOO["klann"]()
    unit = robot.bodies[1].distance(0, 1) / 0.268
    place = joint_positions(robot, "fore", math.pi) / unit
    patent = {"D": (0.741, 0.750), "E": (0.232, 0.866), "F": (0.866, 1.5), "T": (0.0, 0.0)}
    for joint, published in patent.items():
        expected = np.subtract(published, (1.599, 0.750))
        assert place[robot.linkage.joints.index(joint)] == pytest.approx(expected, abs=1e-12)


def test_chebyshevs_feet_walk_on_a_line():
    """Over the half turn about its middle a toe leaves the level by 0.2 % of its stride."""
    robot = ZOO["chebyshev"](1)
    x, y = toe_positions(robot, np.linspace(0.5 * math.pi, 1.5 * math.pi, 181))[:, 0].T
    assert np.ptp(y) < 0.003 * np.ptp(x)


def test_a_pad_on_a_body_that_turns_all_the_way_round():
    """The rocker of a drag link turns with the crank; the tables agree with the projection."""
    robot = robot_from_joints(
        {
            "frame": {"O": (0.0, 0.0), "P": (0.08, 0.0)},
            "crank": {"O": (0.0, 0.0), "A": (0.3, 0.0)},
            "coupler": {"A": (0.0, 0.0), "B": (0.25, 0.0)},
            "rocker": {"P": (0.0, 0.0), "B": (0.2, 0.0), "T": (0.1, -0.3)},
        },
        [("B", "A", "P", 1)],
        "T",
        phased_legs(1),
    )
    tables = compile_robot(robot)
    q, v = np.array([0.1, 0.5, 0.2, 5.9]), np.array([0.3, -0.2, 0.4, 2.0])
    T = pr.tangent_matrix(robot, q)[0]
    mass = T.T @ pr.project(robot, q, v).mass @ T
    assert np.abs(mass_matrix(tables, q) - mass).max() < 1e-11
    slope = tables.pads[0, :, 1, 2]  # how fast the foot turns with the crank
    assert slope.mean() == pytest.approx(1.0, abs=1e-2) and slope.min() > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", *ZOO])
def test_walks_agree_on_both_plants(name):
    """In a steady walk at 1 rad/s on slippery ground, speed and cost of transport agree
    within 5 %.
    """
    robot = ROBOTS[name]()
    ground = Terrain.flat(0.2)
    ours, theirs = (walk(make(robot, ground), 1.0, 3.0) for make in PLANTS.values())
    assert not ours.fell and not theirs.fell
    for value in ("speed", "cost_of_transport"):
        assert getattr(theirs, value) == pytest.approx(getattr(ours, value), rel=0.05), value
