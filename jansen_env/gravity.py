"""Gravity: the earth's, and what may be given in its place."""

from __future__ import annotations

from typing import Any

import numpy as np

from jansen_env.checks import entries, finite, non_negative

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
    x, y = entries("gravity", gravity, "a number or (x, y)", 2)
    return finite("gravity", x), finite("gravity", y)
