"""Pushes in a control step of n robots; what they are is documented in
:mod:`jansen_env.world.push`."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import Bools1, Floats1, Floats3, Ints1, kernel, stage
from jansen_env.engine.random import number, uniform
from jansen_env.engine.records import row_dtype

STREAM = 1  # of an episode's random numbers; that of sensors is another

PUSHES = row_dtype(
    [
        ("impulse_x", "f8"),  # N s, the largest at random; both 0: there are none at random
        ("impulse_y", "f8"),
        ("duration", "f8"),  # s
        ("interval", "f8"),  # s
        ("time_step", "f8"),  # s
    ]
)


Settings = Annotated[NDArray[np.void], PUSHES, 1]


@kernel
def fill_pushes(
    active: Bools1, elapsed: Ints1, seeds: Ints1, strength: Floats1, settings: Settings,
    random: Bools1, schedule: Floats3, scheduled: Ints1, out: Floats3,
) -> bool:  # fmt: skip
    """Fill impulses on the chassis in each time step of a control step; whether there are any.

    Args:
        active: (n,) whether a robot takes the step; the others are not pushed.
        elapsed: (n,) control steps since the episode began. seeds: (n,) of the episodes.
        strength: (n,) by which the random pushes are multiplied. settings: (1,) of :data:`PUSHES`.
        random: (n,) whether a robot's episode has random pushes, if there are any.
        schedule: (n, most, 3) times since the episode began, s, and impulses in x and y, N s.
        scheduled: (n,) how many of these there are. out: (n, steps, 2) N s.
    """
    push, any_pushed, steps = settings[0], False, out.shape[1]
    at_random = push.impulse_x > 0.0 or push.impulse_y > 0.0
    for r in range(len(out)):
        for k in range(steps):
            out[r, k, 0] = out[r, k, 1] = 0.0
        if not active[r]:
            continue
        begin = elapsed[r] * steps
        for i in range(scheduled[r]):
            start, x, y = schedule[r, i, 0], schedule[r, i, 1], schedule[r, i, 2]
            if _push(start, x, y, begin, push, out[r]):
                any_pushed = True
        if at_random and random[r]:
            episode = number(seeds[r], STREAM)
            first = int(mathematics.floor(begin * push.time_step / push.interval))
            last = int(mathematics.floor((begin + steps) * push.time_step / push.interval))
            for window in range(first, last + 1):
                key = number(episode, window)
                start = push.interval * window + uniform(key, 0) * (push.interval - push.duration)
                x = strength[r] * push.impulse_x * (2.0 * uniform(key, 1) - 1.0)
                y = strength[r] * push.impulse_y * (2.0 * uniform(key, 2) - 1.0)
                if _push(start, x, y, begin, push, out[r]):
                    any_pushed = True
    return any_pushed


@stage
def _push(start, x, y, begin, push, out):
    """Add one push to a robot's time steps (steps, 2) from ``begin``; whether it is felt."""
    steps, step = len(out), push.time_step
    if start >= (begin + steps) * step or start + push.duration <= begin * step:
        return False
    before = _share(begin * step - start, push.duration)
    for k in range(steps):
        after = _share((begin + k + 1) * step - start, push.duration)
        out[k, 0] += x * (after - before)
        out[k, 1] += y * (after - before)
        before = after
    return True


@stage
def _share(time, duration):
    """The share of its impulse that a push has given a time after its start, s."""
    return 0.5 - 0.5 * mathematics.cos(math.pi * min(1.0, max(0.0, time / duration)))
