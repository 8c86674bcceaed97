"""Uniform random numbers with the same bits on every processor."""

from __future__ import annotations

from typing import Any

import numpy as np


def uniform(rng: np.random.Generator, low: float, high: float, size: Any = None) -> Any:
    """As ``rng.uniform``, which some processors round once, after multiplying and adding."""
    return low + (high - low) * rng.random(size)
