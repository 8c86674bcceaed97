"""Baselines of JansenCrank-v0: the paper's PID, constant torque, and inverse dynamics.

All read nothing but the observation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policy import Array, PIDPolicy, Policy, TorquePolicy
from jansen_env.control import PID
from jansen_env.dynamics.inverse import crank_torque
from jansen_env.robot import Robot

COS_CRANK, SIN_CRANK, CRANK_SPEED, ERROR, COMMAND = range(5)  # places in the observation
BASELINES = ("pid", "constant", "inverse")

# Beside the joints' friction, 1.6 N m s / rad, it damps the crank (0.73 kg m^2) nearly critically.
FEEDBACK = PID(kp=5.0, ki=0.0, kd=2.0)


def observed_reference(
    observations: Array, memory: None, starts: NDArray[np.bool_]
) -> tuple[Array, Array, None]:
    """The environment's own reference, of which the observation has the error."""
    return observations[:, ERROR], observations[:, COMMAND] - observations[:, CRANK_SPEED], None


def inverse_dynamics(robot: Robot, torque_limit: float, feedback: PID = FEEDBACK) -> TorquePolicy:
    """Computed torque: what the commanded speed takes at this crank angle, plus kp e + kd de/dt.

    Args:
        robot: whose crank turns. torque_limit: of the environment, N m.
        feedback: its kp and kd.
    """

    def torque(observations: Array) -> Array:
        cos, sin, speed, error, command = observations.T
        needed = crank_torque(robot, np.arctan2(sin, cos), command).total
        result: Array = needed + feedback.kp * error + feedback.kd * (command - speed)
        return result

    return TorquePolicy(torque, torque_limit)


def mean_friction(robot: Robot) -> float:
    """Mean over a turn of the joints' friction as the crank feels it, N m s / rad."""
    turn = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    return float(crank_torque(robot, turn).friction.mean())


def load_baseline(name: str, env: Any) -> Policy:
    """``"pid"`` (13), ``"constant"`` torque, or ``"inverse"`` dynamics.

    The constant torque is the one whose power feeds the joints' friction at the commanded speed.

    Args:
        name: one of :data:`BASELINES`. env: the unwrapped environment it is to act in.

    Raises:
        ValueError: another name.
    """
    if name not in BASELINES:
        raise ValueError(f"baseline is {name!r}, must be one of {BASELINES}")
    if name == "inverse":
        return inverse_dynamics(env.robot, env.torque_limit)
    if name == "constant":
        friction = mean_friction(env.robot)
        return TorquePolicy(lambda batch: friction * batch[:, COMMAND], env.torque_limit)
    return PIDPolicy(observed_reference, env.torque_limit, env.control_dt)
