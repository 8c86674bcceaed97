"""Noise of a robot's sensors; what it is is documented in :mod:`jansen_env.world.observations`."""

from __future__ import annotations

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import stage
from jansen_env.engine.random import normal, number

STREAM = 0  # of an episode's random numbers; pushes and commands have others
BIAS = 0  # of the stream's keys; the others are those of the steps


@stage
def sample_errors(robot, deviation, speeds, is_new, bias, error):
    """Sample the errors of a robot's readings in this step, always the same for one step.

    Mean speeds over the step err by the errors of the readings and by second ones of the same size.

    Args:
        robot: The robot's record.
        deviation: Shape (d, 2), standard deviations: of each step's own noise, and of the bias
            that stays for the episode. Of an angle, rad, it is at the first of its sine and cosine.
        speeds: Shape (2,), columns of the velocity in x and of the crank's speed; -1 for none.
        is_new: Whether ``bias`` is that of another episode.
        bias: Shape (d,), kept from step to step: sampling it takes as long as a step's noise.
        error: Shape (d,), gets the errors of the readings.

    Returns:
        The errors of the mean speeds over the step, m/s and rad/s.
    """
    size, level = len(deviation), robot.parameters.noise_level
    stream = number(robot.seed, STREAM)
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
    """Turn an observation ``out`` (d,) into what the sensors tell.

    Args:
        error: Shape (d,), see :func:`sample_errors`.
        angles: Shape (d, 2), columns of cosine and sine, where an angle's error stands; else -1.
        low: Shape (d,), lower limits of the observation.
        high: Shape (d,), upper limits.
        out: The observation.
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
    """Turn the angle whose cosine and sine are at two places of an observation."""
    x, y = float(out[cos]), float(out[sin])
    c, s = mathematics.cos(angle), mathematics.sin(angle)
    out[cos] = _within(x * c - y * s, low[cos], high[cos])
    out[sin] = _within(y * c + x * s, low[sin], high[sin])


@stage
def _within(value, low, high):
    """``value``, but no less than ``low`` and no more than ``high``."""
    return min(float(high), max(float(low), value))
