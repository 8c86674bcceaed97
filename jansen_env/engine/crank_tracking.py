"""The crank task of n robots: actions, observations, rewards and information."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import Bools1, Floats1, Floats2, Ints1, Ints2, Singles2, kernel, stage
from jansen_env.engine.readings import keep_actions
from jansen_env.engine.records import Robots, floats, row_dtype

START_ANGLE = math.pi  # rad, of the reference at time 0, as in the paper
LOST = math.pi  # rad, tracking error at which an episode ends
TRACKING_WIDTH = 0.8  # rad, tracking error at which half of the tracking reward is left

# The reward's terms, and likewise their weights.
REWARD = row_dtype(floats("tracking", "torque"))
# Information on a robot that is held; its units are listed with the environment.
HELD_INFORMATION = row_dtype(
    [*floats("crank_angle", "crank_speed", "crank_torque"), ("diverged", bool)]
)
ENERGIES = row_dtype(
    floats("motor_work", "electrical_work", "joint_loss", "mechanical_energy_change", "residual")
)
# A held robot's row, see jansen_env.engine.readings.ROW.
HELD_ROW = row_dtype(
    [
        *floats("action", "action_before", "weight", "direction"),
        ("info", HELD_INFORMATION),
        ("energy", ENERGIES),
    ]
)
INFORMATION = row_dtype(floats("tracking_error", "speed_command"))
# The task's row.
ROW = row_dtype([("info", INFORMATION), ("reward", REWARD)])

Weights = Annotated[NDArray[np.void], REWARD, 1]
HeldRows = Annotated[NDArray[np.void], HELD_ROW, 1]
Rows = Annotated[NDArray[np.void], ROW, 1]


@kernel
def take_actions(
    actions: Floats2, active: Bools1, elapsed: Ints1, full_torque: Floats1, rows: HeldRows,
    asked: Floats2, delay: Ints2, torque: Floats1, earlier: Floats1, switch: Ints1,
) -> int:  # fmt: skip
    """See :func:`jansen_env.engine.readings.keep_actions`."""
    return keep_actions(
        actions, active, elapsed, full_torque, rows, asked, delay, torque, earlier, switch
    )


@kernel
def finish_step(
    which: Ints1, states: Floats2, robots: Robots, torque: Floats1, elapsed: Ints1,
    period: float, weights: Weights, rows: HeldRows, own: Rows, reward: Floats1,
    terminated: Bools1, out: Singles2,
) -> None:  # fmt: skip
    """Reward the step of ``period`` seconds that led to ``states`` (n, 8), and describe it.

    Args:
        which: (k,) robots that have taken it.
        robots: (n,) ROBOT of :mod:`jansen_env.engine.records`. torque: (n,) last asked for, N m.
        elapsed: (n,) steps since the reset.
        weights: (1,) of :data:`REWARD`. rows: (n,) of :data:`HELD_ROW`, own: (n,) of :data:`ROW`.
        reward, terminated: (n,). out: (n, 5) observations.
    """
    for r in which:
        energy, total = rows[r].energy, robots[r].accumulators
        work, loss, change = total.motor_work, total.joint_loss, total.energy_change
        energy.motor_work, energy.joint_loss = work, loss
        energy.electrical_work = total.electrical_work
        energy.mechanical_energy_change, energy.residual = change, work - loss - change
        rows[r].info.crank_torque = torque[r] + total.torque_impulse / period
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
    which: Ints1, states: Floats2, elapsed: Ints1, period: float, rows: HeldRows, own: Rows,
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
