"""Noise of n robots' sensors; what it is is documented in :mod:`jansen_env.world.observations`."""

from __future__ import annotations

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import (
    Floats1,
    Floats2,
    Ints1,
    Ints2,
    Singles1,
    Singles2,
    kernel,
    stage,
)
from jansen_env.engine.random import normal, number
from jansen_env.engine.readings import put

STREAM = 0  # of an episode's random numbers; that of pushes is another
BIAS = 0  # of the stream's keys; the others are those of the steps


@kernel(nogil=True)
def draw_errors(
    which: Ints1, elapsed: Ints1, seeds: Ints1, level: Floats1, deviation: Floats2, speeds: Ints1,
    known: Ints1, bias: Floats2, error: Floats2, mean_error: Floats2,
) -> None:  # fmt: skip
    """Draw the errors of some robots' readings in this step, always the same for one step.

    Mean speeds over the step err by the errors of the readings and by second ones of the same size.

    Args:
        which: (k,) of the robots.
        elapsed: (n,) control steps since the episode began. seeds: (n,) of the episodes.
        level: (n,) by which noise is multiplied.
        deviation: (d, 2) standard deviations: of each step's own noise, and of the bias that stays
            for the episode. Of an angle, rad, it is at the first of its sine and cosine.
        speeds: (2,) columns of the velocity in x and of the crank's speed, -1 for none.
        known: (n,) seeds of the episodes whose biases are in ``bias`` (n, d); kept from call to
            call, as they take as long to draw as all the noise of a step.
        error: (n, d) out: of the readings. mean_error: (n, 2) out: of the means over the step, m/s
            and rad/s.
    """
    size = len(deviation)
    for r in which:
        stream = number(seeds[r], STREAM)
        if seeds[r] != known[r]:
            known[r], key = seeds[r], number(stream, BIAS)
            for i in range(size):
                bias[r, i] = deviation[i, 1] * normal(key, i)
        step = number(stream, BIAS + 1 + elapsed[r])
        for i in range(size):
            if deviation[i, 0] != 0.0 or deviation[i, 1] != 0.0:
                error[r, i] = level[r] * (deviation[i, 0] * normal(step, i) + bias[r, i])
        for k in range(2):
            i = speeds[k]
            if i < 0:
                continue
            more = level[r] * deviation[i, 0] * normal(step, size + k)
            mean_error[r, k] = error[r, i] + more


@kernel
def add_noise(
    which: Ints1, error: Floats2, angles: Ints2, measured: Floats2, columns: Ints1, low: Singles1,
    high: Singles1, truth: Singles2, out: Singles2,
) -> None:  # fmt: skip
    """Turn observations ``out`` (n, d) of some robots into what their sensors tell.

    Args:
        which: (k,) of the robots. error: (n, d) see :func:`draw_errors`.
        angles: (d, 2) columns of cosine and sine, where an angle's error stands; -1 elsewhere.
        measured: (n, m) numbers that are observed in place of the exact ones in ``columns`` (m,).
        low, high: (d,) of the observation space. truth: (n, d) out: what ``out`` was.
    """
    for r in which:
        for i in range(out.shape[1]):
            truth[r, i] = out[r, i]
        for k in range(len(columns)):
            put(out, r, columns[k], measured[r, k])
        for i in range(out.shape[1]):
            if error[r, i] == 0.0:
                continue
            if angles[i, 0] >= 0:
                _turn(out[r], angles[i, 0], angles[i, 1], error[r, i], low, high)
            else:
                out[r, i] = _within(float(out[r, i]) + error[r, i], low[i], high[i])


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
