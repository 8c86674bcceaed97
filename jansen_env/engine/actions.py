"""Actions of n robots as torques."""

from __future__ import annotations

import math

from jansen_env.engine.jit import compiled


@compiled
def take_actions(actions, active, full_torque, rows, torque):
    """Keep actions (n, 1), clipped to -1 .. 1, in ``rows``; 0 of robots not ``active`` (n,).

    Args:
        full_torque: (n,) N m, the torque of action 1, with its sign. torque: (n,) out, N m.

    Returns:
        The first active robot whose action is not finite, and nothing is kept; else -1.
    """
    for r in range(len(actions)):
        if active[r] and not math.isfinite(actions[r, 0]):
            return r
    for r in range(len(actions)):
        action = actions[r, 0] if active[r] else 0.0
        rows[r].action = min(1.0, max(-1.0, action))
        torque[r] = rows[r].action * full_torque[r]
        rows[r].info.crank_torque = torque[r]
    return -1
