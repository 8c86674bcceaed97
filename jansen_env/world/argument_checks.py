"""Checks of arguments, options and states that worlds and tasks share.

All functions raise ValueError for anything else than they describe.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import finite, positive, shown, within
from jansen_env.plants.base import check_time_step

Array = NDArray[np.float64]

MOST_STEPS = 10_000  # time steps in a control period: seconds on the slowest plant


def control_period(control_dt: Any, time_step: Any) -> tuple[float, float]:
    """``control_dt`` and ``time_step`` in s: the first 1 to :data:`MOST_STEPS` times the second."""
    period = positive("control_dt", control_dt)
    step = check_time_step(time_step)
    steps = period / step
    if steps > MOST_STEPS * (1.0 + 1e-9):
        raise ValueError(
            f"control_dt is {shown(control_dt)}, must be at most {MOST_STEPS} times time_step, "
            f"{shown(time_step)}"
        )
    if steps < 1.0 - 1e-9 or abs(steps - round(steps)) > 1e-6 * steps:
        raise ValueError(
            f"control_dt is {shown(control_dt)}, must be a multiple of time_step, "
            f"{shown(time_step)}"
        )
    return period, step


def interval(name: str, value: Any) -> float:
    """A time in s above 0; inf for None, which stands for never."""
    return math.inf if value is None else positive(name, value)


def flag(name: str, value: Any) -> bool:
    """A switch: True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} is {shown(value)}, must be True or False")
    return bool(value)


def batched_actions(count: int, actions: Any) -> Array:
    """Actions (count, 1) as an array of floats."""
    try:
        values: Array = np.ascontiguousarray(actions, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(
            f"actions are {shown(actions)}, must be numbers, shape ({count}, 1)"
        ) from None
    if values.shape != (count, 1):
        raise ValueError(f"actions have shape {values.shape}, must have ({count}, 1)")
    return values


def known_options(options: dict[str, Any], allowed: Sequence[str]) -> None:
    """Raises ValueError for options of ``reset`` that are not ``allowed``."""
    unknown = sorted({*options} - {*allowed})
    if unknown:
        raise ValueError(f"reset options {unknown} are unknown, must be in {sorted(allowed)}")


def option(
    options: Mapping[str, Any],
    name: str,
    drawn: float,
    low: float | None = None,
    high: float | None = None,
) -> float:
    """An option of ``reset``, or what was drawn in its place."""
    if name not in options:
        return drawn
    label = f"options[{name!r}]"
    if low is None or high is None:
        return finite(label, options[name])
    return within(label, options[name], low, high)


def known_parameters(changes: dict[str, Any], allowed: Sequence[str]) -> None:
    """Raises TypeError for what cannot be changed of one robot."""
    unknown = sorted({*changes} - {*allowed})
    if unknown:
        raise TypeError(f"{unknown} cannot be changed, must be in {sorted(allowed)}")


def complete_state(state: Mapping[str, Any], example: Mapping[str, Any]) -> None:
    """Raises ValueError where a state to go on from has not all that ``example`` has."""
    missing = sorted({*example} - {*state})
    if missing:
        raise ValueError(f"state lacks {missing}, must come from get_state()")
