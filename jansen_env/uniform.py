"""Uniform random numbers that are the same, bit for bit, on every processor.

Resets use these functions to sample the crank angle and speed, the values of the task, the delay,
randomised parameters and seeds, and ``Terrain.rough`` uses them, too. Random numbers within an
episode, such as sensor noise and pushes, come from :mod:`jansen_env.engine.random`. Web pages
sample resets with :mod:`jansen_env.engine.pcg64`.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def uniform(rng: np.random.Generator, low: float, high: float, size: Any = None) -> Any:
    """Sample numbers uniformly between two limits, as ``rng.uniform`` does on x86-64.

    On some processors, NumPy's own function fuses the multiplication and the addition. It then
    rounds only once, and the result differs.

    Args:
        rng: Random number generator.
        low: Lower limit.
        high: Upper limit.
        size: Shape of the returned array. None for a single float.
    """
    return low + (high - low) * rng.random(size)


def draw_seed(rng: np.random.Generator) -> int:
    """Sample a whole number below 2^63, as ``rng.integers(2**63)`` does with Gymnasium's PCG64.

    The number consists of the upper 63 bits of the generator's next 64 bits. NumPy's function takes
    six times as long, because it checks the range.
    """
    return int(rng.bit_generator.random_raw()) >> 1
