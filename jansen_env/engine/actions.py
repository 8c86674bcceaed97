"""Actions of n robots as torques, which may come late."""

from __future__ import annotations

import math

from jansen_env.engine.kernel import stage


@stage(inline=False)
def keep_actions(
    actions, active, elapsed, full_torque, rows, asked, delay, torque, earlier, switch
):
    """Keep actions (n, 1), clipped to -1 .. 1, in ``rows``; 0 of robots not ``active`` (n,).

    Args:
        elapsed: (n,) control steps since the reset; counted on where ``active``.
        full_torque: (n,) N m, the torque of action 1, with its sign.
        asked: (n, steps) N m, the torques asked for, latest first; moved on by one.
        delay: (n, 2) how many control steps a torque comes late, and time steps on top of these.
        torque, earlier, switch: (n,) out: the torque of this control step, N m, and the one before,
            which still holds in its first ``switch`` time steps.

    Returns:
        The first active robot whose action is not finite, and nothing is kept; else -1.
    """
    for r in range(len(actions)):
        if active[r] and not math.isfinite(actions[r, 0]):
            return r
    for r in range(len(actions)):
        action = actions[r, 0] if active[r] else 0.0
        elapsed[r] += active[r]
        rows[r].action_before = rows[r].action
        rows[r].action = min(1.0, max(-1.0, action))
        for k in range(asked.shape[1] - 1, 0, -1):
            asked[r, k] = asked[r, k - 1]
        asked[r, 0] = rows[r].action * full_torque[r]
        whole = delay[r, 0]
        torque[r], earlier[r], switch[r] = asked[r, whole], asked[r, whole + 1], delay[r, 1]
        rows[r].info.crank_torque = torque[r]
    return -1
