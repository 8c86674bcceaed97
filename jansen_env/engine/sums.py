"""Sums of numbers in a fixed order, with the same rounding as Python's and NumPy's sums.

With these functions, a kernel returns the same bits as ``math.fsum`` and ``numpy.sum``.
"""

from __future__ import annotations

from jansen_env.engine.kernel import stage

LANES = 8  # number of partial sums in NumPy's loop
BLOCK = 128  # largest number of values that NumPy adds in one loop


@stage(inline=False)
def _block_sum(values):
    """Return the sum of up to ``BLOCK`` numbers: eight partial sums, then the rest one by one."""
    count, total = len(values), 0.0
    whole = count - count % LANES
    if whole > 0:
        s0, s1, s2, s3 = values[0], values[1], values[2], values[3]
        s4, s5, s6, s7 = values[4], values[5], values[6], values[7]
        for i in range(LANES, whole, LANES):
            s0 += values[i]
            s1 += values[i + 1]
            s2 += values[i + 2]
            s3 += values[i + 3]
            s4 += values[i + 4]
            s5 += values[i + 5]
            s6 += values[i + 6]
            s7 += values[i + 7]
        total = ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7))
    for i in range(whole, count):
        total += values[i]
    return total


@stage
def _half(count):
    """Return how many of ``count`` numbers are in the first half of a sum that is split in two."""
    return count // 2 - (count // 2) % LANES


@stage(inline=False)
def _sum_of_256(values):
    """Return the sum of numbers in at most two blocks, see :func:`pairwise_sum`."""
    if len(values) <= BLOCK:
        return _block_sum(values)
    half = _half(len(values))
    return _block_sum(values[:half]) + _block_sum(values[half:])


@stage(inline=False)
def _sum_of_512(values):
    """Return the sum of numbers in at most four blocks, see :func:`pairwise_sum`."""
    if len(values) <= BLOCK:
        return _block_sum(values)
    half = _half(len(values))
    return _sum_of_256(values[:half]) + _sum_of_256(values[half:])


@stage(inline=False)
def pairwise_sum(values):
    """Return the sum of a contiguous array of up to 900 numbers, as ``numpy.sum`` computes it."""
    if len(values) <= BLOCK:
        return _block_sum(values)
    half = _half(len(values))
    return _sum_of_512(values[:half]) + _sum_of_512(values[half:])


@stage(inline=False)
def exact_sum(values, partials):
    """Return the sum of numbers, rounded once, as ``math.fsum`` computes it.

    The method is that of Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust
    Geometric Predicates", 1997.

    Args:
        values: The numbers, shape (n,).
        partials: Work space for partial sums, shape (n + 1,).
    """
    count = 0
    for k in range(len(values)):
        x, kept = values[k], 0
        for j in range(count):
            y = partials[j]
            if abs(x) < abs(y):
                x, y = y, x
            high = x + y
            low = y - (high - x)
            if low != 0.0:
                partials[kept] = low
                kept += 1
            x = high
        partials[kept] = x
        count = kept + 1
    return _rounded(partials, count)


@stage
def _rounded(partials, count):
    """Return the sum, rounded once, of partial sums that do not overlap, smallest first."""
    total = rest = 0.0
    k = count
    while k > 0 and rest == 0.0:
        k -= 1
        before = total
        total = before + partials[k]
        rest = partials[k] - (total - before)
    # Half way between two floats, the next partial sum decides in which direction to round.
    if k > 0 and ((rest < 0.0 and partials[k - 1] < 0.0) or (rest > 0.0 and partials[k - 1] > 0.0)):
        twice = 2.0 * rest
        other = total + twice
        if other - total == twice:
            total = other
    return total
