"""Positions of the joints from the crank angle: the linkage closed by intersecting circles.

Everything is in the chassis frame: crank axis O at the origin, +x the walking direction. A back
leg is the mirror image of a fore leg: x -> -x and crank angle psi -> pi - psi.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array
from jansen_env.engine import closure
from jansen_env.engine.closure import (
    advance_over_turn,
    put_angles_to_end,
    put_coordinates,
    put_joints,
    put_legs,
)
from jansen_env.engine.mathematics import directions
from jansen_env.robot.linkage import JANSEN
from jansen_env.robot.links import Side
from jansen_env.robot.robot import Robot
from jansen_env.robot.robot_arrays import Closing, closing_of, leg_rows, toe_joints

P, O, A, B, C, D, E, T = range(len(JANSEN.joints))  # noqa: E741 - the joints' names
"""Indices of the joints of Jansen's leg; T is the toe's centre."""

TURN_SAMPLES = 720  # number of crank angles per turn
TINY_TURN = 1e-6  # rad, of the crank, for slopes


class LinkageError(ValueError):
    """A design that cannot turn a full revolution."""


def joint_positions(robot: Robot, side: Side, psi: ArrayLike) -> Array:
    """Joint positions of a leg whose own crank stands at ``psi``.

    Args:
        robot: its links are used, its legs are not.
        psi: crank angle relative to the chassis, rad, any shape (...).

    Returns:
        Places in the order of ``robot.linkage.joints``, (..., joints, 2), m, chassis frame.

    Raises:
        LinkageError: the linkage does not close; names the joint and the crank angle.
    """
    angle = np.asarray(psi, dtype=float)
    if side == "back":
        mirrored = joint_positions(robot, "fore", math.pi - angle)
        return mirrored * np.array([-1.0, 1.0])
    given, joints = np.ascontiguousarray(angle.ravel()), robot.linkage.joints
    places, fault = np.empty((given.size, len(joints), 2)), np.zeros(2)
    closing, _ = closing_of(robot)
    failed = put_joints(given, *closing, places, fault)
    if failed >= 0:
        raise _open_joint(robot, closing, failed, given[int(fault[0])], fault[1])
    return places.reshape(*angle.shape, len(joints), 2)


def _open_joint(
    robot: Robot, closing: Closing, dyad: int, angle: float, span: float
) -> LinkageError:
    """Return the error for a dyad that does not close.

    Args:
        robot: The robot.
        closing: Arrays with which its leg is closed.
        dyad: Index of the dyad.
        angle: Crank angle, in rad.
        span: Distance that the dyad cannot span, in m.
    """
    joint, *_, start, end = closing.dyads[dyad]
    first, second = (robot.linkage.names[body] for body in (start, end))
    of_first, of_second = closing.spans[dyad]
    return LinkageError(
        f"joint {robot.linkage.joints[joint]} does not close at crank angle {angle:.4f} rad: "
        f"{first} of {of_first:.5f} m and {second} of {of_second:.5f} m cannot span {span:.5f} m"
    )


def coordinates(robot: Robot, side: Side, psi: ArrayLike, joints: Array | None = None) -> Array:
    """Generalised coordinates (1) of a leg with the chassis at rest in its own frame.

    Args and errors as for :func:`joint_positions`; joints: what that gives, where it is known.

    Returns:
        (..., 3 bodies): theta_1, x_1, y_1, ... in rad and m. theta_2 is ``psi``, not wrapped; the
        other angles lie in (-pi, pi].
    """
    place = joint_positions(robot, side, psi) if joints is None else joints
    mirror = 1.0 if side == "fore" else -1.0
    angle = np.ascontiguousarray(np.asarray(psi, float).ravel())
    x = np.empty((angle.size, len(robot.bodies), 3))
    places = np.ascontiguousarray(place.reshape(-1, *place.shape[-2:]))
    closing, bars = closing_of(robot)
    put_coordinates(angle, mirror, closing.members, closing.corners, bars, places, x)
    return x.reshape(*place.shape[:-2], 3 * len(robot.bodies))


def turning(robot: Robot, angles: ArrayLike, pairs: Sequence[tuple[int, int]]) -> Array:
    """Return relative angular speeds of pairs of bodies per crank speed (..., legs, pairs), >= 0.

    Args:
        angles: of the robot's crank (...), rad. pairs: numbers of two bodies each, from 1.

    Raises LinkageError: the linkage does not close.
    """
    angle, rates = np.asarray(angles, float), []
    for leg in robot.legs:
        ahead, behind = (
            coordinates(robot, leg.side, angle + leg.phase + way)[..., ::3]
            for way in (TINY_TURN, -TINY_TURN)
        )
        change = (ahead - behind + math.pi) % (2.0 * math.pi) - math.pi
        rates.append(change / (2.0 * TINY_TURN))
    slope = np.stack(rates, axis=-2)
    first, second = np.array(pairs).T - 1
    return np.asarray(np.abs(slope[..., second] - slope[..., first]))


def check_closure(robot: Robot) -> None:
    """Raise LinkageError for a design that cannot turn a full revolution: says where."""
    joint_positions(robot, "fore", np.linspace(-math.pi, math.pi, TURN_SAMPLES, endpoint=False))


def nearest_dead_point(robot: Robot, samples: int = TURN_SAMPLES) -> tuple[float, str, float]:
    """Return the crank angle nearest to a dead point: two links that meet in a joint are in line.

    Returns:
        Sine of the angle between the links there; the joint; the leg's crank angle, rad.

    Raises:
        LinkageError: the linkage does not close.
    """
    psi, out = np.linspace(-math.pi, math.pi, samples, endpoint=False), np.empty(2)
    places, (closing, _) = joint_positions(robot, "fore", psi), closing_of(robot)
    dyad = robot.linkage.dyads[closure.nearest_dead_point(places, closing.dyads, out)]
    return float(out[0]), dyad.joint, float(psi[int(out[1])])


def advance_per_turn(robot: Robot, samples: int = TURN_SAMPLES) -> float:
    """Advance in one counter-clockwise turn of the crank, m; negative: towards -x.

    As if it stood level on its lowest toe: good for the sign and the order of magnitude.
    Raises LinkageError: the linkage does not close.
    """
    psi = np.empty(samples + 1)
    put_angles_to_end(2.0 * math.pi, psi)
    places = joints_of_legs(robot, psi)
    advance: float = advance_over_turn(places, toe_joints(robot), np.empty(samples))
    return advance


def toe_positions(robot: Robot, psi: ArrayLike) -> Array:
    """Positions of all toes (..., toes, 2) at crank angles (...), m, chassis frame.

    Raises LinkageError: the linkage does not close.
    """
    joints = _joints_at(robot, np.asarray(psi, dtype=float))
    leg, joint = np.array(robot.toes).T
    return joints[..., leg, joint, :]


def joints_of_legs(robot: Robot, psi: Array) -> Array:
    """Return the positions of the joints of all legs in the chassis frame.

    Args:
        robot: The robot.
        psi: Crank angles, in rad, shape (n,).

    Returns:
        Positions in m, shape (legs, n, joints, 2).

    Raises:
        LinkageError: If the linkage does not close.
    """
    (closing, _), legs, count = closing_of(robot), leg_rows(robot), len(psi)
    angles = np.empty((len(legs), count))
    places, fault = np.empty((len(legs), count, len(robot.linkage.joints), 2)), np.zeros(3)
    failed = put_legs(psi, legs, *closing, angles, places, fault)
    if failed >= 0:
        angle = angles[int(fault[2]), int(fault[0])]
        raise _open_joint(robot, closing, failed, angle, fault[1])
    return places


def _joints_at(robot: Robot, psi: Array) -> Array:
    """Return the positions of the joints of all legs in the chassis frame.

    Args:
        robot: The robot.
        psi: Crank angles, in rad, any shape.

    Returns:
        Positions in m, shape (..., legs, joints, 2).
    """
    legs = joints_of_legs(robot, np.ascontiguousarray(psi.ravel()))
    return np.moveaxis(legs, 0, 1).reshape(*psi.shape, *legs.shape[:1], *legs.shape[2:])


def world_joints(robot: Robot, q: ArrayLike) -> Array:
    """Joint positions of all legs (..., legs, joints, 2), m, in the order of the linkage.

    Args:
        q: (..., 4) crank axis x, y (m), chassis pitch theta and crank angle psi (rad).
    """
    pose = np.asarray(q, dtype=float)
    joints = _joints_at(robot, pose[..., 3])
    c, s = np.moveaxis(directions(pose[..., 2, None, None]), -1, 0)
    x, y = joints[..., 0], joints[..., 1]
    turned = np.stack([c * x - s * y, s * x + c * y], axis=-1)
    return turned + pose[..., None, None, :2]
