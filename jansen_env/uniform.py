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


def draw_seed(rng: np.random.Generator) -> int:
    """Draw a whole number below 2^63: what ``rng.integers(2**63)`` draws with Gymnasium's PCG64.

    Those are the upper bits of its next 64; NumPy takes six times as long to check the range.
    """
    return int(rng.bit_generator.random_raw()) >> 1
