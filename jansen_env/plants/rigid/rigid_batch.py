"""Rigid-body backend: links are pymunk bodies, pins are joints, pymunk solves rigid contacts.

This backend shares the data of the robot, the ground and the contact laws with the projection
backend, but not its equations and solvers. Compliant pads have their own springs. The motor and
viscous joints act as torques on the bodies. Dry bearings and a dry gear are joints that hold up to
their friction torque. The rotor is a body behind a stiff gear. Pins may have play
(:mod:`jansen_env.plants.rigid.bodies`), and the gear may have backlash (:class:`LooseRotor`).

pymunk solves pins and contacts together by iteration, and it pulls open joints together again.
Joints therefore have gaps of some hundredths of a millimetre (:attr:`StepResult.joint_gap`), and
resting toes creep. The iteration starts from the impulses of the last time step, but there is no
such impulse for a toe that is landing. A time step with a landing therefore gets ten times as many
iterations. This backend is about a thousand times slower than the projection backend.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import override

from jansen_env.arrays import Array, Bools, Ints, Rows
from jansen_env.checks import finite, invalid, within
from jansen_env.dynamics.gravity import GRAVITY, Gravity
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.dynamics.pads import pad_layout, pad_sides
from jansen_env.engine import episode
from jansen_env.engine.collision import sides_in_ground
from jansen_env.engine.episode import Episodes, Observing
from jansen_env.engine.integrator import DIVERGED
from jansen_env.engine.placement import PLACEMENT_DEPTH
from jansen_env.engine.records import UNKNOWN_DEFLECTION
from jansen_env.plants.base import (
    JointPlay,
    check_backlash,
    check_colliding,
    check_fixed_chassis,
    check_joint_play,
    check_legs,
    check_pushes,
    divergence,
)
from jansen_env.plants.batched_plant import BatchedPlant
from jansen_env.plants.kernel_arrays import KernelArrays
from jansen_env.plants.parameters import nominal
from jansen_env.plants.rigid import bodies
from jansen_env.plants.rigid.bodies import (
    ANGLE,
    CHASSIS,
    SHAFT,
    SPIN,
    VX,
    VY,
    BodySpace,
    Snapshot,
    turn_motions,
)
from jansen_env.plants.rigid.pad_forces import PadContacts, SpringPads, Sums, check_stiffness
from jansen_env.plants.robot_parameters import check_values, gravity_of, machine_of, terrain_of
from jansen_env.plants.robot_placement import RobotPlacement
from jansen_env.plants.robot_records import RobotRecords
from jansen_env.plants.shape_planes import ShapePlanes
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import check_closure
from jansen_env.terrain import Ground, Shapes

TIME_STEP = 2.5e-4  # default time step of pymunk, in s
PLAY_TIME_STEP = 1.25e-4  # default time step with joint play, in s
# Iterations of pymunk's solver in a time step; they start from the impulses of the last time step.
ITERATIONS = 200
# Iterations in a time step in which a pad may touch down. There are no impulses to start from, and
# the impact has to propagate through all joints at once, or it is too soft.
TOUCHDOWN_ITERATIONS = 2000
BEFORE_END = 5.0  # distance from the end of the ground, in m, at which a robot must turn back
MAX_JOINT_GAP = 0.01  # gap of a joint, in m, beyond which the robot counts as broken
TWIST = 0.3  # phase by which the fastest vibration of the gear advances in a time step, in rad
TWIST_DAMPING = 0.125  # damping ratio of this vibration
LOOKAHEAD = 0.01  # time after which pymunk's impulses on a newly placed robot have settled, in s


class GearedRotor:
    """Rotor of the motor, with an inertia above 0, as a body behind a stiff gear.

    The rotor turns in the chassis. An ideal gear of ratio G makes the rotor turn by theta + G psi.
    Here the gear is a torsional spring with a damper. They act on the twist

        delta = phi - theta - G psi = phi - G alpha - (1 - G) theta

    where phi is the angle of the rotor and alpha = theta + psi the angle of the shaft. A torque
    lambda on the rotor therefore comes with a torque -G lambda on the shaft and (G - 1) lambda on
    the chassis. The three torques add up to zero, because a gear does not change the angular
    momentum of the whole robot. The spring is as stiff as the time step allows, and the damper has
    an eighth of the critical damping.

    Args:
        robot: The robot.
        time_step: Time step of pymunk, in s.

    Attributes:
        inertia: Inertia of the rotor, in kg m^2.
        ratio: Gear ratio G.
        time_step: Time step of pymunk, in s.
        stiffness: Stiffness of the spring, measured at the rotor, in N m/rad.
        damping: Damping coefficient, measured at the rotor, in N m s/rad.
        angle: Angle phi of the rotor, in rad.
        speed: Angular velocity of the rotor, in rad/s.
        torque: Torque of the gear on the rotor in the next time step, in N m.
        energy: Kinetic energy of the rotor plus the energy of the gear's spring, in J.
        loss: Energy lost in the gear in the last time step, in J.
    """

    def __init__(self, robot: Robot, time_step: float) -> None:
        motor = robot.motor
        self.inertia = motor.rotor_inertia
        self.ratio = motor.gear_ratio
        self.time_step = time_step
        twist = np.array([0.0, 0.0, -1.0, -self.ratio])  # rate of the twist per rate of q
        matrices = [motion.mass_matrix for motion in turn_motions(robot)]
        yielding = max(float(twist @ np.linalg.solve(matrix, twist)) for matrix in matrices)
        inverse = 1.0 / self.inertia + yielding
        self.stiffness = (TWIST / time_step) ** 2 / inverse  # measured at the rotor, in N m/rad
        self.damping = 2.0 * TWIST_DAMPING * TWIST / time_step / inverse
        self.angle = self.speed = self.torque = self.energy = self.loss = 0.0

    def start(self, motion: Array) -> None:
        """Set the angle and the speed of the rotor to those of an ideal gear.

        Args:
            motion: Motion of the bodies, shape (bodies, 6).
        """
        chassis = motion[CHASSIS]
        turn = motion[SHAFT] - chassis
        self.angle = chassis[ANGLE] + self.ratio * turn[ANGLE]
        self.speed = chassis[SPIN] + self.ratio * turn[SPIN]
        self._twist_rate = self.torque = 0.0
        self._load(motion)

    def step(self, motion: Array) -> None:
        """Advance the rotor by one time step.

        Args:
            motion: Motion of the bodies at the end of the time step, shape (bodies, 6).
        """
        self.angle += self.time_step * self.speed
        self.speed += self.time_step * self.torque / self.inertia
        self._load(motion)

    def _load(self, motion: Array) -> None:
        """Compute the torque of the gear in the next time step.

        pymunk moves the bodies before it changes their velocities. The torque is therefore that of
        the twist at the end of the time step.

        Args:
            motion: Motion of the bodies now, shape (bodies, 6).
        """
        h = self.time_step
        before = self._twist_rate
        twist, rate = self._find_twist(motion)
        self._twist_rate = rate
        # The velocities belong to the middle of the next move (leapfrog).
        middle = twist + 0.5 * h * rate
        self.energy = 0.5 * self.inertia * self.speed**2 + 0.5 * self.stiffness * middle**2
        self.loss = h * self.damping * before * 0.5 * (before + rate)
        self.torque = -self.stiffness * (twist + h * rate) - self.damping * rate

    def _find_twist(self, motion: Array) -> tuple[float, float]:
        """Return the twist of the gear, in rad, and its rate, in rad/s.

        Args:
            motion: Motion of the bodies, shape (bodies, 6).
        """
        chassis = motion[CHASSIS]
        turn = motion[SHAFT] - chassis
        twist = self.angle - chassis[ANGLE] - self.ratio * turn[ANGLE]
        rate = self.speed - chassis[SPIN] - self.ratio * turn[SPIN]
        return twist, rate

    @property
    def on_bodies(self) -> tuple[float, float]:
        """Torques of the gear on the chassis and on the shaft in the next time step, in N m."""
        return (self.ratio - 1.0) * self.torque, -self.ratio * self.torque


class LooseRotor(GearedRotor):
    """Rotor of the motor behind a stiff gear with backlash.

    The spring and the damper of the gear act only beyond a dead band of the twist, and the flanks
    of the gear never pull. Within the band the rotor turns freely, so the torque and the friction
    of the motor act on the rotor and not on the shaft. All friction of motor and gear belongs to
    the rotor's side of the band.

    Args:
        robot: The robot.
        time_step: Time step of pymunk, in s.
        backlash: Width of the dead band, measured at the crank, in rad.

    Attributes:
        slack: Half the width of the dead band, measured at the rotor, in rad.
    """

    def __init__(self, robot: Robot, time_step: float, backlash: float) -> None:
        super().__init__(robot, time_step)
        self.slack = 0.5 * self.ratio * backlash
        self._dry = robot.motor.friction / self.ratio  # measured at the rotor, in N m
        self._viscous = robot.motor.viscous_friction / self.ratio**2  # at the rotor, in N m s/rad
        self._excess = self._stator = self._resisting = self._relative = 0.0

    @override
    def start(self, motion: Array) -> None:
        """Set the speed of the rotor to that of an ideal gear, in the middle of the dead band.

        Args:
            motion: Motion of the bodies, shape (bodies, 6).
        """
        self._excess = self._stator = self._resisting = self._relative = 0.0
        super().start(motion)

    def turning(self, chassis: float) -> float:
        """Return the speed of the rotor relative to the chassis, measured at the crank, in rad/s.

        Args:
            chassis: Angular velocity of the chassis, in rad/s.
        """
        return (self.speed - chassis) / self.ratio

    def drive(self, torque: float, chassis: float) -> float:
        """Compute the torque of the motor, less its friction, on the rotor in the next time step.

        Dry friction stops the rotor, but it does not reverse it.

        Args:
            torque: Torque of the motor, measured at the crank, in N m.
            chassis: Angular velocity of the chassis, in rad/s.

        Returns:
            The torque on the rotor, in N m. The opposite torque acts on the chassis.
        """
        self._relative = self.speed - chassis
        viscous = -self._viscous * self._relative
        pushed = torque / self.ratio + viscous
        stopping = self._relative * self.inertia / self.time_step + self.torque + pushed
        self._resisting = viscous - min(max(stopping, -self._dry), self._dry)
        self._stator = torque / self.ratio + self._resisting
        return self._stator

    @override
    def step(self, motion: Array) -> None:
        self.angle += self.time_step * self.speed
        self.speed += self.time_step * (self.torque + self._stator) / self.inertia
        self._load(motion)
        mean = 0.5 * (self._relative + self.speed - float(motion[CHASSIS, SPIN]))
        self.loss -= self.time_step * self._resisting * mean

    @override
    def _load(self, motion: Array) -> None:
        """Compute the torque of the gear in the next time step.

        Args:
            motion: Motion of the bodies now, shape (bodies, 6).
        """
        h = self.time_step
        before = self._twist_rate
        damped = self.torque + self.stiffness * self._excess
        twist, rate = self._find_twist(motion)
        self._twist_rate = rate
        middle = self._beyond(twist + 0.5 * h * rate)
        self.energy = 0.5 * self.inertia * self.speed**2 + 0.5 * self.stiffness * middle**2
        self.loss = -h * damped * 0.5 * (before + rate)
        self._excess = self._beyond(twist + h * rate)
        torque = -self.stiffness * self._excess - self.damping * rate
        pulls = torque * self._excess >= 0.0
        self.torque = 0.0 if pulls else torque

    def _beyond(self, twist: float) -> float:
        """Return the part of a twist beyond the dead band, in rad."""
        return twist - min(max(twist, -self.slack), self.slack)


class RigidBodyBatch(BatchedPlant):
    """A single robot on a terrain, simulated body by body.

    Methods and attributes that are not documented here have the same meaning as those of
    :class:`jansen_env.plants.batch.Batch` for a batch of one robot.

    Args:
        robot: The robot.
        terrain: The ground.
        time_step: Time step of pymunk, in s.
        gravity: Gravitational acceleration, in m/s^2: a number that acts downwards, or a vector
            (x, y).
        fixed_chassis: Whether the chassis is fixed in the air, as in the paper's fixed model.
        links_collide: Whether the sides of links touch vertices of the ground.
        joint_play: Radial clearance of all pins of the legs, in m; or clearances by joint. With
            play, use a time step of at most :data:`PLAY_TIME_STEP`.
        backlash: Dead band between the motor and the crank, in rad at the crank.
        records: Records to use. If None, the batch makes a new one.

    Attributes:
        pin_impulses: Largest impulse of each pin in a time step of the last step, in N s, shape
            (pins,): that of the crank axis first, and then those of each leg in the order of
            :attr:`jansen_env.robot.linkage.Linkage.moving_pins`. The impulses are 0 unless
            ``tracing`` is True.
        crank_torque: Largest torque of the gear on the crank in a time step of the last step, in
            N m. It is 0 unless ``tracing`` is True.

    Raises:
        ValueError: If an argument is out of range, the time step is too long for the stiffness of
            the robot's pads, ``joint_play`` names a joint without a pin, or there is backlash, but
            the motor has no rotor inertia.
        LinkageError: If the robot cannot turn its crank through a full revolution.
    """

    knows_joint_forces = False
    joints_open = True
    tracing = False

    def __init__(
        self,
        robot: Robot,
        terrain: Ground,
        time_step: float = TIME_STEP,
        gravity: Gravity = GRAVITY,
        fixed_chassis: bool = False,
        links_collide: bool = False,
        joint_play: JointPlay = 0.0,
        backlash: float = 0.0,
        records: RobotRecords | None = None,
    ) -> None:
        check_closure(robot)
        self.joint_play = check_joint_play(joint_play)
        self.backlash = check_backlash(backlash)
        self.crank_torque = 0.0
        check_colliding([terrain], links_collide)
        super().__init__([robot], [terrain], time_step, gravity, fixed_chassis, records)
        self.links_collide = links_collide
        self.lookahead_steps = max(1, round(LOOKAHEAD / self.time_step))
        self._owners = bodies.pad_bodies(robot, pad_layout(robot))
        self._sides = pad_sides(robot)
        self._colliding = self._sides if links_collide else self._sides[:0]
        self._take_parameters()
        self._build(np.zeros(8))

    def _take_parameters(self) -> None:
        """Derive the robot, the ground and the gravity from :attr:`parameters`."""
        values = self.parameters[0]
        robot = self._machine = machine_of(self.robots[0], values)
        terrain = self._ground = terrain_of(self.terrains[0], values)
        self._effective_gravity = gravity_of(self.gravity, values)
        self._check_rotor(robot)
        self._play = bodies.play_of_pins(robot, self.joint_play)
        self.pin_impulses = np.zeros(len(self._play))
        self._jointed = robot
        if self.backlash > 0.0:  # the friction of the motor acts on the rotor
            free = replace(robot.motor, friction=0.0, viscous_friction=0.0)
            self._jointed = replace(robot, motor=free)
        self._friction = bodies.joint_friction(self._jointed)
        self._shapes: ShapePlanes | None = None
        if isinstance(terrain, Shapes):
            self._shapes = ShapePlanes(terrain)
            self._ends = -math.inf, math.inf
            self._set_line(np.array([[-1.0, terrain.lowest], [1.0, terrain.lowest]]))
        else:
            first, last = terrain.polyline[[0, -1], 0].tolist()
            self._ends = first + BEFORE_END, last - BEFORE_END
            self._set_line(terrain.polyline.copy())
        self._springs = None
        self._rotor: GearedRotor | None = None
        self._loose: LooseRotor | None = None
        if not robot.pad_compliance.rigid and not self.fixed_chassis:
            owners = [*self._owners, *bodies.side_bodies(robot, self._colliding)]
            self._springs = SpringPads(
                robot, terrain, owners, self.time_step, self._colliding, self._shapes
            )
        if self.backlash > 0.0:
            self._rotor = self._loose = LooseRotor(robot, self.time_step, self.backlash)
        elif robot.motor.rotor_inertia > 0.0:
            self._rotor = GearedRotor(robot, self.time_step)
        self._set_machines(self._every)
        self._apply(self._every)

    def _check_rotor(self, robot: Robot) -> None:
        """Check that a robot has a rotor if there is backlash.

        Args:
            robot: The robot, with the parameters of its episode.

        Raises:
            ValueError: If the motor of the robot has no rotor inertia. Nothing would turn within
                the dead band.
        """
        if self.backlash > 0.0 and robot.motor.rotor_inertia == 0.0:
            raise invalid("backlash", self.backlash, "0 for a motor without rotor_inertia")

    def _set_line(self, line: Array) -> None:
        """Set the height line that the robot observes.

        Args:
            line: Vertices of the line, in m, shape (vertices, 2).
        """
        self.surface: Array = line
        self.records.status["end_vertex"] = len(line)

    @override
    def shapes(self, row: int) -> ShapePlanes | None:
        return self._shapes

    @override
    def look_down(self, rows: Ints, scan: Array) -> None:
        if self._shapes is not None and len(rows) > 0:
            x, y = self.states[0, :2].tolist()
            self._set_line(self._shapes.line_below(x, y, scan))

    @override
    def set_parameters(self, rows: Ints, values: Rows) -> None:
        """Apply the parameters of an episode. After an error, nothing has changed.

        Args:
            rows: Index of the robot, shape (1,).
            values: Parameters of the robot, a record of
                :data:`jansen_env.plants.parameters.EPISODE`, shape (1,).

        Raises:
            ValueError: If a value is outside its limits, a robot with compliant pads gets a
                restitution above 0, or the pads are too stiff for the time step.
        """
        check_values(values, np.array([not self.robots[0].pad_compliance.rigid]))
        self._go_on(self.robots[0], self.terrains[0], values[0])

    @override
    def set_terrain(self, row: int, terrain: Ground) -> None:
        """Replace the ground, including its friction and restitution.

        After an error, nothing has changed.

        Args:
            row: Index of the robot, which is 0.
            terrain: The new ground.

        Raises:
            ValueError: If the ground consists of shapes and the links of the robot collide.
        """
        check_colliding([terrain], self.links_collide)
        values = self.parameters[0].copy()
        values["friction"] = terrain.friction
        values["restitution"] = terrain.restitution
        self._go_on(self.robots[0], terrain, values)

    @override
    def set_robots(self, rows: Ints, robots: Sequence[Robot]) -> None:
        """Exchange the robot and reset its parameters to the nominal values.

        After an error, nothing has changed.

        Args:
            rows: Index of the robot, shape (1,).
            robots: The new robot, in a sequence of length 1.

        Raises:
            ValueError: If the legs of the new robot are on other sides than those of the present
                one, or its pads are too stiff for the time step.
            LinkageError: If the new robot cannot turn its crank through a full revolution.
        """
        self.check_robot(robots[0])
        self._go_on(robots[0], self.terrains[0], nominal(robots[0], self.terrains[0]))

    def _go_on(self, robot: Robot, terrain: Ground, values: np.void) -> None:
        """Replace the robot, the ground and the parameters, and keep the state.

        Args:
            robot: The new robot.
            terrain: The new ground.
            values: The new parameters, a record of :data:`jansen_env.plants.parameters.EPISODE`.

        Raises:
            ValueError: If the backend cannot simulate them. Nothing has changed in that case.
        """
        memory = self._memory
        undo = self.keep(np.arange(1))
        self.robots = [robot]
        self.terrains = [terrain]
        self.parameters[0] = values
        try:
            self._take_parameters()
        except ValueError:
            undo()
            raise
        self._memory = memory

    @override
    def check_feet(self, robot: Robot, values: np.void) -> None:
        """Do nothing: feet that are too stiff are rejected when their parameters are applied."""

    @override
    def check_robot(self, robot: Robot) -> None:
        """Raise the errors that :meth:`set_robots` would raise for this robot.

        Args:
            robot: The robot.

        Raises:
            ValueError: If the legs of the robot are on other sides than those of the present one,
                its pads are too stiff for the time step, or there is backlash, but the motor has no
                rotor inertia.
            LinkageError: If the robot cannot turn its crank through a full revolution.
        """
        check_legs(robot, self.robots[0])
        check_closure(robot)
        self._check_rotor(robot)
        if not robot.pad_compliance.rigid:
            check_stiffness(robot, self.time_step, self._owners)

    @override
    def keep(self, rows: Ints) -> Callable[[], None]:
        before = self.__dict__.copy()  # a change builds a new pymunk space and keeps the old one
        saved = self.records.copy(rows)
        joint_gap = self.joint_gap.copy()

        def undo() -> None:
            self.__dict__.update(before)
            self._set_machines(self._every)
            self.records.restore(rows, saved)
            self.joint_gap[:] = joint_gap

        return undo

    def _build(self, state: Array, bristle: Array | None = None) -> None:
        """Put the robot into a new pymunk space.

        Args:
            state: x, y, theta, psi and their rates, in m, rad and s, shape (8,).
            bristle: Lengths of the bristles of compliant pads and of the sides of colliding links,
                in m. None for bristles at rest.
        """
        self._space = BodySpace(
            self._jointed,
            self._ground,
            self._effective_gravity,
            state,
            self.fixed_chassis,
            self._colliding,
            self._play,
        )
        self._contacts = PadContacts(self._space, self._ground, self.time_step, self._shapes)
        self.states[0] = self._space.state
        now = self._space.snapshot()
        if self._springs is not None:
            self._springs.start(now, self._space.space, bristle)
        if self._rotor is not None:
            self._rotor.start(now.motion)
        self._in_legs = self._energy_in_legs(now)
        self._record_deflection()

    @override
    def set_mechanical_state(
        self, row: int, state: ArrayLike, deflection: Array | None = None
    ) -> None:
        """Set the mechanical state of the robot, with closed joints.

        Args:
            row: Index of the robot, which is 0.
            state: x, y, theta, psi and their rates, in m, rad and s, shape (8,).
            deflection: Compression and bend of compliant pads, in m, shape (pads, 2). If None, the
                bristles of the pads are at rest.

        Raises:
            ValueError: If the chassis is fixed, but moves in this state.
        """
        state = np.asarray(state, dtype=float)
        if self.fixed_chassis:
            check_fixed_chassis(state)
        self._build(state)
        if deflection is not None and self._springs is not None:
            bristle = np.append(deflection[:, 1], np.zeros(len(self._colliding)))
            self._memory = self._space.state, self.in_contact, bristle

    @property  # type: ignore[explicit-override]  # mypy overlooks it at a property with a setter
    @override
    def in_contact(self) -> Bools:
        """Whether each pad is on the ground, shape (pads,).

        Setting it to None marks every pad as off the ground.
        """
        return self._contacts.pressed

    @in_contact.setter
    def in_contact(self, value: Bools | None) -> None:
        self._contacts.set_pressed(value)

    @override
    def place(self, rows: Ints, crank_angles: ArrayLike, crank_speeds: ArrayLike = 0.0) -> None:
        """Place the robot at x = 0, look ahead in time, and set its crank speed.

        See :meth:`place_at` and :meth:`lookahead`.

        Args:
            rows: Index of the robot, shape (1,).
            crank_angles: Crank angle, in rad, shape (1,).
            crank_speeds: Crank speed with which the robot starts, in rad/s, shape (1,).

        Raises:
            ValueError: If the robot cannot be placed at x = 0.
            FloatingPointError: If the simulation diverges during the lookahead.
        """
        self.place_at(rows, crank_angles)
        self.lookahead()
        if self.any_diverged:
            raise self.refusal(0.0)
        self.states[:, 7] = crank_speeds
        self.set_mechanical_state(0, self.states[0])

    @override
    def place_at(
        self, rows: Ints, crank_angles: ArrayLike, x: float = 0.0, pitch: float | None = None
    ) -> None:
        """Place the robot at rest on its lowest toes, which touch the ground without a gap.

        Otherwise the position is that of :meth:`jansen_env.plants.batch.Batch.place_at`.

        Args:
            rows: Index of the robot, shape (1,).
            crank_angles: Crank angle, in rad, shape (1,).
            x: Position of the crank axis, in m.
            pitch: Pitch of the chassis, in rad. None turns the robot until both its fore and its
                back feet carry it.

        Raises:
            ValueError: If ``x`` or ``pitch`` is not finite, there is no ground at ``x``, or the
                feet of the robot are too soft to carry it.
        """
        x = within("x", x, *self._ends)
        pitch = math.nan if pitch is None else finite("pitch", pitch)
        records = RobotRecords(1, self.toes, self.pads)
        records.robots[:] = self.records.robots
        records.properties["fixed_chassis"] = False
        arrays = KernelArrays(
            self.robots, self.terrains, records, self.engine_settings, fixed_chassis=False
        )
        arrays.find_ground(0, x)
        RobotPlacement(arrays).place(rows, crank_angles, x, pitch)
        self._build(records.states[0] + PLACEMENT_DEPTH * np.eye(8)[1])

    @override
    def reconnect(self) -> None:
        """Do nothing, because this backend keeps no views of the records."""

    @override
    def lookahead(
        self, torque: float = 0.0, rows: Ints | None = None, pushes: Array | None = None
    ) -> None:
        """Fill the sums with those of the next :data:`LOOKAHEAD` seconds.

        The state is restored afterwards, with closed joints.

        Args:
            torque: Commanded crank torque, in N m.
            rows: Ignored, because there is only one robot.
            pushes: Impulse on the chassis in the first time step, in N s, shape (1, 1, 2). None for
                no impulse.
        """
        impulses = np.zeros((self.lookahead_steps, 2))
        saved = self._memory
        if pushes is not None:
            impulses[0] = pushes[0, 0]
        try:
            self._run(torque, 0.0, 0, impulses)
        finally:
            self._memory = saved

    @override
    def step(
        self,
        torque: Array,
        steps: int,
        earlier: Array | None = None,
        switch: Ints | None = None,
        rows: Ints | None = None,
        pushes: Array | None = None,
    ) -> None:
        """Hold a crank torque for some time steps, within the limits of the motor.

        If the step is rejected, the robot keeps the state that it had before, its sums are 0, and
        :attr:`diverged` is True. :meth:`refusal` returns the reason.

        Args:
            torque: Commanded crank torque, in N m, shape (1,).
            steps: Number of time steps.
            earlier: Torque that is held instead in the first ``switch`` time steps, in N m, shape
                (1,). None for no such torque.
            switch: Number of time steps with the torque ``earlier``, shape (1,).
            rows: Index of the robot, shape (1,), or None. An empty array does nothing.
            pushes: Impulse on the chassis at the crank axis in each time step, in the x and y
                directions of the world, in N s, shape (1, steps, 2). None for no impulses.

        Raises:
            ValueError: If ``pushes`` has a different shape.
        """
        if rows is None or len(rows) > 0:
            before = 0.0 if earlier is None else float(earlier[0])
            first = 0 if switch is None else int(switch[0])
            impulses = np.zeros((1, steps, 2)) if pushes is None else check_pushes(pushes, 1, steps)
            self._run(float(torque[0]), before, first, impulses[0])

    @override
    def control_step(
        self,
        rows: Ints,
        actions: Array,
        episodes: Episodes,
        observing: Observing,
        meanwhile: Callable[[], None] | None = None,
    ) -> None:
        """Simulate one control step of the robot; see :mod:`jansen_env.engine.episode`.

        Args:
            rows: Index of the robot, shape (1,). If it is empty, the robot does not move.
            actions: Action, as a fraction of the torque limit, shape (1, 1).
            episodes: Parts of the robot's record that belong to the episode and the task.
            observing: Observation of the robot, and the settings that define it.
            meanwhile: Function that is called after the step.
        """
        if len(rows) > 0:
            steps = int(self.engine_settings["steps"][0])
            motions = self.records.motions
            impulses = np.zeros((steps, 2))
            action = float(actions[0, 0])
            episode.begin_step(0, action, impulses, motions.robots, episodes)
            whole, switch = motions.robots["delay"][0].tolist()
            torque, earlier = self.records.torques[0, whole : whole + 2].tolist()
            self._run(torque, earlier, switch, impulses)
            self.look_down(rows, observing.scan)
            episode.finish_step(
                0, self.engine_settings, self.surface, self._pressed, motions, episodes, observing
            )
        if meanwhile is not None:
            meanwhile()

    def _run(self, torque: float, earlier: float, switch: int, impulses: Array) -> None:
        """Simulate one time step for each impulse.

        Args:
            torque: Commanded crank torque, in N m.
            earlier: Torque that is held instead in the first ``switch`` time steps, in N m.
            switch: Number of time steps with the torque ``earlier``.
            impulses: Impulse on the chassis in each time step, in N s, shape (steps, 2).
        """
        h = self.time_step
        before = self._space.state
        now = self._space.snapshot()
        gap = 0.0
        start = now.energy + self._stored
        pads = len(self._owners)
        self.accumulators[:] = np.zeros((), self.accumulators.dtype)
        total = self.accumulators[0]
        sums = Sums(total, np.zeros(pads), np.zeros((pads, 2)), np.zeros(1))
        self._pressed = np.zeros(len(impulses))
        self.pin_impulses[:] = self.crank_torque = 0.0
        for k, impulse in enumerate(impulses):
            now, used = self._advance(now, earlier if k < switch else torque, impulse, sums)
            self._pressed[k] = sums.pressed[0]
            sums.pressed[0] = 0.0
            total["torque_impulse"] += h * (used - torque)
            gap = max(gap, now.joint_gap)
        self._refusal = self._refused(before, torque, gap)
        self.any_diverged = self._refusal is not None
        self.diverged[:] = self.any_diverged
        self.slip[:] = self.contact_force[:] = self.joint_gap[:] = 0.0
        if self.any_diverged:
            self.accumulators[:] = np.zeros((), self.accumulators.dtype)
            self._pressed[:] = 0.0
            self._build(before)
            return
        self.states[0] = self._space.state
        self._record_deflection()
        total["contact_gain"] = total["worst_residual"] = math.nan
        total["non_toe_impulse"] = sums.impulse[self.toes :, 1].sum()
        total["energy_change"] = now.energy + self._stored - start
        duration = len(impulses) * h
        # The mean torque is rounded before the commanded torque is subtracted.
        lacking = torque + total["torque_impulse"] / duration - torque
        total["torque_impulse"] = lacking * len(impulses) * h
        if self._shapes is not None:
            total["links_in_ground"] = self._shapes.count_crossing(now.pads[self._sides])
        elif not self.fixed_chassis:
            places = np.ascontiguousarray(now.pads).ravel()
            total["links_in_ground"] = sides_in_ground(places, self._sides, self.surface)
        self.slip[0] = sums.slip[: self.toes]
        self.joint_gap[0] = gap
        self.contact_force[0] = sums.impulse[: self.toes] / duration

    @override
    def refusal(self, torque: float) -> FloatingPointError:
        return self._refusal or divergence(self._space.state, torque)

    def _refused(self, before: Array, torque: float, gap: float) -> FloatingPointError | None:
        """Check the state after a step.

        Args:
            before: State before the step, shape (8,).
            torque: Commanded crank torque, in N m.
            gap: Widest gap of a joint in the step, in m.

        Returns:
            The error for which the step is rejected, or None if the step is valid.
        """
        state = self._space.state.tolist()
        if not all(-DIVERGED < speed < DIVERGED for speed in state[4:]):
            return divergence(before, torque)
        if not gap < MAX_JOINT_GAP:
            apart = f"a joint came apart by {gap} m under a torque of {torque} N m"
            return FloatingPointError(f"{apart}; try a smaller time_step")
        if not self._ends[0] < state[0] < self._ends[1]:
            end = f"the ground of the rigid-body plant ends at {self._ends} m"
            return FloatingPointError(f"the robot is at x = {state[0]} m; {end}")
        return None

    def _advance(
        self, now: Snapshot, commanded: float, push: Array, sums: Sums
    ) -> tuple[Snapshot, float]:
        """Simulate one time step.

        Args:
            now: Positions and velocities of the bodies before the time step.
            commanded: Commanded crank torque, in N m.
            push: Impulse on the chassis at the crank axis, in N s, shape (2,).
            sums: Sums over the step, to which this time step is added.

        Returns:
            Positions and velocities of the bodies after the time step, and the torque of the motor,
            in N m.
        """
        h = self.time_step
        motor = self._machine.motor
        rotor = self._rotor
        springs = self._springs
        spin = now.motion[:, SPIN]
        stored = self._stored
        loads = self._space.loads
        loose = self._loose
        chassis = float(spin[CHASSIS])
        turning = spin[SHAFT] - chassis if loose is None else loose.turning(chassis)
        torque = float(motor.torque(commanded, turning))
        loads[:, 2] = -self._friction @ spin
        if loose is None:
            loads[[CHASSIS, SHAFT], 2] += -torque, torque
        else:
            loads[CHASSIS, 2] -= loose.drive(torque, chassis)
        if rotor is not None:
            loads[[CHASSIS, SHAFT], 2] += rotor.on_bodies
        loads[:, :2] = 0.0
        if springs is not None:
            loads += springs.loads(now)
        # Generalised impulse on (x, y, angle) of the chassis, at the position to which pymunk moves
        # the chassis before it changes the velocity.
        tilted = now.motion[CHASSIS, ANGLE] + h * spin[CHASSIS]
        cos, sin = math.cos(tilted), math.sin(tilted)
        ax, ay = (-self._space.home[CHASSIS, 1:]).tolist()
        x, y = cos * ax - sin * ay, sin * ax + cos * ay
        impulse = np.array([*push, x * push[1] - y * push[0]])
        loads[CHASSIS] += impulse / h
        landing = springs is None and self._contacts.landing_soon(now)
        self._space.aim_pins(now, h)
        after = self._space.advance(h, TOUCHDOWN_ITERATIONS if landing else ITERATIONS)
        mean = 0.5 * (spin + after.motion[:, SPIN])
        moved = 0.5 * (now.motion[CHASSIS] + after.motion[CHASSIS])[[VX, VY, SPIN]]
        push_work = float(impulse @ moved)
        turned = float(mean[SHAFT] - mean[CHASSIS])
        loss = h * float(spin @ self._friction @ mean) + self._space.dry_loss(mean)
        loss += self._space.play_loss(now, after)
        if self.tracing:
            self._trace(torque)
        if rotor is not None:
            rotor.step(after.motion)
            loss += rotor.loss
        self._in_legs = self._energy_in_legs(after)
        if loose is not None:
            turned = 0.5 * (turning + loose.turning(float(after.motion[CHASSIS, SPIN])))
        work = h * torque * turned
        total = sums.total
        total["motor_work"] += work
        total["push_work"] += push_work
        total["electrical_work"] += h * float(motor.electrical_power(torque, turned))
        total["joint_loss"] += loss
        if springs is None:
            slip_loss, landed = self._contacts.book(after, sums)
            total["slip_loss"] += slip_loss
            if landed:
                left = now.energy + stored + work + push_work - loss - slip_loss
                total["impact_loss"] += left - (after.energy + self._stored)
        else:
            touching = springs.touching[: len(self._owners)]
            springs.step(after, self._space.space, sums)
            self._contacts.note(touching)
        return after, torque

    def _trace(self, torque: float) -> None:
        """Update the largest pin impulses and crank torque with those of the last time step.

        Args:
            torque: Torque of the motor in the last time step, in N m.
        """
        crank = 0.0 if self._loose is not None else torque
        if self._rotor is not None:
            crank += self._rotor.on_bodies[1]
        self.crank_torque = max(self.crank_torque, abs(float(crank)))
        np.maximum(self.pin_impulses, self._space.pin_impulses(), out=self.pin_impulses)

    @property
    def _stored(self) -> float:
        """Energy stored in the rotor and in the springs of legs and compliant pads, in J."""
        rotor = 0.0 if self._rotor is None else self._rotor.energy
        return rotor + (0.0 if self._springs is None else self._springs.stored) + self._in_legs

    def _energy_in_legs(self, now: Snapshot) -> float:
        """Return the energy of the springs of the legs, in J."""
        springs = self._space.springs
        return 0.0 if springs is None else springs.energy(now.motion, self.time_step)

    def _record_deflection(self) -> None:
        """Store the bends of compliant pads in the robot's record.

        The compression is marked as unknown, because it follows from the positions of the bodies.
        """
        self.records.deflection[0] = UNKNOWN_DEFLECTION
        if self._springs is not None:
            self.records.deflection[0, :, 1] = self._springs.bristle[: self.pads]

    @property
    def _memory(self) -> tuple[Array, Bools, Array | None]:
        """State, flags of the pads on the ground, and bristles.

        Setting this property closes the joints and removes the twist of the gear.
        """
        bristle = None if self._springs is None else self._springs.bristle.copy()
        return self._space.state, self.in_contact, bristle

    @_memory.setter
    def _memory(self, value: tuple[Array, Bools, Array | None]) -> None:
        state, in_contact, bristle = value
        self._build(state, bristle)
        self.in_contact = in_contact

    @override
    def energy(self, row: int) -> float:
        """Return the kinetic plus potential energy of the robot, in J.

        It includes the energy of the rotor and of the springs of legs and compliant pads.
        """
        return self._space.snapshot().energy + self._stored

    @override
    def pad_centres(self, row: int) -> Array:
        return self._space.snapshot().pads

    @override
    def contact_frames(self, row: int) -> tuple[Array, Array]:
        return self._space.contact_frames(self.pad_centres(0)[: self.toes])

    @override
    def joint_forces(self, torque: float = 0.0, push: Array | None = None) -> JointForces:
        """Raise an error, because this backend does not compute joint forces.

        Raises:
            ValueError: Always.
        """
        raise ValueError("plant must be 'projection' with joint forces, got 'rigid_body'")

    @override
    def peak_loads(self) -> tuple[float, float]:
        """Raise an error, because this backend does not compute joint forces.

        Raises:
            ValueError: Always.
        """
        raise ValueError("plant must be 'projection' with joint loads, got 'rigid_body'")

    @override
    def close(self) -> None:
        """Do nothing, because this backend has no threads to release."""

    def __getstate__(self) -> dict[str, Any]:
        """Pickle only the arguments and the state; everything else is rebuilt."""
        given = (
            self.time_step,
            self.gravity,
            self.fixed_chassis,
            self.links_collide,
            self.joint_play,
            self.backlash,
        )
        kept = "records", "engine_settings", "_torque_rate", "any_diverged", "joint_gap", "_memory"
        arguments = (*self.robots, *self.terrains, *given)
        return {"arguments": arguments, **{name: getattr(self, name) for name in kept}}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        records = saved["records"]
        before = records.copy(np.arange(1))
        self.__init__(*saved["arguments"], records=records)  # type: ignore[misc]
        self.engine_settings[:] = saved["engine_settings"]
        self._torque_rate = saved["_torque_rate"]
        records.restore(self._every, before)
        self._take_parameters()
        self._memory = saved["_memory"]
        records.restore(self._every, before)
        self.joint_gap[:] = saved["joint_gap"]
        self.any_diverged = saved["any_diverged"]
