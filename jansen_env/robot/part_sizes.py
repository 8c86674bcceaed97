"""Sizes of the holes and walls of buildable parts, which the drawings and the design page share."""

from __future__ import annotations

import math

from jansen_env.robot import Robot
from jansen_env.robot.buildable import ALUMINIUM, Build
from jansen_env.robot.linkage import CRANK, FRAME

MARGIN = 5.0  # mm, distance between parts, and from a part to the edge of a sheet
M3 = 1.6  # radius of a hole for an M3 screw
SHOE_SCREW = 2.25  # radius of a hole for an M4 screw
WALL = 1.5  # least width of material between two holes; a window needs twice this width
PARALLEL = math.pi / 6.0  # rad; if two sides enclose less, a shoe's screws lie behind one another
SHOE_SCREWS = (15.0, 15.0), (14.0, 28.0)  # mm from the toe: on two sides; behind one another


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
