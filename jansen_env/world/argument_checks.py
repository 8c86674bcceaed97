"""Arguments of n robots: checks, one value for all or one for each, and records of arguments.

All functions raise ValueError for anything else than they describe.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, field, fields, is_dataclass, make_dataclass
from functools import cache, partial
from types import SimpleNamespace
from typing import Any, TypeAlias, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from jansen_env.checks import entries, listed, positive, shown, within
from jansen_env.engine.integrator import DIVERGED
from jansen_env.plants.base import check_time_step

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Check: TypeAlias = Callable[[str, Any], Any]  # of an argument's name and value
Records: TypeAlias = Mapping[str, type]  # by the names under which they are passed
Filled: TypeAlias = Any  # a record of :func:`fill`, whose fields have the types of their checks

T = TypeVar("T")
Range = TypeAliasType("Range", float | Sequence[float])  # a number, or (low, high)
PerRobot = TypeAliasType("PerRobot", T | Sequence[T] | NDArray[Any], type_params=(T,))
"""One for all robots, or one for each."""

MOST_STEPS = 10_000  # time steps in a control period: seconds on the slowest plant


class Each(tuple[Any, ...]):
    """One value for each robot, where a plain sequence could as well be one value for all."""


def control_period(control_dt: Any, time_step: Any) -> tuple[float, float]:
    """``control_dt`` and ``time_step`` in s: the first 1 to :data:`MOST_STEPS` times the second."""
    period = positive("control_dt", control_dt)
    step = check_time_step(time_step)
    steps = period / step
    too_long = steps > MOST_STEPS * (1.0 + 1e-9)
    if too_long or steps < 1.0 - 1e-9 or abs(steps - round(steps)) > 1e-6 * steps:
        allowed = f"at most {MOST_STEPS} times" if too_long else "a multiple of"
        raise ValueError(
            f"control_dt is {shown(control_dt)}, must be {allowed} time_step, {shown(time_step)}"
        )
    return period, step


def flag(name: str, value: Any) -> bool:
    """A switch: True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} is {shown(value)}, must be True or False")
    return bool(value)


def start_noise(name: str, value: Any) -> float:
    """The scale of an error of a start: at most the speed beyond which a state has diverged."""
    return within(name, value, 0.0, DIVERGED)


def optional(check: Check) -> Check:
    """A check that takes None, too."""
    return lambda name, value: None if value is None else check(name, value)


def number_range(name: str, value: Any, least: float, most: float) -> tuple[float, float]:
    """A number or a pair between ``least`` and ``most`` as (low, high)."""
    pair: tuple[Any, ...] = (value, value)
    if isinstance(value, (tuple, list, np.ndarray)):
        pair = entries(name, value, "a number or (low, high)")
    if len(pair) != 2:
        raise ValueError(f"{name} is {shown(value)}, must be a number or (low, high)")
    low, high = (within(name, one, least, most) for one in pair)
    if low > high:
        raise ValueError(f"{name} is {shown(value)}, must be (low, high) with low <= high")
    return low, high


def option(
    options: Mapping[str, Any],
    name: str,
    drawn: float,
    low: float = -np.inf,
    high: float = np.inf,
) -> float:
    """An option of ``reset``, or the number that was drawn in its place."""
    return within(f"options[{name!r}]", options[name], low, high) if name in options else drawn


def entries_of(name: str, value: Any, count: int) -> list[Any]:
    """``count`` values: the entries of a sequence or array (count,), or one value repeated."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, (list, tuple)):
        return [value] * count
    if len(value) != count:
        raise ValueError(f"{name} has {len(value)} entries, must have {count}, or be one")
    return list(value)


def broadcast_ranges(count: int, name: str, value: Any, least: float, most: float) -> Array:
    """(count, 2) ranges, of a number or (low, high) for all, an array (count,) of numbers, or an
    array (count, 2) or list of ranges for each."""
    several = isinstance(value, (np.ndarray, Each)) or (
        isinstance(value, (list, tuple))
        and any(isinstance(one, (list, tuple, np.ndarray)) for one in value)
    )
    values = entries_of(name, value, count) if several else [value] * count
    return np.array([number_range(name, one, least, most) for one in values])


# Records of arguments: TypedDicts whose keys are ``Annotated`` with the fields below, so that type
# checkers know them, or dataclasses with these fields. What :func:`fill` returns has been checked.


@cache
def arguments_of(record: type) -> tuple[Field[Any], ...]:
    """Return the fields of a record."""
    if not is_dataclass(record):
        hints = get_type_hints(record, include_extras=True).items()
        own = [(name, hint.__origin__, hint.__metadata__[0]) for name, hint in hints]
        record = make_dataclass(record.__name__, own)
    return fields(record)


def single(default: Any, check: Check, only: bool = False) -> Any:
    """Return a field with one value for all robots; ``only``: several must have its default."""
    return field(default=default, metadata={"check": check, "single_only": only})


def per_robot(default: Any, check: Check) -> Any:
    """Return a field with one value for all robots or one for each; it becomes a list."""

    def broadcast(count: int, name: str, value: Any) -> list[Any]:
        return [check(name, one) for one in entries_of(name, value, count)]

    return broadcast_by(default, broadcast)


def range_per_robot(default: Any, least: float, most: float) -> Any:
    """Return a field with ranges (n, 2), see :func:`broadcast_ranges`."""
    return broadcast_by(default, partial(broadcast_ranges, least=least, most=most))


def broadcast_by(default: Any, broadcast: Callable[[int, str, Any], Any]) -> Any:
    """Return a field that ``broadcast`` makes of count, name and value."""
    return field(default=default, metadata={"broadcast": broadcast, "per_robot": True})


def signature_of(records: Records, defaults: Mapping[str, Any]) -> inspect.Signature:
    """Return a signature with the fields of all records as keywords, some with other defaults."""
    keywords = [
        inspect.Parameter(
            one.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=defaults.get(one.name, one.default),
            annotation=one.type,
        )
        for kind in records.values()
        for one in arguments_of(kind)
    ]
    return inspect.Signature(keywords)


def marked(records: Records, mark: str) -> dict[str, Any]:
    """Return the defaults of the records' fields with a mark, such as "per_robot", by name."""
    every = [one for kind in records.values() for one in arguments_of(kind)]
    return {one.name: one.default for one in every if one.metadata.get(mark)}


def fill(records: Records, keywords: Mapping[str, Any], count: int) -> dict[str, Any]:
    """Return the records of ``count`` robots with checked keywords; TypeError for another name."""
    known = {one.name for kind in records.values() for one in arguments_of(kind)}
    if unknown := sorted({*keywords} - known):
        allowed = listed(sorted(known), unknown[0])
        raise TypeError(f"unexpected keyword argument {unknown[0]!r}, must be in {allowed}")
    found = {}
    for name, kind in records.items():
        given = [(one, keywords.get(one.name, one.default)) for one in arguments_of(kind)]
        values = {one.name: _checked(one, value, count) for one, value in given}
        found[name] = kind(**values) if is_dataclass(kind) else SimpleNamespace(**values)
    return found


def _checked(one: Field[Any], value: Any, count: int) -> Any:
    if "broadcast" in one.metadata:
        return one.metadata["broadcast"](count, one.name, value)
    found = one.metadata["check"](one.name, value) if "check" in one.metadata else value
    if count > 1 and one.metadata.get("single_only") and found != one.default:
        raise ValueError(
            f"{one.name} is {shown(value)}, must be {one.default!r} for several robots at once; "
            "vectorization_mode='sync' has the others"
        )
    return found
