"""Positions of the joints from the crank angle: the linkage closed by intersecting circles.

Everything is in the chassis frame: crank axis O at the origin, +x the walking direction. A back
leg is the mirror image of a fore leg: x -> -x and crank angle psi -> pi - psi.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jansen_env.engine.mathematics import angles_of, atan2, cos, directions, lengths_of, sin
from jansen_env.robot.linkage import CRANK, FRAME, JANSEN
from jansen_env.robot.links import Bar, Link, Side
from jansen_env.robot.robot import Robot

Array = NDArray[np.float64]

P, O, A, B, C, D, E, T = range(len(JANSEN.joints))  # noqa: E741 - the joints' names
"""Indices of the joints of Jansen's leg; T is the toe's centre."""


TINY_TURN = 1e-6  # rad, of the crank, for slopes


class LinkageError(ValueError):
    """A design that cannot turn a full revolution."""


def _third_corner(
    name: str, psi: Array, p: Array, q: Array, from_p: float, from_q: float, turn: float
) -> Array:
    """Corner at ``from_p`` from p and ``from_q`` from q, left (turn=1) or right (-1) of p -> q."""
    span = q - p
    distance = lengths_of(span)
    along = (distance**2 + (from_p * from_p - from_q * from_q)) / (2.0 * distance)
    across2 = from_p * from_p - along**2
    if not np.all(across2 > 0.0):
        worst = np.unravel_index(np.argmin(across2), across2.shape)
        raise LinkageError(
            f"joint {name} does not close at crank angle {float(psi[worst]):.4f} rad: its two "
            f"links of {from_p:.5f} m and {from_q:.5f} m cannot span {float(distance[worst]):.5f} m"
        )
    unit = span / distance[..., None]
    left = np.stack([-unit[..., 1], unit[..., 0]], axis=-1)
    return p + along[..., None] * unit + turn * np.sqrt(across2)[..., None] * left


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
    linkage = robot.linkage
    places = {linkage.joints[linkage.axis]: np.zeros((*angle.shape, 2))}
    _add_joints(places, robot, FRAME - 1, np.full(angle.shape, robot.frame_angle))
    _add_joints(places, robot, CRANK - 1, angle)
    for dyad in linkage.dyads:
        first, second = (linkage.body_between(dyad.joint, end) for end in dyad[1:3])
        places[dyad.joint] = _third_corner(
            dyad.joint, angle, places[dyad.start], places[dyad.end],
            _between(robot, first, dyad.start, dyad.joint),
            _between(robot, second, dyad.end, dyad.joint), dyad.branch,
        )  # fmt: skip
        for body in (first, second):
            joints = linkage.bodies[body][1]
            if len(joints) > 2:
                i, j = [k for k, joint in enumerate(joints) if joint in places][:2]
                edge = places[joints[j]] - places[joints[i]]
                half_turn, turn = _edge_to_angle(robot.bodies[body], i, j)
                heading = angles_of(edge) + half_turn + turn
                _add_joints(places, robot, body, heading)
    return np.stack([places[joint] for joint in linkage.joints], axis=-2)


def _add_joints(places: dict[str, Array], robot: Robot, body: int, heading: Array) -> None:
    """Add all joints of a body whose angle is known, and one of its joints."""
    joints, corners = robot.linkage.bodies[body][1], robot.bodies[body].corners
    first = next(k for k, joint in enumerate(joints) if joint in places)
    reach, offset = corners[first]
    centre = places[joints[first]] - reach * directions(heading + offset)
    for joint, (reach, offset) in zip(joints, corners, strict=True):
        if joint not in places:
            places[joint] = centre + reach * directions(heading + offset)


def _between(robot: Robot, body: int, a: str, b: str) -> float:
    """Distance between two joints of a body, m."""
    joints = robot.linkage.bodies[body][1]
    return robot.bodies[body].distance(joints.index(a), joints.index(b))


def _edge_to_angle(link: Link, i: int, j: int) -> tuple[float, float]:
    """Turn from the edge between two joints of a link to its angle: half a turn or none, and more.

    For a link whose angle points to the first of them the edge is taken the other way round.
    """
    (r, a), (s, b) = link.corners[i], link.corners[j]
    way = -1.0 if r > 0.0 else 1.0
    x = way * (s * cos(b) - r * cos(a))
    y = way * (s * sin(b) - r * sin(a))
    return (math.pi if r > 0.0 else 0.0), -atan2(y, x)


def coordinates(robot: Robot, side: Side, psi: ArrayLike, joints: Array | None = None) -> Array:
    """Generalised coordinates (1) of a leg with the chassis at rest in its own frame.

    Args and errors as for :func:`joint_positions`; joints: what that gives, where it is known.

    Returns:
        (..., 3 bodies): theta_1, x_1, y_1, ... in rad and m. theta_2 is ``psi``, not wrapped; the
        other angles lie in (-pi, pi].
    """
    place = joint_positions(robot, side, psi) if joints is None else joints
    mirror = 1.0 if side == "fore" else -1.0
    x = np.empty((*place.shape[:-2], len(robot.bodies), 3))
    for body, link in enumerate(robot.bodies):
        i, j, *_ = robot.linkage.members[body]
        edge = place[..., j, :] - place[..., i, :]
        heading = angles_of(edge)
        if isinstance(link, Bar):
            x[..., body, 1:] = place[..., [i, j], :].mean(axis=-2)
        else:
            half_turn, turn = _edge_to_angle(link, 0, 1)
            heading = heading + half_turn + mirror * turn
            reach, offset = link.corners[0]
            centre = place[..., i, :] - reach * directions(heading + mirror * offset)
            x[..., body, 1:] = centre
        x[..., body, 0] = heading
    x[..., 0] -= 2.0 * math.pi * np.ceil(x[..., 0] / (2.0 * math.pi) - 0.5)
    x[..., CRANK - 1, 0] = psi
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


def check_closure(robot: Robot, samples: int = 720) -> None:
    """Raise LinkageError for a design that cannot turn a full revolution: says where."""
    joint_positions(robot, "fore", np.linspace(-math.pi, math.pi, samples, endpoint=False))


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
