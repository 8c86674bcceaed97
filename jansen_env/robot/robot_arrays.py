"""Arrays of a robot's leg for the compiled kernels.

The web page makes the same arrays from a robot file.
"""

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
from jansen_env.robot.spring import Spring, TorsionSpring

NUMBERS = (LINK.names or ())[1:]


class LegLinks(NamedTuple):
    """Links of a leg, in the form of :mod:`jansen_env.engine.link_shapes`.

    Attributes:
        links: Records of type ``LINK``, shape (bodies,).
        points: Positions of the joints of plates, in m, shape (bodies, most joints, 2). The values
            of other links are 0.
        members: Indices of the joints of each body, shape (bodies, most joints). An entry of -1
            stands for no joint.
    """

    links: Rows
    points: Array
    members: Ints


class Closing(NamedTuple):
    """Arrays from which the positions of a leg's joints are computed.

    See :mod:`jansen_env.engine.closure`.

    Attributes:
        frame_angle: Angle of the frame in the chassis, in rad.
        members: Indices of the joints of each body, shape (bodies, most joints). An entry of -1
            stands for no joint.
        corners: Joints of each body in polar coordinates, in m and rad, shape (bodies, most joints,
            2).
        dyads: Three joints, branch and two bodies of each dyad, shape (dyads, 6).
        spans: Lengths of the two links of each dyad, in m, shape (dyads, 2).
    """

    frame_angle: float
    members: Ints
    corners: Array
    dyads: Ints
    spans: Array


class SpringRows(NamedTuple):
    """Springs of a leg; see :func:`jansen_env.engine.reduction.compile_tables`.

    Attributes:
        springs: Joints at the ends of each linear spring, shape (springs, 2). The second index is
            -1 for a point of the chassis.
        spring_values: Stiffness (N/m) and rest length (m) of these springs, and the point of the
            chassis (x, y, m), shape (springs, 4).
        torsion: Indices of the two bodies of each torsion spring, shape (torsion springs, 2).
        torsion_values: Stiffness (N m/rad) and rest angle (rad) of these springs, shape (torsion
            springs, 2).
    """

    springs: Ints
    spring_values: Array
    torsion: Ints
    torsion_values: Array


def spring_rows(robot: Robot) -> SpringRows:
    """Return the springs of a leg as arrays."""
    linkage = robot.linkage
    linear = [spring for spring in robot.springs if isinstance(spring, Spring)]
    torsion = [spring for spring in robot.springs if isinstance(spring, TorsionSpring)]
    ends = [
        (linkage.joints.index(each.start), linkage.joints.index(each.end) if each.end else -1)
        for each in linear
    ]
    bodies = [tuple(map(linkage.names.index, (each.first, each.second))) for each in torsion]
    values = [(each.stiffness, each.rest_length, *each.anchor) for each in linear]
    torsion_values = [(each.stiffness, each.rest_angle) for each in torsion]
    return SpringRows(
        np.array(ends, np.int64).reshape(-1, 2),
        np.array(values, float).reshape(-1, 4),
        np.array(bodies, np.int64).reshape(-1, 2),
        np.array(torsion_values, float).reshape(-1, 2),
    )


def leg_links(robot: Robot) -> LegLinks:
    """Return the links of a robot's leg."""
    members = robot.linkage.padded_members
    points = np.zeros((*members.shape, 2))
    for k, link in enumerate(robot.bodies):
        if places := getattr(link, "points", None):
            points[k, : len(places)] = places
    return LegLinks(np.array([*map(_row, robot.bodies)], LINK), points, members)


def _row(link: Link) -> tuple[float, ...]:
    """Return the values of a link as a record of type ``LINK``."""
    numbers = (getattr(link, name, 0.0) for name in NUMBERS)
    return (KINDS.index(type(link).__name__), *numbers)


def closing_of(robot: Robot) -> tuple[Closing, Bools]:
    """Return the arrays from which a leg's joints are computed, and which of its bodies are bars.

    Returns:
        The arrays, and a flag for each body that tells whether it is a bar, shape (bodies,).
    """
    linkage = robot.linkage
    links, points, members = leg_links(robot)
    dyads = np.zeros((len(linkage.dyads), 6), np.int64)
    dyads[:, :4] = [
        (*map(linkage.joints.index, (joint, start, end)), branch)
        for joint, start, end, branch in linkage.dyads
    ]
    corners = np.empty_like(points)
    spans = np.empty((len(dyads), 2))
    bars = np.empty(len(links), bool)
    assemble(links, points, members, dyads, corners, bars, spans)
    return Closing(robot.frame_angle, members, corners, dyads, spans), bars


def leg_rows(robot: Robot) -> Array:
    """Return side (1 for fore, -1 for back) and phase (rad) of each leg, shape (legs, 2)."""
    return np.array([(1.0 if leg.side == "fore" else -1.0, leg.phase) for leg in robot.legs])


def toe_joints(robot: Robot) -> Ints:
    """Return the indices of the joints of a leg that are toes."""
    return np.array([joint for joint, _ in robot.linkage.all_pads[: len(robot.linkage.toes)]])


def chassis_row(robot: Robot) -> Rows:
    """Return the values of a robot that do not belong to its links or legs.

    Returns:
        Record of type ``CHASSIS``, shape (1,).
    """
    row = np.zeros(1, CHASSIS)
    row["frame_angle"] = robot.frame_angle
    row["pad_radius"] = robot.pad_radius
    for name in ("payload", "motor", "pad_compliance"):
        part = getattr(robot, name)
        for field in fields(part):
            row[name][field.name] = getattr(part, field.name)
    return row


def machine_row(robot: Robot) -> Rows:
    """Return the record of a robot without the parameters of an episode.

    In this record the crank is free, and the robot is weightless on level ground without friction.
    The reach of its pads and its advance per turn of the crank are not set.

    Returns:
        Record of type ``MACHINE``, shape (1,).
    """
    row = np.zeros(1, MACHINE)
    links = leg_links(robot).links
    friction = np.array(robot.bearing_friction)
    work = np.empty((2, len(links) + 1))
    stiffness = np.array([spring.stiffness for spring in robot.springs], float)
    put_machine(links, len(robot.legs), chassis_row(robot), friction, stiffness, work, row)
    return row
