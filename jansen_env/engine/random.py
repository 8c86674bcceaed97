"""Random numbers that are a function of a seed and counters, and therefore need no stored state.

The generator is SplitMix64 (Steele, Lea and Flood, Fast Splittable Pseudorandom Number Generators,
OOPSLA 2014): the k-th number of the generator that starts at ``key`` is a mix of key + (k + 1)
times the golden ratio. A number may serve as the key of further numbers:
``number(number(seed, step), channel)``.

The arithmetic relies on overflows, of which NumPy warns if the kernels are not compiled.
"""

from __future__ import annotations

import math

import numpy as np

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import stage

# Numba converts to float when it combines signed and unsigned integers, so all are unsigned here.
GOLDEN = np.uint64(0x9E3779B97F4A7C15)
FIRST_FACTOR, SECOND_FACTOR = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
FIRST_SHIFT, SECOND_SHIFT, LAST_SHIFT = np.uint64(30), np.uint64(27), np.uint64(31)
ONE, UNUSED_BITS = np.uint64(1), np.uint64(12)
# Numbers of the random streams of an episode. Each stream starts at ``number(seed, STREAM)``.
SENSOR_STREAM = 0
PUSH_STREAM = 1
COMMAND_STREAM = 2
SPACING = 2.0**-52  # spacing of uniform numbers; each is in the middle of an interval of this width


@stage
def number(key, k):
    """Return 64 random bits.

    Args:
        key: Seed, or another number that this function returned.
        k: Index of the number in the sequence that belongs to the key: 0, 1, ...
    """
    mixed = np.uint64(key) + GOLDEN * (np.uint64(k) + ONE)
    mixed = (mixed ^ (mixed >> FIRST_SHIFT)) * FIRST_FACTOR
    mixed = (mixed ^ (mixed >> SECOND_SHIFT)) * SECOND_FACTOR
    return mixed ^ (mixed >> LAST_SHIFT)


@stage
def uniform(key, k):
    """Return the ``k``-th uniform number of a key, between 0 and 1 and never equal to either."""
    return (float(number(key, k) >> UNUSED_BITS) + 0.5) * SPACING


@stage
def normal(key, k):
    """Return the ``k``-th standard normal number of a key, by Box and Muller's method (1958)."""
    radius = math.sqrt(-2.0 * mathematics.log(uniform(key, 2 * k)))
    return radius * mathematics.cos(2.0 * math.pi * uniform(key, 2 * k + 1))
