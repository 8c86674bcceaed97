"""Forces in the joints of a batch's first robot, from the trace of its time steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.plants.base import check_pushes, divergence
from jansen_env.plants.trace import trace_forces

if TYPE_CHECKING:
    from jansen_env.plants.batch import Batch

FIRST = np.zeros(1, np.int64)


def forces_of(batch: Batch) -> JointForces:
    """Return the forces in every joint in each time step that was traced last."""
    tables, gravity = batch.tables_in_force(0), batch.effective_gravity
    return trace_forces(tables, batch.trace, batch.time_step, gravity)


def forces_ahead(
    batch: Batch, torque: float = 0.0, push: NDArray[np.float64] | None = None
) -> JointForces:
    """Return the forces in every joint in the next time step, the mean; the state stays.

    Args:
        torque: N m, of the crank. push: (2,) N s, the impulse on the chassis in that step.

    Raises:
        FloatingPointError: it diverges in that step.
    """
    pushes = None if push is None else check_pushes(push)[None, None]
    kept = batch.tracing, batch.trace, batch.touchdowns
    batch.tracing = True
    try:
        batch.lookahead(torque, FIRST, pushes)
        if batch.diverged[0]:
            raise divergence(batch.states[0], torque)
        return forces_of(batch).at(0)
    finally:
        batch.tracing, batch.trace, batch.touchdowns = kept
