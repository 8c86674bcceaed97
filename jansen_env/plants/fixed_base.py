"""The pinned plant: the paper's fixed model, chassis held in the air, one freedom, the crank."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import finite, non_negative, positive
from jansen_env.dynamics.joint_forces import JointForces, joint_forces
from jansen_env.dynamics.reduced import compile_robot
from jansen_env.engine import runge_kutta
from jansen_env.engine.jit import announce
from jansen_env.engine.tables import kernel_model, parameters
from jansen_env.gravity import GRAVITY
from jansen_env.plants.base import check_time_step
from jansen_env.robot import Robot

Array = NDArray[np.float64]

DIVERGED = 1e4  # rad/s, beyond which a state is no longer believed


class PinnedResult(NamedTuple):
    """What happened during one :meth:`PinnedPlant.step`, J."""

    motor_work: float
    joint_loss: float
    energy_change: float

    @property
    def energy_residual(self) -> float:
        """Motor work less losses and energy change, J: the time step's error."""
        return self.motor_work - self.joint_loss - self.energy_change


class PinnedPlant:
    """A robot with its chassis held level in the air: reset, step(torque), state.

    Args:
        robot: whose crank turns. time_step: of the integration (Runge-Kutta, order 4), s.
        gravity: m/s^2.

    Raises:
        ValueError: an argument out of range; LinkageError: the robot cannot turn its crank.
    """

    def __init__(self, robot: Robot, time_step: float = 1e-3, gravity: float = GRAVITY) -> None:
        announce("runge_kutta.turn")
        self.robot = robot
        self.time_step = check_time_step(time_step)
        self.gravity = non_negative("gravity", gravity)
        self.tables = compile_robot(robot)
        self._body = kernel_model(self.tables).body
        self._parameters = parameters(self.tables, (0.0, -self.gravity))
        self._state = np.zeros(3)

    @property
    def state(self) -> Array:
        """(2,) crank angle (rad, not wrapped) and crank speed (rad/s), a copy."""
        return self._state[: runge_kutta.LOSS].copy()

    @state.setter
    def state(self, value: Array) -> None:
        state = np.asarray(value, dtype=float)
        if state.shape != (2,) or not np.isfinite(state).all():
            raise ValueError(f"state is {value!r}, must be 2 finite numbers")
        self._state[: runge_kutta.LOSS] = state

    def reset(self, crank_angle: float = 0.0, crank_speed: float = 0.0) -> Array:
        """Start from a crank angle (rad) and speed (rad/s); returns the new state (2,)."""
        self.state = np.array([crank_angle, crank_speed])
        return self.state

    def energy(self) -> float:
        """Kinetic plus potential energy, J (potential 0 with the centre of mass at the axis)."""
        return float(sum(runge_kutta.pinned_energy(self._body, self._parameters, *self._state[:2])))

    def step(self, torque: float, duration: float) -> PinnedResult:
        """Hold a crank torque (N m) for a while (s, rounded to whole time steps).

        Raises:
            ValueError: a torque that is not finite, or a duration not above 0.
            FloatingPointError: the state is no longer finite, or faster than anything believable.
        """
        steps = max(1, round(positive("duration", duration) / self.time_step))
        finite("torque", torque)
        energy, angle = self.energy(), self._state[runge_kutta.ANGLE]
        self._state[runge_kutta.LOSS] = 0.0
        runge_kutta.turn(steps, self.time_step, torque, self._state, self._body, self._parameters)
        if not -DIVERGED < self._state[runge_kutta.SPEED] < DIVERGED:
            raise FloatingPointError(
                f"the state diverged to {self.state.tolist()} under a torque of {torque} N m; "
                "try a smaller time_step"
            )
        turned = float(self._state[runge_kutta.ANGLE] - angle)
        loss = float(self._state[runge_kutta.LOSS])
        return PinnedResult(torque * turned, loss, self.energy() - energy)

    def joint_forces(self, torque: float = 0.0) -> JointForces:
        """Forces in every joint at the present state under a crank torque (N m)."""
        angle, speed = self.state
        q, q_dot = np.array([0.0, 0.0, 0.0, angle]), np.array([0.0, 0.0, 0.0, speed])
        return joint_forces(self.robot, q, q_dot, torque, fixed_base=True, gravity=self.gravity)

    def __getstate__(self) -> dict[str, Any]:
        """The arguments and the state: everything else is made anew from them."""
        return {
            "robot": self.robot, "time_step": self.time_step, "gravity": self.gravity,
            "state": self.state,
        }  # fmt: skip

    def __setstate__(self, saved: dict[str, Any]) -> None:
        state = saved.pop("state")
        self.__init__(**saved)  # type: ignore[misc]
        self.state = state
