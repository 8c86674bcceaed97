"""Noise of n robots' sensors; what it is is documented in :mod:`jansen_env.noise`."""

from __future__ import annotations

import math

from jansen_env.engine.jit import compiled
from jansen_env.engine.random import normal, number

STREAM = 0  # of an episode's random numbers; that of pushes is another
BIAS = 0  # of the stream's keys; the others are those of the steps

# Places in the observation, see JansenWalkerEnv: of what is an angle.
COS_CRANK, SIN_CRANK = 0, 1
SIN_PITCH, COS_PITCH = 3, 4


@compiled
def add_noise(which, elapsed, seeds, level, deviation, low, high, known, bias, truth, out):
    """Add noise to observations ``out`` (n, d) of some robots; what they were, to ``truth`` (n, d).

    The noise of a robot's step is always the same, however often its observation is described.

    Args:
        which: (k,) of the robots.
        elapsed: (n,) control steps since the episode began. seeds: (n,) of the episodes.
        level: (n,) by which noise is multiplied.
        deviation: (d, 2) standard deviations: of each step's own noise, and of the bias that stays
            for the episode. Of an angle, rad, it is at the first of its sine and cosine.
        low, high: (d,) of the observation space.
        known: (n,) seeds of the episodes whose biases are in ``bias`` (n, d); kept from call to
            call, as they take as long to draw as all the noise of a step.
    """
    for r in which:
        stream = number(seeds[r], STREAM)
        if seeds[r] != known[r]:
            known[r], key = seeds[r], number(stream, BIAS)
            for i in range(out.shape[1]):
                bias[r, i] = deviation[i, 1] * normal(key, i)
        step = number(stream, BIAS + 1 + elapsed[r])
        for i in range(out.shape[1]):
            truth[r, i] = out[r, i]
        for i in range(out.shape[1]):
            if deviation[i, 0] == 0.0 and deviation[i, 1] == 0.0:
                continue
            error = level[r] * (deviation[i, 0] * normal(step, i) + bias[r, i])
            if i == COS_CRANK:
                _turn(out[r], COS_CRANK, SIN_CRANK, error, low, high)
            elif i == SIN_PITCH:
                _turn(out[r], COS_PITCH, SIN_PITCH, error, low, high)
            else:
                out[r, i] = _within(float(out[r, i]) + error, low[i], high[i])


@compiled
def _turn(out, cos, sin, angle, low, high):
    """Turn the angle whose cosine and sine are at two places of an observation."""
    x, y = float(out[cos]), float(out[sin])
    c, s = math.cos(angle), math.sin(angle)
    out[cos] = _within(x * c - y * s, low[cos], high[cos])
    out[sin] = _within(y * c + x * s, low[sin], high[sin])


@compiled
def _within(value, low, high):
    """``value``, but no less than ``low`` and no more than ``high``."""
    return min(float(high), max(float(low), value))
