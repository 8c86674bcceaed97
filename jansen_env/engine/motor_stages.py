"""The motor inside compiled code; see :class:`jansen_env.robot.motor.Motor`."""

from __future__ import annotations

from jansen_env.engine.kernel import stage


@stage
def limited_torque(asked, lost, share, params):
    """Return the torque that a motor gives of one asked for, N m.

    Args:
        lost: what its speed takes of the stall torque, N m. share: of the torque-speed line that
            counts, where its own effect on the speed is solved for; else 1.
    """
    most = params.most_torque
    high = max(min(share * (params.stall_torque - lost), most), -most)
    low = min(max(-share * (params.stall_torque + lost), -most), most)
    return min(high, max(low, asked))


@stage
def drawn_power(torque, speed, params):
    """Return the power that a motor draws, W; nothing is fed back."""
    inner = torque * (params.driving if torque * speed >= 0.0 else params.driven)
    return max(inner * (speed + params.winding * inner), 0.0)
