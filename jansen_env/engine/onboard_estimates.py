"""Onboard sensors of a robot (encoder, IMU and motor current), and estimates from their readings.

The crank speed is the change of the encoder's angle over the last step. The IMU is at the crank
axis. Its pitch rate and accelerations are means over the last step. The accelerations are those
forwards and upwards along the chassis: at rest on level ground, they are 0 and 9.81 m/s^2.

The pitch is the angle to the vertical, even if gravity is tilted. The estimate integrates the gyro
and corrects the result by the direction of the measured acceleration. The estimate of the velocity
integrates the accelerometer and corrects the result by the motion of the lowest toe, which is
assumed to stand still while the robot is supported.

``agents/export/firmware.c.in`` does the same in C, so change both.
"""

from __future__ import annotations

import math

import numpy as np

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import stage
from jansen_env.engine.readings import put

STANDARD_GRAVITY = 9.81  # m/s^2
CORRECTION_TIME = 2.0  # s, time constant with which the accelerometer corrects the gyro's pitch
LEGS_TIME = 0.1  # s, time constant with which the legs correct the accelerometer's velocity
SUPPORTED = 5.0  # m/s^2, upward acceleration above which the robot is taken to be supported
SAMPLES = 128  # crank angles per turn at which the paths of the toes are known
# Indices of the estimates.
COS_PITCH, SIN_PITCH, ANGLE, SPEED, VELOCITY, RATE, FORWARDS, UPWARDS = range(8)
# Indices into ``columns``, the columns of the observation for readings and estimates.
(
    COS_ANGLE_COLUMN,
    SIN_ANGLE_COLUMN,
    SPEED_COLUMN,
    SIN_PITCH_COLUMN,
    COS_PITCH_COLUMN,
    RATE_COLUMN,
    VELOCITY_COLUMN,
    FORWARDS_COLUMN,
    UPWARDS_COLUMN,
    TORQUE_COLUMN,
) = range(10)


@stage
def begin_onboard(robot):
    """Reset the estimates at the beginning of an episode, and store the pitch and the velocity.

    Args:
        robot: The robot's record.
    """
    memory, state = robot.onboard, robot.state
    memory.is_first = True
    memory.before[0], memory.before[1], memory.before[2] = state[2], state[4], state[5]


@stage(inline=False)
def read_onboard(period, moved, robot, columns, out):
    """Write the readings of the IMU and of the motor current into an observation, without errors.

    Args:
        period: Duration of a control step, in s.
        moved: Whether the robot has just taken a step.
        robot: The robot's record.
        columns: Columns of the readings and estimates, shape (10,); -1 for one not observed.
        out: Output, the observation, shape (d,).
    """
    memory, state = robot.onboard, robot.state
    estimates, before = memory.estimates, memory.before
    if moved or memory.is_first:
        rate = (state[2] - before[0]) / period
        x, y = (state[4] - before[1]) / period, (state[5] - before[2]) / period
        before[0], before[1], before[2] = state[2], state[4], state[5]
        weight, tilt = STANDARD_GRAVITY * robot.parameters.gravity_scale, robot.parameters.tilt
        x += weight * mathematics.sin(tilt)
        y += weight * mathematics.cos(tilt)
        cos, sin = mathematics.cos(state[2]), mathematics.sin(state[2])
        estimates[RATE] = rate
        estimates[FORWARDS] = cos * x + sin * y
        estimates[UPWARDS] = cos * y - sin * x
    put(out, columns[RATE_COLUMN], estimates[RATE])
    put(out, columns[FORWARDS_COLUMN], estimates[FORWARDS])
    put(out, columns[UPWARDS_COLUMN], estimates[UPWARDS])
    put(out, columns[TORQUE_COLUMN], robot.direction * robot.info.crank_torque)


@stage
def _toe(paths, toe, angle, cos, sin):
    """Return how far a toe is ahead of the crank axis and above it, in m.

    Args:
        paths: Positions of the toes, see :func:`estimate_onboard`.
        toe: Index of the toe.
        angle: Crank angle, in rad.
        cos: Cosine of the pitch.
        sin: Sine of the pitch.
    """
    place = angle * (SAMPLES / (2.0 * math.pi))
    place -= SAMPLES * mathematics.floor(place / SAMPLES)
    low = min(int(place), SAMPLES - 1)
    fraction = place - low
    x = float(paths[low, toe, 0]) * (1.0 - fraction) + float(paths[low + 1, toe, 0]) * fraction
    y = float(paths[low, toe, 1]) * (1.0 - fraction) + float(paths[low + 1, toe, 1]) * fraction
    return cos * x - sin * y, sin * x + cos * y


@stage(inline=False)
def estimate_onboard(period, moved, robot, paths, columns, out):
    """Estimate crank speed, pitch and velocity from readings with errors.

    Args:
        period: Duration of a control step, in s.
        moved: Whether the robot has just taken a step.
        robot: The robot's record.
        paths: Positions of the toes in the chassis frame over a turn that walks towards +x, in m,
            shape (SAMPLES + 1, toes, 2).
        columns: Columns of the readings and estimates, shape (10,).
        out: The observation, shape (d,). It contains the readings, and the estimates are written
            to it.
    """
    memory = robot.onboard
    estimates = memory.estimates
    if moved or memory.is_first:
        first = memory.is_first
        old_angle, old_cos, old_sin = estimates[ANGLE], estimates[COS_PITCH], estimates[SIN_PITCH]
        # In a compiled kernel, float() would not convert single precision to double precision.
        sine = np.float64(out[columns[SIN_ANGLE_COLUMN]])
        cosine = np.float64(out[columns[COS_ANGLE_COLUMN]])
        angle = mathematics.atan2(sine, cosine)
        turn = angle - old_angle
        turn -= 2.0 * math.pi * mathematics.nearest(turn / (2.0 * math.pi))
        rate = float(out[columns[RATE_COLUMN]])
        along = float(out[columns[FORWARDS_COLUMN]])
        across = float(out[columns[UPWARDS_COLUMN]])
        gain, pitched = 1.0 if first else period / CORRECTION_TIME, rate * period
        cos, sin = old_cos - pitched * old_sin, old_sin + pitched * old_cos
        cos += gain * (across / STANDARD_GRAVITY - cos)
        sin += gain * (along / STANDARD_GRAVITY - sin)
        length = max(math.sqrt(cos * cos + sin * sin), 1e-9)
        cos, sin = cos / length, sin / length
        lowest, by_legs = math.inf, 0.0
        for toe in range(paths.shape[1]):
            old_x, old_y = _toe(paths, toe, old_angle, old_cos, old_sin)
            x, y = _toe(paths, toe, angle, cos, sin)
            if y + old_y < lowest:
                lowest, by_legs = y + old_y, (old_x - x) / period
        velocity = estimates[VELOCITY] + period * (cos * along - sin * across)
        if sin * along + cos * across > SUPPORTED:
            velocity += period / LEGS_TIME * (by_legs - velocity)
        estimates[COS_PITCH], estimates[SIN_PITCH], estimates[ANGLE] = cos, sin, angle
        estimates[SPEED] = 0.0 if first else turn / period
        estimates[VELOCITY] = 0.0 if first else velocity
        memory.is_first = False
    put(out, columns[COS_PITCH_COLUMN], estimates[COS_PITCH])
    put(out, columns[SIN_PITCH_COLUMN], estimates[SIN_PITCH])
    put(out, columns[SPEED_COLUMN], estimates[SPEED])
    put(out, columns[VELOCITY_COLUMN], estimates[VELOCITY])
