"""What the contact statistics of a step say per second."""

from __future__ import annotations

from jansen_env.engine.integrator import IMPULSE_N, IMPULSE_T, SLIP
from jansen_env.engine.jit import compiled


@compiled
def contact_means(record, elapsed, slip, force):
    """Slip (n, toes), m, and mean tangential and normal force (n, toes, 2), N, of a step.

    Args:
        record: (n, pads, 3) of the step, toes first. elapsed: its length, s.
    """
    for r in range(len(slip)):
        for j in range(slip.shape[1]):
            slip[r, j] = record[r, j, SLIP]
            force[r, j, 0] = record[r, j, IMPULSE_T] / elapsed
            force[r, j, 1] = record[r, j, IMPULSE_N] / elapsed
