"""What each robot of the walking task observes, and what its step is worth."""

from __future__ import annotations

import math

from jansen_env.engine.collision import height_at
from jansen_env.engine.jit import compiled

FALLEN_PITCH = 1.2  # rad
TRACKING_WIDTH = 0.75  # of the command: speed error at which tracking has fallen to 1/e ...
WIDEST_TRACKING = 0.25  # m/s ... but no wider than this
NARROWEST_TRACKING = 0.002  # m/s ... nor narrower, so that a command of 0 can be tracked


@compiled
def tracking_score(speed, command):
    """Share of the tracking reward earned at ``speed`` for ``command`` (m/s), 0 to 1.

    A bell of width min(0.75 |command|, 0.25 m/s): standing still earns exp(-1 / 0.75^2) = 0.17 of
    it at slow commands and less at fast ones.
    """
    width = min(max(TRACKING_WIDTH * abs(command), NARROWEST_TRACKING), WIDEST_TRACKING)
    return math.exp(-(((speed - command) / width) ** 2))


@compiled
def observe(states, command, share, farthest, loads, surface, bounds, ground, out):
    toes = loads.shape[1]
    for r in range(len(states)):
        x, theta, psi = states[r, 0], states[r, 2], states[r, 3]
        out[r, 0], out[r, 1], out[r, 2] = math.cos(psi), math.sin(psi), states[r, 7]
        out[r, 3], out[r, 4], out[r, 5] = math.sin(theta), math.cos(theta), states[r, 6]
        out[r, 6], out[r, 7] = states[r, 4], states[r, 5]
        begin, end = bounds[ground[r]], bounds[ground[r] + 1]
        out[r, 8] = states[r, 1] - height_at(surface, begin, end, x)
        out[r, 9] = command[r]
        for j in range(toes):
            out[r, 10 + j] = loads[r, j]
        out[r, 10 + toes] = share[r]
        direction = math.copysign(1.0, command[r])
        out[r, 11 + toes] = max(0.0, farthest[r] - direction * x)


@compiled
def judge(
    states, x_before, slip, force, work, bumped, command, farthest, fallen,
    loads, weight, period, weights, reward, terms, speeds,
):  # fmt: skip
    """Work of :meth:`WalkingTask.judge`."""
    for r in range(len(states)):
        x, pitch = states[r, 0], states[r, 2]
        speed = (x - x_before[r]) / period
        falls = (bumped[r] or abs(pitch) > FALLEN_PITCH) and not fallen[r]
        fallen[r] = fallen[r] or falls
        # The mean speed onto new ground in the commanded direction; at most 0 on old ground.
        gained = speed
        if command[r] != 0.0:
            direction = math.copysign(1.0, command[r])
            new = direction * x - farthest[r]
            if new <= 0.0:
                gained = direction * min(direction * speed, 0.0)
            else:
                farthest[r] += new
                gained = direction * new / period
        slipped = 0.0
        for j in range(slip.shape[1]):
            slipped += slip[r, j]
            loads[r, j] = force[r, j, 1] / weight[r]
        power = abs(work[r]) / period
        terms[r, 0] = weights[0] * tracking_score(gained, command[r])
        terms[r, 1] = -weights[1] * (slipped / period)
        terms[r, 2] = -weights[2] * power / weight[r]
        terms[r, 3] = -weights[3] * pitch**2
        terms[r, 4] = -weights[4] if falls else 0.0
        total = 0.0
        for i in range(5):
            total += terms[r, i]
        reward[r], speeds[r] = total, speed
