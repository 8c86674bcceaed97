"""Noise of a robot's sensors.

:class:`jansen_env.world.observations.Noise` documents the noise.
"""

from __future__ import annotations

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import stage
from jansen_env.engine.random import SENSOR_STREAM, normal, number

BIAS = 0  # number of the stream's key for the biases; the following keys are those of the steps


@stage
def sample_errors(robot, deviation, speeds, is_new, bias, error):
    """Sample the errors of a robot's readings in this step.

    The errors depend only on the seed and the step, so sampling them again gives the same errors.
    The error of a mean speed over the step is the sum of the error of the reading and of a second
    error with the same standard deviation.

    Args:
        robot: The robot's record.
        deviation: Standard deviations, shape (d, 2): of the noise of each step, and of the bias
            that is constant during the episode. The standard deviation of an angle, in rad, is in
            the row of its sine or cosine, whichever comes first.
        speeds: Columns of the velocity in x and of the crank speed, shape (2,); -1 for none.
        is_new: Whether ``bias`` belongs to another episode and must be sampled again.
        bias: Biases, shape (d,). They are stored between steps, because sampling them takes as long
            as sampling the noise of a step.
        error: Output, errors of the readings, shape (d,).

    Returns:
        The errors of the mean velocity in m/s and of the mean crank speed in rad/s.
    """
    size, level = len(deviation), robot.parameters.noise_level
    stream = number(robot.seed, SENSOR_STREAM)
    if is_new:
        key = number(stream, BIAS)
        for i in range(size):
            bias[i] = deviation[i, 1] * normal(key, i)
    step = number(stream, BIAS + 1 + robot.elapsed)
    for i in range(size):
        if deviation[i, 0] != 0.0 or deviation[i, 1] != 0.0:
            error[i] = level * (deviation[i, 0] * normal(step, i) + bias[i])
    velocity_error = crank_error = 0.0
    if speeds[0] >= 0:
        more = level * deviation[speeds[0], 0] * normal(step, size)
        velocity_error = error[speeds[0]] + more
    if speeds[1] >= 0:
        more = level * deviation[speeds[1], 0] * normal(step, size + 1)
        crank_error = error[speeds[1]] + more
    return velocity_error, crank_error


@stage
def add_errors(error, angles, low, high, out):
    """Add the errors of the sensors to an observation.

    Args:
        error: Errors, shape (d,), see :func:`sample_errors`.
        angles: Columns of the cosine and the sine of the angle whose error is in this row, shape
            (d, 2); -1 if the error is not that of an angle.
        low: Lower limits of the observation, shape (d,).
        high: Upper limits of the observation, shape (d,).
        out: The observation, shape (d,), changed in place.
    """
    for i in range(len(out)):
        if error[i] == 0.0:
            continue
        if angles[i, 0] >= 0:
            _turn(out, angles[i, 0], angles[i, 1], error[i], low, high)
        else:
            out[i] = _within(float(out[i]) + error[i], low[i], high[i])


@stage
def _turn(out, cos, sin, angle, low, high):
    """Add to the angle whose cosine and sine are in two columns of an observation.

    Args:
        out: The observation, changed in place.
        cos: Column of the cosine.
        sin: Column of the sine.
        angle: Angle to add, in rad.
        low: Lower limits of the observation.
        high: Upper limits of the observation.
    """
    x, y = float(out[cos]), float(out[sin])
    c, s = mathematics.cos(angle), mathematics.sin(angle)
    out[cos] = _within(x * c - y * s, low[cos], high[cos])
    out[sin] = _within(y * c + x * s, low[sin], high[sin])


@stage
def _within(value, low, high):
    """Clip ``value`` to the range from ``low`` to ``high``."""
    return min(float(high), max(float(low), value))
