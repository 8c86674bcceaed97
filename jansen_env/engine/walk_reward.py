"""The walking task of n robots: commands, rewards and their means, on top of the readings.

The reward is a product of factors, each 1 where a step is as asked for, so that none can be bought
with another. They are documented in :class:`jansen_env.tasks.walking.walker_env.JansenWalkerEnv`.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine import mathematics, readings
from jansen_env.engine.kernel import (
    Bools1,
    Floats1,
    Floats2,
    Floats3,
    Ints1,
    Singles2,
    kernel,
    stage,
)
from jansen_env.engine.readings import put, read, take_step
from jansen_env.engine.records import Robots, floats, row_dtype

FALLEN_PITCH = 1.2  # rad

FURTHEST_TARGET = 0.5  # m, the target waits when it is so far away
LONGEST_MEAN = 3.4  # s, over which means are taken at most ...
SHORTEST_MEAN = 0.2  # s, ... and at least
FLOOR = 0.3  # of tracking: floor that keeps a learning signal
CATCHING_UP = 2.0  # times the command: up to this mean speed progress is not less
STANDING = 0.05  # m/s: mean speed at which progress is 0 when the command is to stand
SLOWEST = 0.1  # m/s: slip and power are rated by the commanded speed, but by no slower one

# Where each factor has fallen to a half.
HALF_LAG = 0.2  # m, of tracking without its floor
HALF_SLIP = 0.2  # m slid by all toes per metre
HALF_ENERGY = 4.0  # cost of transport: motor power / (weight * speed)
HALF_EFFORT = 0.3  # m, RMS torque / weight
HALF_CHANGE = 0.8  # change of the action
HALF_PITCH = 0.4  # rad

MEANS = floats("mean_speed", "mean_slip", "mean_power", "rms_torque")
# The reward's factors; all but the first two have an exponent, their weight.
WEIGHTED = floats("slip", "energy", "effort", "smoothness", "posture")
REWARD = row_dtype([*floats("tracking", "progress"), *WEIGHTED])
# The weights, and the definition of a fall: by pitch (rad), and whether by a joint on the ground;
# and whether it ends the episode.
SETTINGS = row_dtype(
    [*WEIGHTED, ("fall_pitch", float), ("fall_contact", bool), ("ends_episode", bool)]
)
# Accounts from step to step: exact in the information, and as measured behind noisy sensors.
ACCOUNTS = row_dtype([*floats("lag"), *MEANS])
# Information beside that of the world.
INFORMATION = row_dtype([*floats("speed_command", "lag"), *MEANS, ("fallen", bool)])
# A robot's row: accounts of its episode, and the reward of its last step.
ROW = row_dtype(
    [
        ("next_command", float),  # m/s, from the next step on
        ("mean_path", float),  # m, over which means are taken
        ("info", INFORMATION),
        ("reward", REWARD),
    ]
)


Settings = Annotated[NDArray[np.void], SETTINGS, 1]
Accounts = Annotated[NDArray[np.void], ACCOUNTS, 1]
Rows = Annotated[NDArray[np.void], ROW, 1]


@kernel(nogil=True)
def finish_step(
    which: Ints1, settings: Settings, task: Rows, reward: Floats1, terminated: Bools1,
    error: Floats2, measured: Accounts, task_places: Ints1, period: float, states: Floats2,
    slip: Floats2, force: Floats3, robots: Robots, rows: readings.Rows, loads: Floats2,
    surface: Floats2, scan: Floats1, places: Ints1, out: Singles2,
) -> None:  # fmt: skip
    """Reward the step that led to ``states`` (n, 8), and :func:`describe` it.

    Args:
        settings: (1,) of :data:`SETTINGS`. task: (n,) of :data:`ROW`.
        reward, terminated: (n,). error: (n, 2) of the measured mean speeds: m/s in x; rad/s of the
            crank, counted as the action is. measured: (n,) of :data:`ACCOUNTS`. Without noise
            these two have no rows.
        task_places: (6,) columns in ``out`` of the command, the lag and the means.
        which, period ... out: see :func:`jansen_env.engine.readings.finish_step`.
    """
    for r in which:
        slipped = take_step(r, period, states, slip, force, robots, rows, loads)
        row, task_row, total, state = rows[r], task[r], robots[r].accumulators, states[r]
        torque = row.info.crank_torque
        velocity, power = row.info.x_velocity, total.motor_work / period
        keep_accounts(velocity, slipped / period, power, torque, period, task_row, task_row.info)
        if len(measured) > 0:
            velocity += error[r, 0]
            power += torque * row.direction * error[r, 1]
            keep_accounts(velocity, 0.0, power, torque, period, task_row, measured[r])  # of no slip
        falls = settings[0].fall_contact and total.non_toe_impulse > 0.0
        falls = falls or abs(state[2]) > settings[0].fall_pitch
        task_row.info.fallen = task_row.info.fallen or falls
        terminated[r] = task_row.info.fallen and settings[0].ends_episode
        reward[r] = compute_reward(state[2], settings[0], row, task_row)
        task_row.info.speed_command = task_row.next_command
        read(r, states, robots, rows, loads, surface, scan, places, out)
        observe(r, task_row.info, task_places, out)


@stage
def keep_accounts(velocity, slip_speed, power, torque, period, row, kept):
    """Update the lag, and exponential means over a quarter turn at the commanded speed.

    Args:
        velocity, slip_speed: of the crank axis and of all toes together, m/s, means over the step.
        power: of the motor, W, torque: of the crank, N m, likewise. period: s, of the step.
        row: of :data:`ROW`. kept: any row that has the fields of :data:`ACCOUNTS`; 0 at first.
    """
    command = row.info.speed_command
    lag = kept.lag + (command - velocity) * period
    kept.lag = min(FURTHEST_TARGET, max(-FURTHEST_TARGET, lag))
    share = -mathematics.expm1(-period / mean_time(command, row.mean_path))
    kept.mean_speed += share * (velocity - kept.mean_speed)
    kept.mean_slip += share * (slip_speed - kept.mean_slip)
    kept.mean_power += share * (abs(power) - kept.mean_power)
    square = kept.rms_torque**2
    kept.rms_torque = math.sqrt(square + share * (torque**2 - square))


@stage
def mean_time(command, path):
    """The time constant of means, s: what ``path`` (m) takes at the commanded speed (m/s)."""
    return min(LONGEST_MEAN, max(SHORTEST_MEAN, path / max(abs(command), 1e-9)))


@stage
def compute_reward(pitch, settings, row, task):
    """Fill a robot's factors and return their product; pitch: rad, settings: :data:`SETTINGS`."""
    info, term = task.info, task.reward
    pace = max(abs(info.speed_command), SLOWEST)
    term.tracking = tracking(info.lag)
    term.progress = progress(info.mean_speed, info.speed_command)
    term.slip = factor(slip_cost(info.mean_slip, pace), settings.slip)
    term.energy = factor(energy_cost(info.mean_power, row.weight, pace), settings.energy)
    term.effort = factor(effort_cost(info.rms_torque, row.weight), settings.effort)
    term.smoothness = factor(change_cost(row.action - row.action_before), settings.smoothness)
    term.posture = factor(pitch_cost(pitch), settings.posture)
    style = term.effort * term.smoothness * term.posture
    return term.tracking * term.progress * term.slip * term.energy * style


@stage
def tracking(lag):
    """1 on the target, with a slope everywhere; lag: m."""
    return FLOOR + (1.0 - FLOOR) / (1.0 + (lag / HALF_LAG) ** 2)


@stage
def progress(mean_speed, command):
    """1 at a mean speed of once to twice the command (m/s), less in proportion on both sides."""
    if command == 0.0:
        return max(0.0, 1.0 - abs(mean_speed) / STANDING)
    ratio = mean_speed / command
    return min(1.0, max(0.0, ratio)) if ratio < CATCHING_UP else CATCHING_UP / ratio


@stage
def slip_cost(mean_slip, pace):
    """Slip of all toes per metre; both m/s."""
    return mean_slip / pace / HALF_SLIP


@stage
def energy_cost(mean_power, weight, pace):
    """Cost of transport; W, N, m/s."""
    return mean_power / (weight * pace) / HALF_ENERGY


@stage
def effort_cost(rms_torque, weight):
    """Torque, N m, for the weight, N."""
    return (rms_torque / weight / HALF_EFFORT) ** 2


@stage
def change_cost(change):
    """Change of the action from step to step."""
    return (change / HALF_CHANGE) ** 2


@stage
def pitch_cost(pitch):
    """Pitch, rad."""
    return (pitch / HALF_PITCH) ** 2


@stage
def factor(cost, weight):
    """1 / (1 + cost), to the power of ``weight``."""
    return 1.0 / (1.0 + cost) if weight == 1.0 else mathematics.power(1.0 + cost, -weight)


@kernel
def describe(
    which: Ints1, task: Rows, task_places: Ints1, states: Floats2, robots: Robots,
    rows: readings.Rows, loads: Floats2, surface: Floats2, scan: Floats1, places: Ints1,
    out: Singles2,
) -> None:  # fmt: skip
    """Observations into ``out`` (n, d), information into ``rows``, of robots ``which`` (k,).

    Args: see :func:`finish_step`.
    """
    for r in which:
        read(r, states, robots, rows, loads, surface, scan, places, out)
        observe(r, task[r].info, task_places, out)


@stage
def observe(r, info, places, out):
    """Put command, lag and means into the columns of a robot's observation."""
    put(out, r, places[0], info.speed_command)
    put(out, r, places[1], info.lag)
    put(out, r, places[2], info.mean_speed)
    put(out, r, places[3], info.mean_slip)
    put(out, r, places[4], info.mean_power)
    put(out, r, places[5], info.rms_torque)
