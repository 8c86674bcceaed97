"""Which parts of a leg can be cut: positions of holes, walls between them, and sheets."""

import math

import numpy as np
import pytest

from jansen_env.engine.cutting import find_thin_wall, find_uncut, put_holes
from jansen_env.robot import ROBOTS
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.robot.linkage import CRANK
from jansen_env.robot.part_sizes import M3, cutting_row, hole_rows
from jansen_env.robot.robot_arrays import closing_of, leg_links

LARGE = (2000.0, 1000.0)  # mm, sides of a sheet


def uncut(robot, sheet=LARGE):
    """Name of the first link that cannot be cut, or "" if all can."""
    links, _, members = leg_links(robot)
    closing, _ = closing_of(robot)
    most = members.shape[1]
    work = np.empty((most + 1, 2)), np.empty((3 * most + 2, 3))
    arrays = (*hole_rows(robot), cutting_row(robot, sheet))
    body = find_uncut(links, members, closing.corners, arrays, work)
    return robot.linkage.names[body] if body >= 0 else ""


def screws(points, radii=(0.0, 0.0, 0.0)):
    """Holes of a plate whose first joint is a toe: those of joints, then those of screws."""
    sizes = cutting_row(ROBOTS["built"]())
    feet = np.array([[True, False, False]])
    holes = np.empty((8, 3))
    count = put_holes(0, np.array(points), np.array([radii]), feet, sizes, holes)
    return sizes[0], holes[:count]


@pytest.mark.parametrize("turn", [0.0, 2.0, 4.0])
def test_screws_of_a_shoe_lie_on_both_sides_of_a_wide_corner(turn):
    cos, sin = math.cos(turn), math.sin(turn)
    axes = np.array([[cos, sin], [-sin, cos]])
    points = np.array([[0.0, 0.0], [90.0, 0.0], [0.0, 80.0]]) @ axes
    sizes, holes = screws(points, (0.0, 3.0, 4.0))
    np.testing.assert_array_equal(holes[:2], [[*points[1], 3.0], [*points[2], 4.0]])
    expected = sizes["apart_first"] * axes
    found = sorted(map(tuple, holes[2:, :2] @ axes.T))
    np.testing.assert_allclose(found, sorted(map(tuple, expected @ axes.T)), atol=1e-12)


def test_screws_of_a_shoe_lie_behind_one_another_in_a_narrow_corner():
    """The first one lies towards the corner before the toe, counter-clockwise."""
    angle = 0.4  # rad
    points = [[100.0, 0.0], [100.0 - 90.0 * math.cos(angle), -90.0 * math.sin(angle)], [0.0, 0.0]]
    sizes, holes = screws(points)
    reaches = np.hypot(*(holes[:, :2] - points[0]).T)
    np.testing.assert_allclose(reaches, [sizes["behind_first"], sizes["behind_second"]])
    assert holes[0, 1] < -1.0 and holes[1, 1] == pytest.approx(0.0)


def test_a_crank_has_holes_for_the_screws_of_its_hub():
    robot = ROBOTS["weekend"]()
    radii, feet = hole_rows(robot)
    sizes = cutting_row(robot)
    holes = np.empty((6, 3))
    count = put_holes(CRANK - 1, np.array([[0.0, 0.0], [3.0, 4.0]]), radii, feet, sizes, holes)
    screw = sizes["hub_reach"][0] * np.array([0.6, 0.8])
    np.testing.assert_allclose(holes[count - 2 : count], [[*screw, M3], [*-screw, M3]])


def test_the_first_two_holes_with_a_thin_wall_are_found():
    holes = np.array([[0.0, 0.0, 3.0], [20.0, 0.0, 3.0], [20.0, 7.0, 2.0], [20.0, 1.0, 2.0]])
    pair = np.empty(2, np.int64)
    assert not find_thin_wall(holes[:3], 1.5, pair) and pair.tolist() == [-1, -1]
    assert find_thin_wall(holes[:3], 2.5, pair) and pair.tolist() == [1, 2]
    assert find_thin_wall(holes, 1.5, pair) and pair.tolist() == [1, 3]


@pytest.mark.parametrize("name", ["built", "weekend"])
def test_a_link_is_neither_too_small_for_its_holes_nor_too_large_for_a_sheet(name):
    robot = ROBOTS[name]()
    assert uncut(robot) == ""
    longest = max(value for key, value in lengths(robot).items() if key != "frame_angle")
    assert uncut(robot, (1e3 * longest, 1e3 * longest)) != ""
    crank = next(key for key in lengths(robot) if key.startswith("crank"))
    reach = 1e-3 * float(cutting_row(robot)["hub_reach"][0])  # m
    assert uncut(with_lengths(robot, {crank: reach})) == "crank"


def test_a_sheet_holds_a_part_that_lies_as_low_as_possible():
    """The frame of the paper's robot is a bar, with half of its width around both of its ends."""
    robot = ROBOTS["built"]()
    sizes = cutting_row(robot)[0]
    bar = 1e3 * lengths(robot)["frame"] + sizes["frame_width"]
    margins = 10.0  # mm, of a sheet
    assert uncut(robot, (bar + margins + 1e-6, 1e3)) != "frame"
    assert uncut(robot, (bar + margins - 1e-6, 1e3)) == "frame"
    assert uncut(robot, (1e3, sizes["frame_width"] + margins - 1e-6)) == "frame"
