"""Checks of arguments, with errors that name the argument, its value and the allowed values."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from dataclasses import fields
from decimal import Decimal
from difflib import get_close_matches
from functools import cache
from numbers import Integral, Real
from operator import attrgetter
from types import NoneType
from typing import Any, Literal, NamedTuple, TypeAlias, TypeVar, get_type_hints

import numpy as np

from jansen_env.arrays import Array

T = TypeVar("T")

MAX_STEPS = 10**10  # largest number of environment steps of one run, which is months of training
LONGEST = 200  # largest number of characters of a value in a message
HINT = "; did you mean "  # beginning of a suggestion at the end of a message
# Smallest and largest normal float32 number.
LEAST_SINGLE, MOST_SINGLE = 2.0**-126, (2.0 - 2.0**-23) * 2.0**127


def shown(value: object) -> str:
    """Return a value as text for a message: its ``repr``, shortened if it is long."""
    try:
        text = repr(value)
    except Exception:  # integers of thousands of digits, for example
        text = f"a {type(value).__name__} that cannot be printed"
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def invalid(name: str, value: object, allowed: object) -> ValueError:
    """Return the ValueError for an invalid argument, with its name, allowed values and value.

    A suggestion of :func:`listed` at the end of ``allowed`` becomes the end of the message.
    """
    values, hint, suggestion = str(allowed).partition(HINT)
    return ValueError(f"{name} must be {values}, got {shown(value)}{hint}{suggestion}")


def one_line(error: BaseException) -> str:
    """Return the text of an error on one line, shortened if it is long."""
    return (" ".join(str(error).split()) or type(error).__name__)[:1000]


@contextlib.contextmanager
def named_errors(source: object, *kinds: type[Exception]) -> Iterator[None]:
    """Turn errors within the context into ValueErrors whose one-line text begins with a source.

    Args:
        source: Source of the errors, such as the name of a file.
        kinds: Types of errors to turn into ValueErrors, in addition to ValueError itself.

    Raises:
        ValueError: If an error of these types occurs within the context.
    """
    every: tuple[type[Exception], ...] = (ValueError, *kinds)
    try:
        yield
    except every as error:
        raise ValueError(f"{source}: {one_line(error)}") from error


def listed(known: Iterable[object], value: object) -> str:
    """Return a list of known names for a message, with the name that ``value`` may have meant."""
    names = [*known]
    text = value[:LONGEST] if isinstance(value, str) else ""
    near = get_close_matches(text, map(str, names), 1)
    return f"{names}{HINT}{near[0]!r}?" if near else str(names)


def one_of(name: str, value: object, known: Iterable[T]) -> T:
    """Return ``value`` if it is a known name.

    Raises:
        ValueError: If it is not a known name.
    """
    allowed = [*known]
    if not isinstance(value, (str, NoneType)) or value not in allowed:
        raise invalid(name, value, f"one of {listed(allowed, value)}")
    return value


def finite(name: str, value: object) -> float:
    """Return ``value`` as a float.

    Raises:
        ValueError: If it is not a finite number.
    """
    if type(value) is float and math.isfinite(value):
        return value  # the usual case, ten times as fast as the general one
    number = math.nan
    if not isinstance(value, bool) and isinstance(value, (Real, Decimal)):
        with contextlib.suppress(OverflowError, ValueError):  # beyond the range of a float
            number = float(value)
    if not math.isfinite(number):
        raise invalid(name, value, "a finite number")
    return number


def positive(name: str, value: object) -> float:
    """Return ``value`` as a float.

    Raises:
        ValueError: If it is not a finite number above 0.
    """
    number = finite(name, value)
    if number <= 0.0:
        raise invalid(name, value, "above 0")
    return number


def positive_single(name: str, value: object) -> float:
    """Return ``value`` as a float.

    Raises:
        ValueError: If it is not a number above 0 within the range of normal float32 numbers.
    """
    number = positive(name, value)
    if not LEAST_SINGLE <= number <= MOST_SINGLE:
        limits = f"between {LEAST_SINGLE:.2g} and {MOST_SINGLE:.2g}"
        raise invalid(name, value, f"{limits}, the range of float32")
    return number


def non_negative(name: str, value: object) -> float:
    """Return ``value`` as a float.

    Raises:
        ValueError: If it is not a finite number of at least 0.
    """
    number = finite(name, value)
    if number < 0.0:
        raise invalid(name, value, "0 or above")
    return number


def within(name: str, value: object, low: float, high: float) -> float:
    """Return ``value`` as a float.

    Raises:
        ValueError: If it is not a finite number with ``low <= value <= high``.
    """
    number = finite(name, value)
    if not low <= number <= high:
        raise invalid(name, value, f"between {low} and {high}")
    return number


def infinite(value: object) -> bool:
    """Return whether ``value`` is the number infinity."""
    return isinstance(value, Real) and value == math.inf


def whole_number(name: str, value: object, most: int | None = None, least: int = 0) -> int:
    """Return ``value`` as an int.

    Args:
        name: Name of the argument.
        value: The value.
        most: Largest allowed number. None for no limit.
        least: Smallest allowed number.

    Raises:
        ValueError: If it is not a whole number from ``least`` to ``most``.
    """
    whole = None if isinstance(value, bool) or not isinstance(value, Integral) else int(value)
    if whole is None or whole < least or (most is not None and whole > most):
        allowed = " above 0" if least else ", 0 or above"
        allowed = allowed if most is None else f" from {least} to {most}"
        raise invalid(name, value, f"a whole number{allowed}")
    return whole


def positive_integer(name: str, value: object, most: int | None = None) -> int:
    """Return ``value`` as an int.

    Raises:
        ValueError: If it is not a whole number from 1 to ``most``; None for ``most`` means that
            there is no upper limit.
    """
    return whole_number(name, value, most, least=1)


def robot_index(index: object, count: int) -> int:
    """Return the index of one of ``count`` robots as an int.

    Raises:
        ValueError: If it is not a whole number from 0 to ``count`` - 1. A bool is not accepted.
    """
    return whole_number("robot index", index, most=count - 1)


def robot_indices(indices: object, count: int) -> list[int]:
    """Return the indices of some of ``count`` robots.

    Args:
        indices: Indices of the robots, or a single index. None for all robots.
        count: Number of robots.

    Raises:
        ValueError: If an index is not valid for :func:`robot_index`, or occurs twice.
    """
    if indices is None:
        return list(range(count))
    if isinstance(indices, Integral):
        return [robot_index(indices, count)]
    allowed = f"None, a whole number from 0 to {count - 1}, or a list of such numbers"
    checked = [robot_index(index, count) for index in entries("robot indices", indices, allowed)]
    if len({*checked}) < len(checked):
        raise invalid("robot indices", indices, "distinct")
    return checked


def instance(name: str, value: object, kind: type) -> Any:
    """Return ``value`` if it has the type ``kind``.

    Raises:
        ValueError: If it has a different type.
    """
    if not isinstance(value, kind):
        raise invalid(name, value, f"a {kind.__name__}")
    return value


def printable(name: str, value: str) -> str:
    """Return a text if it can be written to a file as UTF-8.

    Raises:
        ValueError: If the text cannot be written as UTF-8.
    """
    try:
        value.encode("utf-8")
    except UnicodeEncodeError as error:
        allowed = f"text; the character at {error.start} is half of a surrogate pair"
        raise invalid(name, value, allowed) from None
    return value


def entries(name: str, value: object, allowed: str, count: int | None = None) -> tuple[Any, ...]:
    """Return the entries of a list, a tuple, an array or another ordered iterable.

    Args:
        name: Name of the argument.
        value: The value.
        allowed: Description of the allowed values, for the error message.
        count: Required number of entries. None for any number.

    Raises:
        ValueError: If ``value`` is not an ordered iterable, or has a different number of entries.
    """
    if isinstance(value, Iterable) and not isinstance(value, (str, bytes, Mapping, Set)):
        with contextlib.suppress(TypeError):  # an array without dimensions raises it
            values = tuple(value)
            if count in (None, len(values)):
                return values
    raise invalid(name, value, allowed)


def numbers_of(value: object) -> Array:
    """Return a copy of real numbers as an array of floats, or a single NaN for anything else.

    Texts, bools, complex numbers, dates, objects and masked arrays do not count as real numbers,
    although NumPy would convert them to floats.
    """
    if type(value) is np.ndarray:  # the usual case
        return value.astype(float) if value.dtype.kind in "fiu" else np.array(math.nan)
    parts = value if isinstance(value, (list, tuple)) else (value,)
    if not any(isinstance(part, np.ma.MaskedArray) for part in parts):
        with contextlib.suppress(TypeError, ValueError, OverflowError):
            array = np.asarray(value)
            if array.dtype.kind in "fiu":
                return array.astype(float)
    return np.array(math.nan)


def finite_numbers(name: str, value: object, count: int, most: float = MOST_SINGLE) -> Array:
    """Return a copy of finite numbers, shape (count,).

    Args:
        name: Name of the argument.
        value: The numbers.
        count: Required number of numbers.
        most: Largest allowed magnitude, by default that of float32.

    Raises:
        ValueError: If there is a different number of them, or one of them is not finite or its
            magnitude is larger than ``most``.
    """
    numbers = numbers_of(value)
    if numbers.shape != (count,) or not (np.abs(numbers) <= most).all():
        raise invalid(name, value, f"{count} finite numbers, within {most:.2g}")
    return numbers


class Limits(NamedTuple):
    """Limits of a number in a field of a dataclass, as part of the type of the field.

    :func:`check_limits` checks fields of the type ``Annotated[float, Limits(...)]``. Pages that
    read the same data use the same limits.

    Attributes:
        least: Lowest allowed number.
        most: Highest allowed number.
        above: Whether ``least`` itself is excluded.
        infinite: Whether infinity is allowed, too.
        note: Text that error messages add, such as the unit.
    """

    least: float = -math.inf
    most: float = math.inf
    above: bool = False
    infinite: bool = False
    note: str = ""

    @property
    def allowed(self) -> str:
        """Description of the allowed numbers, in words."""
        note = self.note and f"; {self.note}"
        if self.most == math.inf:
            return (f"above {self.least:g}" if self.above else f"{self.least:g} or above") + note
        start = f"above {self.least:g} and at most" if self.above else f"between {self.least:g} and"
        return f"{start} {self.most:g}{note}"

    def check(self, name: str, value: object) -> float:
        """Return ``value`` as a float.

        Raises:
            ValueError: If it is outside the limits.
        """
        if self.infinite and infinite(value):
            return math.inf
        number = finite(name, value)
        low = number > self.least if self.above else number >= self.least
        if not (low and number <= self.most):
            raise invalid(name, value, self.allowed)
        return number


@cache
def limits_of(kind: type) -> dict[str, Limits]:
    """Return the limits of those fields of a dataclass that have limits, by name."""
    hints = get_type_hints(kind, include_extras=True)
    found = {
        field.name: getattr(hints[field.name], "__metadata__", ())  # arguments of Annotated
        for field in fields(kind)
    }
    return {name: parts[0] for name, parts in found.items() if parts}


class Combination(NamedTuple):
    """Rule for fields of a dataclass: their sum or their product must be within limits.

    Attributes:
        fields: Names of the fields. A name that occurs twice counts twice.
        operation: "sum" or "product".
        limits: Limits of the sum or product.
    """

    fields: tuple[str, ...]
    operation: Literal["sum", "product"]
    limits: Limits

    def check(self, part: object) -> None:
        """Check that an instance of the dataclass follows the rule.

        Raises:
            ValueError: If the instance violates the rule.
        """
        values = [getattr(part, name) for name in self.fields]
        number = math.fsum(values) if self.operation == "sum" else math.prod(values)
        if not self.limits.least <= number <= self.limits.most:
            names = dict.fromkeys(self.fields)
            given = " and ".join(f"{name} of {getattr(part, name):g}" for name in names)
            raise ValueError(
                f"{type(part).__name__}: the {self.operation} of {', '.join(self.fields)} must be "
                f"{self.limits.allowed}, got {number:g}: {given}"
            )


class FiniteWith(NamedTuple):
    """Rule for two fields of a dataclass: the second is finite unless the first is 0 or infinite.

    Attributes:
        field: Name of the first field.
        other: Name of the second field, which is infinite by default.
    """

    field: str
    other: str

    def check(self, part: Any) -> None:
        """Check that an instance of the dataclass follows the rule.

        Raises:
            ValueError: If it does not.
        """
        value = getattr(part, self.field)
        other = getattr(part, self.other)
        if infinite(other) and not infinite(value) and value != 0.0:
            name = f"{type(part).__name__}.{self.other}"
            raise invalid(name, other, f"finite with a {self.field} of {value:g}")


class AtLeast(NamedTuple):
    """Rule for a dataclass: a field must have at least a certain number of entries.

    Attributes:
        field: Name of the field.
        least: Smallest allowed number of entries.
    """

    field: str
    least: int

    def check(self, part: object) -> None:
        """Check that an instance of the dataclass follows the rule.

        Raises:
            ValueError: If it does not.
        """
        count = len(getattr(part, self.field))
        if count < self.least:
            name = f"{type(part).__name__}.{self.field}"
            raise ValueError(f"{name} must have {self.least} or more entries, got {count}")


class AsManyAs(NamedTuple):
    """Rule for a dataclass: a field must have as many entries as another field.

    Attributes:
        field: Name of the field.
        other: Name of the other field, or its path, such as "linkage.bodies".
    """

    field: str
    other: str

    def check(self, part: object) -> None:
        """Check that an instance of the dataclass follows the rule.

        Raises:
            ValueError: If it does not.
        """
        count = len(getattr(part, self.field))
        allowed = len(attrgetter(self.other)(part))
        if count != allowed:
            name = f"{type(part).__name__}.{self.field}"
            raise ValueError(
                f"{name} must have {allowed} entries, the same number as {self.other}, got {count}"
            )


Rule: TypeAlias = Combination | FiniteWith | AtLeast | AsManyAs


def check_limits(part: Any) -> None:
    """Check the fields of a frozen dataclass, and replace those with limits by floats.

    The function also checks the rules of the class, ``RULES``.

    Args:
        part: Instance of the dataclass.

    Raises:
        ValueError: If a field is outside its limits, or a rule is violated.
    """
    for name, limits in limits_of(type(part)).items():  # type: ignore[arg-type]
        value = limits.check(f"{type(part).__name__}.{name}", getattr(part, name))
        object.__setattr__(part, name, value)
    for rule in getattr(part, "RULES", ()):
        rule.check(part)


def number_range(name: str, value: object, least: float, most: float) -> tuple[float, float]:
    """Return a number or a pair of numbers as (low, high).

    Args:
        name: Name of the argument.
        value: A number, which stands for both ends, or a pair.
        least: Lowest allowed number.
        most: Highest allowed number.

    Raises:
        ValueError: If a number is outside the limits, or ``low`` is larger than ``high``.
    """
    pair: tuple[object, ...] = (value, value)
    if isinstance(value, (tuple, list, np.ndarray)):
        pair = entries(name, value, "a number or (low, high)", 2)
    low, high = (within(name, number, least, most) for number in pair)
    if low > high:
        raise invalid(name, value, "(low, high) with low <= high")
    return low, high


def one_or_two(name: str, value: object) -> tuple[float, float]:
    """Return two numbers of at least 0.

    Args:
        name: Name of the argument.
        value: A pair of numbers, or a single number, for which the second number is 0.

    Raises:
        ValueError: If a number is not finite or is below 0, or if there are not one or two numbers.
    """
    if not isinstance(value, Iterable):
        return non_negative(name, value), 0.0
    first, second = entries(name, value, "a number or two", 2)
    return non_negative(name, first), non_negative(name, second)


def set_checked(part: object, check: Callable[[str, object], object], *names: str) -> None:
    """Replace fields of a frozen dataclass with the values that ``check`` returns for them."""
    for name in names:
        value = check(f"{type(part).__name__}.{name}", getattr(part, name))
        object.__setattr__(part, name, value)


def load_record(kind: type, name: str, value: object) -> Any:
    """Return an instance of a dataclass, or None.

    Args:
        kind: Type of the dataclass.
        name: Name of the argument.
        value: An instance, a dictionary of the arguments of an instance, or None.

    Raises:
        ValueError: If ``value`` is something else, or the dictionary has unknown keys.
    """
    if value is None or isinstance(value, kind):
        return value
    known = sorted(argument.name for argument in fields(kind))
    if not isinstance(value, Mapping):
        allowed = f"None, a {kind.__name__} or a dictionary with some of {known}"
        raise invalid(name, value, allowed)
    if unknown := [key for key in value if key not in known]:
        raise invalid(f"a key of {name}", unknown[0], f"one of {listed(known, unknown[0])}")
    return kind(**value)
