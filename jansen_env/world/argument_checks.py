"""Checks of arguments; all functions raise ValueError for anything else than they describe."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from jansen_env.checks import positive, shown, within
from jansen_env.engine.integrator import DIVERGED
from jansen_env.plants.base import check_time_step, numbers_of

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Check: TypeAlias = Callable[[str, Any], Any]  # of an argument's name and value
Values: TypeAlias = dict[str, Any]
"""Values by name: options of a reset, changes, states, information."""
Arguments: TypeAlias = tuple[Any, ...]
"""Arguments of a kernel but the first."""

T = TypeVar("T")
Range = TypeAliasType("Range", float | Sequence[float])  # a number, or (low, high)
PerRobot = TypeAliasType("PerRobot", T | Sequence[T] | NDArray[np.generic], type_params=(T,))
"""One for all robots, or one for each."""

MOST_TIME_STEPS = 10_000  # time steps in a control period: seconds on the slowest plant
RENDER_MODES = ["human", "rgb_array"]


def control_period(control_dt: object, time_step: object) -> tuple[float, float]:
    """``control_dt`` and ``time_step``, s: the first 1 to ``MOST_TIME_STEPS`` times the second."""
    period = positive("control_dt", control_dt)
    step = check_time_step(time_step)
    steps = period / step
    too_long = steps > MOST_TIME_STEPS * (1.0 + 1e-9)
    if too_long or steps < 1.0 - 1e-9 or abs(steps - round(steps)) > 1e-6 * steps:
        allowed = f"at most {MOST_TIME_STEPS} times" if too_long else "a multiple of"
        raise ValueError(
            f"control_dt is {shown(control_dt)}, must be {allowed} time_step, {shown(time_step)}"
        )
    return period, step


def flag(name: str, value: object) -> bool:
    """A switch: True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} is {shown(value)}, must be True or False")
    return bool(value)


def finite_numbers(name: str, value: object, count: int) -> Array:
    """Finite numbers (count,), a copy."""
    numbers = numbers_of(value)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise ValueError(f"{name} is {shown(value)}, must be {count} finite numbers")
    return numbers


def start_noise(name: str, value: object) -> float:
    """The scale of a start's error: at most the speed beyond which a state has diverged."""
    return within(name, value, 0.0, DIVERGED)


def optional(check: Check) -> Check:
    """A check that also accepts None."""
    return lambda name, value: None if value is None else check(name, value)


def option(
    options: Values,
    name: str,
    drawn: float,
    low: float = -np.inf,
    high: float = np.inf,
) -> float:
    """An option of ``reset``, or the number that was drawn in its place."""
    return within(f"options[{name!r}]", options[name], low, high) if name in options else drawn


def entries_of(name: str, value: object, count: int) -> list[Any]:
    """``count`` values: the entries of a sequence or array (count,), or one value repeated."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, (list, tuple)):
        return [value] * count
    if len(value) != count:
        raise ValueError(f"{name} has {len(value)} entries, must have {count}, or be one")
    return list(value)


def render_mode(name: str, mode: object, allowed: Sequence[str] = RENDER_MODES) -> str | None:
    """None, or one of the modes allowed."""
    if mode is None or (isinstance(mode, str) and mode in allowed):
        return mode
    raise ValueError(f"{name} is {shown(mode)}, must be None or one of {allowed}")
