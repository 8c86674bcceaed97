"""Ground profiles as points: waves, stairs, ramps and others, user-specified or random.

Each kind of ground has a number, its index in :data:`KINDS`, and parameters, shape (k,), in the
order of :data:`jansen_env.terrain.generators.LEVELS`. Every ground except a slope is level around x
= 0. It begins at ``start`` and ends near ``reach``, which are distances from the origin in m and
the same on both sides. Beyond its end, it is level.
"""

from __future__ import annotations

import math

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import Bools1, Floats1, Floats2, kernel, stage

KINDS = ("slope", "rough", "waves", "stairs", "steps", "stumps", "ramps")
SLOPE, ROUGH, WAVES, STAIRS, STEPS, STUMPS, RAMPS = range(len(KINDS))
START = 0.6
"""Distance from the origin at which a ground begins, in m; the toes reach 0.55 m."""
REACH = 9.0
"""Distance from the origin at which a ground ends, in m.

This is sufficient for 10 s at 0.8 m/s, plus the reach of the toes.
"""
SHIFT = 0.4
"""Range of a random start, in m; the robot walks 0.33 m in half a turn of the crank."""
RISER_SLOPE = math.radians(75.0)
"""Slope of the face of a step, in rad; it is below 90 degrees, because x must increase."""
LEAST_RUN = 1e-3
"""Smallest horizontal length of the face of a step, in m."""
PER_WAVE = 8
"""Number of vertices per wave."""
EXTENT = 1000.0
"""Horizontal distance by which the first and the last segment are extended, in m."""


@stage
def face_run(height):
    """Return the horizontal length of the face of a step, in m.

    Args:
        height: Height of the step, in m.
    """
    return max(abs(height) / mathematics.tan(RISER_SLOPE), LEAST_RUN)


@stage
def count_periods(start, reach, period):
    """Return the number of periods that fit between ``start`` and ``reach``, at least one.

    Args:
        start: Distance from the origin at which the ground begins, in m.
        reach: Distance from the origin at which the ground ends, in m.
        period: Length of a period, in m.
    """
    return max(1, int((reach - start) / period))


@stage
def _period(kind, values):
    """Return the length of one period of a ground, in m."""
    if kind in (STAIRS, ROUGH, STEPS, WAVES):
        return values[1]  # tread, spacing or length
    if kind == STUMPS:
        # This is values[2], rounded as in the positions of the blocks: a width plus a gap.
        return values[1] + (values[2] - values[1])
    return 4.0 * values[1]


@stage
def _vertices(kind, count):
    """Return the number of vertices on one side of the origin for ``count`` periods."""
    if kind == ROUGH:
        return count + 2
    if kind == WAVES:
        return count * PER_WAVE + 1
    return 4 * count if kind in (STUMPS, RAMPS) else 2 * count


@kernel
def count_points(kind: int, values: Floats1, start: float, reach: float) -> int:
    """Return the number of points of a ground.

    Args:
        kind: Number of the kind of ground.
        values: Parameters of the ground, shape (k,).
        start: Distance from the origin at which the ground begins, in m.
        reach: Distance from the origin at which the ground ends, in m.
    """
    if kind == SLOPE:
        return 2
    return 2 * _vertices(kind, count_periods(start, reach, _period(kind, values))) + 2


@kernel
def count_draws(kind: int, values: Floats1, start: float, reach: float) -> int:
    """Return the number of random numbers that generate a ground.

    Args:
        kind: Number of the kind of ground.
        values: Parameters of the ground, shape (k,).
        start: Distance from the origin at which the ground begins, in m.
        reach: Distance from the origin at which the ground ends, in m.
    """
    if kind == SLOPE:
        return 0
    count = count_periods(start, reach, _period(kind, values))
    return 2 * count if kind == ROUGH else 4 * count if kind == STEPS else 0


@kernel
def draw_start(kind: int, draw: float) -> float:
    """Return the distance from the origin at which a ground begins, in m.

    The distance is random, because otherwise a policy could memorise the way to the first obstacle.
    Slopes and steps always begin at :data:`START`.

    Args:
        kind: Number of the kind of ground.
        draw: Random number from 0 to 1.
    """
    return START if kind in (SLOPE, STEPS) else START + ((START + SHIFT) - START) * draw


@kernel
def has_start(kind: int) -> bool:
    """Return whether a kind of ground begins at a random distance, see :func:`draw_start`.

    Args:
        kind: Number of the kind of ground.
    """
    return kind != SLOPE and kind != STEPS


@kernel
def choose_direction(kind: int, draw: float, fixed: Bools1, values: Floats1) -> None:
    """Choose whether a slope or stairs go up or down.

    Args:
        kind: Number of the kind of ground.
        draw: Random number from 0 to 1. Below 0.5, the direction is reversed.
        fixed: Whether each parameter must keep its value, shape (k,).
        values: Parameters, changed in place, shape (k,).
    """
    if (kind in (SLOPE, STAIRS)) and draw < 0.5 and not fixed[0]:
        values[0] = -values[0]


@kernel
def put_ground(
    kind: int, values: Floats1, start: float, reach: float, draws: Floats1, points: Floats2
) -> None:
    """Compute the points of a ground.

    Args:
        kind: Number of the kind of ground.
        values: Parameters of the ground, shape (k,).
        start: Distance from the origin at which the ground begins, in m.
        reach: Distance from the origin at which the ground ends, in m.
        draws: Random numbers from 0 to 1, excluding 1, shape (:func:`count_draws`,).
        points: Output, in m, shape (:func:`count_points`, 2).
    """
    if kind == SLOPE:
        rise = mathematics.tan(values[0])
        points[0, 0], points[0, 1], points[1, 0], points[1, 1] = -1.0, -rise, 1.0, rise
        return
    count = count_periods(start, reach, _period(kind, values))
    for side in range(2):
        if kind == ROUGH:
            _put_rough(side, values, start, count, draws, points)
        elif kind == WAVES:
            _put_waves(side, values, start, count, points)
        elif kind == STAIRS:
            _put_stairs(side, values, start, count, points)
        elif kind == STEPS:
            _put_steps(side, values, start, count, draws, points)
        elif kind == STUMPS:
            _put_stumps(side, values, start, count, points)
        else:
            _put_ramps(side, values, start, count, points)
        _end_side(side, points)


@stage
def _put_point(side, k, x, y, points):
    """Store vertex ``k`` of a side; vertices are counted from the origin outwards.

    ``side`` is 0 for the right side and 1 for the left side.
    """
    middle = len(points) // 2
    if side == 0:
        points[middle + k, 0], points[middle + k, 1] = x, y
    else:
        points[middle - 1 - k, 0], points[middle - 1 - k, 1] = -x, y


@stage
def _end_side(side, points):
    """Add the last point of a side, up to which it continues level."""
    last = len(points) // 2 - 1
    place = points[2 * last] if side == 0 else points[1]
    _put_point(side, last, abs(place[0]) + 1.0, place[1] + 0.0, points)


@stage
def _put_face(side, k, edge, before, height, points):
    """Add the steep face of step ``k`` at an edge; level treads lie between the faces."""
    half = 0.5 * face_run(height - before)
    _put_point(side, 2 * k, edge - half, before, points)
    _put_point(side, 2 * k + 1, edge + half, height, points)


@stage(inline=False)
def _put_rough(side, values, start, count, draws, points):
    """Add vertices with heights uniform between -height and height, level at both ends."""
    height, spacing = values[0], values[1]
    for k in range(count + 2):
        y = 0.0
        if 0 < k <= count:
            y = -height + (height - -height) * draws[side * count + k - 1]
        _put_point(side, k, start + spacing * k, y, points)


@stage(inline=False)
def _put_waves(side, values, start, count, points):
    """Add cosine waves of eight segments each."""
    for k in range(count * PER_WAVE + 1):
        turn = 2.0 * math.pi * (k % PER_WAVE) / PER_WAVE
        x = start + values[1] * (k / PER_WAVE)
        _put_point(side, k, x, values[0] * (0.5 - 0.5 * mathematics.cos(turn)), points)


@stage(inline=False)
def _put_stairs(side, values, start, count, points):
    """Add stairs that rise towards +x, with a landing around the origin."""
    rise, tread = values[0], values[1]
    way = 1.0 if side == 0 else -1.0
    for k in range(count):
        edge = start + 0.5 * tread + tread * k
        before = 0.0 if k == 0 else way * (rise * k)
        _put_face(side, k, edge, before, way * (rise * (k + 1)), points)


@stage(inline=False)
def _put_steps(side, values, start, count, draws, points):
    """Add level pieces of random lengths and heights."""
    height, spacing = values[0], values[1]
    way = before = 0.0
    for k in range(count):
        first = side * count + k
        low, high = 0.5 * spacing, 1.5 * spacing
        way += low + (high - low) * draws[first]
        low, high = -0.5 * height, 0.5 * height
        level = low + (high - low) * draws[2 * count + first]
        _put_face(side, k, start + way, before, level, points)
        before = level


@stage(inline=False)
def _put_stumps(side, values, start, count, points):
    """Add blocks on level ground."""
    height, width = values[0], values[1]
    gap = values[2] - width
    for k in range(count):
        edge = start + 0.5 * gap + (width + gap) * k
        _put_face(side, 2 * k, edge, 0.0, height, points)
        _put_face(side, 2 * k + 1, edge + width, height, 0.0, points)


@stage(inline=False)
def _put_ramps(side, values, start, count, points):
    """Add ramps up and down with level pieces between them."""
    rise = mathematics.tan(values[0])
    for k in range(4 * count):
        up = 1.0 if k % 4 == 1 or k % 4 == 2 else 0.0
        _put_point(side, k, start + values[1] * k, up * values[1] * rise, points)


@kernel
def put_line(points: Floats2, line: Floats2) -> float:
    """Copy the points of a ground, extend both ends, and return the largest |dy/dx|.

    Args:
        points: Points of the ground, in m, shape (n, 2).
        line: Output, in m, shape (n, 2).
    """
    last = len(points) - 1
    for k in range(len(points)):
        line[k, 0], line[k, 1] = points[k, 0], points[k, 1]
    _extend(points[0], points[1], -1.0, line[0])
    _extend(points[last - 1], points[last], 1.0, line[last])
    steepest = 0.0
    for k in range(last):
        slope = (line[k + 1, 1] - line[k, 1]) / (line[k + 1, 0] - line[k, 0])
        steepest = max(steepest, abs(slope))
    return steepest


@stage
def _extend(start, end, way, out):
    """Store the outer end of a segment, moved outwards along the segment."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    place = end if way > 0.0 else start
    x, y = place[0], place[1]
    out[0], out[1] = x + way * (EXTENT * dx / dx), y + way * (EXTENT * dy / dx)
