"""Schedules of pushes, and the impulses of the pushes in a control step of a robot.

:mod:`jansen_env.world.push` documents the pushes.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import Floats2, kernel, stage
from jansen_env.engine.random import PUSH_STREAM, number, uniform
from jansen_env.engine.records import row_dtype

PUSHES = row_dtype(
    [
        # Largest components of random impulses, in N s. If both are 0, there are no random pushes.
        ("impulse_x", "f8"),
        ("impulse_y", "f8"),
        ("duration", "f8"),  # duration of a push, in s
        ("interval", "f8"),  # interval that contains one random push, in s
        ("time_step", "f8"),  # time step of the integration, in s
    ]
)
"""Record of the settings of pushes."""

Settings = Annotated[NDArray[np.void], PUSHES, 1]


@kernel
def add_push(
    time: float, x: float, y: float, settings: Settings, count: int, schedule: Floats2
) -> int:
    """Add a push that starts now to a schedule, and remove the pushes that are over.

    If the schedule is full, it does not change.

    Args:
        time: Time since the beginning of the episode, in s.
        x: Impulse in x, in N s.
        y: Impulse in y, in N s.
        settings: Settings of the pushes, shape (1,).
        count: Number of pushes in the schedule.
        schedule: Scheduled pushes, see :func:`fill_pushes`, changed in place, shape (most, 3).

    Returns:
        The new number of pushes, or -1 if the schedule is full.
    """
    kept = 0
    for i in range(count):
        if schedule[i, 0] + settings[0].duration > time:
            for k in range(3):
                schedule[kept, k] = schedule[i, k]
            kept += 1
    if kept == len(schedule):
        return -1
    schedule[kept, 0], schedule[kept, 1], schedule[kept, 2] = time, x, y
    return kept + 1


@stage
def fill_pushes(robot, schedule, settings, out):
    """Fill the impulses on a robot's chassis in each time step of its next control step.

    Args:
        robot: The robot's record.
        schedule: Scheduled pushes, shape (most, 3): time since the beginning of the episode in s,
            and impulses in x and y in N s.
        settings: Record of :data:`PUSHES`.
        out: Output, impulses in x and y in each time step, in N s, shape (steps, 2).

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
        strength, episode = robot.parameters.push_strength, number(robot.seed, PUSH_STREAM)
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
    """Add a push to the impulses in a robot's time steps.

    Args:
        start: Time at which the push starts, in s since the beginning of the episode.
        x: Impulse in x, in N s.
        y: Impulse in y, in N s.
        begin: Number of time steps between the beginning of the episode and the control step.
        push: Record of :data:`PUSHES`.
        out: Impulses in each time step, in N s, shape (steps, 2), changed in place.

    Returns:
        Whether the push acts in this control step.
    """
    steps, step = len(out), push.time_step
    if start >= (begin + steps) * step or start + push.duration <= begin * step:
        return False
    before = _delivered(begin * step - start, push.duration)
    for k in range(steps):
        after = _delivered((begin + k + 1) * step - start, push.duration)
        out[k, 0] += x * (after - before)
        out[k, 1] += y * (after - before)
        before = after
    return True


@stage
def _delivered(time, duration):
    """Return the fraction of its impulse that a push has delivered.

    Args:
        time: Time since the start of the push, in s.
        duration: Duration of the push, in s.
    """
    return 0.5 - 0.5 * mathematics.cos(math.pi * min(1.0, max(0.0, time / duration)))
