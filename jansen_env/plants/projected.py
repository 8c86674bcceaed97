"""The projection plant: pymunk finds the ground, the projected equations feel it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import finite, positive
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.dynamics.reduced import Tables
from jansen_env.gravity import GRAVITY, Gravity
from jansen_env.parameters import ROBOT_PARAMETERS
from jansen_env.plants.base import (
    ENERGIES,
    StepResult,
    check_deflection,
    check_in_contact,
    check_pushes,
    check_state,
    divergence,
)
from jansen_env.plants.batch import DETECTION_INTERVAL, TIME_STEP, Batch
from jansen_env.plants.trace import PeakLoads
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]


class ProjectionPlant:
    """A robot on a terrain: reset, step(torque), state. It is a :attr:`batch` of one.

    Args:
        robot, terrain: what walks where.
        gravity: m/s^2 downwards, or a vector (x, y); may be changed between steps.
        time_step, detection_interval; errors: see :class:`Batch`.
    """

    def __init__(
        self,
        robot: Robot,
        terrain: Terrain,
        time_step: float = TIME_STEP,
        gravity: Gravity = GRAVITY,
        detection_interval: float = DETECTION_INTERVAL,
    ) -> None:
        self._take(Batch([robot], [terrain], time_step, gravity, detection_interval, threads=1))

    @classmethod
    def of(cls, batch: Batch) -> ProjectionPlant:
        """Return the plant that a batch of one robot is."""
        plant = cls.__new__(cls)
        plant._take(batch)
        return plant

    def _take(self, batch: Batch) -> None:
        self.batch, self.time_step, self.toes = batch, batch.time_step, batch.toes
        self.detection_interval = batch.detection_interval

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.batch.robots[0]

    @property
    def terrain(self) -> Terrain:
        """The terrain."""
        return self.batch.terrains[0]

    @property
    def tables(self) -> Tables:
        """The compiled robot under its parameters."""
        return self.batch.tables_in_force(0)

    @property
    def state(self) -> Array:
        """(8,) x, y, theta, psi and their rates, a copy; x, y the crank axis, m, rad, s."""
        return self.batch.states[0].copy()

    @state.setter
    def state(self, value: Array) -> None:
        self.batch.set_state(0, check_state(value))

    @property
    def x(self) -> float:
        """Position of the crank axis along the ground, m."""
        return float(self.batch.states[0, 0])

    @property
    def gravity(self) -> tuple[float, float]:
        """(x, y) m/s^2, without the tilt of the parameters."""
        params = self.batch.nominal_params[0]
        return float(params["gravity_x"]), float(params["gravity_y"])

    @gravity.setter
    def gravity(self, value: Gravity) -> None:
        self.batch.change(0, {"gravity": value})

    @property
    def nominal(self) -> np.void:
        """The robot's and its ground's own numbers, for :meth:`set_parameters`."""
        return self.batch.nominal[0].copy()

    def set_parameters(self, values: np.void) -> None:
        """Put parameters in force, see :class:`jansen_env.plants.base.BatchedPlant`."""
        self.batch.set_parameters(np.zeros(1, np.int64), np.array([values], ROBOT_PARAMETERS))

    @property
    def prescribed_crank_speed(self) -> bool:
        """Whether the crank keeps its speed whatever torque that takes: locked, if it stands."""
        return bool(self.batch.params["prescribed_speed"][0])

    @prescribed_crank_speed.setter
    def prescribed_crank_speed(self, driven: bool) -> None:
        self.batch.params["prescribed_speed"] = bool(driven)

    @property
    def in_contact(self) -> NDArray[np.bool_] | None:
        """(pads,) the pads on the ground, as traced last; None where that is not known.

        Part of the state only in that it says what lands next: set it after :attr:`state`.
        """
        in_contact = self.batch.in_contact
        return None if in_contact is None else in_contact.copy()

    @in_contact.setter
    def in_contact(self, value: Any) -> None:
        self.batch.in_contact = check_in_contact(value, len(self.batch.contact_statistics[0]))

    @property
    def deflection(self) -> Array:
        """(pads, 2) compression and bend of compliant pads, m: set it after the state."""
        return self.batch.deflection[0].copy()

    @deflection.setter
    def deflection(self, value: Any) -> None:
        self.batch.deflection[0] = check_deflection(value, len(self.batch.deflection[0]))

    @property
    def tracing(self) -> bool:
        """Whether :meth:`step` keeps a record of its time steps in :attr:`trace`."""
        return self.batch.tracing

    @tracing.setter
    def tracing(self, value: bool) -> None:
        self.batch.tracing = bool(value)

    @property
    def trace(self) -> NDArray[np.void]:
        """(steps,) time steps of the last :meth:`step` or :meth:`lookahead`, see :class:`Batch`."""
        return self.batch.trace

    @property
    def touchdowns(self) -> NDArray[np.bool_]:
        """(steps,) whether a pad touched down in each time step of the last traced :meth:`step`."""
        return self.batch.touchdowns

    def reset(self, x: float = 0.0, crank_angle: float = 0.0, pitch: float | None = None) -> Array:
        """Place the robot at rest, see :meth:`Batch.place_at`; returns the new state (8,)."""
        angles = np.array([finite("crank_angle", crank_angle)])
        self.batch.place_at(np.zeros(1, np.int64), angles, x, pitch)
        return self.state

    def lookahead(self, torque: float = 0.0, push: Array | None = None) -> StepResult:
        """Result of one time step; the state stays as it is.

        ``push``: (2,) N s, the impulse on the chassis in it, None for none.
        """
        pushes = None if push is None else check_pushes(push)[None, None]
        self.batch.lookahead(torque, pushes=pushes)
        return self._result(torque)

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
            torque: N m on the crank, counter-clockwise positive (and its reaction on the chassis).
            duration: s, rounded to whole time steps.
            earlier, switch, pushes (steps, 2): as of one robot in
                :meth:`jansen_env.plants.base.BatchedPlant.step`.

        Raises:
            ValueError: a duration out of range, or pushes of another shape.
            FloatingPointError: the simulation diverged, to a speed that nothing has or to a pad
                deep in the ground. The state is as it was before.
        """
        steps = max(1, round(positive("duration", duration) / self.time_step))
        asked, before = np.array([torque], dtype=float), np.array([earlier], dtype=float)
        impulses = None if pushes is None else check_pushes(pushes, steps)[None]
        self.batch.step(asked, steps, before, np.array([switch]), pushes=impulses)
        return self._result(torque, steps)

    def _result(self, torque: float, steps: int = 1) -> StepResult:
        """Return the result of the batch's last step, of so many time steps."""
        batch = self.batch
        if batch.any_diverged:
            raise divergence(batch.states[0], torque)
        total = batch.accumulators[0]
        sums = dict(zip(total.dtype.names or (), total.item(), strict=True))
        return StepResult(
            slip=batch.slip[0].copy(),
            contact_force=batch.contact_force[0].copy(),
            non_toe_contact=sums["non_toe_impulse"] > 0.0,
            residual=sums["worst_residual"],
            torque=torque + sums["torque_impulse"] / (steps * self.time_step),
            **{name: sums[name] for name in ENERGIES},
        )

    def joint_forces(self, torque: float = 0.0, push: Array | None = None) -> JointForces:
        """Mean forces in every joint over the next time step under a crank torque (N m).

        They contain a landing toe's impulse / time step. ``push``: see :meth:`lookahead`.
        """
        return self.batch.joint_forces(torque, push)

    def peak_loads(self) -> PeakLoads:
        """The largest loads on any joint in the last :meth:`step`, which must have been traced."""
        return self.batch.peak_loads()

    def contact_frames(self) -> tuple[Array, Array]:
        """(toes, 2) points and tangents, see :class:`jansen_env.plants.base.BatchedPlant`."""
        return self.batch.contact_frames(0)

    def toe_positions(self) -> Array:
        """(toes, 2) centres of the toe pads, m."""
        return self.batch.pad_centres(0)[: self.toes]

    def energy(self) -> float:
        """Kinetic plus potential energy, J (potential 0 with the centre of mass at y = 0)."""
        return self.batch.energy(0)
