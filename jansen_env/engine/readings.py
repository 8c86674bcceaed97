"""Actions of n robots as torques, which may come late; readings of walking ones."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine import mathematics
from jansen_env.engine.collision import height_at
from jansen_env.engine.kernel import (
    Bools1,
    Floats1,
    Floats2,
    Floats3,
    Ints1,
    Ints2,
    Singles2,
    kernel,
    stage,
)
from jansen_env.engine.records import Robots, floats, row_dtype

# Information on a robot in its world; units are listed with the environments.
STATE = ("x_position", "x_velocity", "pitch", "crank_angle", "crank_speed", "crank_torque")
INFORMATION = row_dtype(
    [*floats(*STATE, "joint_gap"), ("links_in_ground", "i8"), ("diverged", bool)]
)
ENERGIES = row_dtype(
    floats(
        "motor_work", "push_work", "correction_work", "electrical_work", "joint_loss", "slip_loss",
        "impact_loss", "mechanical_energy_change", "residual",
    )
)  # fmt: skip
# What of it is shown of a robot whose chassis is held.
HELD_INFORMATION = "crank_angle", "crank_speed", "crank_torque", "diverged"
HELD_ENERGIES = (
    "motor_work", "electrical_work", "joint_loss", "mechanical_energy_change", "residual"
)  # fmt: skip
# A robot's row: its last actions, what it is, and its last step.
ROW = row_dtype(
    [
        ("action", float),  # the last one
        ("action_before", float),
        ("x_before", float),  # m, where the step began
        ("weight", float),  # N
        ("direction", float),  # 1 or -1: which way the crank turns to walk towards +x
        ("info", INFORMATION),
        ("energy", ENERGIES),
    ]
)


Rows = Annotated[NDArray[np.void], ROW, 1]


@kernel
def take_actions(
    actions: Floats2, active: Bools1, elapsed: Ints1, full_torque: Floats1, rows: Rows,
    asked: Floats2, delay: Ints2, torque: Floats1, earlier: Floats1, switch: Ints1,
) -> int:  # fmt: skip
    """Keep actions (n, 1), clipped to -1 .. 1, in ``rows``; 0 of robots not ``active`` (n,).

    Args:
        elapsed: (n,) control steps since the reset; counted on where ``active``.
        full_torque: (n,) N m, the torque of action 1, with its sign.
        asked: (n, steps) N m, the torques asked for, latest first; moved on by one.
        delay: (n, 2) how many control steps a torque comes late, and time steps on top of these.
        torque, earlier, switch: (n,) out: the torque of this control step, N m, and the one before,
            which still holds in its first ``switch`` time steps.

    Returns:
        The first active robot whose action is not finite, and nothing is kept; else -1.
    """
    for r in range(len(actions)):
        if active[r] and not math.isfinite(actions[r, 0]):
            return r
    for r in range(len(actions)):
        action = actions[r, 0] if active[r] else 0.0
        elapsed[r] += active[r]
        rows[r].action_before = rows[r].action
        rows[r].action = min(1.0, max(-1.0, action))
        for k in range(asked.shape[1] - 1, 0, -1):
            asked[r, k] = asked[r, k - 1]
        asked[r, 0] = rows[r].action * full_torque[r]
        whole = delay[r, 0]
        torque[r], earlier[r], switch[r] = asked[r, whole], asked[r, whole + 1], delay[r, 1]
        rows[r].info.crank_torque = torque[r]
    return -1


@kernel(nogil=True)
def finish_step(
    which: Ints1, period: float, states: Floats2, slip: Floats2, force: Floats3, robots: Robots,
    rows: Rows, loads: Floats2, surface: Floats2, scan: Floats1, places: Ints1, out: Singles2,
) -> None:  # fmt: skip
    """Account for the step of ``period`` seconds that led to ``states`` (n, 8), and read them.

    Args:
        which: (k,) robots that have taken it.
        slip: (n, toes) m. force: (n, toes, 2) N. robots: (n,) ROBOT of the plant.
        rows: (n,) of :data:`ROW`. loads: (n, toes) normal forces / weight.
        surface: (vertices, 2) m, of all terrains.
        scan: (count,) m, places from the crank axis at which the ground is looked at.
        places: (10 + toes + count,) column of each reading in ``out`` (n, d), -1 for none: the
            order is that of :func:`read`.
    """
    for r in which:
        take_step(r, period, states, slip, force, robots, rows, loads)
        read(r, states, robots, rows, loads, surface, scan, places, out)


@kernel
def describe(
    which: Ints1, states: Floats2, robots: Robots, rows: Rows, loads: Floats2, surface: Floats2,
    scan: Floats1, places: Ints1, out: Singles2,
) -> None:  # fmt: skip
    """Read the present state of robots ``which`` (k,); see :func:`finish_step`."""
    for r in which:
        read(r, states, robots, rows, loads, surface, scan, places, out)


@stage
def take_step(r, period, states, slip, force, robots, rows, loads):
    """Account for a robot's step; returns the path that all its toes slid, m."""
    row, x = rows[r], states[r, 0]
    row.info.crank_torque += robots[r].accumulators.torque_impulse / period
    slipped = 0.0
    for j in range(slip.shape[1]):
        slipped += slip[r, j]
        loads[r, j] = force[r, j, 1] / row.weight
    row.info.x_velocity = (x - row.x_before) / period
    row.info.links_in_ground = robots[r].accumulators.links_in_ground
    row.x_before = x
    return slipped


@stage
def read(r, states, robots, rows, loads, surface, scan, places, out):
    """Put a robot's readings into the columns of its observation, and into its information."""
    status, state, row, toes = robots[r].status, states[r], rows[r], loads.shape[1]
    ground = height_at(surface, status.first_vertex, status.end_vertex, state[0])
    theta, psi = state[2], state[3]
    put(out, r, places[0], mathematics.cos(psi))
    put(out, r, places[1], row.direction * mathematics.sin(psi))
    put(out, r, places[2], row.direction * state[7])
    put(out, r, places[3], mathematics.sin(theta))
    put(out, r, places[4], mathematics.cos(theta))
    put(out, r, places[5], state[6])
    put(out, r, places[6], state[4])
    put(out, r, places[7], state[5])
    put(out, r, places[8], state[1] - ground)
    put(out, r, places[9], row.action)
    for j in range(toes):
        put(out, r, places[10 + j], loads[r, j])
    for i in range(len(scan)):
        x = state[0] + scan[i]
        ground = height_at(surface, status.first_vertex, status.end_vertex, x)
        put(out, r, places[10 + toes + i], state[1] - ground)
    inform(state, robots[r].accumulators, row)


@stage
def put(out, r, place, value):
    """Put a number into a column of a robot's observation, unless that is -1."""
    if place >= 0:
        out[r, place] = value


@stage
def inform(state, total, row):
    """Information on a robot's state and on its last step's energies."""
    info, energy = row.info, row.energy
    info.x_position, info.pitch = state[0], state[2]
    info.crank_angle, info.crank_speed = state[3], state[7]
    energy.motor_work, energy.push_work = total.motor_work, total.push_work
    energy.correction_work = total.correction_work
    energy.joint_loss = total.joint_loss
    energy.electrical_work = total.electrical_work
    energy.slip_loss, energy.impact_loss = total.slip_loss, total.impact_loss
    energy.mechanical_energy_change = total.energy_change
    losses = energy.joint_loss + energy.slip_loss + energy.impact_loss
    work = energy.motor_work + energy.push_work + energy.correction_work
    energy.residual = work - losses - energy.mechanical_energy_change
