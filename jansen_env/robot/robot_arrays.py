"""Arrays of a robot's leg as kernels read them, the same as a page makes from a robot file."""

from __future__ import annotations

from dataclasses import fields
from typing import NamedTuple

import numpy as np

from jansen_env.arrays import Array, Bools, Ints, Rows
from jansen_env.engine.link_shapes import KINDS, LINK, assemble
from jansen_env.engine.machines import CHASSIS, put_machine
from jansen_env.engine.records import MACHINE
from jansen_env.robot.links import Link
from jansen_env.robot.robot import Robot

NUMBERS = (LINK.names or ())[1:]


class LegLinks(NamedTuple):
    """Links of a leg, see :mod:`jansen_env.engine.link_shapes`."""

    links: Rows  # (bodies,) LINK
    points: Array  # (bodies, most joints, 2) m, of plates
    members: Ints  # (bodies, most joints)


class Closing(NamedTuple):
    """How a leg is closed, see :mod:`jansen_env.engine.closure`."""

    frame_angle: float  # rad
    members: Ints  # (bodies, most joints)
    corners: Array  # (bodies, most joints, 2)
    dyads: Ints  # (dyads, 6)
    spans: Array  # (dyads, 2) m


def leg_links(robot: Robot) -> LegLinks:
    """Return the links of a robot's leg."""
    members = robot.linkage.members
    shape = len(members), max(map(len, members))
    joints, points = np.full(shape, -1), np.zeros((*shape, 2))
    for k, link in enumerate(robot.bodies):
        joints[k, : len(members[k])] = members[k]
        if places := getattr(link, "points", None):
            points[k, : len(places)] = places
    return LegLinks(np.array([*map(_row, robot.bodies)], LINK), points, joints)


def _row(link: Link) -> tuple[float, ...]:
    """Return the numbers of a link as a row of ``LINK``."""
    numbers = (getattr(link, name, 0.0) for name in NUMBERS)
    return (KINDS.index(type(link).__name__), *numbers)


def closing_of(robot: Robot) -> tuple[Closing, Bools]:
    """Return how a robot's leg is closed, and whether each of its bodies is a bar."""
    linkage = robot.linkage
    links, points, members = leg_links(robot)
    dyads = np.zeros((len(linkage.dyads), 6), np.int64)
    dyads[:, :4] = [
        (*map(linkage.joints.index, (joint, start, end)), branch)
        for joint, start, end, branch in linkage.dyads
    ]
    corners, spans = np.empty_like(points), np.empty((len(dyads), 2))
    bars = np.empty(len(links), bool)
    assemble(links, points, members, dyads, corners, bars, spans)
    return Closing(robot.frame_angle, members, corners, dyads, spans), bars


def leg_rows(robot: Robot) -> Array:
    """Return the legs of a robot (legs, 2): 1 of a fore leg and -1 of a back leg; and phase."""
    return np.array([(1.0 if leg.side == "fore" else -1.0, leg.phase) for leg in robot.legs])


def toe_joints(robot: Robot) -> Ints:
    """Return the joints of a leg that are toes."""
    return np.array([joint for joint, _ in robot.linkage.all_pads[: len(robot.linkage.toes)]])


def chassis_row(robot: Robot) -> Rows:
    """Return what a robot has beside links and legs (1,), ``CHASSIS``."""
    row = np.zeros(1, CHASSIS)
    row["frame_angle"], row["pad_radius"] = robot.frame_angle, robot.pad_radius
    for name in ("payload", "motor", "pad_compliance"):
        part = getattr(robot, name)
        for field in fields(part):
            row[name][field.name] = getattr(part, field.name)
    return row


def machine_row(robot: Robot) -> Rows:
    """Return what a robot is without parameters (1,), ``MACHINE``.

    Its crank is free, and it is weightless on level slippery ground. How far its pads get, and how
    it advances, is not known yet.
    """
    row, links = np.zeros(1, MACHINE), leg_links(robot).links
    friction, work = np.array(robot.bearing_friction), np.empty((2, len(links) + 1))
    put_machine(links, len(robot.legs), chassis_row(robot), friction, work, row)
    return row
