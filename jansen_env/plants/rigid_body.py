"""The rigid-body plant: every link a pymunk body, every pin a joint, pymunk's own contact solver.

It shares with the projection plant the robot's data, what rubs on what, the ground and the contact
laws, not its equations and solvers: no projection, no tables. Rigid pads are pymunk's, those that
give have springs of their own (:mod:`jansen_env.plants.spring_pads`). Motor and viscous joints act
as torques on the bodies, dry bearings and a dry gear are joints that hold up to their friction
torque, the rotor is a body behind a stiff gear (:mod:`jansen_env.plants.geared_rotor`).

pymunk solves pins and contacts by iteration in one go and pulls open joints together again: joints
gap by some hundredths of a millimetre (:attr:`StepResult.joint_gap`) and resting toes creep. It
goes on from the impulses of the last time step, which a landing toe does not have: a step with a
landing gets ten times the iterations. It is some hundred times slower than the projection plant.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray

from jansen_env.checks import finite, positive, positive_integer, within
from jansen_env.dynamics.pads import pad_layout
from jansen_env.engine.records import UNKNOWN_DEFLECTION
from jansen_env.gravity import GRAVITY, Gravity, gravity_vector
from jansen_env.parameters import ROBOT_PARAMETERS, nominal
from jansen_env.plants import bodies as links
from jansen_env.plants.base import (
    StepResult,
    check_deflection,
    check_in_contact,
    check_pushes,
    check_state,
    check_time_step,
    divergence,
    is_bounded,
)
from jansen_env.plants.bodies import CHASSIS, SHAFT
from jansen_env.plants.geared_rotor import GearedRotor
from jansen_env.plants.initial_pose import prepare_placement, resting_pose, static_deflection
from jansen_env.plants.pad_contacts import SLOP, PadContacts
from jansen_env.plants.robot_parameters import (
    HONOURED_BY_MACHINES,
    check_values,
    machine_of,
    terrain_of,
    tilted,
)
from jansen_env.plants.snapshot import ANGLE, SPIN, VX, VY, BodyReader, Snapshot, Sums
from jansen_env.plants.spring_pads import SpringPads
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import check_closure
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]

TIME_STEP = 2.5e-4  # s
ITERATIONS = 200  # of pymunk's solver in a time step, from the last one's impulses on
TOUCHDOWN_ITERATIONS = 2000  # in one in which a pad may touch down, with nothing to go on from
BEFORE_END = 5.0  # m, from the end of the ground at which a robot must turn back
MAX_JOINT_GAP = 0.01  # m, a joint's gap beyond which the robot is no longer one
LOOKAHEAD = 0.01  # s, after which pymunk's impulses on a robot placed again have settled
_Body = pymunk.batch.BodyFields


class RigidBodyPlant:
    """A robot on a terrain, body by body: reset, step(torque), state.

    Args:
        robot, terrain: what walks where.
        time_step: of pymunk, s.
        gravity: m/s^2 downwards, or a vector (x, y); may be changed between steps.
        iterations: of pymunk's solver in a time step. touchdown_iterations: in one in which a pad
            may touch down; an impact has to run through all joints at once, or it is too soft.
        fixed_base: hold the chassis still in the air, as the paper's fixed model does.

    Attributes:
        robot, terrain: what walks where, as they are themselves. parameters: a row of
            :data:`jansen_env.parameters.ROBOT_PARAMETERS`, those in force.
            honours: names of the parameters that it knows.

    Raises:
        ValueError: an argument out of range, or a time step too long for the stiffness of the
            robot's pads; LinkageError: the robot cannot turn its crank.
    """

    honours = HONOURED_BY_MACHINES

    def __init__(
        self,
        robot: Robot,
        terrain: Terrain,
        time_step: float = TIME_STEP,
        gravity: Gravity = GRAVITY,
        iterations: int = ITERATIONS,
        touchdown_iterations: int = TOUCHDOWN_ITERATIONS,
        fixed_base: bool = False,
    ) -> None:
        check_closure(robot)
        self.robot, self.terrain = robot, terrain
        self.parameters = nominal(robot, terrain)
        self.time_step = check_time_step(time_step)
        self.iterations = positive_integer("iterations", iterations)
        self.touchdown_iterations = positive_integer("touchdown_iterations", touchdown_iterations)
        self.fixed_base = bool(fixed_base)
        self.toes = len(robot.legs)
        self._layout = pad_layout(robot)
        self._owners = links.pad_bodies(self._layout)
        self._gravity = gravity_vector(gravity)
        prepare_placement(robot, terrain)
        self._apply_parameters()
        self._build(np.zeros(8))

    def _apply_parameters(self) -> None:
        """Take the machine, the ground and the gravity that :attr:`parameters` make."""
        robot = self._machine = machine_of(self.robot, self.parameters)
        terrain = self._ground = terrain_of(self.terrain, self.parameters)
        self._effective_gravity = tilted(self._gravity, float(self.parameters["tilt"]))
        self._home = links.poses(robot, np.zeros(4))
        self._inertias = links.inertias(robot)
        self._friction = links.joint_friction(robot)
        self._springs = self._rotor = None
        if not robot.pad_compliance.rigid:
            self._springs = SpringPads(robot, terrain, self._owners, self.time_step)
        if robot.motor.rotor_inertia > 0.0:
            self._rotor = GearedRotor(robot, self.time_step)
        first, last = terrain.polyline[[0, -1], 0].tolist()
        self._ends = first + BEFORE_END, last - BEFORE_END

    @property
    def nominal(self) -> np.void:
        """The robot's and its ground's own numbers, for :meth:`set_parameters`."""
        return nominal(self.robot, self.terrain)

    def set_parameters(self, values: np.void) -> None:
        """Put parameters of robot and ground in force, from the next placing on.

        Args:
            values: a row of :data:`jansen_env.parameters.ROBOT_PARAMETERS`.

        Raises:
            ValueError: a number out of its limits, a parameter that is not honoured, restitution
                where pads give, or a time step too long for the pads' stiffness.
        """
        given, own = (np.array([row], ROBOT_PARAMETERS) for row in (values, self.nominal))
        check_values(given, own, np.array([not self.robot.pad_compliance.rigid]), self.honours)
        self._change(self.terrain, values)

    def set_terrain(self, terrain: Terrain) -> None:
        """Change the ground: the robot must be placed anew."""
        values = self.parameters.copy()
        values["friction"], values["restitution"] = terrain.friction, terrain.restitution
        self._change(terrain, values)

    def _change(self, terrain: Terrain, values: np.void) -> None:
        """Go on from the same state as another robot on another ground."""
        before, memory = (self.terrain, self.parameters), self._memory
        self.terrain, self.parameters = terrain, values.copy()
        try:
            self._apply_parameters()
        except ValueError:
            self.terrain, self.parameters = before
            self._apply_parameters()
            raise
        finally:
            self._memory = memory

    def _build(self, state: Array, bristle: Array | None = None) -> None:
        """A new space with the robot in ``state``: nothing is left of what the old one cached.

        ``bristle``: (pads,) m, of pads that give; None for none.
        """
        space = pymunk.Space()
        space.gravity = self._effective_gravity
        space.collision_slop = SLOP
        space.collision_persistence = 1  # arbiters that touch, and no older ones
        self._ground.add_to(space)
        self._space = space
        self._bodies = [pymunk.Body(m, inertia) for m, inertia in self._inertias]
        if self.fixed_base:
            self._bodies[CHASSIS].body_type = pymunk.Body.KINEMATIC
        links.put(self._bodies, self._home, np.zeros(self._home.shape))
        self._pins = links.make_pins(self._machine, self._bodies)
        self._pads = links.make_pads(self._machine, self._layout, self._bodies)
        self._dry = links.make_dry_joints(self._machine, self._bodies)
        space.add(*self._bodies, *self._pins, *self._dry)
        if self._springs is None:  # they push by themselves
            space.add(*self._pads)
        self._reader = BodyReader(space, self._bodies, self._pins, self._pads, self._owners)
        # Force and torque for every body of the space, the ground's (last) too: they stay 0.
        self._loads = np.zeros((self._reader.rows, 3))
        self._set = pymunk.batch.Buffer()
        self._set.set_float_buf(self._loads)
        self._contacts = PadContacts(
            space, self._ground, self._owners, self._reader.index, self._machine.pad_radius,
            self.time_step,
        )  # fmt: skip
        q, v = state[:4], state[4:]
        links.put(self._bodies, links.poses(self._machine, q), links.rates(self._machine, q, v))
        for body in self._bodies:
            space.reindex_shapes_for_body(body)
        now = self._snapshot()
        if self._springs is not None:
            self._springs.start(now, space, bristle)
        if self._rotor is not None:
            self._rotor.start(now.motion)

    @property
    def gravity(self) -> tuple[float, float]:
        """(x, y) m/s^2, without the tilt of the parameters."""
        return self._gravity

    @gravity.setter
    def gravity(self, value: Gravity) -> None:
        self._gravity = gravity_vector(value)
        pull = tilted(self._gravity, float(self.parameters["tilt"]))
        self._effective_gravity = self._space.gravity = pull

    @property
    def state(self) -> Array:
        """(8,) x, y, theta, psi and their rates; x, y the crank axis on the chassis, m, rad, s.

        Setting it closes the joints and forgets what pymunk's solver had cached, so that a state
        carried to another plant goes on the same there only up to the gaps; bristles of pads that
        give are at rest. Pinned, the chassis' rates must be 0.
        """
        chassis, shaft = self._bodies[CHASSIS], self._bodies[SHAFT]
        axis = tuple(-self._home[CHASSIS, 1:])
        place, speed = chassis.local_to_world(axis), chassis.velocity_at_local_point(axis)
        return np.array([
            place.x, place.y, chassis.angle, shaft.angle - chassis.angle, speed.x, speed.y,
            chassis.angular_velocity, shaft.angular_velocity - chassis.angular_velocity,
        ])  # fmt: skip

    @state.setter
    def state(self, value: Array) -> None:
        state = check_state(value)
        if self.fixed_base and state[4:7].any():
            raise ValueError(f"state is {value!r}, its chassis must not move: its base is fixed")
        self._build(state)

    @property
    def in_contact(self) -> NDArray[np.bool_]:
        """(pads,) the pads on the ground now or just before, see :class:`PadContacts`."""
        return self._contacts.pressed

    @in_contact.setter
    def in_contact(self, value: Any) -> None:
        self._contacts.set_pressed(check_in_contact(value, len(self._pads)))

    @property
    def x(self) -> float:
        """Position of the crank axis along the ground, m."""
        return float(self.state[0])

    def reset(self, x: float = 0.0, crank_angle: float = 0.0, pitch: float | None = None) -> Array:
        """Place the robot at rest on its lowest toes; those that give sink in by its weight on two.

        Args:
            x: crank axis, m. crank_angle: rad. pitch: rad, or None to stand on both sides.

        Returns:
            The new state (8,).

        Raises:
            ValueError: there is no ground at ``x``, or a number is not finite.
        """
        within("x", x, *self._ends)
        finite("crank_angle", crank_angle)
        level = links.poses(self._machine, np.array([0.0, 0.0, 0.0, crank_angle]))
        centre = self._inertias[:, 0] @ level[:, 1:] / self._inertias[:, 0].sum()
        y, theta = resting_pose(self._machine, centre, self._ground, x, crank_angle, pitch)
        y -= static_deflection(self._machine, -self._effective_gravity[1])
        self._build(np.array([x, y, theta, crank_angle, 0.0, 0.0, 0.0, 0.0]))
        return self.state

    def step(
        self,
        torque: float,
        duration: float,
        earlier: float = 0.0,
        switch: int = 0,
        pushes: Array | None = None,
    ) -> StepResult:
        """Hold a crank torque for a while.

        Args:
            torque: N m on the crank, counter-clockwise positive (and its reaction on the chassis),
                as far as the robot's motor can.
            duration: s, rounded to whole time steps.
            earlier: N m, held instead in the first ``switch`` time steps: a delay.
            pushes: (steps, 2) N s, the impulse on the chassis at the crank axis in each time step,
                world x and y; None for none.

        Raises:
            ValueError: a duration out of range, or pushes of another shape.
            FloatingPointError: the simulation diverged: a speed that nothing has, a joint that came
                apart by more than :data:`MAX_JOINT_GAP`, or a robot at the end of the ground. The
                state is as it was before, joints closed.
        """
        steps = max(1, round(positive("duration", duration) / self.time_step))
        h, sums, before = self.time_step, Sums(len(self._pads)), self.state
        impulses = np.zeros((steps, 2)) if pushes is None else check_pushes(pushes, steps)
        now = self._snapshot()
        start = now.energy + self._held
        for k in range(steps):
            now, used = self._advance(now, earlier if k < switch else torque, impulses[k], sums)
            sums.torque_impulse += h * (used - torque)
        state = self.state
        error = None
        if not is_bounded(state):
            error = divergence(before, torque)
        elif not sums.joint_gap < MAX_JOINT_GAP:
            error = FloatingPointError(
                f"a joint came apart by {sums.joint_gap} m under a torque of {torque} N m; "
                "try a smaller time_step"
            )
        elif not self._ends[0] < self.x < self._ends[1]:
            error = FloatingPointError(
                f"the robot is at x = {self.x} m; the ground of the rigid-body plant ends at "
                f"{self._ends} m"
            )
        if error is not None:
            self._build(before)
            raise error
        toes = slice(0, self.toes)
        return StepResult(
            slip=sums.slip[toes], contact_force=sums.impulse[toes] / (steps * h),
            motor_work=sums.motor_work, joint_loss=sums.joint_loss, slip_loss=sums.slip_loss,
            impact_loss=sums.impact_loss, energy_change=now.energy + self._held - start,
            non_toe_contact=bool(sums.impulse[self.toes :, 1].any()), residual=math.nan,
            contact_gain=math.nan, joint_gap=sums.joint_gap, electrical_work=sums.electrical_work,
            torque=torque + sums.torque_impulse / (steps * h), push_work=sums.push_work,
        )  # fmt: skip

    def _advance(
        self, now: Snapshot, asked: float, push: Array, sums: Sums
    ) -> tuple[Snapshot, float]:
        """One time step under a torque that is asked for: where it leads, and the motor's.

        ``push``: (2,) N s on the chassis at the crank axis.
        """
        h, motor, rotor, springs = self.time_step, self._machine.motor, self._rotor, self._springs
        spin, held = now.motion[:, SPIN], self._held
        loads = self._loads[: len(spin)]
        torque = float(motor.torque(asked, spin[SHAFT] - spin[CHASSIS]))
        loads[:, 2] = -self._friction @ spin
        loads[CHASSIS, 2] -= torque
        loads[SHAFT, 2] += torque
        if rotor is not None:
            loads[[CHASSIS, SHAFT], 2] += rotor.on_bodies
        loads[:, :2] = 0.0
        if springs is not None:
            loads += springs.loads(now)
        # A generalised impulse on the chassis' (x, y, angle), where pymunk moves it first.
        turned = now.motion[CHASSIS, ANGLE] + h * spin[CHASSIS]
        cos, sin = math.cos(turned), math.sin(turned)
        ax, ay = (-self._home[CHASSIS, 1:]).tolist()
        x, y = cos * ax - sin * ay, sin * ax + cos * ay
        impulse = np.array([*push, x * push[1] - y * push[0]])
        loads[CHASSIS] += impulse / h
        pymunk.batch.set_space_bodies(self._space, _Body.FORCE | _Body.TORQUE, self._set)
        landing = springs is None and self._contacts.landing_soon(now)
        self._space.iterations = self.touchdown_iterations if landing else self.iterations
        self._space.step(h)
        after = self._snapshot()
        mean = 0.5 * (spin + after.motion[:, SPIN])
        moved = 0.5 * (now.motion[CHASSIS] + after.motion[CHASSIS])[[VX, VY, SPIN]]
        push_work = float(impulse @ moved)
        turning = float(mean[SHAFT] - mean[CHASSIS])
        work = h * torque * turning
        loss = h * float(spin @ self._friction @ mean) + self._dry_loss(mean)
        if rotor is not None:
            rotor.step(after.motion)
            loss += rotor.loss
        sums.motor_work += work
        sums.push_work += push_work
        sums.electrical_work += h * float(motor.electrical_power(torque, turning))
        sums.joint_loss += loss
        if springs is None:
            slip_loss, landed = self._contacts.book(after, sums)
            sums.slip_loss += slip_loss
            if landed:
                left = now.energy + held + work + push_work - loss - slip_loss
                sums.impact_loss += left - (after.energy + self._held)
        else:
            touching = springs.touching
            springs.step(after, self._space, sums)
            self._contacts.note(touching)
        sums.joint_gap = max(sums.joint_gap, after.joint_gap)
        return after, torque

    @property
    def _held(self) -> float:
        """What rotor and springs hold, J."""
        rotor = 0.0 if self._rotor is None else self._rotor.energy
        return rotor + (0.0 if self._springs is None else self._springs.stored)

    def _dry_loss(self, mean: Array) -> float:
        """What dry friction took in a time step of mean spins (bodies,), J."""
        loss = 0.0
        for joint in self._dry:
            a, b = self._reader.index[joint.a.id], self._reader.index[joint.b.id]
            loss += joint.impulse * abs(float(mean[b] - mean[a]))
        return loss

    def lookahead(self, torque: float = 0.0) -> StepResult:
        """What the next :data:`LOOKAHEAD` seconds would do; the state stays, joints closed."""
        saved = self._memory
        try:
            return self.step(torque, LOOKAHEAD)
        finally:
            self._memory = saved

    @property
    def deflection(self) -> Array:
        """(pads, 2) compression and bend of compliant pads, m; set it after the state.

        Compression is unknown: springs have no memory here, and follow from where the bodies are.
        """
        deflection = np.tile(UNKNOWN_DEFLECTION, (len(self._pads), 1))
        if self._springs is not None:
            deflection[:, 1] = self._springs.bristle
        return deflection

    @deflection.setter
    def deflection(self, value: Any) -> None:
        bristle = check_deflection(value, len(self._pads))[:, 1]
        if self._springs is not None:
            self._memory = self.state, self.in_contact, bristle

    @property
    def _memory(self) -> tuple[Array, NDArray[np.bool_], Array | None]:
        """State, pads on the ground and bristles; setting it closes joints and gear."""
        bristle = None if self._springs is None else self._springs.bristle.copy()
        return self.state, self.in_contact, bristle

    @_memory.setter
    def _memory(self, value: tuple[Array, NDArray[np.bool_], Array | None]) -> None:
        state, in_contact, bristle = value
        self._build(state, bristle)
        self.in_contact = in_contact

    def energy(self) -> float:
        """Kinetic plus potential energy, J (potential 0 with the centre of mass at the origin)."""
        return self._snapshot().energy + self._held

    def _snapshot(self) -> Snapshot:
        """Return where everything is now."""
        return self._reader.read(self._inertias, self._effective_gravity)

    def contact_frames(self) -> tuple[Array, Array]:
        """(toes, 2) points of the ground nearest to each toe's pad and its tangents there.

        Where no ground is within reach, the pad's lowest point and +x.
        """
        points = self.toe_positions() - np.array([0.0, self._machine.pad_radius])
        tangents = np.tile([1.0, 0.0], (self.toes, 1))
        ours = pymunk.ShapeFilter(group=1)
        for toe, (x, y) in enumerate(self.toe_positions().tolist()):
            near = self._space.point_query_nearest((x, y), 2.0 * self._machine.pad_radius, ours)
            if near is not None and near.distance > 0.0:
                normal = (pymunk.Vec2d(x, y) - near.point).normalized()
                points[toe], tangents[toe] = near.point, (normal.y, -normal.x)
        return points, tangents

    def toe_positions(self) -> Array:
        """(toes, 2) centres of the toe pads, m."""
        return self._snapshot().pads[: self.toes]

    def __getstate__(self) -> dict[str, Any]:
        """The arguments and the state: everything else is made again from them."""
        return {
            "robot": self.robot, "terrain": self.terrain, "time_step": self.time_step,
            "gravity": self._gravity, "iterations": self.iterations,
            "touchdown_iterations": self.touchdown_iterations, "fixed_base": self.fixed_base,
            "parameters": self.parameters, "memory": self._memory,
        }  # fmt: skip

    def __setstate__(self, saved: dict[str, Any]) -> None:
        parameters, memory = saved.pop("parameters"), saved.pop("memory")
        self.__init__(**saved)  # type: ignore[misc]
        self.parameters = parameters
        self._apply_parameters()
        self._memory = memory
