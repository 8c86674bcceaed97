"""A robot as pymunk bodies: one for each link, a joint for each pin, a circle for each pad.

All frames and the load are one body, all cranks another; every other link is one of its own.
"""

from __future__ import annotations

import functools
import math
from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pymunk
import pymunk.batch

from jansen_env.arrays import Array, Ints
from jansen_env.dynamics.pads import Pads, pad_layout
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import coordinates, joint_positions, world_joints
from jansen_env.robot.linkage import CRANK, FRAME
from jansen_env.terrain import Ground

_Body = pymunk.batch.BodyFields
_MOTION = _Body.POSITION | _Body.ANGLE | _Body.VELOCITY | _Body.ANGULAR_VELOCITY

CHASSIS, SHAFT = 0, 1  # places of the bodies that all legs share; then those of each leg
X, Y, ANGLE, VX, VY, SPIN = range(6)  # columns of a motion
SLOP = 1e-5  # m, how deep a resting toe may sink in
GAP_LEFT = 0.5  # share of a joint's gap left after one second; the rest is pulled together
INSET = 0.98  # radius of links' sides, of the pads', so that pads touch first at their ends
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


class TurnMotion(NamedTuple):
    """A level robot at a crank angle: how its bodies move with each rate of q."""

    poses: Array  # (bodies, 3), see :func:`poses`
    rates: Array  # (4, bodies, 3) of these per rate of q
    mass_matrix: Array  # (4, 4)
    pads: Array  # (pads, 2) their centres, m


@functools.lru_cache(maxsize=2)
def turn_motions(robot: Robot) -> list[TurnMotion]:
    """The robot at :data:`TURN` crank angles."""
    (mass, inertia), layout, motions = inertias(robot).T, pad_layout(robot), []
    joints = [robot.linkage.all_pads[k][0] for k in layout.joint]
    for psi in 2.0 * math.pi * np.arange(TURN) / TURN:
        q = np.array([0.0, 0.0, 0.0, psi])
        moved = np.array([rates(robot, q, unit) for unit in np.eye(4)])
        matrix = np.einsum("ibk,bk,jbk->ij", moved, np.stack([inertia, mass, mass], 1), moved)
        pads = world_joints(robot, q)[layout.leg, joints]
        motions.append(TurnMotion(poses(robot, q), moved, matrix, pads))
    return motions


def pad_bodies(robot: Robot, layout: Pads) -> list[int]:
    """Index of the body that each pad is part of."""
    pairs = zip(layout.leg.tolist(), layout.joint.tolist(), strict=True)
    return [place_of(robot, leg, robot.linkage.all_pads[k][1] + 1) for leg, k in pairs]


def side_bodies(robot: Robot, sides: Ints) -> list[int]:
    """Index of the body that each of links' ``sides`` (n, 2) is part of; pairs of pads."""
    layout, linkage, bodies = pad_layout(robot), robot.linkage, []
    for side in sides.tolist():
        pads = [(int(layout.leg[k]), *linkage.all_pads[layout.joint[k]]) for k in side]
        ends = {joint for _, joint, _ in pads}
        leg = max([leg for leg, _, body in pads if body != FRAME - 1], default=0)
        body = next(k for k, joints in enumerate(linkage.members, 1) if ends <= {*joints})
        bodies.append(place_of(robot, leg, body))
    return bodies


class Snapshot(NamedTuple):
    """Pose of all bodies at an instant."""

    motion: Array  # (bodies, 6)
    pads: Array  # (pads, 2) centres, m
    energy: float  # J, without what springs hold
    joint_gap: float  # m, the widest

    def speed_along(self, body: int, x: float, y: float, tx: float, ty: float) -> float:
        """Velocity (m/s) along (tx, ty) of the point of a body that is at (x, y)."""
        cx, cy, _, vx, vy, w = self.motion[body].tolist()
        return float((vx - w * (y - cy)) * tx + (vy + w * (x - cx)) * ty)


class BodySpace:
    """A new space with a robot in a state: nothing is left of what an older one cached.

    Attributes:
        space: pymunk's. bodies, pins, pads, dry: of the robot in it. owners: the body of each pad.
            index: of the bodies by pymunk's ids. radius: of the pads, m.
        home: (bodies, 3) where bodies are on a chassis at 0. inertias: (bodies, 2) kg, kg m^2.
        loads: (bodies, 3) force, N, and torque, N m, on each in the next time step.
    """

    def __init__(
        self,
        robot: Robot,
        terrain: Ground,
        gravity: tuple[float, float],
        state: Array,
        held: bool,
        sides: Ints,
    ) -> None:
        self.space = space = pymunk.Space()
        self._gravity = space.gravity = gravity
        space.collision_slop = SLOP
        space.collision_persistence = 1  # arbiters that touch, and no older ones
        terrain.add_to(space)
        layout = pad_layout(robot)
        self.owners = pad_bodies(robot, layout)
        self.home, self.inertias = poses(robot, np.zeros(4)), inertias(robot)
        self.bodies = [pymunk.Body(m, inertia) for m, inertia in self.inertias]
        if held:
            self.bodies[CHASSIS].body_type = pymunk.Body.KINEMATIC
        self._put(self.home, np.zeros(self.home.shape))
        self.pins = self._make_pins(robot)
        self.pads = self._make_pads(robot, layout)
        self.dry = []
        for (a, b), torque in dry_pairs(robot).items():
            joint = pymunk.SimpleMotor(self.bodies[a], self.bodies[b], 0.0)
            joint.max_force = torque
            self.dry.append(joint)
        space.add(*self.bodies, *self.pins, *self.dry)
        if robot.pad_compliance.rigid:  # those that give push by themselves
            space.add(*self.pads, *self._make_sides(robot, sides))
        # A row for every body of the space, the ground's (last) too: it stays 0.
        rows = np.zeros((self._list_bodies(), 3))
        self.loads = rows[: len(self.bodies)]
        self._set = pymunk.batch.Buffer()
        self._set.set_float_buf(rows)
        self.radius = robot.pad_radius
        q, v = state[:4], state[4:]
        self._put(poses(robot, q), rates(robot, q, v))
        for body in self.bodies:
            space.reindex_shapes_for_body(body)

    def _put(self, where: Array, speed: Array) -> None:
        """Put bodies where ``where`` (n, 3) says (angle, x, y), moving at ``speed``."""
        for body, (angle, x, y), (spin, vx, vy) in zip(
            self.bodies, where.tolist(), speed.tolist(), strict=True
        ):
            body.angle, body.position = angle, (x, y)
            body.angular_velocity, body.velocity = spin, (vx, vy)

    def _make_pins(self, robot: Robot) -> list[pymunk.PivotJoint]:
        """One joint per pin, the crank's own first; made while the bodies are at home."""
        pins = [pymunk.PivotJoint(self.bodies[CHASSIS], self.bodies[SHAFT], (0.0, 0.0))]
        for i, leg in enumerate(robot.legs):
            joints = joint_positions(robot, leg.side, leg.phase)
            for pin in robot.linkage.moving_pins:
                held, turning = (self.bodies[place_of(robot, i, k)] for k in (pin.other, pin.body))
                place = tuple(joints[robot.linkage.joints.index(pin.joint)])
                pins.append(pymunk.PivotJoint(held, turning, place))
        for joint in pins:
            joint.error_bias = GAP_LEFT
        return pins

    def _make_pads(self, robot: Robot, layout: Pads) -> list[pymunk.Circle]:
        """Round pads in the order of the layout; made while the bodies are at home."""
        pads = []
        for i, k, owner in zip(layout.leg, layout.joint, self.owners, strict=True):
            leg, body = robot.legs[i], self.bodies[owner]
            place = joint_positions(robot, leg.side, leg.phase)[robot.linkage.all_pads[k][0]]
            circle = pymunk.Circle(body, robot.pad_radius, tuple(place - np.array(body.position)))
            circle.friction = circle.elasticity = 1.0  # pymunk multiplies them with the ground's
            circle.filter = pymunk.ShapeFilter(group=1)  # legs never touch one another
            pads.append(circle)
        return pads

    def _make_sides(self, robot: Robot, sides: Ints) -> list[pymunk.Segment]:
        """Links' ``sides`` (n, 2), pairs of pads; made while the bodies are at home."""
        segments = []
        for pads, owner in zip(sides.tolist(), side_bodies(robot, sides), strict=True):
            body, ends = self.bodies[owner], (self.pads[k] for k in pads)
            a, b = (body.world_to_local(end.body.local_to_world(end.offset)) for end in ends)
            segment = pymunk.Segment(body, a, b, INSET * robot.pad_radius)
            segment.friction = segment.elasticity = 1.0
            segment.filter = pymunk.ShapeFilter(group=1)
            segments.append(segment)
        return segments

    def _list_bodies(self) -> int:
        """Note which body carries each end of a pin and each pad; how many bodies there are."""
        self._got = pymunk.batch.Buffer()
        pymunk.batch.get_space_bodies(self.space, _Body.BODY_ID, self._got)
        rows = list(memoryview(self._got.int_buf()).cast("P"))
        self.index = {body.id: i for i, body in enumerate(self.bodies)}
        if rows[: len(self.index)] != list(self.index):
            raise RuntimeError("pymunk lists the bodies in another order than they were added in")
        ends = [*(pin.a for pin in self.pins), *(pin.b for pin in self.pins)]
        anchors = [*(pin.anchor_a for pin in self.pins), *(pin.anchor_b for pin in self.pins)]
        places = [tuple(place) for place in (*anchors, *(pad.offset for pad in self.pads))]
        self._carriers = np.array([*(self.index[body.id] for body in ends), *self.owners])
        self._carried = np.array(places).T
        return len(rows)

    @property
    def state(self) -> Array:
        """(8,) x, y, theta, psi and their rates."""
        chassis, shaft = self.bodies[CHASSIS], self.bodies[SHAFT]
        axis = tuple(-self.home[CHASSIS, 1:])
        place, speed = chassis.local_to_world(axis), chassis.velocity_at_local_point(axis)
        return np.array([
            place.x, place.y, chassis.angle, shaft.angle - chassis.angle, speed.x, speed.y,
            chassis.angular_velocity, shaft.angular_velocity - chassis.angular_velocity,
        ])  # fmt: skip

    def snapshot(self) -> Snapshot:
        """Return where everything is now."""
        self._got.clear()
        pymunk.batch.get_space_bodies(self.space, _MOTION, self._got)
        motion = np.frombuffer(self._got.float_buf()).reshape(-1, 6)[: len(self.bodies)].copy()
        mass, inertia = self.inertias.T
        twice = mass @ (motion[:, VX] ** 2 + motion[:, VY] ** 2) + inertia @ motion[:, SPIN] ** 2
        energy = float(0.5 * twice - self._gravity @ (mass @ motion[:, :ANGLE]))
        angle, (x, y) = motion[:, ANGLE], self._carried
        cos, sin = np.cos(angle)[self._carriers], np.sin(angle)[self._carriers]
        points = motion[self._carriers, :ANGLE]
        points[:, 0] += cos * x - sin * y
        points[:, 1] += sin * x + cos * y
        pins = len(self.pins)
        apart = points[:pins] - points[pins : 2 * pins]
        return Snapshot(motion, points[2 * pins :], energy, math.sqrt((apart**2).sum(axis=1).max()))

    def advance(self, time_step: float, iterations: int) -> Snapshot:
        """Let pymunk take a time step, s, under :attr:`loads`; returns where everything is then."""
        pymunk.batch.set_space_bodies(self.space, _Body.FORCE | _Body.TORQUE, self._set)
        self.space.iterations = iterations
        self.space.step(time_step)
        return self.snapshot()

    def dry_loss(self, mean: Array) -> float:
        """Return the energy that dry friction took in a time step of mean spins (bodies,), J."""
        loss = 0.0
        for joint in self.dry:
            a, b = self.index[joint.a.id], self.index[joint.b.id]
            loss += joint.impulse * abs(float(mean[b] - mean[a]))
        return loss

    def contact_frames(self, centres: Array) -> tuple[Array, Array]:
        """(k, 2) points of the ground nearest to pads' ``centres`` (k, 2), and tangents there."""
        points = centres - np.array([0.0, self.radius])
        tangents = np.tile([1.0, 0.0], (len(centres), 1))
        ours = pymunk.ShapeFilter(group=1)
        for pad, (x, y) in enumerate(centres.tolist()):
            near = self.space.point_query_nearest((x, y), 2.0 * self.radius, ours)
            if near is not None and near.distance > 0.0:
                normal = (pymunk.Vec2d(x, y) - near.point).normalized()
                points[pad], tangents[pad] = near.point, (normal.y, -normal.x)
        return points, tangents
