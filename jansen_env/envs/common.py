"""Arguments that the environments share, checked in one place."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from jansen_env.robot import ROBOTS, Payload, Robot
from jansen_env.validation import non_negative, positive, within

RENDER_MODES = ["human", "rgb_array"]


def load_robot(robot: Robot | str, payload: Payload | float | None = None) -> Robot:
    """A robot by itself or by the name of a design, with a payload (or kg at the crank axis)."""
    if not isinstance(robot, Robot):
        if not isinstance(robot, str) or robot not in ROBOTS:
            raise ValueError(f"robot is {robot!r}, must be a Robot or one of {sorted(ROBOTS)}")
        robot = ROBOTS[robot]()
    if payload is None:
        return robot
    load = payload if isinstance(payload, Payload) else Payload(non_negative("payload", payload))
    return replace(robot, payload=load)


def command_range(command: Any, limit: float) -> tuple[float, float]:
    """``speed_command`` as (low, high): a number or a pair within +-``limit``."""
    pair = command if isinstance(command, (tuple, list, np.ndarray)) else 2 * [command]
    if len(pair) != 2:
        raise ValueError(f"speed_command is {command!r}, must be a number or (low, high)")
    low, high = (within("speed_command", value, -limit, limit) for value in pair)
    if low > high:
        raise ValueError(f"speed_command is {command!r}, must be (low, high) with low <= high")
    return low, high


def control_period(control_dt: Any, time_step: Any) -> float:
    """``control_dt`` in s: above 0 and a multiple of ``time_step``."""
    steps = positive("control_dt", control_dt) / positive("time_step", time_step)
    if steps < 1.0 - 1e-9 or abs(steps - round(steps)) > 1e-6 * steps:
        raise ValueError(
            f"control_dt is {control_dt!r}, must be a multiple of time_step, {time_step!r}"
        )
    return float(control_dt)


def flag(name: str, value: Any) -> bool:
    """A switch: True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} is {value!r}, must be True or False")
    return bool(value)


def render_mode(mode: Any) -> str | None:
    """None or one of :data:`RENDER_MODES`."""
    if mode is not None and mode not in RENDER_MODES:
        raise ValueError(f"render_mode is {mode!r}, must be None or one of {RENDER_MODES}")
    return mode


def torque_share(action: Any) -> float:
    """The action (1,) as a share of the torque limit, clipped to -1 .. 1."""
    values = np.asarray(action, dtype=float)
    if values.shape != (1,) or not math.isfinite(values[0]):
        raise ValueError(f"action is {action!r}, must be one finite number, shape (1,)")
    return min(1.0, max(-1.0, float(values[0])))
