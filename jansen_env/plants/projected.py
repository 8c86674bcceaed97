"""The projection plant: pymunk finds the ground, the projected equations feel it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import finite, positive
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.dynamics.reduced import body_sums, compile_robot
from jansen_env.engine import integrator
from jansen_env.engine.collision import PAD
from jansen_env.engine.tables import DRIVEN, GRAVITY_X, GRAVITY_Y
from jansen_env.gravity import GRAVITY, Gravity, gravity_vector
from jansen_env.plants.base import StepResult, check_pressed, check_state, divergence
from jansen_env.plants.batch import DETECTION_INTERVAL, TIME_STEP, Batch
from jansen_env.plants.initial_pose import set_down
from jansen_env.plants.trace import PeakLoads, landings, pads_pressed, peak_loads, trace_forces
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]

SET_DOWN_ROUNDS = 3  # Newton steps of lowering it
SET_DOWN_DEPTH = 1e-9  # m, by which a robot is set down into the ground: its toes carry at once


class ProjectionPlant:
    """A robot on a terrain: reset, step(torque), state.

    Args:
        robot, terrain: what walks where.
        time_step: of the integration, s.
        gravity: m/s^2 downwards, or a vector (x, y); may be changed between steps. Sideways it is
            a pull at the centre of mass.
        detection_interval: time between two looks for the ground, s.

    Attributes:
        tracing: whether :meth:`step` keeps a record of its time steps in :attr:`trace`.
        landings: (steps,) whether a pad landed in each time step of the last traced :meth:`step`.

    Raises:
        ValueError: an argument out of range; LinkageError: the robot cannot turn its crank.
    """

    def __init__(
        self,
        robot: Robot,
        terrain: Terrain,
        time_step: float = TIME_STEP,
        gravity: Gravity = GRAVITY,
        detection_interval: float = DETECTION_INTERVAL,
    ) -> None:
        self.robot, self.terrain = robot, terrain
        self._batch = Batch([robot], [terrain], time_step, gravity, detection_interval, threads=1)
        self.time_step, self.detection_interval = self._batch.time_step, detection_interval
        self.tables, self.toes = self._batch.tables, self._batch.toes
        self._detector = self._batch.detector
        self._state, self._parameters = self._batch.states[0], self._batch.parameters[0]
        self._totals, self._record = self._batch.totals[0], self._batch.record[0]
        self._torque = np.zeros(1)
        self.tracing = False
        self._trace = self._no_trace = np.zeros((0, integrator.trace_width(len(self._record))))
        self.landings = np.zeros(0, bool)
        self._pressed: NDArray[np.bool_] | None = None

    @property
    def state(self) -> Array:
        """(8,) x, y, theta, psi and their rates, a copy; x, y the crank axis, m, rad, s."""
        return self._state.copy()

    @state.setter
    def state(self, value: Array) -> None:
        self._state[:] = check_state(value)
        self._pressed = None

    @property
    def gravity(self) -> tuple[float, float]:
        """(x, y) m/s^2."""
        return float(self._parameters[GRAVITY_X]), float(self._parameters[GRAVITY_Y])

    @gravity.setter
    def gravity(self, value: Gravity) -> None:
        self._parameters[[GRAVITY_X, GRAVITY_Y]] = gravity_vector(value)

    @property
    def crank_driven(self) -> bool:
        """Whether the crank keeps its speed whatever torque that takes: locked, if it stands."""
        return bool(self._parameters[DRIVEN])

    @crank_driven.setter
    def crank_driven(self, driven: bool) -> None:
        self._parameters[DRIVEN] = bool(driven)

    @property
    def pressed(self) -> NDArray[np.bool_] | None:
        """(pads,) the pads on the ground, as traced last; None where that is not known.

        Part of the state only in that it says what lands next: set it after :attr:`state`.
        """
        return None if self._pressed is None else self._pressed.copy()

    @pressed.setter
    def pressed(self, value: Any) -> None:
        self._pressed = check_pressed(value, len(self._record))

    def become(self, robot: Robot, parameters: Array) -> None:
        """Be another robot of the same design: its payload and its row of parameters, a copy."""
        if robot is not self.robot:
            self.robot, self.tables = robot, compile_robot(robot)
        self._parameters[:] = parameters

    def sums(self) -> tuple[Array, Array]:
        """Totals and record of the last :meth:`step` or :meth:`peek`: see :class:`Batch`."""
        return self._totals, self._record

    def reset(self, x: float = 0.0, crank_angle: float = 0.0, pitch: float | None = None) -> Array:
        """Set the robot down at rest on its lowest toes.

        Args:
            x: crank axis, m. crank_angle: rad.
            pitch: rad; None turns the robot until both its fore and its back feet carry it
                (until the ground bears it on both sides of its centre of mass).

        Returns:
            The new state (8,).

        Raises:
            ValueError: a number that is not finite.
        """
        centre = body_sums(self.tables, finite("crank_angle", crank_angle)).c / self.robot.mass
        y, theta = set_down(self.robot, centre, self.terrain, x, crank_angle, pitch)
        self._state[:] = (x, y, theta, crank_angle, 0.0, 0.0, 0.0, 0.0)
        self._pressed = None
        for _ in range(SET_DOWN_ROUNDS):  # to the discs' true gap, where the ground is not straight
            normal, pad, centres = self._look()
            if len(pad):
                gap = (normal[:, :2] * centres[pad]).sum(axis=1) - normal[:, 2]
                self._state[1] -= ((gap - self.robot.pad_radius) / normal[:, 1]).min()
        self._state[1] -= SET_DOWN_DEPTH
        return self.state

    @property
    def x(self) -> float:
        """Position of the crank axis along the ground, m."""
        return float(self._state[0])

    def peek(self, torque: float = 0.0) -> StepResult:
        """What one time step would do; the state stays as it is."""
        state, pressed = self._state.copy(), self._pressed
        try:
            return self.step(torque, self.time_step)
        finally:
            self._state[:], self._pressed = state, pressed

    @property
    def trace(self) -> Array:
        """(steps, columns) what each time step of the last :meth:`step` or :meth:`peek` did.

        Columns as named in :mod:`jansen_env.engine.integrator`; no rows unless :attr:`tracing`.
        """
        return self._trace

    def joint_forces(self, torque: float = 0.0) -> JointForces:
        """Forces in every joint now: the mean over the next time step under a crank torque (N m).

        With a toe landing in that step they contain its impulse / time step.
        """
        kept = self.tracing, self._trace, self.landings
        self.tracing = True
        try:
            self.peek(torque)
            return trace_forces(self.tables, self._trace, self.time_step, self.gravity).at(0)
        finally:
            self.tracing, self._trace, self.landings = kept

    def peak_loads(self) -> PeakLoads:
        """The largest loads on any joint in the last :meth:`step`, which must have been traced."""
        forces = trace_forces(self.tables, self._trace, self.time_step, self.gravity)
        return peak_loads(forces.bearing, self.landings, self.time_step)

    def contact_frames(self) -> tuple[Array, Array]:
        """(toes, 2) points of the ground nearest to each toe's pad and its tangents there.

        Where no ground is within reach, the pad's lowest point and +x.
        """
        planes, pads, centres = self._look()
        points = centres[: self.toes] - np.array([0.0, self.robot.pad_radius])
        tangents = np.tile([1.0, 0.0], (self.toes, 1))
        for plane, pad in zip(planes[::-1], pads[::-1], strict=True):  # a pad's nearest comes last
            if pad < self.toes:
                normal = plane[:2]
                points[pad] = centres[pad] - self.robot.pad_radius * normal
                tangents[pad] = normal[1], -normal[0]
        return points, tangents

    def __getstate__(self) -> dict[str, Any]:
        """The arguments and the state: everything else is made anew from them."""
        return {
            "robot": self.robot, "terrain": self.terrain, "time_step": self.time_step,
            "gravity": self.gravity, "detection_interval": self.detection_interval,
            "state": self.state, "driven": self.crank_driven, "tracing": self.tracing,
            "pressed": self.pressed,
        }  # fmt: skip

    def __setstate__(self, saved: dict[str, Any]) -> None:
        later = {name: saved.pop(name) for name in ("state", "driven", "tracing", "pressed")}
        self.__init__(**saved)  # type: ignore[misc]
        self.state, self.crank_driven = later["state"], later["driven"]
        self.tracing, self.pressed = later["tracing"], later["pressed"]

    def toe_positions(self) -> Array:
        """(toes, 2) centres of the toe pads, m."""
        return self._look()[2][: self.toes].copy()

    def energy(self) -> float:
        """Kinetic plus potential energy, J (potential 0 with the centre of mass at y = 0)."""
        return self._batch.energy(0)

    def _look(self) -> tuple[Array, NDArray[np.int64], Array]:
        """Contact planes (n, 3), the pad that each is for (n,), and the centres of the pads."""
        self._batch.look()
        detector = self._detector
        begin, end = detector.spans[0].tolist()
        return detector.planes[begin:end], detector.contacts[begin:end, PAD], detector.centres

    def step(self, torque: float, duration: float) -> StepResult:
        """Hold a crank torque for a while.

        Args:
            torque: N m on the crank, counter-clockwise positive (and its reaction on the chassis).
            duration: s, rounded to whole time steps.

        Raises:
            FloatingPointError: the simulation diverged, to a speed that nothing has or to a pad
                deep in the ground. The state is as it was before.
        """
        steps = max(1, round(positive("duration", duration) / self.time_step))
        self._torque[0] = torque
        pressed = self._pressed
        self._trace, self._pressed = self._no_trace, None
        trace = np.empty((steps, self._no_trace.shape[1])) if self.tracing else None
        self._batch.step(self._torque, steps, trace)
        if self._batch.diverged[0]:
            self._pressed, self.landings = pressed, np.zeros(0, bool)
            raise divergence(self._state, torque)
        if trace is not None:
            self._trace, self.landings = trace, landings(trace, pressed)
            self._pressed = pads_pressed(trace)[-1]
        record, elapsed = self._record, steps * self.time_step
        motor, joints, slip, impact, residual, bumps, _, change, gain = self._totals.tolist()
        return StepResult(
            slip=record[: self.toes, integrator.SLIP].copy(),
            contact_force=record[: self.toes, integrator.IMPULSE_T : integrator.IMPULSE_N + 1]
            / elapsed,
            motor_work=motor,
            joint_loss=joints,
            slip_loss=slip,
            impact_loss=impact,
            energy_change=change,
            bumped=bumps > 0.0,
            residual=residual,
            contact_gain=gain,
        )
