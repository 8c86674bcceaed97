"""A robot's bodies in a pymunk space, where they move and touch the ground."""

from __future__ import annotations

import math

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray

from jansen_env.dynamics.pads import pad_layout
from jansen_env.plants import bodies as links
from jansen_env.plants.bodies import CHASSIS, SHAFT
from jansen_env.plants.pad_contacts import SLOP, PadContacts
from jansen_env.plants.snapshot import ANGLE, SPIN, VX, VY, Snapshot
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]
_Body = pymunk.batch.BodyFields
_MOTION = _Body.POSITION | _Body.ANGLE | _Body.VELOCITY | _Body.ANGULAR_VELOCITY


class BodySpace:
    """A new space with a robot in a state: nothing is left of what an older one cached.

    Attributes:
        space: pymunk's. bodies, pins, pads, dry: of the robot in it. owners: the body of each pad.
            index: of the bodies by pymunk's ids.
        home: (bodies, 3) where bodies are on a chassis at 0. inertias: (bodies, 2) kg, kg m^2.
        loads: (bodies, 3) force, N, and torque, N m, on each in the next time step.
        contacts: of its pads, where they are rigid.
    """

    def __init__(
        self,
        robot: Robot,
        terrain: Terrain,
        gravity: tuple[float, float],
        time_step: float,
        state: Array,
        fixed_base: bool,
    ) -> None:
        self.space = space = pymunk.Space()
        self.set_gravity(gravity)
        space.collision_slop = SLOP
        space.collision_persistence = 1  # arbiters that touch, and no older ones
        terrain.add_to(space)
        layout = pad_layout(robot)
        self.owners = links.pad_bodies(robot, layout)
        self.home, self.inertias = links.poses(robot, np.zeros(4)), links.inertias(robot)
        self.bodies = [pymunk.Body(m, inertia) for m, inertia in self.inertias]
        if fixed_base:
            self.bodies[CHASSIS].body_type = pymunk.Body.KINEMATIC
        links.put(self.bodies, self.home, np.zeros(self.home.shape))
        self.pins = links.make_pins(robot, self.bodies)
        self.pads = links.make_pads(robot, layout, self.bodies)
        self.dry = links.make_dry_joints(robot, self.bodies)
        space.add(*self.bodies, *self.pins, *self.dry)
        if robot.pad_compliance.rigid:  # those that give push by themselves
            space.add(*self.pads)
        # A row for every body of the space, the ground's (last) too: it stays 0.
        rows = np.zeros((self._list_bodies(), 3))
        self.loads = rows[: len(self.bodies)]
        self._set = pymunk.batch.Buffer()
        self._set.set_float_buf(rows)
        self._radius = robot.pad_radius
        self.contacts = PadContacts(
            space, terrain, self.owners, self.index, self._radius, time_step
        )
        q, v = state[:4], state[4:]
        links.put(self.bodies, links.poses(robot, q), links.rates(robot, q, v))
        for body in self.bodies:
            space.reindex_shapes_for_body(body)

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

    def set_gravity(self, gravity: tuple[float, float]) -> None:
        """Change gravity, (x, y) m/s^2."""
        self._gravity = self.space.gravity = gravity

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
        points = centres - np.array([0.0, self._radius])
        tangents = np.tile([1.0, 0.0], (len(centres), 1))
        ours = pymunk.ShapeFilter(group=1)
        for pad, (x, y) in enumerate(centres.tolist()):
            near = self.space.point_query_nearest((x, y), 2.0 * self._radius, ours)
            if near is not None and near.distance > 0.0:
                normal = (pymunk.Vec2d(x, y) - near.point).normalized()
                points[pad], tangents[pad] = near.point, (normal.y, -normal.x)
        return points, tangents
