"""Baselines of JansenCrank-v0: the paper's PID, constant torque, and inverse dynamics.

All read nothing but the observation and answer ``predict`` as Stable-Baselines3's models do.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.pid import Gains, PIDController
from agents.policy import ConstantTorque, Policy, as_action, rows
from jansen_env.dynamics.inverse import crank_torque
from jansen_env.robot import Robot

Array = NDArray[np.float64]

COS_CRANK, SIN_CRANK, CRANK_SPEED, ERROR, COMMAND = range(5)  # places in the observation
BASELINES = ("pid-paper", "constant", "inverse")

# Beside the joints' friction, 1.6 N m s / rad, it damps the crank (0.73 kg m^2) nearly critically.
FEEDBACK = Gains(kp=5.0, ki=0.0, kd=2.0)


class ObservedReference:
    """The environment's own reference: the observation has the error."""

    def follow(
        self, seen: Array, memory: None, fresh: NDArray[np.bool_]
    ) -> tuple[Array, Array, None]:
        """See :class:`agents.pid.Reference`."""
        return seen[:, ERROR], seen[:, COMMAND] - seen[:, CRANK_SPEED], None


class InverseDynamics:
    """Computed torque: what the commanded speed takes at this crank angle, plus kp e + kd de/dt.

    Args:
        robot: whose crank turns. torque_limit: of the environment, N m.
        gains: kp and kd count.
    """

    def __init__(self, robot: Robot, torque_limit: float, gains: Gains = FEEDBACK) -> None:
        self.robot, self.torque_limit, self.gains = robot, torque_limit, gains

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (n, 1) or (1,) for observations (n, d) or (d,); the state is not used."""
        cos, sin, speed, error, command = rows(observation).T
        needed = crank_torque(self.robot, np.arctan2(sin, cos), command).total
        torque = needed + self.gains.kp * error + self.gains.kd * (command - speed)
        return as_action(torque / self.torque_limit, observation), state


def mean_friction(robot: Robot) -> float:
    """Mean over a turn of the joints' friction as the crank feels it, N m s / rad."""
    turn = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    return float(crank_torque(robot, turn).friction.mean())


def load_baseline(name: str, env: Any) -> Policy:
    """``"pid-paper"`` (13), ``"constant"`` torque, or ``"inverse"`` dynamics.

    The constant torque is the one whose power feeds the joints' friction at the commanded speed.

    Args:
        name: one of :data:`BASELINES`. env: the unwrapped environment it is to act in.

    Raises:
        ValueError: another name.
    """
    if name not in BASELINES:
        raise ValueError(f"baseline is {name!r}, must be one of {BASELINES}")
    if name == "inverse":
        return InverseDynamics(env.robot, env.torque_limit)
    if name == "constant":
        friction = mean_friction(env.robot)
        return ConstantTorque(lambda command: friction * command, COMMAND, env.torque_limit)
    return PIDController(Gains(), ObservedReference(), env.torque_limit, env.control_dt)
