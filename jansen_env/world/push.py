"""Pushes: forces on the chassis at the crank axis, at random times or at given ones.

The force of a push is a half sine of its duration T; of the impulse J, from t0 on:

    F(t) = J pi / (2 T) sin(pi (t - t0) / T)
    impulse from t to t + h = J / 2 (cos(pi (t - t0) / T) - cos(pi (t + h - t0) / T))

The impulses of the time steps are the second line, not a sum of forces, and so they add up to J.
They are drawn from the episode's seed and counters (:mod:`jansen_env.engine.random`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from jansen_env import checks
from jansen_env.arrays import Array, Rows
from jansen_env.engine.pushes import PUSHES

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
        checks.set_checked(self, checks.one_or_two, "impulse")
        time = partial(checks.within, low=SHORTEST)
        checks.set_checked(self, partial(time, high=LONGEST), "interval")
        checks.set_checked(self, partial(time, high=self.interval), "duration")


def check_schedule(name: str, pushes: object) -> Array:
    """Return an episode's own pushes (k, 3): start, s, and impulses in x and y, N s; ValueError."""
    allowed = f"a list of at most {MOST_PUSHES} (t, Jx, Jy)"
    rows = checks.entries(name, pushes, allowed)
    triples = [checks.entries(name, row, allowed, 3) for row in rows]
    if len(triples) > MOST_PUSHES:
        raise checks.invalid(name, pushes, allowed)
    for i, (time, *impulse) in enumerate(triples):
        checks.non_negative(f"{name}[{i}] time", time)
        for part, number in zip(("Jx", "Jy"), impulse, strict=True):
            checks.finite(f"{name}[{i}] {part}", number)
    return np.array(triples, float).reshape(-1, 3)


def push_settings(push: Push | None, time_step: float) -> Rows:
    """Return the engine's settings (1,) of random pushes; None for none. ``time_step``: s."""
    settings = np.zeros(1, PUSHES)
    kind = push or Push(0.0)
    settings[0] = (*kind.impulse, kind.duration, kind.interval, time_step)  # type: ignore[misc]
    return settings


def add_push(pushes: Array, push: Array, duration: float) -> Array:
    """Return pushes (k, 3) that are not over when another one (3,) begins, and that one.

    Args:
        pushes: Schedule of an episode.
        push: The other one.
        duration: Time that a push takes, s.

    Raises:
        ValueError: If there are too many.
    """
    continuing = pushes[pushes[:, 0] + duration > push[0]]
    if len(continuing) == MOST_PUSHES:
        raise ValueError(f"there are {MOST_PUSHES} pushes, must be fewer")
    return np.concatenate([continuing, push[None]])
