"""A robot as pymunk bodies: one for each link, a joint for each pin, a circle for each pad.

All frames and the load are one body, all cranks another; every other link is one of its own.
"""

from __future__ import annotations

import functools
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
import pymunk
from numpy.typing import NDArray

from jansen_env.dynamics.pads import Pads, pad_layout
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import coordinates, joint_positions, world_joints
from jansen_env.robot.linkage import CRANK

Array = NDArray[np.float64]

CHASSIS, SHAFT = 0, 1  # places of the bodies that all legs share; then those of each leg
GAP_LEFT = 0.5  # share of a joint's gap left after one second; the rest is pulled together
TURN = 24  # crank angles at which a robot's lightest spots are looked for


def place_of(robot: Robot, leg: int, body: int) -> int:
    """Index of body 1, 2, ... of a leg: frames are the chassis, cranks the shaft."""
    return body - 1 + (body > CRANK) * leg * (len(robot.bodies) - CRANK)


def count_bodies(robot: Robot) -> int:
    """How many there are."""
    return place_of(robot, len(robot.legs), CRANK + 1)


@functools.lru_cache(maxsize=8 * TURN)
def _local_bodies(robot: Robot, crank_angle: float) -> Array:
    """(legs, bodies, 3) angle, x, y of every link in the chassis frame."""
    legs = [coordinates(robot, leg.side, crank_angle + leg.phase) for leg in robot.legs]
    bodies = np.array(legs).reshape(len(legs), -1, 3)
    bodies.setflags(write=False)
    return bodies


def _lumps(robot: Robot) -> list[tuple[float, float, Array]]:
    """Mass, inertia and centre (at crank angle 0) of the chassis and of the shaft."""
    home, lumps = _local_bodies(robot, 0.0), []
    for k in (CHASSIS, SHAFT):
        link = robot.bodies[k]
        parts = [(link.mass, link.inertia, leg[k, 1:]) for leg in home]
        load = robot.payload
        if k == CHASSIS and (load.mass > 0.0 or load.inertia > 0.0):
            parts.append((load.mass, load.inertia, np.array(load.position)))
        mass = math.fsum(m for m, _, _ in parts)
        centre = np.sum([m * r for m, _, r in parts], axis=0) / mass
        inertia = math.fsum(j + m * float((r - centre) @ (r - centre)) for m, j, r in parts)
        lumps.append((mass, inertia, centre))
    return lumps


def inertias(robot: Robot) -> Array:
    """(bodies, 2) mass, kg, and inertia about the centre of mass, kg m^2."""
    links = [(link.mass, link.inertia) for link in robot.bodies[2:]]
    return np.array([*((m, j) for m, j, _ in _lumps(robot)), *links * len(robot.legs)])


def poses(robot: Robot, q: Array) -> Array:
    """(bodies, 3) angle, x, y of every body at q = (x, y, theta, psi); angles 0 at q = 0."""
    theta, psi = float(q[2]), float(q[3])
    home, links = _local_bodies(robot, 0.0), _local_bodies(robot, psi)
    cos, sin = math.cos(psi), math.sin(psi)
    (_, _, chassis), (_, _, shaft) = _lumps(robot)
    result = np.empty((count_bodies(robot), 3))
    result[CHASSIS] = 0.0, *chassis
    result[SHAFT] = psi, cos * shaft[0] - sin * shaft[1], sin * shaft[0] + cos * shaft[1]
    result[2:] = links[:, 2:].reshape(-1, 3)
    turned = links[:, 2:, 0] - home[:, 2:, 0]
    result[2:, 0] = ((turned + math.pi) % (2.0 * math.pi) - math.pi).ravel()
    cos, sin = math.cos(theta), math.sin(theta)
    x, y = result[:, 1].copy(), result[:, 2].copy()
    result[:, 0] += theta
    result[:, 1], result[:, 2] = q[0] + cos * x - sin * y, q[1] + sin * x + cos * y
    return result


def rates(robot: Robot, q: Array, v: Array) -> Array:
    """(bodies, 3) rates of :func:`poses`: differences of closed forms, good to 1e-9."""
    step = 1e-6
    q = np.array([0.0, 0.0, *(math.remainder(angle, 2.0 * math.pi) for angle in q[2:])])
    change = poses(robot, q + step * v) - poses(robot, q - step * v)
    change[:, 0] = (change[:, 0] + math.pi) % (2.0 * math.pi) - math.pi
    return change / (2.0 * step)


def viscous_pairs(robot: Robot) -> dict[tuple[int, int], float]:
    """Viscous friction between pairs of bodies, N m s/rad: joints and motor, without zeros."""
    each = zip(robot.linkage.damped, robot.damping, strict=True)
    return _summed(robot, each, robot.motor.viscous_friction)


def joint_friction(robot: Robot) -> Array:
    """(bodies, bodies) K: the viscous torques of joints and motor on the bodies are -K times
    their spins."""
    K = np.zeros((count_bodies(robot), count_bodies(robot)))
    for (a, b), coefficient in viscous_pairs(robot).items():
        K[a, a] += coefficient
        K[b, b] += coefficient
        K[a, b] -= coefficient
        K[b, a] -= coefficient
    return K


def dry_pairs(robot: Robot) -> dict[tuple[int, int], float]:
    """Coulomb friction torque between pairs of bodies, N m: bearings and gear, without zeros."""
    each = zip(robot.linkage.bearings, robot.bearing_friction, strict=True)
    return _summed(robot, each, robot.motor.friction)


def _summed(
    robot: Robot, of_a_leg: Iterable[tuple[tuple[int, int], float]], motor: float
) -> dict[tuple[int, int], float]:
    """What each leg has between its bodies, and the motor, between the bodies that legs share."""
    total: dict[tuple[int, int], float] = defaultdict(float)
    pairs = [*of_a_leg]
    for leg in range(len(robot.legs)):
        for (i, j), value in pairs:
            total[place_of(robot, leg, i), place_of(robot, leg, j)] += value
    total[CHASSIS, SHAFT] += motor
    return {pair: value for pair, value in total.items() if value > 0.0}


def make_dry_joints(robot: Robot, bodies: list[pymunk.Body]) -> list[pymunk.SimpleMotor]:
    """Joints that hold two bodies' spins together up to their dry friction torque."""
    joints = []
    for (a, b), torque in dry_pairs(robot).items():
        joint = pymunk.SimpleMotor(bodies[a], bodies[b], 0.0)
        joint.max_force = torque
        joints.append(joint)
    return joints


class TurnMotion(NamedTuple):
    """A level robot at a crank angle: how its bodies move with each rate of q."""

    poses: Array  # (bodies, 3), see :func:`poses`
    rates: Array  # (4, bodies, 3) of these per rate of q
    mass_matrix: Array  # (4, 4)
    pads: Array  # (pads, 2) their centres, m


def turn_motions(robot: Robot) -> Iterator[TurnMotion]:
    """The robot at :data:`TURN` crank angles."""
    (mass, inertia), layout = inertias(robot).T, pad_layout(robot)
    joints = [robot.linkage.all_pads[k][0] for k in layout.joint]
    for psi in 2.0 * math.pi * np.arange(TURN) / TURN:
        q = np.array([0.0, 0.0, 0.0, psi])
        moved = np.array([rates(robot, q, unit) for unit in np.eye(4)])
        matrix = np.einsum("ibk,bk,jbk->ij", moved, np.stack([inertia, mass, mass], 1), moved)
        pads = world_joints(robot, q)[layout.leg, joints]
        yield TurnMotion(poses(robot, q), moved, matrix, pads)


def put(bodies: list[pymunk.Body], where: Array, speed: Array) -> None:
    """Put bodies where ``where`` (n, 3) says (angle, x, y), moving at ``speed``."""
    for body, (angle, x, y), (spin, vx, vy) in zip(
        bodies, where.tolist(), speed.tolist(), strict=True
    ):
        body.angle, body.position = angle, (x, y)
        body.angular_velocity, body.velocity = spin, (vx, vy)


def make_pins(robot: Robot, bodies: list[pymunk.Body]) -> list[pymunk.PivotJoint]:
    """One joint per pin, the crank's own first; made while the bodies are at home."""
    pins = [pymunk.PivotJoint(bodies[CHASSIS], bodies[SHAFT], (0.0, 0.0))]
    for i, leg in enumerate(robot.legs):
        joints = joint_positions(robot, leg.side, leg.phase)
        for pin in robot.linkage.moving_pins:
            held, turning = (bodies[place_of(robot, i, body)] for body in (pin.other, pin.body))
            place = tuple(joints[robot.linkage.joints.index(pin.joint)])
            pins.append(pymunk.PivotJoint(held, turning, place))
    for one in pins:
        one.error_bias = GAP_LEFT
    return pins


def pad_bodies(robot: Robot, layout: Pads) -> list[int]:
    """Index of the body that each pad is part of."""
    pairs = zip(layout.leg.tolist(), layout.joint.tolist(), strict=True)
    return [place_of(robot, leg, robot.linkage.all_pads[k][1] + 1) for leg, k in pairs]


def make_pads(robot: Robot, layout: Pads, bodies: list[pymunk.Body]) -> list[pymunk.Circle]:
    """Round pads in the order of the layout; made while the bodies are at home."""
    pads = []
    for i, k, owner in zip(layout.leg, layout.joint, pad_bodies(robot, layout), strict=True):
        leg, body = robot.legs[i], bodies[owner]
        place = joint_positions(robot, leg.side, leg.phase)[robot.linkage.all_pads[k][0]]
        circle = pymunk.Circle(body, robot.pad_radius, tuple(place - np.array(body.position)))
        circle.friction = circle.elasticity = 1.0  # pymunk multiplies them with the ground's
        circle.filter = pymunk.ShapeFilter(group=1)  # legs never touch one another
        pads.append(circle)
    return pads
