"""Uniform random numbers with the same bits on every processor."""

from __future__ import annotations

from typing import Any

import numpy as np


def uniform(rng: np.random.Generator, low: float, high: float, size: Any = None) -> Any:
    """Draw numbers from ``low`` to ``high``, as ``rng.uniform`` does on x86-64.

    On some processors NumPy's own fuses the multiplication and the addition, and so rounds once.

    Args:
        size: shape of the array to return; None for a float.
    """
    return low + (high - low) * rng.random(size)
