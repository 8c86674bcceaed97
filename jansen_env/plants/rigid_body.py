"""The rigid-body plant: every link a pymunk body, every pin a joint, pymunk's own contact solver.

It shares with the projection plant the robot's data, the ground and the contact laws, not its
equations and solvers. Rigid pads are pymunk's, compliant ones have springs of their own. Motor and
viscous joints act as torques on the bodies, dry bearings and a dry gear are joints that hold up to
their friction torque, the rotor is a body behind a stiff gear.

pymunk solves pins and contacts by iteration in one go and pulls open joints together again: joints
gap by some hundredths of a millimetre (:attr:`StepResult.joint_gap`) and resting toes creep. It
goes on from the last time step's impulses, which a landing toe does not have: a step with a landing
gets ten times the iterations. It is some hundred times slower than the projection plant.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import finite, positive, positive_integer, within
from jansen_env.dynamics.pads import pad_layout
from jansen_env.engine.integrator import DIVERGED
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
)
from jansen_env.plants.bodies import CHASSIS, SHAFT
from jansen_env.plants.body_space import BodySpace
from jansen_env.plants.geared_rotor import GearedRotor
from jansen_env.plants.initial_pose import prepare_placement, resting_pose, static_deflection
from jansen_env.plants.robot_parameters import (
    HONOURED_BY_MACHINES,
    check_values,
    machine_of,
    terrain_of,
    tilted,
)
from jansen_env.plants.snapshot import ANGLE, SPIN, VX, VY, Snapshot, Sums
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


class RigidBodyPlant:
    """A robot on a terrain, body by body: reset, step(torque), state.

    Args:
        time_step: of pymunk, s.
        gravity: m/s^2 downwards, or a vector (x, y); may be changed between steps.
        iterations: of pymunk's solver in a time step. touchdown_iterations: in one in which a pad
            may touch down; an impact has to run through all joints at once, or it is too soft.
        fixed_base: hold the chassis still in the air, as the paper's fixed model does.

    Attributes:
        robot, terrain: without parameters. parameters: a row of ``ROBOT_PARAMETERS``, in force.

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
        self._owners = links.pad_bodies(pad_layout(robot))
        self._gravity = gravity_vector(gravity)
        prepare_placement(robot, terrain)
        self._apply_parameters()
        self._build(np.zeros(8))

    def _apply_parameters(self) -> None:
        """Take the machine, the ground and the gravity that :attr:`parameters` make."""
        robot = self._machine = machine_of(self.robot, self.parameters)
        terrain = self._ground = terrain_of(self.terrain, self.parameters)
        self._effective_gravity = tilted(self._gravity, float(self.parameters["tilt"]))
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
        """The robot's and its ground's own numbers."""
        return nominal(self.robot, self.terrain)

    def set_parameters(self, values: np.void) -> None:
        """Put a row of parameters in force, see :class:`jansen_env.plants.base.BatchedPlant`.

        Raises ValueError also for a time step too long for the pads' stiffness.
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
        """Put the robot into ``state`` in a new space; bristle: (pads,) m, of compliant pads."""
        pull, h = self._effective_gravity, self.time_step
        self._space = BodySpace(self._machine, self._ground, pull, h, state, self.fixed_base)
        self._contacts = self._space.contacts
        now = self._space.snapshot()
        if self._springs is not None:
            self._springs.start(now, self._space.space, bristle)
        if self._rotor is not None:
            self._rotor.start(now.motion)

    @property
    def gravity(self) -> tuple[float, float]:
        """(x, y) m/s^2, without the tilt of the parameters."""
        return self._gravity

    @gravity.setter
    def gravity(self, value: Gravity) -> None:
        self._gravity = gravity_vector(value)
        self._effective_gravity = tilted(self._gravity, float(self.parameters["tilt"]))
        self._space.set_gravity(self._effective_gravity)

    @property
    def state(self) -> Array:
        """(8,) x, y, theta, psi and their rates; x, y the crank axis on the chassis, m, rad, s.

        Setting it closes the joints and lets bristles rest.
        """
        return self._space.state

    @state.setter
    def state(self, value: Array) -> None:
        state = check_state(value)
        if self.fixed_base and state[4:7].any():
            raise ValueError(f"state is {value!r}, its chassis must not move: its base is fixed")
        self._build(state)

    @property
    def in_contact(self) -> NDArray[np.bool_]:
        """(pads,) the pads on the ground now or just before."""
        return self._contacts.pressed

    @in_contact.setter
    def in_contact(self, value: Any) -> None:
        self._contacts.set_pressed(check_in_contact(value, len(self._owners)))

    @property
    def x(self) -> float:
        """Position of the crank axis along the ground, m."""
        return float(self.state[0])

    def reset(self, x: float = 0.0, crank_angle: float = 0.0, pitch: float | None = None) -> Array:
        """Place the robot at rest on its lowest toes; compliant ones sink in by its weight on two.

        Pitch None: to stand on both sides. Raises ValueError: there is no ground at ``x`` (m), or a
        number is not finite.
        """
        within("x", x, *self._ends)
        finite("crank_angle", crank_angle)
        level = links.poses(self._machine, np.array([0.0, 0.0, 0.0, crank_angle]))
        masses = links.inertias(self._machine)[:, 0]
        centre = masses @ level[:, 1:] / masses.sum()
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
        """Hold a crank torque for a while, see ``ProjectionPlant.step``.

        FloatingPointError is raised, too, for a joint that came apart by more than
        :data:`MAX_JOINT_GAP`, or a robot at the end of the ground.
        """
        steps = max(1, round(positive("duration", duration) / self.time_step))
        h, sums, before = self.time_step, Sums(len(self._owners)), self.state
        impulses = np.zeros((steps, 2)) if pushes is None else check_pushes(pushes, steps)
        now = self._space.snapshot()
        start = now.energy + self._held
        for k in range(steps):
            now, used = self._advance(now, earlier if k < switch else torque, impulses[k], sums)
            sums.torque_impulse += h * (used - torque)
        if (error := self._refusal(before, torque, sums.joint_gap)) is not None:
            self._build(before)
            raise error
        return sums.result(self.toes, steps * h, torque, now.energy + self._held - start)

    def _refusal(self, before: Array, torque: float, gap: float) -> FloatingPointError | None:
        """Return the error of a step from state ``before`` (8,), None for none."""
        if not all(-DIVERGED < speed < DIVERGED for speed in self.state[4:].tolist()):
            return divergence(before, torque)
        if not gap < MAX_JOINT_GAP:
            return FloatingPointError(
                f"a joint came apart by {gap} m under a torque of {torque} N m; "
                "try a smaller time_step"
            )
        if not self._ends[0] < self.x < self._ends[1]:
            return FloatingPointError(
                f"the robot is at x = {self.x} m; the ground of the rigid-body plant ends at "
                f"{self._ends} m"
            )
        return None

    def _advance(
        self, now: Snapshot, asked: float, push: Array, sums: Sums
    ) -> tuple[Snapshot, float]:
        """Take a time step under a torque and a push (2,), N s; also returns the motor's torque."""
        h, motor, rotor, springs = self.time_step, self._machine.motor, self._rotor, self._springs
        spin, held = now.motion[:, SPIN], self._held
        loads = self._space.loads
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
        ax, ay = (-self._space.home[CHASSIS, 1:]).tolist()
        x, y = cos * ax - sin * ay, sin * ax + cos * ay
        impulse = np.array([*push, x * push[1] - y * push[0]])
        loads[CHASSIS] += impulse / h
        landing = springs is None and self._contacts.landing_soon(now)
        after = self._space.advance(h, self.touchdown_iterations if landing else self.iterations)
        mean = 0.5 * (spin + after.motion[:, SPIN])
        moved = 0.5 * (now.motion[CHASSIS] + after.motion[CHASSIS])[[VX, VY, SPIN]]
        push_work = float(impulse @ moved)
        turning = float(mean[SHAFT] - mean[CHASSIS])
        work = h * torque * turning
        loss = h * float(spin @ self._friction @ mean) + self._space.dry_loss(mean)
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
            springs.step(after, self._space.space, sums)
            self._contacts.note(touching)
        sums.joint_gap = max(sums.joint_gap, after.joint_gap)
        return after, torque

    @property
    def _held(self) -> float:
        """Energy in rotor and springs, J."""
        rotor = 0.0 if self._rotor is None else self._rotor.energy
        return rotor + (0.0 if self._springs is None else self._springs.stored)

    def lookahead(self, torque: float = 0.0) -> StepResult:
        """Result of the next :data:`LOOKAHEAD` seconds; the state stays, joints closed."""
        saved = self._memory
        try:
            return self.step(torque, LOOKAHEAD)
        finally:
            self._memory = saved

    @property
    def deflection(self) -> Array:
        """(pads, 2) compression (unknown: the bodies tell) and bend of compliant pads, m."""
        deflection = np.tile(UNKNOWN_DEFLECTION, (len(self._owners), 1))
        if self._springs is not None:
            deflection[:, 1] = self._springs.bristle
        return deflection

    @deflection.setter
    def deflection(self, value: Any) -> None:
        bristle = check_deflection(value, len(self._owners))[:, 1]
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
        """Kinetic plus potential energy, J."""
        return self._space.snapshot().energy + self._held

    def contact_frames(self) -> tuple[Array, Array]:
        """See :meth:`jansen_env.plants.base.BatchedPlant.contact_frames`."""
        return self._space.contact_frames(self.toe_positions())

    def toe_positions(self) -> Array:
        """(toes, 2) centres of the toe pads, m."""
        return self._space.snapshot().pads[: self.toes]

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
