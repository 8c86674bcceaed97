"""Positions of the joints as functions of the crank angle, by intersecting circles.

Unless stated otherwise, positions are in the chassis frame. Its origin is the crank axis O, and +x
is the walking direction. A back leg is the mirror image of a fore leg: x becomes -x, and the crank
angle psi becomes pi - psi.
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
"""Indices of the joints of Jansen's leg. T is the centre of the toe."""

TURN_SAMPLES = 720  # number of crank angles per turn
STANCE = 0.01  # greatest height of a toe in stance above the ground, divided by the standing height
TINY_TURN = 1e-6  # change of the crank angle for difference quotients, in rad


class LinkageError(ValueError):
    """Error for a robot that cannot turn its crank through a full turn, or cannot stand."""


def joint_positions(robot: Robot, side: Side, psi: ArrayLike) -> Array:
    """Return the positions of the joints of one leg.

    Args:
        robot: Robot with the links of the leg. Its legs are not used.
        side: Side of the leg, ``"fore"`` or ``"back"``.
        psi: Angle of the leg's crank relative to the chassis, in rad, any shape.

    Returns:
        Positions in the chassis frame, in m, in the order of ``robot.linkage.joints``, shape (...,
        joints, 2).

    Raises:
        LinkageError: If the linkage does not close. The message names the joint and the crank
            angle.
    """
    angle = np.asarray(psi, dtype=float)
    if side == "back":
        mirrored = joint_positions(robot, "fore", math.pi - angle)
        return mirrored * np.array([-1.0, 1.0])
    given = np.ascontiguousarray(angle.ravel())
    joints = robot.linkage.joints
    places = np.empty((given.size, len(joints), 2))
    fault = np.zeros(2)
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
        closing: Arrays from which the positions of its joints are computed.
        dyad: Index of the dyad.
        angle: Crank angle, in rad.
        span: Distance that the dyad cannot span, in m.
    """
    joint, *_, start, end = closing.dyads[dyad]
    first = robot.linkage.names[start]
    second = robot.linkage.names[end]
    of_first, of_second = closing.spans[dyad]
    return LinkageError(
        f"joint {robot.linkage.joints[joint]} does not close at crank angle {angle:.4f} rad: "
        f"{first} of {of_first:.5f} m and {second} of {of_second:.5f} m cannot span {span:.5f} m"
    )


def coordinates(robot: Robot, side: Side, psi: ArrayLike, joints: Array | None = None) -> Array:
    """Return the generalised coordinates of a leg in the chassis frame, equation (1) of the paper.

    Args:
        robot: Robot with the links of the leg. Its legs are not used.
        side: Side of the leg, ``"fore"`` or ``"back"``.
        psi: Angle of the leg's crank relative to the chassis, in rad, any shape.
        joints: Result of :func:`joint_positions` for the same arguments. None to compute it.

    Returns:
        theta_1, x_1, y_1, theta_2, ... in rad and m, shape (..., 3 bodies). theta_2 is ``psi``
        and is not wrapped. All other angles are in (-pi, pi].

    Raises:
        LinkageError: If the linkage does not close.
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
    """Return the magnitudes of relative angular speeds of pairs of bodies, per crank speed.

    Args:
        robot: The robot.
        angles: Crank angles of the robot, in rad, any shape.
        pairs: Pairs of numbers of bodies, from 1.

    Returns:
        Relative angular speeds divided by the crank speed, at least 0, shape (..., legs, pairs).

    Raises:
        LinkageError: If the linkage does not close.
    """
    angle = np.asarray(angles, float)
    rates = []
    for leg in robot.legs:
        middle = angle + leg.phase
        ahead = coordinates(robot, leg.side, middle + TINY_TURN)[..., ::3]
        behind = coordinates(robot, leg.side, middle - TINY_TURN)[..., ::3]
        change = (ahead - behind + math.pi) % (2.0 * math.pi) - math.pi
        rates.append(change / (2.0 * TINY_TURN))
    slope = np.stack(rates, axis=-2)
    first, second = np.array(pairs).T - 1
    return np.asarray(np.abs(slope[..., second] - slope[..., first]))


def check_closure(robot: Robot) -> None:
    """Check that the crank can turn through a full turn.

    Raises:
        LinkageError: If the linkage does not close. The message names the joint and the crank
            angle.
    """
    joint_positions(robot, "fore", np.linspace(-math.pi, math.pi, TURN_SAMPLES, endpoint=False))


def nearest_dead_point(robot: Robot, samples: int = TURN_SAMPLES) -> tuple[float, str, float]:
    """Find the crank angle at which the linkage is nearest to a dead point.

    At a dead point, two links that meet in a joint are in line.

    Args:
        robot: The robot.
        samples: Number of crank angles in the turn.

    Returns:
        Sine of the angle between the two links, the name of the joint, and the angle of the leg's
        crank in rad.

    Raises:
        LinkageError: If the linkage does not close.
    """
    psi = np.linspace(-math.pi, math.pi, samples, endpoint=False)
    out = np.empty(2)
    places = joint_positions(robot, "fore", psi)
    closing, _ = closing_of(robot)
    dyad = robot.linkage.dyads[closure.nearest_dead_point(places, closing.dyads, out)]
    return float(out[0]), dyad.joint, float(psi[int(out[1])])


def advance_per_turn(robot: Robot, samples: int = TURN_SAMPLES) -> float:
    """Return the advance of the robot in one counter-clockwise turn of its crank, in m.

    The advance is negative if the robot walks towards -x. It is computed for a robot that stays
    level and stands on its lowest toe. It therefore gives only the sign and the order of magnitude
    of the actual advance.

    Args:
        robot: The robot.
        samples: Number of steps into which the turn is divided.

    Raises:
        LinkageError: If the linkage does not close.
    """
    psi = np.empty(samples + 1)
    put_angles_to_end(2.0 * math.pi, psi)
    places = joints_of_legs(robot, psi)
    advance: float = advance_over_turn(places, toe_joints(robot), np.empty(samples))
    return advance


def toe_positions(robot: Robot, psi: ArrayLike) -> Array:
    """Return the positions of all toes in the chassis frame.

    Args:
        robot: The robot.
        psi: Crank angles, in rad, any shape.

    Returns:
        Positions in m, shape (..., toes, 2).

    Raises:
        LinkageError: If the linkage does not close.
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
    closing, _ = closing_of(robot)
    legs = leg_rows(robot)
    count = len(psi)
    angles = np.empty((len(legs), count))
    places = np.empty((len(legs), count, len(robot.linkage.joints), 2))
    fault = np.zeros(3)
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
    """Return the positions of the joints of all legs in the world frame.

    Args:
        robot: The robot.
        q: Position x, y of the crank axis (m), chassis pitch theta and crank angle psi (rad), shape
            (..., 4).

    Returns:
        Positions in m, in the order of ``robot.linkage.joints``, shape (..., legs, joints, 2).

    Raises:
        LinkageError: If the linkage does not close.
    """
    pose = np.asarray(q, dtype=float)
    joints = _joints_at(robot, pose[..., 3])
    c, s = np.moveaxis(directions(pose[..., 2, None, None]), -1, 0)
    x, y = joints[..., 0], joints[..., 1]
    turned = np.stack([c * x - s * y, s * x + c * y], axis=-1)
    return turned + pose[..., None, None, :2]
