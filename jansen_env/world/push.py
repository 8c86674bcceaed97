"""Pushes: forces on the chassis at the crank axis, at random times or at given ones.

The force of a push is a half sine of its duration T; of the impulse J, from t0 on:

    F(t) = J pi / (2 T) sin(pi (t - t0) / T)
    impulse from t to t + h = J / 2 (cos(pi (t - t0) / T) - cos(pi (t + h - t0) / T))

The impulses of the time steps are the second line, not a sum of forces, and so they add up to J.
They are drawn from the episode's seed and counters (:mod:`jansen_env.engine.random`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import entries, finite, non_negative, one_or_two, shown, within

Array = NDArray[np.float64]
SHORTEST, LONGEST = 1e-3, 1e6  # s, of durations and intervals
MOST_PUSHES = 1000  # of an episode's own


@dataclass(frozen=True)
class Push:
    """Random pushes on the chassis: one in each interval.

    A push begins at a time drawn so that it ends within its interval; each component of its impulse
    is uniform from minus to plus the largest. By default that is half the fastest command, 0.4 m/s,
    of a machine of 3.2 kg, as in Isaac Lab's velocity tasks (0.5 of 1 m/s every 10 to 15 s;
    legged_gym, Rudin et al. 2022: up to 1 m/s every 15 s); episodes of 10 s have two of these.

    Args:
        impulse: the largest, N s: horizontal, or (horizontal, vertical).
        duration: of a push, s, from 0.001 on. interval: s, as long or longer.

    Raises:
        ValueError: an argument out of range.
    """

    impulse: float | tuple[float, float] = 1.3
    duration: float = 0.1
    interval: float = 5.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "impulse", one_or_two("Push.impulse", self.impulse))
        interval = within("Push.interval", self.interval, SHORTEST, LONGEST)
        duration = within("Push.duration", self.duration, SHORTEST, interval)
        object.__setattr__(self, "interval", interval)
        object.__setattr__(self, "duration", duration)


def check_schedule(name: str, pushes: Any) -> Array:
    """Return an episode's own pushes (k, 3): start, s, and impulses in x and y, N s; ValueError."""
    allowed = f"a list of at most {MOST_PUSHES} (t, Jx, Jy)"
    rows = [tuple(entries(name, one, allowed)) for one in entries(name, pushes, allowed)]
    if len(rows) > MOST_PUSHES or any(len(row) != 3 for row in rows):
        raise ValueError(f"{name} is {shown(pushes)}, must be {allowed}")
    checked = [
        (non_negative(f"{name}[{i}] time", t), finite(f"{name}[{i}] Jx", x),
         finite(f"{name}[{i}] Jy", y))
        for i, (t, x, y) in enumerate(rows)
    ]  # fmt: skip
    return np.array(checked, float).reshape(-1, 3)
