"""A robot made of pymunk objects: a body per link, a joint per pin, and a circle per pad.

The frames of all legs and the payload form one body, the chassis. The cranks of all legs form
another body, the shaft. Every other link is a separate body.

A pin with play is a journal in a hole: its axis stays within a circle whose radius is the radial
clearance. Where it meets the circle, it does not bounce, and it slides without friction. As
proposed by J. J. Moreau (*Unilateral contact and dry friction in finite freedom dynamics*, 1988),
the time steps enforce this limit at position level: in the time step in which the journal would
leave the circle, an impulse makes it arrive at the circle instead.
"""

from __future__ import annotations

import functools
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import pymunk
import pymunk.batch

from jansen_env.arrays import Array, Ints
from jansen_env.checks import invalid, listed
from jansen_env.dynamics.pads import Pads, pad_layout
from jansen_env.plants.base import LARGEST_PLAY, JointPlay
from jansen_env.plants.rigid.leg_springs import LegSprings
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import coordinates, joint_positions, world_joints
from jansen_env.robot.linkage import CRANK, FRAME
from jansen_env.terrain import Ground

_Body = pymunk.batch.BodyFields
_MOTION = _Body.POSITION | _Body.ANGLE | _Body.VELOCITY | _Body.ANGULAR_VELOCITY

# Indices of the bodies that all legs share. The bodies of each leg follow.
CHASSIS = 0
SHAFT = 1
X, Y, ANGLE, VX, VY, SPIN = range(6)  # columns of a motion
SLOP = 1e-5  # depth, in m, to which a resting toe may sink into the ground
GAP_LEFT = 0.5  # fraction of a joint's gap that is left after one second of closing the gap
INSET = 0.98  # radius of the sides of links divided by that of pads, so that pads touch first
TURN = 24  # number of crank angles at which the smallest effective mass of a robot is searched
PLAY_CORRECTION = 0.2  # fraction of a gap beyond the play that is closed in a time step
MOST_CENTRAL = 1e-12  # offset of a pin from the centre of its hole, in m, that counts as 0


def place_of(robot: Robot, leg: int, body: int) -> int:
    """Return the index of a body of a leg.

    The frame of each leg belongs to the chassis, and the crank of each leg belongs to the shaft.

    Args:
        robot: The robot.
        leg: Index of the leg.
        body: Number of the body in the linkage, counted from 1.
    """
    return body - 1 + (body > CRANK) * leg * (len(robot.bodies) - CRANK)


def count_bodies(robot: Robot) -> int:
    """Return the number of bodies of a robot."""
    return place_of(robot, len(robot.legs), CRANK + 1)


@functools.lru_cache(maxsize=8 * TURN)
def _local_bodies(robot: Robot, crank_angle: float) -> Array:
    """Return angle, x and y of every link in the chassis frame, shape (legs, bodies, 3)."""
    legs = [coordinates(robot, leg.side, crank_angle + leg.phase) for leg in robot.legs]
    bodies = np.array(legs).reshape(len(legs), -1, 3)
    bodies.setflags(write=False)
    return bodies


def _lumps(robot: Robot) -> list[tuple[float, float, Array]]:
    """Return mass, inertia and centre of mass of chassis and shaft, at crank angle 0."""
    home = _local_bodies(robot, 0.0)
    lumps = []
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
    """Return the mass and the inertia of every body.

    Returns:
        Mass, in kg, and inertia about the centre of mass, in kg m^2, shape (bodies, 2).
    """
    links = [(link.mass, link.inertia) for link in robot.bodies[2:]]
    return np.array([*((m, j) for m, j, _ in _lumps(robot)), *links * len(robot.legs)])


def poses(robot: Robot, q: Array) -> Array:
    """Return the pose of every body.

    Args:
        robot: The robot.
        q: Generalised coordinates (x, y, theta, psi), in m and rad, shape (4,).

    Returns:
        Angle, x and y, in rad and m, shape (bodies, 3). All angles are 0 at q = 0.
    """
    theta = float(q[2])
    psi = float(q[3])
    home = _local_bodies(robot, 0.0)
    links = _local_bodies(robot, psi)
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
    result[:, 1] = q[0] + cos * x - sin * y
    result[:, 2] = q[1] + sin * x + cos * y
    return result


def rates(robot: Robot, q: Array, v: Array) -> Array:
    """Return the rates of change of :func:`poses`.

    They are computed by differences of closed forms and are accurate to 1e-9.

    Args:
        robot: The robot.
        q: Generalised coordinates (x, y, theta, psi), in m and rad, shape (4,).
        v: Rates of the generalised coordinates, in m/s and rad/s, shape (4,).

    Returns:
        Rates of angle, x and y, in rad/s and m/s, shape (bodies, 3).
    """
    step = 1e-6
    q = np.array([0.0, 0.0, *(math.remainder(angle, 2.0 * math.pi) for angle in q[2:])])
    change = poses(robot, q + step * v) - poses(robot, q - step * v)
    change[:, 0] = (change[:, 0] + math.pi) % (2.0 * math.pi) - math.pi
    return change / (2.0 * step)


def viscous_pairs(robot: Robot) -> dict[tuple[int, int], float]:
    """Return the viscous friction of joints and motor for each pair of bodies, in N m s/rad.

    Pairs without friction are left out.
    """
    each = zip(robot.linkage.damped, robot.damping, strict=True)
    return _summed(robot, each, robot.motor.viscous_friction)


def joint_friction(robot: Robot) -> Array:
    """Return the matrix K of viscous friction, in N m s/rad, shape (bodies, bodies).

    The viscous torques of joints and motor on the bodies are -K times the angular velocities of the
    bodies.
    """
    K = np.zeros((count_bodies(robot), count_bodies(robot)))
    for (a, b), coefficient in viscous_pairs(robot).items():
        K[a, a] += coefficient
        K[b, b] += coefficient
        K[a, b] -= coefficient
        K[b, a] -= coefficient
    return K


def dry_pairs(robot: Robot) -> dict[tuple[int, int], float]:
    """Return the Coulomb friction torque of bearings and gear for each pair of bodies, in N m.

    Pairs without friction are left out.
    """
    each = zip(robot.linkage.bearings, robot.bearing_friction, strict=True)
    return _summed(robot, each, robot.motor.friction)


def _summed(
    robot: Robot, of_a_leg: Iterable[tuple[tuple[int, int], float]], motor: float
) -> dict[tuple[int, int], float]:
    """Return values between pairs of bodies, summed over all legs and the motor.

    Args:
        robot: The robot.
        of_a_leg: Pairs of bodies of a leg, counted from 1, each with its value.
        motor: Value between the chassis and the shaft, which is added once.

    Returns:
        The sums by pair of bodies, without zeros.
    """
    total: dict[tuple[int, int], float] = defaultdict(float)
    pairs = [*of_a_leg]
    for leg in range(len(robot.legs)):
        for (i, j), value in pairs:
            total[place_of(robot, leg, i), place_of(robot, leg, j)] += value
    total[CHASSIS, SHAFT] += motor
    return {pair: value for pair, value in total.items() if value > 0.0}


def play_of_pins(robot: Robot, play: JointPlay) -> Array:
    """Return the radial clearance of every pin, in the order of :attr:`BodySpace.pins`.

    The bearing of the crank axis, which all legs share, has no play.

    Args:
        robot: The robot.
        play: Radial clearance of all pins of the legs, in m; or clearances by joint. The pins of
            joints that are not named have no play.

    Raises:
        ValueError: If the linkage has no pin at a joint that is named.
    """
    pins = robot.linkage.moving_pins
    if isinstance(play, Mapping):
        known = sorted({pin.joint for pin in pins})
        for joint in play:
            if joint not in known:
                allowed = f"one of {listed(known, joint)}"
                raise invalid("a joint of joint_play", joint, allowed)
        of_a_leg = [play.get(pin.joint, 0.0) for pin in pins]
    else:
        of_a_leg = [play] * len(pins)
    return np.array([0.0, *of_a_leg * len(robot.legs)])


class TurnMotion(NamedTuple):
    """Motion of the bodies of a level robot at one crank angle.

    Attributes:
        poses: Pose of every body, shape (bodies, 3); see :func:`poses`.
        rates: Rates of the poses per rate of each generalised coordinate, shape (4, bodies, 3).
        mass_matrix: Mass matrix in the generalised coordinates, shape (4, 4).
        pads: Centres of the pads, in m, shape (pads, 2).
    """

    poses: Array
    rates: Array
    mass_matrix: Array
    pads: Array


@functools.lru_cache(maxsize=2)
def turn_motions(robot: Robot) -> list[TurnMotion]:
    """Return the motion of a robot's bodies at :data:`TURN` crank angles over a turn."""
    mass, inertia = inertias(robot).T
    layout = pad_layout(robot)
    motions = []
    joints = [robot.linkage.all_pads[k][0] for k in layout.joint]
    for psi in 2.0 * math.pi * np.arange(TURN) / TURN:
        q = np.array([0.0, 0.0, 0.0, psi])
        moved = np.array([rates(robot, q, unit) for unit in np.eye(4)])
        matrix = np.einsum("ibk,bk,jbk->ij", moved, np.stack([inertia, mass, mass], 1), moved)
        pads = world_joints(robot, q)[layout.leg, joints]
        motions.append(TurnMotion(poses(robot, q), moved, matrix, pads))
    return motions


def pad_bodies(robot: Robot, layout: Pads) -> list[int]:
    """Return the index of the body to which each pad belongs.

    Args:
        robot: The robot.
        layout: Pads of the robot.
    """
    pairs = zip(layout.leg.tolist(), layout.joint.tolist(), strict=True)
    return [place_of(robot, leg, robot.linkage.all_pads[k][1] + 1) for leg, k in pairs]


def side_bodies(robot: Robot, sides: Ints) -> list[int]:
    """Return the index of the body to which each side of a link belongs.

    Args:
        robot: The robot.
        sides: Indices of the two pads at the ends of each side, shape (n, 2).
    """
    layout = pad_layout(robot)
    linkage = robot.linkage
    bodies = []
    for side in sides.tolist():
        pads = [(int(layout.leg[k]), *linkage.all_pads[layout.joint[k]]) for k in side]
        ends = {joint for _, joint, _ in pads}
        leg = max([leg for leg, _, body in pads if body != FRAME - 1], default=0)
        body = next(k for k, joints in enumerate(linkage.members, 1) if ends <= {*joints})
        bodies.append(place_of(robot, leg, body))
    return bodies


class Snapshot(NamedTuple):
    """Positions and velocities of all bodies at an instant.

    Attributes:
        motion: x, y and angle of each body and their rates, in m, rad and s, shape (bodies, 6); see
            :data:`X` and the following constants.
        pads: Centres of the pads, in m, shape (pads, 2).
        energy: Kinetic and potential energy, in J, without the energy in springs of legs and pads.
        joint_gap: Widest gap of any joint, in m. The play of a joint is part of its gap.
        pins: Both ends of every pin, in m, shape (2, pins, 2).
    """

    motion: Array
    pads: Array
    energy: float
    joint_gap: float
    pins: Array

    def speed_along(self, body: int, x: float, y: float, tx: float, ty: float) -> float:
        """Return the velocity of a point of a body along a direction, in m/s.

        Args:
            body: Index of the body.
            x: Position of the point, in m.
            y: Height of the point, in m.
            tx: x component of the direction, a unit vector.
            ty: y component of the direction.
        """
        cx, cy, _, vx, vy, w = self.motion[body].tolist()
        return float((vx - w * (y - cy)) * tx + (vy + w * (x - cx)) * ty)


class BodySpace:
    """New pymunk space with a robot in a state.

    A new space contains nothing that an older space has cached.

    Args:
        robot: The robot.
        terrain: The ground.
        gravity: Gravitational acceleration (x, y), in m/s^2.
        state: x, y, theta, psi and their rates, in m, rad and s, shape (8,).
        fixed_chassis: Whether the chassis is fixed in the air, so that no pad touches the ground.
        sides: Indices of the two pads at the ends of each side of a link that collides with the
            ground, shape (n, 2).
        play: Radial clearance of each pin, that of the crank axis first, in m, shape (pins,).

    Attributes:
        space: The pymunk space.
        bodies: Bodies of the robot.
        pins: Joints of the robot's pins, that of the crank axis first.
        play: Radial clearance of each pin, in m, shape (pins,).
        pads: Circles of the robot's pads.
        dry: Joints that exert the Coulomb friction of bearings and gear.
        springs: Springs of the legs, or None for a robot without springs.
        owners: Index of the body to which each pad belongs.
        index: Indices of the bodies, by pymunk's ids.
        radius: Radius of the pads, in m.
        home: Angle, x and y of each body with the chassis and the crank at 0, in rad and m, shape
            (bodies, 3).
        inertias: Mass, in kg, and inertia, in kg m^2, of each body, shape (bodies, 2).
        loads: Force in x and y, in N, and torque, in N m, on each body in the next time step, shape
            (bodies, 3).
    """

    def __init__(
        self,
        robot: Robot,
        terrain: Ground,
        gravity: tuple[float, float],
        state: Array,
        fixed_chassis: bool,
        sides: Ints,
        play: Array,
    ) -> None:
        self.play = play
        self._loose = np.flatnonzero(play)
        self.space = space = pymunk.Space()
        self._gravity = space.gravity = gravity
        space.collision_slop = SLOP
        space.collision_persistence = 1  # keep only the contacts of the present time step
        if not fixed_chassis:
            terrain.add_to(space)
        layout = pad_layout(robot)
        self.owners = pad_bodies(robot, layout)
        self.home = poses(robot, np.zeros(4))
        self.inertias = inertias(robot)
        self.bodies = [pymunk.Body(m, inertia) for m, inertia in self.inertias]
        if fixed_chassis:
            self.bodies[CHASSIS].body_type = pymunk.Body.KINEMATIC
        self._put(self.home, np.zeros(self.home.shape))
        self.pins = self._make_pins(robot)
        self.pads = self._make_pads(robot, layout)
        self.dry = []
        for (a, b), torque in dry_pairs(robot).items():
            joint = pymunk.SimpleMotor(self.bodies[a], self.bodies[b], 0.0)
            joint.max_force = torque
            self.dry.append(joint)
        self.springs = LegSprings(robot, self.bodies) if robot.springs else None
        space.add(*self.bodies, *self.pins, *self.dry)
        if self.springs is not None:
            space.add(*self.springs.linear, *self.springs.torsion)
        if robot.pad_compliance.rigid:  # the forces of compliant pads are part of the loads
            space.add(*self.pads, *self._make_sides(robot, sides))
        # One row per body of the space. The last row belongs to the ground and stays 0.
        rows = np.zeros((self._list_bodies(), 3))
        self.loads = rows[: len(self.bodies)]
        self._set = pymunk.batch.Buffer()
        self._set.set_float_buf(rows)
        self.radius = robot.pad_radius
        q = state[:4]
        v = state[4:]
        where = poses(robot, q)
        self._put(where, rates(robot, q, v))
        if self.springs is not None:
            self.springs.start(float(q[3]), where[:, 0])
        for body in self.bodies:
            space.reindex_shapes_for_body(body)

    def _put(self, where: Array, speed: Array) -> None:
        """Set the poses and velocities of the bodies.

        Args:
            where: Angle, x and y of each body, in rad and m, shape (bodies, 3).
            speed: Rates of ``where``, in rad/s and m/s, shape (bodies, 3).
        """
        for body, (angle, x, y), (spin, vx, vy) in zip(
            self.bodies, where.tolist(), speed.tolist(), strict=True
        ):
            body.angle = angle
            body.position = (x, y)
            body.angular_velocity = spin
            body.velocity = (vx, vy)

    def _make_pins(self, robot: Robot) -> list[pymunk.PivotJoint | pymunk.SlideJoint]:
        """Return one joint per pin, that of the crank axis first.

        The bodies must be at their positions :attr:`home`.
        """
        pins: list[pymunk.PivotJoint | pymunk.SlideJoint]
        pins = [pymunk.PivotJoint(self.bodies[CHASSIS], self.bodies[SHAFT], (0.0, 0.0))]
        for i, leg in enumerate(robot.legs):
            joints = joint_positions(robot, leg.side, leg.phase)
            for pin in robot.linkage.moving_pins:
                held = self.bodies[place_of(robot, i, pin.other)]
                turning = self.bodies[place_of(robot, i, pin.body)]
                place = tuple(joints[robot.linkage.joints.index(pin.joint)])
                if self.play[len(pins)] > 0.0:
                    ends = held.world_to_local(place), turning.world_to_local(place)
                    pins.append(pymunk.SlideJoint(held, turning, *ends, 0.0, 0.0))
                else:
                    pins.append(pymunk.PivotJoint(held, turning, place))
        for joint in pins:
            joint.error_bias = GAP_LEFT
        return pins

    def _make_pads(self, robot: Robot, layout: Pads) -> list[pymunk.Circle]:
        """Return the circles of the pads, in the order of the layout.

        The bodies must be at their positions :attr:`home`.
        """
        pads = []
        for i, k, owner in zip(layout.leg, layout.joint, self.owners, strict=True):
            leg = robot.legs[i]
            body = self.bodies[owner]
            place = joint_positions(robot, leg.side, leg.phase)[robot.linkage.all_pads[k][0]]
            circle = pymunk.Circle(body, robot.pad_radius, tuple(place - np.array(body.position)))
            # pymunk multiplies these by the values of the ground's shapes, whose elasticity is the
            # restitution (`add_to` in terrain/).
            circle.friction = circle.elasticity = 1.0
            circle.filter = pymunk.ShapeFilter(group=1)  # legs do not collide with each other
            pads.append(circle)
        return pads

    def _make_sides(self, robot: Robot, sides: Ints) -> list[pymunk.Segment]:
        """Return the segments of the sides of links, each between two pads.

        The bodies must be at their positions :attr:`home`.
        """
        segments = []
        for pads, owner in zip(sides.tolist(), side_bodies(robot, sides), strict=True):
            body = self.bodies[owner]
            ends = (self.pads[k] for k in pads)
            a, b = (body.world_to_local(end.body.local_to_world(end.offset)) for end in ends)
            segment = pymunk.Segment(body, a, b, INSET * robot.pad_radius)
            segment.friction = segment.elasticity = 1.0
            segment.filter = pymunk.ShapeFilter(group=1)
            segments.append(segment)
        return segments

    def _list_bodies(self) -> int:
        """Store which body carries each end of a pin and each pad.

        Returns:
            The number of bodies of the space, including the body of the ground.
        """
        self._got = pymunk.batch.Buffer()
        pymunk.batch.get_space_bodies(self.space, _Body.BODY_ID, self._got)
        rows = list(memoryview(self._got.int_buf()).cast("P"))
        self.index = {body.id: i for i, body in enumerate(self.bodies)}
        if rows[: len(self.index)] != list(self.index):
            raise RuntimeError("pymunk must list the bodies in the order in which they were added")
        self._dry_places = [(self.index[joint.a.id], self.index[joint.b.id]) for joint in self.dry]
        ends = [*(pin.a for pin in self.pins), *(pin.b for pin in self.pins)]
        anchors = [*(pin.anchor_a for pin in self.pins), *(pin.anchor_b for pin in self.pins)]
        places = [tuple(place) for place in (*anchors, *(pad.offset for pad in self.pads))]
        self._carriers = np.array([*(self.index[body.id] for body in ends), *self.owners])
        self._carried = np.array(places).T
        pins = len(self.pins)
        self._loose_joints = [self.pins[k] for k in self._loose.tolist()]
        self._loose_carriers = self._carriers[: 2 * pins].reshape(2, pins)[:, self._loose]
        self._loose_anchors = self._carried[:, : 2 * pins].reshape(2, 2, pins)[:, :, self._loose]
        self._reach = 0.0
        return len(rows)

    @property
    def state(self) -> Array:
        """State of the robot: x, y, theta, psi and their rates, in m, rad and s, shape (8,)."""
        chassis = self.bodies[CHASSIS]
        shaft = self.bodies[SHAFT]
        axis = tuple(-self.home[CHASSIS, 1:])
        place = chassis.local_to_world(axis)
        speed = chassis.velocity_at_local_point(axis)
        return np.array(
            [
                place.x,
                place.y,
                chassis.angle,
                shaft.angle - chassis.angle,
                speed.x,
                speed.y,
                chassis.angular_velocity,
                shaft.angular_velocity - chassis.angular_velocity,
            ]
        )

    def snapshot(self) -> Snapshot:
        """Return the present positions and velocities of all bodies."""
        self._got.clear()
        pymunk.batch.get_space_bodies(self.space, _MOTION, self._got)
        motion = np.frombuffer(self._got.float_buf()).reshape(-1, 6)[: len(self.bodies)].copy()
        mass, inertia = self.inertias.T
        twice = mass @ (motion[:, VX] ** 2 + motion[:, VY] ** 2) + inertia @ motion[:, SPIN] ** 2
        energy = float(0.5 * twice - self._gravity @ (mass @ motion[:, :ANGLE]))
        points = self._find_points(motion)
        pins = len(self.pins)
        ends = points[: 2 * pins].reshape(2, pins, 2)
        apart = ends[0] - ends[1]
        gap = math.sqrt((apart**2).sum(axis=1).max())
        return Snapshot(motion, points[2 * pins :], energy, gap, ends)

    def _find_points(self, motion: Array) -> Array:
        """Return the ends of all pins, and then the centres of all pads.

        Args:
            motion: Positions of all bodies, shape (bodies, 6) or (bodies, 3).

        Returns:
            The points, in m, shape (2 pins + pads, 2).
        """
        angle = motion[:, ANGLE]
        x, y = self._carried
        cos, sin = np.cos(angle)[self._carriers], np.sin(angle)[self._carriers]
        points = motion[self._carriers, :ANGLE]
        points[:, 0] += cos * x - sin * y
        points[:, 1] += sin * x + cos * y
        return points

    def aim_pins(self, now: Snapshot, time_step: float) -> None:
        """Let pins with play reach the end of their play in the next time step, but not pass it.

        Let d be the vector from the centre of the hole to the axis of the pin, n the direction in
        which the axis would leave the circle, p the play and h the time step. The speed along n may
        then be at most (p - n d) / h. pymunk's joint of two anchors at a distance L above its
        ``max`` m limits the speed to -(1 - e ** h) (L - m) / h, where e is its ``error_bias``. For
        the two limits to be equal, the anchor in the hole is moved until the anchors are p apart in
        the direction n, m is negative, and e follows.

        Args:
            now: Positions and velocities of all bodies before the time step.
            time_step: Time step, in s.
        """
        if len(self._loose) == 0:
            return
        # pymunk moves the bodies before it changes their velocities.
        place = now.motion[:, :VX] + time_step * now.motion[:, VX:]
        carriers = self._loose_carriers
        x, y, angle = place[carriers].transpose(2, 0, 1)
        vx, vy, spin = now.motion[carriers, VX:].transpose(2, 0, 1)
        cos = np.cos(angle)
        sin = np.sin(angle)
        anchor_x, anchor_y = self._loose_anchors
        arm_x = cos * anchor_x - sin * anchor_y
        arm_y = sin * anchor_x + cos * anchor_y
        away_x = np.diff(x + arm_x, axis=0)[0]
        away_y = np.diff(y + arm_y, axis=0)[0]
        normal_x = away_x + time_step * np.diff(vx - spin * arm_y, axis=0)[0]
        normal_y = away_y + time_step * np.diff(vy + spin * arm_x, axis=0)[0]
        size = np.maximum(np.hypot(normal_x, normal_y), MOST_CENTRAL)
        normal_x /= size
        normal_y /= size
        play = self.play[self._loose]
        left = play - normal_x * away_x - normal_y * away_y
        left[left < 0.0] *= PLAY_CORRECTION
        reach = 0.1 * LARGEST_PLAY / time_step  # in m; it keeps the power below e^10
        aims = ((play + left + reach) / (play + reach)) ** (1.0 / time_step)
        arm_x[0] += away_x - play * normal_x
        arm_y[0] += away_y - play * normal_y
        hole_x = cos[0] * arm_x[0] + sin[0] * arm_y[0]
        hole_y = cos[0] * arm_y[0] - sin[0] * arm_x[0]
        anchors = zip(hole_x.tolist(), hole_y.tolist(), strict=True)
        for joint, anchor, aim in zip(self._loose_joints, anchors, aims.tolist(), strict=True):
            joint.anchor_a = anchor
            joint.error_bias = aim
        if reach != self._reach:
            self._reach = reach
            for joint in self._loose_joints:
                joint.max = -reach
        self._aimed = normal_x, normal_y, arm_x, arm_y

    def pin_impulses(self) -> Array:
        """Return the impulse of each pin in the last time step, in N s, shape (pins,)."""
        return np.array([pin.impulse for pin in self.pins])

    def play_loss(self, before: Snapshot, after: Snapshot) -> float:
        """Return the energy lost where pins took up their play in the last time step, in J.

        Args:
            before: Positions and velocities of all bodies before the time step.
            after: Positions and velocities of all bodies after the time step.
        """
        if len(self._loose) == 0:
            return 0.0
        normal_x, normal_y, arm_x, arm_y = self._aimed
        mean = 0.5 * (before.motion[:, VX:] + after.motion[:, VX:])
        vx, vy, spin = mean[self._loose_carriers].transpose(2, 0, 1)
        speed_x = np.diff(vx - spin * arm_y, axis=0)[0]
        speed_y = np.diff(vy + spin * arm_x, axis=0)[0]
        impulses = np.array([joint.impulse for joint in self._loose_joints])
        return float(impulses @ (speed_x * normal_x + speed_y * normal_y))

    def advance(self, time_step: float, iterations: int) -> Snapshot:
        """Simulate one time step under :attr:`loads`.

        Args:
            time_step: Time step, in s.
            iterations: Number of iterations of pymunk's solver.

        Returns:
            Positions and velocities of all bodies after the time step.
        """
        pymunk.batch.set_space_bodies(self.space, _Body.FORCE | _Body.TORQUE, self._set)
        self.space.iterations = iterations
        self.space.step(time_step)
        return self.snapshot()

    def dry_loss(self, mean: Array) -> float:
        """Return the energy that Coulomb friction dissipated in the last time step, in J.

        Args:
            mean: Mean angular velocity of each body over the time step, in rad/s, shape (bodies,).
        """
        loss = 0.0
        for joint, (a, b) in zip(self.dry, self._dry_places, strict=True):
            loss += joint.impulse * abs(float(mean[b] - mean[a]))
        return loss

    def contact_frames(self, centres: Array) -> tuple[Array, Array]:
        """Return the point of the ground nearest to each pad, and the tangent there.

        Args:
            centres: Centres of the pads, in m, shape (k, 2).

        Returns:
            The points, in m, shape (k, 2), and the tangents of the ground at these points, shape
            (k, 2). If no ground is near a pad, its point is the lowest point of the pad, and its
            tangent points in the +x direction.
        """
        points = centres - np.array([0.0, self.radius])
        tangents = np.tile([1.0, 0.0], (len(centres), 1))
        ours = pymunk.ShapeFilter(group=1)
        for pad, (x, y) in enumerate(centres.tolist()):
            near = self.space.point_query_nearest((x, y), 2.0 * self.radius, ours)
            if near is not None and near.distance > 0.0:
                normal = (pymunk.Vec2d(x, y) - near.point).normalized()
                points[pad] = near.point
                tangents[pad] = (normal.y, -normal.x)
        return points, tangents
