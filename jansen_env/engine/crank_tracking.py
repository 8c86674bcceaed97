"""The crank task of n robots: actions, observations, rewards and information."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine import mathematics, readings
from jansen_env.engine.kernel import Bools1, Floats1, Floats2, Ints1, Singles2, kernel, stage
from jansen_env.engine.readings import inform
from jansen_env.engine.records import Robots, floats, row_dtype

START_ANGLE = math.pi  # rad, of the reference at time 0, as in the paper
LOST = math.pi  # rad, tracking error at which an episode ends
TRACKING_WIDTH = 0.8  # rad, tracking error at which half of the tracking reward is left

# The reward's terms, and likewise their weights.
REWARD = row_dtype(floats("tracking", "torque"))
INFORMATION = row_dtype(floats("tracking_error", "speed_command"))
# The task's row.
ROW = row_dtype([("info", INFORMATION), ("reward", REWARD)])

Weights = Annotated[NDArray[np.void], REWARD, 1]
Rows = Annotated[NDArray[np.void], ROW, 1]


@kernel
def finish_step(
    which: Ints1, states: Floats2, robots: Robots, elapsed: Ints1, period: float,
    weights: Weights, rows: readings.Rows, own: Rows, reward: Floats1, terminated: Bools1,
    out: Singles2,
) -> None:  # fmt: skip
    """Reward the step of ``period`` seconds that led to ``states`` (n, 8), and describe it.

    Args:
        which: (k,) robots that have taken it.
        robots: (n,) ROBOT of :mod:`jansen_env.engine.records`. elapsed: (n,) steps since the reset.
        weights: (1,) of :data:`REWARD`. rows: (n,) of readings, own: (n,) of :data:`ROW`.
        reward, terminated: (n,). out: (n, 5) observations.
    """
    for r in which:
        total = robots[r].accumulators
        inform(states[r], total, rows[r])
        rows[r].info.crank_torque += total.torque_impulse / period
        _describe(states[r], elapsed[r], period, rows[r], own[r], out[r])
        term, error = own[r].reward, own[r].info.tracking_error
        term.tracking = tracking(error, weights[0].tracking)
        term.torque = torque_cost(rows[r].action, weights[0].torque)
        reward[r] = term.tracking + term.torque
        terminated[r] = abs(error) > LOST


@stage
def tracking(error, weight):
    """The weight without an error (rad), half of it at :data:`TRACKING_WIDTH`."""
    return weight / (1.0 + (error / TRACKING_WIDTH) ** 2)


@stage
def torque_cost(action, weight):
    """Minus the square of the torque, as a share of its limit."""
    return -weight * action**2


@kernel
def describe(
    which: Ints1, states: Floats2, elapsed: Ints1, period: float, rows: readings.Rows, own: Rows,
    out: Singles2,
) -> None:  # fmt: skip
    """Write observations of robots ``which`` (k,) to ``out`` (n, 5), and information to both rows.

    Args:
        states: (n, 8). elapsed: (n,) steps since the reset. period: s, of a step.
    """
    for r in which:
        _describe(states[r], elapsed[r], period, rows[r], own[r], out[r])


@stage
def _describe(state, elapsed, period, row, own, out):
    info, angle, speed = own.info, state[3], state[7]
    row.info.crank_angle, row.info.crank_speed = angle, speed
    info.tracking_error = info.speed_command * elapsed * period + START_ANGLE - angle
    out[0], out[1], out[2] = mathematics.cos(angle), mathematics.sin(angle), speed
    out[3], out[4] = info.tracking_error, info.speed_command
