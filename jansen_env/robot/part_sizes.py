"""Sizes of the holes and walls of buildable parts, which the drawings and the design page share."""

from __future__ import annotations

import math

import numpy as np

from jansen_env.arrays import Array, Bools, Rows
from jansen_env.engine.cutting import CUTTING
from jansen_env.robot import Robot, buildable
from jansen_env.robot.buildable import ALUMINIUM, Build
from jansen_env.robot.linkage import CRANK, FRAME

MARGIN = 5.0  # distance between parts, and from a part to the edge of a sheet, in mm
M3 = 1.6  # radius of a hole for an M3 screw
SHOE_SCREW = 2.25  # radius of a hole for an M4 screw
WALL = 1.5  # least width of material between two holes; a window needs twice this width
PARALLEL = math.pi / 6.0  # in rad; if two sides enclose less, a shoe's screws are in line
SHOE_SCREWS = (15.0, 15.0), (14.0, 28.0)  # distances from the toe, in mm: on two sides, and in line


def radii(build: Build) -> tuple[float, float, float, float]:
    """Return the radii of a pin, a hole that turns on the pin, the shaft and a hub, in mm."""
    pin = 1e3 * build.pin_radius
    return pin, pin + 1e3 * build.bush, 1e3 * build.shaft_radius, 1e3 * build.hub_radius


def pin_hole_radii(robot: Robot, body: int) -> dict[str, float]:
    """Return the radius of each joint's hole in a body, in mm.

    The body that holds the pin has a hole for the pin. Every other body has a hole for a bush.

    Args:
        robot: Robot whose body has the holes.
        body: Number of the body, from 1 on.
    """
    build = robot.build
    holders = {pin.joint: pin.other for pin in reversed(robot.linkage.pins)}
    pin, bush, shaft, _ = radii(build)
    joints = robot.linkage.bodies[body - 1][1]
    holes = {joint: pin if holders[joint] == body else bush for joint in joints if joint in holders}
    if body in (FRAME, CRANK):  # holes for the shaft's bush, or for the hub's spigot
        axis = robot.linkage.bodies[CRANK - 1][1][0]
        spigot = build is ALUMINIUM and body == CRANK
        holes[axis] = pin if spigot else shaft + bush - pin
    return holes


def feet_of(robot: Robot, body: int) -> list[str]:
    """Return the names of the toes whose treads a body carries.

    Args:
        robot: Robot that the body belongs to.
        body: Number of the body, from 1 on.
    """
    toes = robot.linkage.all_pads[: len(robot.linkage.toes)]
    return [robot.linkage.joints[joint] for joint, index in toes if index == body - 1]


def hole_rows(robot: Robot) -> tuple[Array, Bools]:
    """Return the arrays from which the engine computes the holes of a leg's links.

    See :func:`jansen_env.engine.cutting.put_holes`.

    Returns:
        The radius of each joint's hole in each body, in mm, and whether each joint of each body is
        a toe whose tread the body carries. Both have the shape (bodies, most joints).
    """
    joints = [letters for _, letters in robot.linkage.bodies]
    shape = len(joints), max(map(len, joints))
    of_joints = np.zeros(shape)
    feet = np.zeros(shape, bool)
    for k, letters in enumerate(joints):
        holes = pin_hole_radii(robot, k + 1)
        toes = feet_of(robot, k + 1)
        of_joints[k, : len(letters)] = [holes.get(joint, 0.0) for joint in letters]
        feet[k, : len(letters)] = [joint in toes for joint in letters]
    return of_joints, feet


def cutting_row(robot: Robot, sheet: tuple[float, float] = (math.inf, math.inf)) -> Rows:
    """Return the sizes by which a robot's parts are cut.

    Args:
        robot: Robot whose parts are cut.
        sheet: Longer and shorter side of the sheets, in mm.

    Returns:
        Record of type ``CUTTING``, in mm, shape (1,).
    """
    build = robot.build
    has_shoes = build is ALUMINIUM
    row = np.zeros(1, CUTTING)
    row["wall"] = WALL
    row["frame_width"] = 1e3 * build.frame_width
    row["width"] = 1e3 * build.width
    row["outline"] = buildable.OUTLINE
    row["hub_reach"] = 1e3 * build.hub_screws
    row["hub_radius"] = M3
    row["foot_screws"] = 2 if has_shoes else 1
    row["foot_radius"] = SHOE_SCREW if has_shoes else M3
    apart, behind = SHOE_SCREWS
    row["apart_first"], row["apart_second"] = apart
    row["behind_first"], row["behind_second"] = behind
    row["parallel"] = PARALLEL
    length, width = sheet
    row["sheet_length"] = length - 2.0 * MARGIN
    row["sheet_width"] = width - 2.0 * MARGIN
    return row
