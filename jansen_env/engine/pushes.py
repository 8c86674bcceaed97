"""Pushes in a control step of a robot; what they are is documented in
:mod:`jansen_env.world.push`."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import stage
from jansen_env.engine.random import number, uniform
from jansen_env.engine.records import row_dtype

STREAM = 1  # of an episode's random numbers; sensors and commands have others

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


@stage
def fill_pushes(robot, schedule, settings, out):
    """Fill the impulses on a robot's chassis in each time step of its next control step.

    Args:
        robot: The robot's record.
        schedule: Shape (most, 3), times since the episode began, s, and impulses in x and y, N s.
        settings: Record of :data:`PUSHES`.
        out: Shape (steps, 2), gets the impulses in N s.

    Returns:
        Whether any push acts in this control step.
    """
    at_random = settings.impulse_x > 0.0 or settings.impulse_y > 0.0
    at_random = at_random and robot.random_pushes
    any_pushed = False
    if not at_random and robot.scheduled == 0:
        return any_pushed
    steps = len(out)
    begin = robot.elapsed * steps
    for k in range(steps):
        out[k, 0] = out[k, 1] = 0.0
    for i in range(robot.scheduled):
        start, x, y = schedule[i, 0], schedule[i, 1], schedule[i, 2]
        if _push(start, x, y, begin, settings, out):
            any_pushed = True
    if at_random:
        strength, episode = robot.parameters.push_strength, number(robot.seed, STREAM)
        first = int(mathematics.floor(begin * settings.time_step / settings.interval))
        last = int(mathematics.floor((begin + steps) * settings.time_step / settings.interval))
        for window in range(first, last + 1):
            key = number(episode, window)
            room = settings.interval - settings.duration
            start = settings.interval * window + uniform(key, 0) * room
            x = strength * settings.impulse_x * (2.0 * uniform(key, 1) - 1.0)
            y = strength * settings.impulse_y * (2.0 * uniform(key, 2) - 1.0)
            if _push(start, x, y, begin, settings, out):
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
