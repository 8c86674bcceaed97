"""Argument checks shared by the package: each names the argument, its value and what is allowed."""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import Any


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
        raise ValueError(f"{name} is {value!r}, must be a finite number")
    return float(value)


def finite(name: str, value: Any) -> float:
    """Return ``value`` as a float. Raises ValueError unless it is a finite number."""
    return _number(name, value)


def positive(name: str, value: Any) -> float:
    """Return ``value`` as a float. Raises ValueError unless it is above 0."""
    if _number(name, value) <= 0.0:
        raise ValueError(f"{name} is {value!r}, must be above 0")
    return float(value)


def non_negative(name: str, value: Any) -> float:
    """Return ``value`` as a float. Raises ValueError if it is below 0."""
    if _number(name, value) < 0.0:
        raise ValueError(f"{name} is {value!r}, must be 0 or above")
    return float(value)


def within(name: str, value: Any, low: float, high: float) -> float:
    """Return ``value`` as a float. Raises ValueError unless ``low <= value <= high``."""
    if not low <= _number(name, value) <= high:
        raise ValueError(f"{name} is {value!r}, must be between {low} and {high}")
    return float(value)


def positive_integer(name: str, value: Any) -> int:
    """Return ``value`` as an int. Raises ValueError unless it is a whole number above 0."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < 1:
        raise ValueError(f"{name} is {value!r}, must be a whole number above 0")
    return int(value)


def whole_number(name: str, value: Any) -> int:
    """Return ``value`` as an int. Raises ValueError unless it is a whole number, 0 or above."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < 0:
        raise ValueError(f"{name} is {value!r}, must be a whole number, 0 or above")
    return int(value)
