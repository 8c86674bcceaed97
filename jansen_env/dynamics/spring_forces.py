"""Forces and energy of a robot's springs, from the positions of the bodies of its legs.

The functions belong to the dense equations (:mod:`jansen_env.dynamics.projection`). The reduced
equations read the energy of all springs from a table over the crank angle instead, see
:mod:`jansen_env.dynamics.reduced`.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from jansen_env.arrays import Array
from jansen_env.robot import Robot, Side, Spring, TorsionSpring
from jansen_env.robot.kinematics import coordinates
from jansen_env.robot.linkage import FRAME
from jansen_env.robot.spring import carrier

TURN_SAMPLES = 256  # number of crank angles for the mean angle of a torsion spring


class SpringEnd(NamedTuple):
    """End of a linear spring on a body of a fore leg.

    The end is at the centre of mass + distance (cos, sin)(theta + offset), where theta is the angle
    of the body. On a back leg, the offset has the opposite sign.

    Attributes:
        body: Index of the body.
        distance: Distance from the centre of mass, in m.
        offset: Angle of the line from the centre of mass, in rad.
    """

    body: int
    distance: float
    offset: float


def spring_ends(robot: Robot, spring: Spring) -> tuple[SpringEnd, SpringEnd]:
    """Return both ends of a linear spring."""
    return _joint_end(robot, spring.start), (
        _joint_end(robot, spring.end) if spring.end else _chassis_end(robot, spring.anchor)
    )


def _joint_end(robot: Robot, joint: str) -> SpringEnd:
    """Return the end of a spring at a joint."""
    body = carrier(robot.linkage, joint)
    reach, offset = robot.bodies[body].corners[robot.linkage.bodies[body][1].index(joint)]
    return SpringEnd(body, reach, offset)


def _chassis_end(robot: Robot, anchor: tuple[float, float]) -> SpringEnd:
    """Return the end of a spring at a point of the chassis, in m."""
    frame = robot.bodies[FRAME - 1]
    axis = robot.linkage.members[FRAME - 1]
    reach, offset = frame.corners[axis.index(robot.linkage.axis)]
    angle = robot.frame_angle + offset
    x = reach * math.cos(angle) + anchor[0]  # from the centre of mass of the frame
    y = reach * math.sin(angle) + anchor[1]
    return SpringEnd(FRAME - 1, math.hypot(x, y), math.atan2(y, x) - robot.frame_angle)


@functools.lru_cache(maxsize=64)
def rest_angles(robot: Robot) -> tuple[float, ...]:
    """Return the rest angle of each torsion spring with its whole turns, for a fore leg, in rad.

    The angles belong to the angles of the bodies from
    :func:`jansen_env.robot.kinematics.coordinates`, unwrapped from crank angle 0 on.
    """
    psi = 2.0 * math.pi / TURN_SAMPLES * np.arange(TURN_SAMPLES)
    angles = np.unwrap(coordinates(robot, "fore", psi)[:, ::3], axis=0)
    rests = []
    for spring in robot.springs:
        if isinstance(spring, TorsionSpring):
            first, second = map(robot.linkage.names.index, (spring.first, spring.second))
            mean = float((angles[:, second] - angles[:, first]).mean()) - spring.rest_angle
            rests.append(spring.rest_angle + 2.0 * math.pi * round(mean / (2.0 * math.pi)))
    return tuple(rests)


def torsion_deflections(robot: Robot, side: Side, x: Array) -> Array:
    """Return the deflection of each torsion spring of a leg, in rad, shape (..., springs).

    It is the angle of the spring minus its rest angle, on the branch that contains it in a turn of
    the crank with the mean deflection nearest to 0. On a back leg, all deflections have the
    opposite sign of those of the mirrored leg.

    Args:
        robot: The robot.
        side: Side of the leg.
        x: Coordinates of the leg, in rad and m, shape (..., 3 bodies).
    """
    springs = [each for each in robot.springs if isinstance(each, TorsionSpring)]
    deflections = np.empty((*x.shape[:-1], len(springs)))
    mirror = 1.0 if side == "fore" else -1.0
    for k, (spring, rest) in enumerate(zip(springs, rest_angles(robot), strict=True)):
        first, second = map(robot.linkage.names.index, (spring.first, spring.second))
        low, high = _range_of(robot, first, second)
        angle = mirror * (x[..., 3 * second] - x[..., 3 * first])
        middle = 0.5 * (low + high)
        turns = np.round((angle - middle) / (2.0 * math.pi))
        deflections[..., k] = mirror * (angle - 2.0 * math.pi * turns - rest)
    return deflections


@functools.lru_cache(maxsize=256)
def _range_of(robot: Robot, first: int, second: int) -> tuple[float, float]:
    """Return the smallest and largest angle between two bodies over a turn, unwrapped, in rad."""
    psi = 2.0 * math.pi / TURN_SAMPLES * np.arange(TURN_SAMPLES)
    angles = np.unwrap(coordinates(robot, "fore", psi)[:, ::3], axis=0)
    between = angles[:, second] - angles[:, first]
    return float(between.min()), float(between.max())


def spring_lengths(robot: Robot, side: Side, x: Array) -> Array:
    """Return the length of each linear spring of a leg, in m, shape (..., springs).

    Args:
        robot: The robot.
        side: Side of the leg.
        x: Coordinates of the leg, in rad and m, shape (..., 3 bodies).
    """
    springs = [each for each in robot.springs if isinstance(each, Spring)]
    lengths = np.empty((*x.shape[:-1], len(springs)))
    for k, spring in enumerate(springs):
        first, second = spring_ends(robot, spring)
        start, _ = end_position(first, side, x)
        end, _ = end_position(second, side, x)
        lengths[..., k] = np.linalg.norm(end - start, axis=-1)
    return lengths


def end_position(end: SpringEnd, side: Side, x: Array) -> tuple[Array, Array]:
    """Return the position of an end of a spring, and its arm about the centre of mass of the body.

    Returns:
        Position and arm, in m, both of shape (..., 2).
    """
    column = 3 * end.body
    angle = x[..., column] + (end.offset if side == "fore" else -end.offset)
    arm = end.distance * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return x[..., column + 1 : column + 3] + arm, arm


def spring_forces(robot: Robot, sides: tuple[Side, ...], X: Array) -> Array:
    """Return the generalised forces of all springs on the bodies of all legs.

    Args:
        robot: The robot.
        sides: Side of each leg.
        X: Coordinates of the legs, in rad and m, shape (..., legs, 3 bodies).

    Returns:
        Forces in N m and N, in the order of the coordinates, shape (..., legs, 3 bodies).
    """
    h = np.zeros(X.shape)
    for leg, side in enumerate(sides) if robot.springs else ():
        _add_spring_forces(robot, side, X[..., leg, :], h[..., leg, :])
    return h


def _add_spring_forces(robot: Robot, side: Side, x: Array, h: Array) -> None:
    """Add the generalised forces of the springs of a leg to ``h``, shape (..., 3 bodies)."""
    for spring in robot.springs:
        if not isinstance(spring, Spring):
            continue
        first, second = spring_ends(robot, spring)
        start, first_arm = end_position(first, side, x)
        end, second_arm = end_position(second, side, x)
        way = end - start
        length = np.linalg.norm(way, axis=-1, keepdims=True)
        stretch = length - spring.rest_length
        pull = spring.stiffness * stretch * np.divide(way, length, where=length > 0.0, out=way)
        for place, arm, force in ((first, first_arm, pull), (second, second_arm, -pull)):
            column = 3 * place.body
            h[..., column] += arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0]
            h[..., column + 1 : column + 3] += force
    deflections = torsion_deflections(robot, side, x)
    k = 0
    for spring in robot.springs:
        if isinstance(spring, TorsionSpring):
            torque = spring.stiffness * deflections[..., k]
            h[..., 3 * robot.linkage.names.index(spring.first)] += torque
            h[..., 3 * robot.linkage.names.index(spring.second)] -= torque
            k += 1
