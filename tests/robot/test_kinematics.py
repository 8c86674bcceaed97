"""Joint positions from the crank angle: the paper's check numbers, rigid links, mirror image."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from jansen_env.robot import ROBOTS, Leg, Triangle, paper_robot
from jansen_env.robot.kinematics import T, advance_per_turn, coordinates, joint_positions

TURN = np.linspace(0.0, 2.0 * math.pi, 1440, endpoint=False)  # rad, a quarter of a degree apart


@pytest.mark.parametrize(
    "psi, side, toe, rate",
    [
        (0.0, "fore", (-0.399037, -0.533103), 0.216520),
        (0.0, "back", (0.280209, -0.621044), -0.367201),
        (1.0, "fore", (-0.268899, -0.564633), 0.419304),
        (1.0, "back", (0.146598, -0.609492), 0.366109),
    ],
)
def test_check_numbers_of_the_papers_reading(psi, side, toe, rate):
    """The place of the toe and d(theta_8)/d(psi) agree to six digits after the point."""
    assert joint_positions(paper_robot(), side, psi)[T] == pytest.approx(toe, abs=6e-7)
    ahead, behind = coordinates(paper_robot(), side, np.array([psi + 1e-5, psi - 1e-5]))[:, 21]
    assert (ahead - behind) / 2e-5 == pytest.approx(rate, abs=6e-7)


@pytest.mark.parametrize("side", ["fore", "back"])
def test_links_keep_their_lengths(robot, side):
    """All joints of every link keep their distance all the way round; 1e-14 is rounding."""
    joints = joint_positions(robot, side, TURN)
    for members, link in zip(robot.linkage.members, robot.bodies, strict=True):
        for i, j in itertools.combinations(range(len(members)), 2):
            span = np.hypot(*(joints[:, members[j]] - joints[:, members[i]]).T)
            # The printed centroid data close to 1e-6 only: the third corner may be so far off.
            rounded = isinstance(link, Triangle) and j == 2
            assert np.abs(span - link.distance(i, j)).max() <= (2e-6 if rounded else 1e-14)
            assert np.ptp(span) <= 1e-14


def test_a_back_leg_is_the_mirror_image(robot):
    """x becomes -x and angles become pi - angle, with the crank at pi - psi, for joints and bodies,
    to rounding.
    """
    fore = joint_positions(robot, "fore", TURN)
    back = joint_positions(robot, "back", math.pi - TURN)
    assert np.abs(back - fore * [-1.0, 1.0]).max() <= 1e-14
    fore = coordinates(robot, "fore", TURN).reshape(len(TURN), -1, 3)
    back = coordinates(robot, "back", math.pi - TURN).reshape(len(TURN), -1, 3)
    assert np.abs(back[..., 1:] - fore[..., 1:] * [-1.0, 1.0]).max() <= 1e-14
    turned = np.exp(1j * back[..., 0]) - np.exp(1j * (math.pi - fore[..., 0]))
    assert np.abs(turned).max() <= 1e-13


@pytest.mark.parametrize(("name", "advance"), [("paper", 0.658), ("holy", -0.980)])
def test_advance_per_turn(name, advance):
    """The paper's machine walks to +x, the holy one to -x; and so do their mirror images."""
    robot = ROBOTS[name]()
    assert advance_per_turn(robot) == pytest.approx(advance, abs=1e-3)
    sides = {"fore": "back", "back": "fore"}
    legs = tuple(Leg(sides[leg.side], -leg.phase) for leg in robot.legs)
    assert advance_per_turn(replace(robot, legs=legs)) == pytest.approx(advance, abs=2e-3)
