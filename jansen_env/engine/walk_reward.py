"""The walking task of a robot: commands, accounts, reward and end of the episode.

The reward is a product of factors, each 1 where a step is as commanded, so that none can be bought
with another. They are documented in :class:`jansen_env.tasks.walking.walker_env.JansenWalkerEnv`.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import APART, stage
from jansen_env.engine.random import number, uniform
from jansen_env.engine.readings import put
from jansen_env.engine.records import floats, row_dtype

STREAM = 2  # of an episode's random numbers, for its commands; sensors and pushes have others
FALLEN_PITCH = 1.2  # rad

STEPS_PER_TURN = 4  # of the feet, with two crank pins: means are taken over a quarter turn
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
HALF_LOAD = 0.8  # of the weight: how far the ground's load is from 1

ENOUGH = 0.8  # of the commanded distance, for a success

MEANS = floats("mean_speed", "mean_slip", "mean_power", "rms_torque")
# The reward's factors; all but the first two have an exponent, their weight.
WEIGHTED = floats("slip", "energy", "effort", "smoothness", "posture", "load")
REWARD = row_dtype([*floats("tracking", "progress"), *WEIGHTED])
# The weights, and the definition of a fall: by pitch (rad), and whether by a joint on the ground;
# and whether it ends the episode.
SETTINGS = row_dtype(
    [*WEIGHTED, ("fall_pitch", float), ("fall_contact", bool), ("ends_episode", bool)]
)
# Accounts from step to step: exact in the information, and as measured behind noisy sensors.
ACCOUNTS = row_dtype([*floats("lag"), *MEANS])
# Information on the task.
INFORMATION = row_dtype(
    [*floats("speed_command", "lag"), *MEANS, ("fallen", bool), ("is_success", bool)]
)
# The task's part of a robot's record.
ROW = row_dtype(
    [
        ("next_command", float),  # m/s, from the next step on
        ("command", float),  # m/s, of the last step
        ("command_range", float, 2),  # m/s, of the next commands
        ("command_steps", "i8"),  # control steps after which the command changes; 0: never
        ("mean_path", float),  # m, over which means are taken
        ("covered", float, 2),  # m, walked in the commanded direction, and commanded
        ("measured", ACCOUNTS),  # as odometry has them, with noisy or onboard sensors
        ("info", INFORMATION),
        ("reward", REWARD),
    ]
)


Settings = Annotated[NDArray[np.void], SETTINGS, 1]
Walks = Annotated[NDArray[np.void], ROW, 1, APART]


@stage
def begin_walk(robot, walk, advance):
    """Begin an episode of the task, whose command is known; ``advance``: m per crank turn."""
    walk.mean_path = abs(advance) / STEPS_PER_TURN
    walk.next_command = walk.info.speed_command
    walk.covered[0] = walk.covered[1] = 0.0
    _clear_accounts(walk.info)
    _clear_accounts(walk.measured)
    walk.info.fallen = walk.info.is_success = False
    term = walk.reward
    term.tracking = term.progress = term.slip = term.energy = term.effort = 0.0
    term.smoothness = term.posture = term.load = 0.0
    robot.reward, robot.terminated = 0.0, False


@stage
def _clear_accounts(kept):
    """Begin new accounts."""
    kept.lag = kept.mean_speed = kept.mean_slip = kept.mean_power = kept.rms_torque = 0.0


@stage
def sample_command(robot, walk):
    """Sample the command that holds after this step, if it is time for another."""
    steps = walk.command_steps
    if steps > 0 and robot.elapsed % steps == 0:
        key = number(robot.seed, STREAM)
        low, high = walk.command_range[0], walk.command_range[1]
        walk.next_command = low + (high - low) * uniform(key, robot.elapsed)


@stage
def judge_walk(period, settings, robot, walk, way, slipped):
    """Update the accounts, reward the step, and decide whether the episode is over.

    Args:
        period: Time of the control step, s.
        settings: Record of :data:`SETTINGS`.
        robot: The robot's record.
        walk: Its record of the task.
        way: Path of the crank axis in the step, m.
        slipped: Path that all toes slid while loaded in the step, m.
    """
    info, total, state = walk.info, robot.accumulators, robot.state
    command = info.speed_command
    walk.command = command
    walk.covered[0] += np.sign(command) * way
    walk.covered[1] += abs(command) * period
    torque, velocity = robot.info.crank_torque, robot.info.x_velocity
    power = total.motor_work / period
    keep_accounts(velocity, slipped / period, power, torque, period, command, walk, info)
    falls = settings.fall_contact and total.non_toe_impulse > 0.0
    falls = falls or abs(state[2]) > settings.fall_pitch
    info.fallen = info.fallen or falls
    enough = walk.covered[0] >= ENOUGH * walk.covered[1]
    info.is_success = enough and not info.fallen and not robot.diverged
    robot.terminated = info.fallen and settings.ends_episode
    robot.reward = compute_reward(state[2], settings, robot, walk)
    info.speed_command = walk.next_command


@stage
def measure_walk(period, robot, walk, velocity, crank_error):
    """Update the accounts as odometry has them, which knows of no slip.

    Args:
        period: Time of the control step, s.
        robot: The robot's record.
        walk: Its record of the task.
        velocity: Measured mean velocity of the crank axis in x, m/s.
        crank_error: Error of the mean crank speed, rad/s, counted as the action is.
    """
    torque = robot.info.crank_torque
    power = robot.accumulators.motor_work / period + torque * robot.direction * crank_error
    keep_accounts(velocity, 0.0, power, torque, period, walk.command, walk, walk.measured)


@stage
def keep_accounts(velocity, slip_speed, power, torque, period, command, walk, kept):
    """Update the lag, and exponential means over a quarter turn at the commanded speed.

    Args:
        velocity: Mean velocity of the crank axis over the step, m/s.
        slip_speed: Mean slip speed of all toes together, m/s.
        power: Mean power of the motor, W.
        torque: Mean torque on the crank, N m.
        period: Time of the step, s.
        command: Commanded speed, m/s.
        walk: Record of the task.
        kept: Record with the fields of :data:`ACCOUNTS`, 0 at first.
    """
    lag = kept.lag + (command - velocity) * period
    kept.lag = min(FURTHEST_TARGET, max(-FURTHEST_TARGET, lag))
    share = -mathematics.expm1(-period / mean_time(command, walk.mean_path))
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
def compute_reward(pitch, settings, robot, walk):
    """Fill a robot's factors and return their product; pitch: rad, settings: :data:`SETTINGS`."""
    info, term = walk.info, walk.reward
    pace = max(abs(info.speed_command), SLOWEST)
    term.tracking = tracking(info.lag)
    term.progress = progress(info.mean_speed, info.speed_command)
    term.slip = factor(slip_cost(info.mean_slip, pace), settings.slip)
    term.energy = factor(energy_cost(info.mean_power, robot.weight, pace), settings.energy)
    term.effort = factor(effort_cost(info.rms_torque, robot.weight), settings.effort)
    term.smoothness = factor(change_cost(robot.action - robot.action_before), settings.smoothness)
    term.posture = factor(pitch_cost(pitch), settings.posture)
    term.load = factor(load_cost(robot.ground_load.unevenness), settings.load)
    style = term.effort * term.smoothness * term.posture * term.load
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
def load_cost(unevenness):
    """Unevenness of the ground's load, see :mod:`jansen_env.engine.ground_load`."""
    return unevenness / HALF_LOAD**2


@stage
def factor(cost, weight):
    """1 / (1 + cost), to the power of ``weight``."""
    return 1.0 / (1.0 + cost) if weight == 1.0 else mathematics.power(1.0 + cost, -weight)


@stage
def observe_walk(command, kept, columns, out):
    """Put the command (m/s) and accounts into the ``columns`` (6,) of a robot's observation."""
    put(out, columns[0], command)
    put(out, columns[1], kept.lag)
    put(out, columns[2], kept.mean_speed)
    put(out, columns[3], kept.mean_slip)
    put(out, columns[4], kept.mean_power)
    put(out, columns[5], kept.rms_torque)
