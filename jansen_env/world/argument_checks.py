"""Arguments of n robots: checks, and settings in which a value may differ between robots.

All functions raise ValueError for anything else than they describe.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import Field, dataclass, field, fields
from typing import Any, ClassVar, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from jansen_env.checks import entries, positive, shown, within
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
PerRobot = TypeAliasType("PerRobot", T | Sequence[T] | NDArray[Any], type_params=(T,))
"""One for all robots, or one for each."""

MOST_TIME_STEPS = 10_000  # time steps in a control period: seconds on the slowest plant
RENDER_MODES = ["human", "rgb_array"]


class Each(tuple[Any, ...]):
    """One value for each robot, where a plain sequence could as well be one value for all."""


def control_period(control_dt: Any, time_step: Any) -> tuple[float, float]:
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


def number_range(name: str, value: object, least: float, most: float) -> tuple[float, float]:
    """A number or a pair between ``least`` and ``most`` as (low, high)."""
    pair: tuple[Any, ...] = (value, value)
    if isinstance(value, (tuple, list, np.ndarray)):
        pair = entries(name, value, "a number or (low, high)")
    if len(pair) != 2:
        raise ValueError(f"{name} is {shown(value)}, must be a number or (low, high)")
    low, high = (within(name, number, least, most) for number in pair)
    if low > high:
        raise ValueError(f"{name} is {shown(value)}, must be (low, high) with low <= high")
    return low, high


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


def shared(default: Any, check: Check, single_only: bool = False) -> Any:
    """A field of settings with one value for all robots.

    ``single_only``: several robots at once must have the default.
    """
    return field(default=default, metadata={"check": check, "single_only": single_only})


def each(default: Any, check: Check, several: Callable[[Any], bool] | None = None) -> Any:
    """A field of settings that becomes a list with a value for each robot.

    ``several``: whether an argument of many robots has one value for each, and not one for all;
    by default sequences and arrays do.
    """
    several = several or (lambda value: isinstance(value, (list, tuple, np.ndarray)))
    return field(default=default, metadata={"check": check, "several": several})


def range_each(default: Any, least: float, most: float, check: Any = number_range) -> Any:
    """A field that becomes a list of (low, high); arrays and lists of ranges are one for each."""

    def several(value: object) -> bool:
        return isinstance(value, np.ndarray) or (
            isinstance(value, (list, tuple))
            and any(isinstance(part, (list, tuple, np.ndarray)) for part in value)
        )

    return each(default, lambda name, value: check(name, value, least, most), several)


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Arguments of an environment; once made they are checked, fields of :func:`each` are lists.

    Attributes:
        preset: names of the values that the environment, not the user, has chosen.
    """

    batched: ClassVar[bool] = False
    preset: ClassVar[frozenset[str]] = frozenset()

    render_mode: str | None = shared(None, render_mode)

    @property
    def count(self) -> int:
        """The number of robots."""
        return 1

    def __post_init__(self) -> None:
        for argument in fields(self):
            if "check" in argument.metadata:
                self._set(argument.name, self._checked(argument))

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _checked(self, argument: Field[Any]) -> Any:
        name, value, marks = argument.name, getattr(self, argument.name), argument.metadata
        check = marks["check"]
        if "several" in marks:
            split = self.batched and (isinstance(value, Each) or marks["several"](value))
            values = entries_of(name, value, self.count) if split else [value] * self.count
            return [check(name, value) for value in values]
        checked = check(name, value)
        if self.batched and self.count > 1 and marks["single_only"] and checked != argument.default:
            raise ValueError(
                f"{name} is {shown(value)}, must be {argument.default!r} for several robots at "
                "once; vectorization_mode='sync' has the others"
            )
        return checked

    def each(self, name: str) -> list[Any]:
        """Return the values of a field of :func:`each`, one for each robot."""
        value = getattr(self, name)
        return list(value) if isinstance(value, list) else [value] * self.count

    @classmethod
    def marked(cls, mark: str) -> Values:
        """Return the defaults of the fields with a mark, "several" or "single_only", by name."""
        return {f.name: f.default for f in fields(cls) if f.metadata.get(mark)}
