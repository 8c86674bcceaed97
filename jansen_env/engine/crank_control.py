"""Control of the crank by a PID controller, equation (13) of the paper, and its parameters.

The controller follows a reference that turns at the crank speed of a commanded walking speed.
Robots without measured parameters get those of the paper's robot, scaled to their size, weight and
motor.
"""

from __future__ import annotations

import math

import numpy as np

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import Floats1, Floats2, kernel
from jansen_env.engine.sums import pairwise_sum

SHORTEST_LENGTH = 1e-3
"""Smallest ratio of a robot's standing height to that of the paper's robot that is used."""
SHORTEST_TURN = 0.05
"""Smallest advance per turn of the crank from which a crank speed is computed, in m."""
TORQUE, TIME, LENGTH = range(3)
"""Indices into a scale: ratios of torques, times and lengths."""
ANGLE, TARGET = range(2)
"""Indices into the memory of :func:`put_reference_errors`."""


@kernel
def put_scale(
    height: float,
    mass: float,
    torque_limit: float,
    paper_height: float,
    paper_mass: float,
    paper_gain: float,
    most_lag: float,
    out: Floats1,
) -> None:
    """Compute torques, times and lengths of a robot as multiples of those of the paper's robot.

    :func:`jansen_env.tasks.walking.tuned.scale_of` explains the scale.

    Args:
        height: Standing height of the robot, in m.
        mass: Mass of the robot's links, in kg.
        torque_limit: Torque limit of the robot's motor, in N m.
        paper_height: Standing height of the paper's robot, in m.
        paper_mass: Mass of the links of the paper's robot, in kg.
        paper_gain: Proportional gain of the paper, in N m/rad.
        most_lag: Lag of the crank at which the scaled gain commands at most the torque limit, in
            rad.
        out: Output, ratios of torques, times and lengths, shape (3,).
    """
    length = max(height / paper_height, SHORTEST_LENGTH)
    out[TORQUE] = min(mass / paper_mass * length, torque_limit / (paper_gain * most_lag))
    out[TIME] = math.sqrt(length)
    out[LENGTH] = length


@kernel
def put_scaled_gains(gains: Floats1, scale: Floats1, out: Floats1) -> None:
    """Scale the gains of a PID controller to a robot.

    Args:
        gains: Proportional gain in N m/rad, integral gain in N m/(rad s), and derivative gain in
            N m s/rad, of the paper's robot, shape (3,).
        scale: Scale of the robot, see :func:`put_scale`, shape (3,).
        out: Output, gains of the robot, shape (3,).
    """
    out[0] = gains[0] * scale[TORQUE]
    out[1] = gains[1] * scale[TORQUE] / scale[TIME]
    out[2] = gains[2] * scale[TORQUE] * scale[TIME]


@kernel
def put_rolling_speeds(advance: float, commands: Floats1, out: Floats1) -> None:
    """Compute the crank speeds at which a robot that does not slip walks at commanded speeds.

    Args:
        advance: Distance that the robot advances per turn of the crank, in m.
        commands: Commanded speeds, in m/s, shape (n,).
        out: Output, crank speeds in rad/s, shape (n,).
    """
    turn = max(abs(advance), SHORTEST_TURN)
    for i in range(len(commands)):
        out[i] = 2.0 * math.pi / turn * commands[i]


@kernel
def put_nearest_settings(
    settings: Floats1, speeds: Floats2, commands: Floats1, work: Floats1, out: Floats1
) -> None:
    """Select the measured setting whose episodes have the speeds nearest to each command.

    A negative command turns the crank backwards, because the robot is its own mirror image.

    Args:
        settings: Measured settings, shape (m,).
        speeds: Speeds of the episodes with each setting, in m/s, shape (m, episodes).
        commands: Commanded speeds, in m/s, shape (n,).
        work: Work space, shape (episodes,).
        out: Output, the settings with the signs of the commands, shape (n,).
    """
    for i in range(len(commands)):
        best, least = 0, math.inf
        for k in range(len(settings)):
            for j in range(len(work)):
                work[j] = abs(speeds[k, j] - abs(commands[i]))
            error = pairwise_sum(work) / len(work)
            if error < least:
                best, least = k, error
        out[i] = np.sign(commands[i]) * settings[best]


@kernel
def put_reference_errors(
    angles: Floats1,
    rates: Floats1,
    speeds: Floats1,
    period: float,
    memory: Floats2,
    errors: Floats1,
    error_rates: Floats1,
) -> None:
    """Compare cranks with references that turn at given speeds, and move the references on.

    Args:
        angles: Observed crank angles, in rad, wrapped to one turn, shape (n,).
        rates: Observed crank speeds, in rad/s, shape (n,).
        speeds: Speeds of the references, in rad/s, shape (n,).
        period: Duration of a control step, in s.
        memory: Crank angle in the last control step and angle of the reference, both in rad and not
            wrapped to one turn, shape (n, 2); changed in place.
        errors: Output, reference minus crank angle, in rad, shape (n,).
        error_rates: Output, rates of these errors, in rad/s, shape (n,).
    """
    turn = 2.0 * math.pi
    for i in range(len(angles)):
        last, target = memory[i, ANGLE], memory[i, TARGET]
        angle = last + (mathematics.modulo(angles[i] - last + math.pi, turn) - math.pi)
        errors[i] = target - angle
        error_rates[i] = speeds[i] - rates[i]
        memory[i, ANGLE], memory[i, TARGET] = angle, target + speeds[i] * period


@kernel
def put_pid_torques(
    gains: Floats1,
    errors: Floats1,
    error_rates: Floats1,
    period: float,
    limit: float,
    integrals: Floats1,
    torques: Floats1,
) -> None:
    """Compute the torques of a PID controller, which are not clipped.

    Args:
        gains: Gains of the controller, see :func:`put_scaled_gains`, shape (3,).
        errors: Errors of the crank angles, in rad, shape (n,).
        error_rates: Rates of the errors, in rad/s, shape (n,).
        period: Duration of a control step, in s.
        limit: Torque limit, in N m. An integral keeps its value where the torque reaches this
            limit (conditional integration, which prevents wind-up).
        integrals: Sums of the errors times the period, in rad s, shape (n,), changed in place.
        torques: Output, in N m, shape (n,).
    """
    for i in range(len(errors)):
        summed = integrals[i] + errors[i] * period
        torques[i] = gains[0] * errors[i] + gains[1] * summed + gains[2] * error_rates[i]
        if abs(torques[i]) < limit:
            integrals[i] = summed
