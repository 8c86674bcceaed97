"""Distances from the crank axis that the pads and the centre of mass of a robot can reach."""

from __future__ import annotations

import math

from jansen_env.engine import mathematics
from jansen_env.engine.collision import SPECULATIVE_MARGIN
from jansen_env.engine.kernel import Floats1, Floats2, Floats3, Floats4, kernel, stage

SPARSE = 2  # table intervals between two crank angles at which pads other than toes are sampled
BETWEEN = 1.01  # factor on the sampled distances, which covers all angles between the samples


@kernel
def measure_reach(
    body: Floats3,
    pads: Floats4,
    toes: int,
    legs: Floats2,
    farthest: Floats2,
    depths: Floats1,
    fore: Floats1,
) -> float:
    """Measure how far the pads and the centre of mass of a robot get from the crank axis.

    Args:
        body: Tables of the body, shape (intervals, order, functions).
        pads: Tables of the pads of a leg, shape (pads, intervals, order, 3).
        toes: Number of toes of a leg; they are the first of its pads.
        legs: Side of each leg (1 for fore, -1 for back) and its phase in rad, shape (legs, 2).
        farthest: Output, shape (2, 2): the largest |c| and |c'| in kg m, and the largest |p| and
            |p'| of the pads in m.
        depths: Output, shape (pitches + 1,), in m: for each pitch, how far below the crank axis the
            centres of pads other than toes reach, and as the last entry the largest such depth for
            any pitch. Both include the speculative margin.
        fore: Work space, shape (pitches,).

    Returns:
        The largest possible distance of a pad's centre from the crank axis, in m.
    """
    farthest[:] = 0.0
    for row in range(len(body)):
        for k in range(2):
            far = mathematics.hypot(body[row, k, 0], body[row, k, 1])
            farthest[0, k] = max(farthest[0, k], far)
    for pad in range(len(pads)):
        for row in range(pads.shape[1]):
            for k in range(2):
                far = mathematics.hypot(pads[pad, row, k, 0], pads[pad, row, k, 1])
                farthest[1, k] = max(farthest[1, k], far)
    _put_depths(pads, toes, legs, depths, fore)
    return BETWEEN * farthest[1, 0]


@stage
def _put_depths(pads, toes, legs, depths, fore):
    """Compute for each pitch how far below the crank axis pads other than toes reach."""
    pitches, farthest = len(fore), 0.0
    fore[:] = -math.inf
    for pad in range(toes, len(pads)):
        for row in range(0, pads.shape[1], SPARSE):
            x, y = BETWEEN * pads[pad, row, 0, 0], BETWEEN * pads[pad, row, 0, 1]
            farthest = max(farthest, mathematics.hypot(x, y))
    for i in range(pitches):
        angle = 2.0 * math.pi * (i + 0.5) / pitches
        cos, sin = mathematics.cos(angle), mathematics.sin(angle)
        for pad in range(toes, len(pads)):
            for row in range(0, pads.shape[1], SPARSE):
                x, y = BETWEEN * pads[pad, row, 0, 0], BETWEEN * pads[pad, row, 0, 1]
                fore[i] = max(fore[i], x * -sin + y * -cos)
    for i in range(pitches):
        depth = -math.inf
        for leg in range(len(legs)):
            depth = max(depth, fore[i] if legs[leg, 0] > 0.0 else fore[pitches - 1 - i])
        depths[i] = depth + farthest * math.pi / pitches + SPECULATIVE_MARGIN
    depths[pitches] = farthest + SPECULATIVE_MARGIN
