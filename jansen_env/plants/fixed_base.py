"""The fixed-base plant: the paper's fixed model, chassis held in the air, one degree of freedom."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import finite, non_negative, positive
from jansen_env.dynamics.joint_forces import JointForces, joint_forces
from jansen_env.engine import runge_kutta
from jansen_env.gravity import GRAVITY
from jansen_env.plants.base import check_state, check_time_step
from jansen_env.plants.design_tables import DesignTables
from jansen_env.plants.robot_data import parameters
from jansen_env.robot import Robot

Array = NDArray[np.float64]


class FixedBaseBatch:
    """``count`` robots with their chassis held level in the air, each with its own crank.

    Args:
        robot: whose cranks turn. count: how many. time_step: of the integration (Runge-Kutta,
            order 4), s. gravity: m/s^2.

    Attributes:
        robots: equal at first, see :meth:`set_robots`.
        states: (n, 2) crank angle (rad, not wrapped) and crank speed (rad/s); can be written to.
        rows: (n, 6) these, and sums, see :mod:`jansen_env.engine.runge_kutta`.
        sums: (n, 5) motor_work, joint_loss, energy_change, electrical_work, J, and torque, the
            motor's mean, N m, over the last :meth:`step`; each an attribute (n,), too.
        diverged: (n,) whether the last :meth:`step` was refused. any_diverged: whether one was.

    Raises:
        ValueError: an argument out of range; LinkageError: the robot cannot turn its crank.
    """

    def __init__(
        self, robot: Robot, count: int = 1, time_step: float = 1e-3, gravity: float = GRAVITY
    ) -> None:
        self.robots = [robot] * count
        self.time_step = check_time_step(time_step)
        self.gravity = non_negative("gravity", gravity)
        self.designs = DesignTables(self.robots)
        self._params = np.repeat(parameters(robot, (0.0, -self.gravity)), count)
        self.rows = np.zeros((count, runge_kutta.STATE))
        self.states = self.rows[:, : runge_kutta.LOSS]
        self.sums = np.zeros((count, 5))
        self.motor_work, self.joint_loss, self.energy_change, self.electrical_work, self.torque = (
            self.sums.T
        )
        self._at_once = np.zeros(count), np.zeros(count, np.int64)  # no torque from before
        self.diverged, self.any_diverged = np.zeros(count, bool), False
        self._work = np.zeros((3, 4, runge_kutta.STATE))
        self._turn = runge_kutta.turn_each.bound()

    def set_robots(self, rows: NDArray[np.int64], robots: Sequence[Robot]) -> None:
        """Exchange robots (k,), for such of the same linkage.

        Raises:
            ValueError, LinkageError: as for the class; nothing has changed then.
        """
        self.designs.set(rows, robots)
        for row, robot in zip(rows.tolist(), robots, strict=True):
            self.robots[row] = robot
            self._params[row : row + 1] = parameters(robot, (0.0, -self.gravity))

    def energy(self, row: int) -> float:
        """Kinetic plus potential energy of a robot, J (0 potential: mass centre at the axis)."""
        designs = self.designs.number, self.designs.model.body
        energy = runge_kutta.fixed_base_energy(row, self.rows, *designs, self._params, self._work)
        return float(energy)

    def step(
        self,
        torque: Array,
        steps: int,
        earlier: Array | None = None,
        switch: NDArray[np.int64] | None = None,
    ) -> None:
        """Hold crank torques, see :meth:`jansen_env.plants.base.BatchedPlant.step`.

        A crank that becomes faster than :data:`jansen_env.engine.runge_kutta.DIVERGED` stays as it
        was, and is named in :attr:`diverged`.
        """
        before = self._at_once if earlier is None else (earlier, switch)
        self.any_diverged = self._turn(*self._arguments_of_turn(torque, steps, *before))

    def _arguments_of_turn(
        self, torque: Array, steps: int, earlier: Any, switch: Any
    ) -> tuple[Any, ...]:
        model = self.designs.model
        return (
            steps, switch, self.time_step, torque, earlier, self.rows, self.designs.number,
            model.body, model.bearings, self._params, self._work, self.sums, self.diverged,
        )  # fmt: skip

    def joint_forces(self, row: int, torque: float = 0.0) -> JointForces:
        """Forces in every joint of a robot at its present state under a crank torque (N m)."""
        robot, (angle, speed) = self.robots[row], self.states[row]
        q, q_dot = np.array([0.0, 0.0, 0.0, angle]), np.array([0.0, 0.0, 0.0, speed])
        return joint_forces(robot, q, q_dot, torque, fixed_base=True, gravity=self.gravity)

    def __getstate__(self) -> dict[str, Any]:
        """The arguments and the states: everything else is made again from them."""
        arguments = (self.robots[0], len(self.states), self.time_step, self.gravity)
        results = (self.robots, self.states.copy(), self.sums.copy(), self.diverged.copy())
        return {"arguments": arguments, "results": results}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(*saved["arguments"])  # type: ignore[misc]
        robots, self.states[:], self.sums[:], self.diverged[:] = saved["results"]
        self.set_robots(np.arange(len(robots)), robots)
        self.any_diverged = bool(self.diverged.any())


class FixedBaseResult(NamedTuple):
    """Energies of one :meth:`FixedBasePlant.step`, J."""

    motor_work: float
    joint_loss: float
    energy_change: float
    electrical_work: float

    @property
    def energy_residual(self) -> float:
        """Motor work less losses and energy change, J: the time step's error."""
        return self.motor_work - self.joint_loss - self.energy_change


class FixedBasePlant:
    """A :class:`FixedBaseBatch` of one, with its arguments and errors."""

    def __init__(self, robot: Robot, time_step: float = 1e-3, gravity: float = GRAVITY) -> None:
        self._take(FixedBaseBatch(robot, 1, time_step, gravity))

    @classmethod
    def of(cls, batch: FixedBaseBatch) -> FixedBasePlant:
        """Return the plant that a batch of one robot is."""
        plant = cls.__new__(cls)
        plant._take(batch)
        return plant

    def _take(self, batch: FixedBaseBatch) -> None:
        self.batch = batch
        self.time_step, self.gravity = batch.time_step, batch.gravity

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.batch.robots[0]

    @property
    def state(self) -> Array:
        """(2,) crank angle (rad, not wrapped) and crank speed (rad/s), a copy."""
        return self.batch.states[0].copy()

    @state.setter
    def state(self, value: Array) -> None:
        self.batch.states[0] = check_state(value, 2)

    def reset(self, crank_angle: float = 0.0, crank_speed: float = 0.0) -> Array:
        """Start from a crank angle (rad) and speed (rad/s); returns the new state (2,)."""
        self.state = np.array([crank_angle, crank_speed])
        return self.state

    def energy(self) -> float:
        """Kinetic plus potential energy, J (potential 0 with the centre of mass at the axis)."""
        return self.batch.energy(0)

    def step(self, torque: float, duration: float) -> FixedBaseResult:
        """Hold a crank torque (N m) for a while (s, rounded to whole time steps).

        Raises:
            ValueError: a torque that is not finite, or a duration not above 0.
            FloatingPointError: the crank became too fast, see :class:`FixedBaseBatch`; its state
                is as it was before.
        """
        steps = max(1, round(positive("duration", duration) / self.time_step))
        batch = self.batch
        batch.step(np.array([finite("torque", torque)]), steps)
        if batch.diverged[0]:
            raise FloatingPointError(
                f"the simulation diverged from {self.state.tolist()} under a torque of {torque} "
                "N m; try a smaller time_step"
            )
        return FixedBaseResult(*batch.sums[0, :4].tolist())

    def joint_forces(self, torque: float = 0.0) -> JointForces:
        """Forces in every joint at the present state under a crank torque (N m)."""
        return self.batch.joint_forces(0, torque)
