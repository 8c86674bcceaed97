"""Gravity: the earth's, and what may be given in its place."""

from __future__ import annotations

from typing import Any

import numpy as np

from jansen_env.checks import finite, non_negative, shown

GRAVITY = 9.81  # m/s^2

Gravity = float | tuple[float, float]
"""A number, m/s^2 downwards, or a vector (x, y): sideways it pulls at the centre of mass."""


def gravity_vector(gravity: Any) -> tuple[float, float]:
    """:data:`Gravity` as a vector (x, y), m/s^2.

    Raises:
        ValueError: neither a number, 0 or above, nor two finite numbers.
    """
    if not isinstance(gravity, (tuple, list, np.ndarray)):
        return 0.0, -non_negative("gravity", gravity)
    if np.shape(gravity) != (2,):
        raise ValueError(f"gravity is {shown(gravity)}, must be a number or (x, y)")
    x, y = (finite("gravity", value) for value in gravity)
    return x, y
