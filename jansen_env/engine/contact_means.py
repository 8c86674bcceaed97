"""What the contact statistics of a step say per second."""

from __future__ import annotations

from jansen_env.engine.jit import compiled


@compiled
def contact_means(statistics, elapsed, slip, force):
    """Slip (n, toes), m, and mean tangential and normal force (n, toes, 2), N, of a step.

    Args:
        statistics: (n, pads) CONTACT_STATISTICS of the step, toes first. elapsed: its length, s.
    """
    for r in range(len(slip)):
        for j in range(slip.shape[1]):
            slip[r, j] = statistics[r, j].slip
            force[r, j, 0] = statistics[r, j].impulse[0] / elapsed
            force[r, j, 1] = statistics[r, j].impulse[1] / elapsed
