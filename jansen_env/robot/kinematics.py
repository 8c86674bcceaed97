"""Positions of the joints from the crank angle: the linkage closed by intersecting circles.

Everything is in the chassis frame: crank axis O at the origin, +x the walking direction. A back
leg is the mirror image of a fore leg: x -> -x and crank angle psi -> pi - psi.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array, Bools, Ints
from jansen_env.engine.closure import put_coordinates, put_joints
from jansen_env.engine.mathematics import directions, lengths_of
from jansen_env.robot.linkage import JANSEN
from jansen_env.robot.links import Bar, Side
from jansen_env.robot.robot import Robot

P, O, A, B, C, D, E, T = range(len(JANSEN.joints))  # noqa: E741 - the joints' names
"""Indices of the joints of Jansen's leg; T is the toe's centre."""

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
    (members, corners, _), (dyads, spans) = body_arrays(robot), dyad_arrays(robot)
    failed = put_joints(given, robot.frame_angle, members, corners, dyads, spans, places, fault)
    if failed >= 0:
        first, second = (robot.linkage.names[body] for body in dyads[failed, 4:])
        raise LinkageError(
            f"joint {joints[dyads[failed, 0]]} does not close at crank angle "
            f"{given[int(fault[0])]:.4f} rad: {first} of {spans[failed, 0]:.5f} m and "
            f"{second} of {spans[failed, 1]:.5f} m cannot span {fault[1]:.5f} m"
        )
    return places.reshape(*angle.shape, len(joints), 2)


def body_arrays(robot: Robot) -> tuple[Ints, Array, Bools]:
    """Members, corners and bars as :mod:`jansen_env.engine.closure` has them."""
    members = robot.linkage.members
    shape = len(members), max(map(len, members))
    joints, corners = np.full(shape, -1), np.zeros((*shape, 2))
    for k, link in enumerate(robot.bodies):
        joints[k, : len(members[k])], corners[k, : len(members[k])] = members[k], link.corners
    return joints, corners, np.array([isinstance(link, Bar) for link in robot.bodies])


def dyad_arrays(robot: Robot) -> tuple[Ints, Array]:
    """Dyads and their spans as :func:`jansen_env.engine.closure.put_joints` has them."""
    linkage, dyads, spans = robot.linkage, list[list[int]](), list[list[float]]()
    for joint, *ends, branch in linkage.dyads:
        links = [linkage.body_between(joint, end) for end in ends]
        places = [linkage.bodies[link][1].index for link in links]
        dyads.append([*map(linkage.joints.index, (joint, *ends)), branch, *links])
        sides = zip((robot.bodies[link] for link in links), places, ends, strict=True)
        spans.append([link.distance(place(end), place(joint)) for link, place, end in sides])
    return np.array(dyads), np.array(spans)


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
    put_coordinates(angle, mirror, body_arrays(robot), places, x)
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
    joint_positions(robot, "fore", np.linspace(-math.pi, math.pi, 720, endpoint=False))


def nearest_dead_point(robot: Robot, samples: int = 720) -> tuple[float, str, float]:
    """Return the crank angle nearest to a dead point: two links that meet in a joint are in line.

    Returns:
        Sine of the angle between the links there; the joint; the leg's crank angle, rad.

    Raises:
        LinkageError: the linkage does not close.
    """
    psi = np.linspace(-math.pi, math.pi, samples, endpoint=False)
    place = joint_positions(robot, "fore", psi)
    dead_points = []
    for dyad in robot.linkage.dyads:
        joint, start, end = (place[:, robot.linkage.joints.index(name)] for name in dyad[:3])
        u, v = joint - start, joint - end
        sine = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        sine /= lengths_of(u) * lengths_of(v)
        k = int(sine.argmin())
        dead_points.append((float(sine[k]), dyad.joint, float(psi[k])))
    return min(dead_points)


def advance_per_turn(robot: Robot, samples: int = 720) -> float:
    """Advance in one counter-clockwise turn of the crank, m; negative: towards -x.

    As if it stood level on its lowest toe: good for the sign and the order of magnitude.
    Raises LinkageError: the linkage does not close.
    """
    toes = toe_positions(robot, np.linspace(0.0, 2.0 * math.pi, samples + 1))
    lowest = np.argmin(toes[1:, :, 1] + toes[:-1, :, 1], axis=1)
    steps = np.diff(toes[..., 0], axis=0)
    return float(-steps[np.arange(samples), lowest].sum())


def toe_positions(robot: Robot, psi: ArrayLike) -> Array:
    """Positions of all toes (..., toes, 2) at crank angles (...), m, chassis frame.

    Raises LinkageError: the linkage does not close.
    """
    joints = _joints_of_legs(robot, np.asarray(psi, dtype=float))
    leg, joint = np.array(robot.toes).T
    return joints[..., leg, joint, :]


def _joints_of_legs(robot: Robot, psi: Array) -> Array:
    """Joint positions of all legs (..., legs, joints, 2) at crank angles (...), chassis frame."""
    legs = [joint_positions(robot, leg.side, psi + leg.phase) for leg in robot.legs]
    return np.stack(legs, axis=-3)


def world_joints(robot: Robot, q: ArrayLike) -> Array:
    """Joint positions of all legs (..., legs, joints, 2), m, in the order of the linkage.

    Args:
        q: (..., 4) crank axis x, y (m), chassis pitch theta and crank angle psi (rad).
    """
    pose = np.asarray(q, dtype=float)
    joints = _joints_of_legs(robot, pose[..., 3])
    c, s = np.moveaxis(directions(pose[..., 2, None, None]), -1, 0)
    x, y = joints[..., 0], joints[..., 1]
    turned = np.stack([c * x - s * y, s * x + c * y], axis=-1)
    return turned + pose[..., None, None, :2]
