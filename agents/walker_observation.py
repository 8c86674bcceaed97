"""Places in the observation of a walking robot, see ``JansenWalkerEnv``: what stands where always.

Behind the toes' loads, of which there may be more or fewer, :func:`place` finds what is asked for.
"""

from __future__ import annotations

from typing import Any

COS_CRANK, SIN_CRANK = 0, 1
CRANK_SPEED = 2  # rad/s
COMMAND = 9  # m/s
LAG = -5  # m, how far the target is ahead; without a height scan, which stands behind it


def place(env: Any, name: str) -> int:
    """Where an unwrapped environment, of one robot or many, shows what has this name.

    Raises:
        ValueError: it does not show it.
    """
    names = [entry.name for entry in env.observed]
    if name not in names:
        raise ValueError(f"name is {name!r}, must be one of {names}")
    return names.index(name)
