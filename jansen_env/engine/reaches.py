"""How far the pads and the centre of mass of a robot get, by its tables."""

from __future__ import annotations

import math

from jansen_env.engine import mathematics
from jansen_env.engine.collision import SPECULATIVE_MARGIN
from jansen_env.engine.kernel import Floats1, Floats2, Floats3, Floats4, kernel, stage

SPARSE = 2  # intervals of a table between two angles at which pads that are no toes are looked at
BETWEEN = 1.01  # what lies between such angles is farther by less than this


@kernel
def measure_reach(
    body: Floats3, pads: Floats4, toes: int, legs: Floats2, farthest: Floats2, depths: Floats1,
    fore: Floats1,
) -> float:  # fmt: skip
    """Measure how far pads and the centre of mass of a robot get from the crank axis.

    Args:
        body: (intervals, order, functions) and pads: (pads, intervals, order, 3) tables.
        toes: The first so many pads of a leg are toes.
        legs: (legs, 2) 1 of a fore leg and -1 of a back leg; and phase, rad.
        farthest: (2, 2) out: largest |c| and |c'|, kg m; and largest |p| and |p'| of the pads, m.
        depths: (pitches + 1,) out: reach of pads that are no toes below the axis by pitch, m, and
            the most. Of their centres, with the speculative margin.
        fore: (pitches,) work space.

    Returns:
        How far from the crank axis a pad's centre can be, m.
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
    """Put the reach of pads that are no toes, by pitch."""
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
