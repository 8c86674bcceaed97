"""Walking task of a robot: commands, accounts, reward and termination.

The reward is a product of factors. Each factor is 1 if the step is exactly as commanded, so a high
value of one factor cannot make up for a low value of another.
:class:`jansen_env.tasks.walking.walker_env.JansenWalkerEnv` documents the factors.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import APART, stage
from jansen_env.engine.random import COMMAND_STREAM, number, uniform
from jansen_env.engine.readings import put
from jansen_env.engine.records import floats, row_dtype

FALLEN_PITCH = 1.2  # pitch beyond which the robot has fallen, in rad

STEPS_PER_TURN = 4  # steps of the feet per turn of the crank; means are taken over a quarter turn
FURTHEST_TARGET = 0.5  # largest distance of the target, in m, at which the target waits
LONGEST_MEAN = 3.4  # longest time constant of a mean, in s
SHORTEST_MEAN = 0.2  # shortest time constant of a mean, in s
FLOOR = 0.3  # lowest value of the tracking factor, which keeps a learning signal
CATCHING_UP = 2.0  # multiple of the command up to which a mean speed does not reduce progress
STANDING = 0.05  # mean speed at which progress is 0 if the command is 0, in m/s
SLOWEST = 0.05  # lowest speed by which slip and power are divided, in m/s

# Values at which each factor is 0.5.
HALF_LAG = 0.2  # lag, in m, for tracking without its floor
HALF_SLIP = 0.2  # distance that all toes together slide per metre, in m
HALF_ENERGY = 4.0  # cost of transport: motor power / (weight * speed)
HALF_EFFORT = 0.3  # RMS torque / weight, in m
HALF_CHANGE = 0.8  # change of the action
HALF_PITCH = 0.4  # pitch, in rad
HALF_LOAD = 0.8  # difference of the load from 1, as a multiple of the weight

ENOUGH = 0.8  # fraction of the commanded distance that is needed for a success

MEANS = floats("mean_speed", "mean_slip", "mean_power", "rms_torque")
# Factors of the reward. All factors except tracking and progress have a weight, their exponent.
WEIGHTED = floats("slip", "energy", "effort", "smoothness", "posture", "load")
REWARD = row_dtype([*floats("tracking", "progress"), *WEIGHTED])
# Weights of the factors; pitch (rad) beyond which the robot has fallen; whether a joint that
# touches the ground counts as a fall; whether a fall ends the episode; and whether the cost of the
# load is a mean over a quarter turn.
SETTINGS = row_dtype(
    [
        *WEIGHTED,
        ("fall_pitch", float),
        ("fall_contact", bool),
        ("ends_episode", bool),
        ("mean_load_cost", bool),
    ]
)
# Accounts that every step updates. They are exact in ``info``, and come from the noisy sensors in
# ``measured``.
ACCOUNTS = row_dtype([*floats("lag"), *MEANS])
# Information on the task.
INFORMATION = row_dtype(
    [*floats("speed_command", "lag"), *MEANS, ("fallen", bool), ("is_success", bool)]
)
# The task's part of a robot's record.
ROW = row_dtype(
    [
        ("next_command", float),  # m/s, command from the next step on
        ("command", float),  # m/s, command in the last step
        ("command_range", float, 2),  # m/s, range of the following commands
        # Number of control steps after which the command changes; 0 if it never changes.
        ("command_steps", "i8"),
        ("mean_path", float),  # m, distance over which means are taken
        ("mean_unevenness", float),  # exponential mean of (load - 1)^2
        # Distance walked in the commanded direction, and commanded distance, in m.
        ("covered", float, 2),
        ("measured", ACCOUNTS),  # accounts by odometry, with noisy or onboard sensors
        ("info", INFORMATION),
        ("reward", REWARD),
    ]
)


Settings = Annotated[NDArray[np.void], SETTINGS, 1]
Walks = Annotated[NDArray[np.void], ROW, 1, APART]


@stage
def begin_walk(robot, walk, advance):
    """Begin an episode of the task; its first command must have been sampled.

    Args:
        robot: The robot's record.
        walk: The task's part of the record.
        advance: Distance that the robot advances per turn of the crank, in m.
    """
    walk.mean_path = abs(advance) / STEPS_PER_TURN
    walk.next_command = walk.info.speed_command
    walk.covered[0] = walk.covered[1] = 0.0
    walk.mean_unevenness = 0.0
    _clear_accounts(walk.info)
    _clear_accounts(walk.measured)
    walk.info.fallen = walk.info.is_success = False
    term = walk.reward
    term.tracking = term.progress = term.slip = term.energy = term.effort = 0.0
    term.smoothness = term.posture = term.load = 0.0
    robot.reward, robot.terminated = 0.0, False


@stage
def _clear_accounts(kept):
    """Set all accounts of a record to 0."""
    kept.lag = kept.mean_speed = kept.mean_slip = kept.mean_power = kept.rms_torque = 0.0


@stage
def sample_command(robot, walk):
    """Sample the command for the next step if the command interval ends with this step.

    Args:
        robot: The robot's record.
        walk: The task's part of the record.
    """
    steps = walk.command_steps
    if steps > 0 and robot.elapsed % steps == 0:
        key = number(robot.seed, COMMAND_STREAM)
        low, high = walk.command_range[0], walk.command_range[1]
        walk.next_command = low + (high - low) * uniform(key, robot.elapsed)


@stage
def judge_walk(period, settings, robot, walk, way, slipped):
    """Update the accounts, compute the reward, and decide whether the episode is over.

    Args:
        period: Duration of the control step, in s.
        settings: Record of :data:`SETTINGS`.
        robot: The robot's record.
        walk: The task's part of the record.
        way: Distance that the crank axis moved in x in this step, in m.
        slipped: Distance that all toes together slid while loaded in this step, in m.
    """
    info, total, state = walk.info, robot.accumulators, robot.state
    command = info.speed_command
    walk.command = command
    walk.covered[0] += np.sign(command) * way
    walk.covered[1] += abs(command) * period
    torque, velocity = robot.info.crank_torque, robot.info.x_velocity
    power = total.motor_work / period
    fraction = mean_fraction(period, command, walk)
    keep_accounts(velocity, slipped / period, power, torque, period, command, fraction, info)
    walk.mean_unevenness += fraction * (robot.ground_load.unevenness - walk.mean_unevenness)
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
    """Update the accounts by odometry, which does not detect slip.

    Args:
        period: Duration of the control step, in s.
        robot: The robot's record.
        walk: The task's part of the record.
        velocity: Measured mean velocity of the crank axis in x, in m/s.
        crank_error: Error of the measured mean crank speed, in rad/s, positive in the direction of
            a positive action.
    """
    torque = robot.info.crank_torque
    power = robot.accumulators.motor_work / period + torque * robot.direction * crank_error
    fraction = mean_fraction(period, walk.command, walk)
    keep_accounts(velocity, 0.0, power, torque, period, walk.command, fraction, walk.measured)


@stage
def keep_accounts(velocity, slip_speed, power, torque, period, command, fraction, kept):
    """Update the lag and the exponential means.

    Args:
        velocity: Mean velocity of the crank axis over the step, in m/s.
        slip_speed: Mean slip speed of all toes together, in m/s.
        power: Mean power of the motor, in W.
        torque: Mean torque on the crank, in N m.
        period: Duration of the step, in s.
        command: Commanded speed, in m/s.
        fraction: Fraction by which the means approach the values of this step.
        kept: Record with the fields of :data:`ACCOUNTS`, which are 0 at the beginning of an
            episode.
    """
    lag = kept.lag + (command - velocity) * period
    kept.lag = min(FURTHEST_TARGET, max(-FURTHEST_TARGET, lag))
    kept.mean_speed += fraction * (velocity - kept.mean_speed)
    kept.mean_slip += fraction * (slip_speed - kept.mean_slip)
    kept.mean_power += fraction * (abs(power) - kept.mean_power)
    square = kept.rms_torque**2
    kept.rms_torque = math.sqrt(square + fraction * (torque**2 - square))


@stage
def mean_fraction(period, command, walk):
    """Return the fraction by which an exponential mean approaches the value of a step.

    The time constant of the means is the time of a quarter turn of the crank at the commanded
    speed.

    Args:
        period: Duration of the step, in s.
        command: Commanded speed, in m/s.
        walk: The task's part of the robot's record.
    """
    return -mathematics.expm1(-period / mean_time(command, walk.mean_path))


@stage
def mean_time(command, path):
    """Return the time constant of the means, in s.

    It is the time in which the robot walks a distance at the commanded speed, clipped to the range
    from :data:`SHORTEST_MEAN` to :data:`LONGEST_MEAN`.

    Args:
        command: Commanded speed, in m/s.
        path: Distance, in m.
    """
    return min(LONGEST_MEAN, max(SHORTEST_MEAN, path / max(abs(command), 1e-9)))


@stage
def compute_reward(pitch, settings, robot, walk):
    """Compute the factors of the reward, store them in the record, and return their product.

    Args:
        pitch: Pitch of the chassis, in rad.
        settings: Record of :data:`SETTINGS`.
        robot: The robot's record.
        walk: The task's part of the record.
    """
    info, term = walk.info, walk.reward
    pace = max(abs(info.speed_command), SLOWEST)
    term.tracking = tracking(info.lag)
    term.progress = progress(info.mean_speed, info.speed_command)
    term.slip = factor(slip_cost(info.mean_slip, pace), settings.slip)
    term.energy = factor(energy_cost(info.mean_power, robot.weight, pace), settings.energy)
    term.effort = factor(effort_cost(info.rms_torque, robot.weight), settings.effort)
    term.smoothness = factor(change_cost(robot.action - robot.action_before), settings.smoothness)
    term.posture = factor(pitch_cost(pitch), settings.posture)
    unevenness = walk.mean_unevenness if settings.mean_load_cost else robot.ground_load.unevenness
    term.load = factor(load_cost(unevenness), settings.load)
    style = term.effort * term.smoothness * term.posture * term.load
    return term.tracking * term.progress * term.slip * term.energy * style


@stage
def tracking(lag):
    """Return the tracking factor, which is 1 if the lag is 0.

    The factor decreases with the magnitude of the lag towards :data:`FLOOR`, and has a slope
    everywhere else.

    Args:
        lag: Lag, in m.
    """
    return FLOOR + (1.0 - FLOOR) / (1.0 + (lag / HALF_LAG) ** 2)


@stage
def progress(mean_speed, command):
    """Return the progress factor, which is 1 from the commanded speed to twice this speed.

    Below this range, the factor is proportional to the mean speed. Above it, the factor is
    inversely proportional to the mean speed. If the command is 0, the factor falls from 1 at
    standstill to 0 at :data:`STANDING`.

    Args:
        mean_speed: Mean speed, in m/s.
        command: Commanded speed, in m/s.
    """
    if command == 0.0:
        return max(0.0, 1.0 - abs(mean_speed) / STANDING)
    ratio = mean_speed / command
    return min(1.0, max(0.0, ratio)) if ratio < CATCHING_UP else CATCHING_UP / ratio


@stage
def slip_cost(mean_slip, pace):
    """Return the cost of the distance that all toes together slide per metre.

    Args:
        mean_slip: Mean slip speed of all toes together, in m/s.
        pace: Speed by which the slip speed is divided, in m/s.
    """
    return mean_slip / pace / HALF_SLIP


@stage
def energy_cost(mean_power, weight, pace):
    """Return the cost of energy, which is proportional to the cost of transport.

    Args:
        mean_power: Mean power of the motor, in W.
        weight: Weight of the robot, in N.
        pace: Speed of the robot, in m/s.
    """
    return mean_power / (weight * pace) / HALF_ENERGY


@stage
def effort_cost(rms_torque, weight):
    """Return the cost of the RMS torque per weight.

    Args:
        rms_torque: RMS torque on the crank, in N m.
        weight: Weight of the robot, in N.
    """
    return (rms_torque / weight / HALF_EFFORT) ** 2


@stage
def change_cost(change):
    """Return the cost of a change of the action.

    Args:
        change: Change of the action since the last step.
    """
    return (change / HALF_CHANGE) ** 2


@stage
def pitch_cost(pitch):
    """Return the cost of the pitch.

    Args:
        pitch: Pitch, in rad.
    """
    return (pitch / HALF_PITCH) ** 2


@stage
def load_cost(unevenness):
    """Return the cost of an uneven load on the ground.

    Args:
        unevenness: Mean of (load - 1)^2, see :mod:`jansen_env.engine.ground_load`.
    """
    return unevenness / HALF_LOAD**2


@stage
def factor(cost, weight):
    """Return a factor of the reward, 1 / (1 + cost) to the power of ``weight``.

    Args:
        cost: Cost, at least 0.
        weight: Weight of the factor.
    """
    return 1.0 / (1.0 + cost) if weight == 1.0 else mathematics.power(1.0 + cost, -weight)


@stage
def observe_walk(command, kept, columns, out):
    """Write the command and the accounts into an observation.

    Args:
        command: Commanded speed, in m/s.
        kept: Record with the fields of :data:`ACCOUNTS`.
        columns: Columns of the command and the accounts, shape (6,); -1 if not observed.
        out: Output, the observation, shape (d,).
    """
    put(out, columns[0], command)
    put(out, columns[1], kept.lag)
    put(out, columns[2], kept.mean_speed)
    put(out, columns[3], kept.mean_slip)
    put(out, columns[4], kept.mean_power)
    put(out, columns[5], kept.rms_torque)
