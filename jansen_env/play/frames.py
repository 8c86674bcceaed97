"""Frames of a robot's steps, and between them."""

from __future__ import annotations

from dataclasses import replace

from jansen_env.rendering import Frame

ARRAYS = ("q", "contact_force", "contact_point", "contact_tangent", "slipping")


def snapshot(frame: Frame, command: float | None, direction: float) -> Frame:
    """A copy that stays as it is while the robot moves.

    Args:
        command: that it shows, m/s, or None. direction: 1 or -1, by which torques are multiplied.
    """
    arrays = {name: getattr(frame, name).copy() for name in ARRAYS}
    return replace(frame, command=command, torque=direction * frame.torque, **arrays)


def between(before: Frame, now: Frame, share: float) -> Frame:
    """The frame at a share (0 to 1) of the time from one to the next; forces are the next one's."""
    moved = {
        name: (1.0 - share) * getattr(before, name) + share * getattr(now, name)
        for name in ("q", "contact_point", "time")
    }
    return replace(now, **moved)
