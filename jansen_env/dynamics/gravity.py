"""Gravity of the earth, and user-specified gravity."""

from __future__ import annotations

from typing import Any

import numpy as np

from jansen_env.checks import entries, finite, non_negative

GRAVITY = 9.81  # m/s^2

Gravity = float | tuple[float, float]
"""Acceleration of gravity in m/s^2: a number (downwards), or a vector (x, y).

The horizontal part of a vector acts at the centre of mass.
"""


def gravity_vector(gravity: Any) -> tuple[float, float]:
    """Return gravity as a vector (x, y), in m/s^2.

    Args:
        gravity: Gravity in a form of :data:`Gravity`.

    Raises:
        ValueError: If ``gravity`` is neither a finite number of at least 0 nor a pair of finite
            numbers.
    """
    if not isinstance(gravity, (tuple, list, np.ndarray)):
        return 0.0, -non_negative("gravity", gravity)
    x, y = entries("gravity", gravity, "a number or (x, y)", 2)
    return finite("gravity", x), finite("gravity", y)
