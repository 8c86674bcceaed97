"""Random numbers that are a function of a seed and counters, and so need no state to be kept.

SplitMix64 (Steele, Lea and Flood, Fast Splittable Pseudorandom Number Generators, OOPSLA 2014): the
k-th number of the generator that starts at ``key`` is a mix of key + (k + 1) times the golden
ratio. It may be the key of further numbers: ``number(number(seed, step), channel)``.

Uncompiled, NumPy warns of the overflows by which these numbers come about.
"""

from __future__ import annotations

import math

import numpy as np

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import stage

# Numba makes a float of an unsigned and a signed integer: all of these are unsigned.
GOLDEN = np.uint64(0x9E3779B97F4A7C15)
FIRST_FACTOR, SECOND_FACTOR = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
FIRST_SHIFT, SECOND_SHIFT, LAST_SHIFT = np.uint64(30), np.uint64(27), np.uint64(31)
ONE, UNUSED_BITS = np.uint64(1), np.uint64(12)
SPACING = 2.0**-52  # of uniform numbers, of which each stands in the middle of its interval


@stage
def number(key, k):
    """64 random bits, the ``k``-th (0, 1, ...) of a key: a seed or what this function gave."""
    mixed = np.uint64(key) + GOLDEN * (np.uint64(k) + ONE)
    mixed = (mixed ^ (mixed >> FIRST_SHIFT)) * FIRST_FACTOR
    mixed = (mixed ^ (mixed >> SECOND_SHIFT)) * SECOND_FACTOR
    return mixed ^ (mixed >> LAST_SHIFT)


@stage
def uniform(key, k):
    """A number between 0 and 1, never one of them: the ``k``-th of a key."""
    return (float(number(key, k) >> UNUSED_BITS) + 0.5) * SPACING


@stage
def normal(key, k):
    """The ``k``-th standard normal number of a key, by Box and Muller (1958)."""
    radius = math.sqrt(-2.0 * mathematics.log(uniform(key, 2 * k)))
    return radius * mathematics.cos(2.0 * math.pi * uniform(key, 2 * k + 1))
