"""Sums of numbers in a fixed order, as Python and NumPy have them.

What was computed by ``math.fsum`` and ``numpy.sum`` keeps its bits in kernels.
"""

from __future__ import annotations

from jansen_env.engine.kernel import stage

LANES = 8  # partial sums of NumPy's loop
BLOCK = 128  # numbers that NumPy adds in one loop


@stage(inline=False)
def _block_sum(values):
    """Sum of up to ``BLOCK`` numbers: eight partial sums, and what is left over one by one."""
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
    """Number of the first numbers of a sum that is split in two."""
    return count // 2 - (count // 2) % LANES


@stage(inline=False)
def _sum_of_256(values):
    if len(values) <= BLOCK:
        return _block_sum(values)
    half = _half(len(values))
    return _block_sum(values[:half]) + _block_sum(values[half:])


@stage(inline=False)
def _sum_of_512(values):
    if len(values) <= BLOCK:
        return _block_sum(values)
    half = _half(len(values))
    return _sum_of_256(values[:half]) + _sum_of_256(values[half:])


@stage(inline=False)
def pairwise_sum(values):
    """Sum of up to 900 numbers, a contiguous array, as ``numpy.sum`` has it."""
    if len(values) <= BLOCK:
        return _block_sum(values)
    half = _half(len(values))
    return _sum_of_512(values[:half]) + _sum_of_512(values[half:])


@stage(inline=False)
def exact_sum(values, partials):
    """Sum of numbers, rounded once, as ``math.fsum`` has it: Shewchuk's partial sums.

    Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates",
    1997. ``partials``: work space, one number longer than ``values``.
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
    """Sum of partial sums that do not overlap, the smallest first, rounded once."""
    total = rest = 0.0
    k = count
    while k > 0 and rest == 0.0:
        k -= 1
        before = total
        total = before + partials[k]
        rest = partials[k] - (total - before)
    # Half way between two numbers, what follows decides.
    if k > 0 and ((rest < 0.0 and partials[k - 1] < 0.0) or (rest > 0.0 and partials[k - 1] > 0.0)):
        twice = 2.0 * rest
        other = total + twice
        if other - total == twice:
            total = other
    return total
