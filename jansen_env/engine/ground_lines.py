"""Ground profiles as points: waves, stairs, ramps and others, fixed or drawn at random.

A kind of ground has a number, its place in :data:`KINDS`, and parameters (k,) in the order that
:data:`jansen_env.terrain.generators.LEVELS` names them. All but slopes are level around x = 0,
begin at ``start`` and end about at ``reach``, m from the origin on either side, and are level
beyond.
"""

from __future__ import annotations

import math

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import Bools1, Floats1, Floats2, kernel, stage

KINDS = ("slope", "rough", "waves", "stairs", "steps", "stumps", "ramps")
SLOPE, ROUGH, WAVES, STAIRS, STEPS, STUMPS, RAMPS = range(len(KINDS))
START = 0.6  # m, from the origin to where a ground begins: the machine's toes reach 0.55 m
REACH = 9.0  # m, to where it ends: 8 m are 10 s at 0.8 m/s, and the toes ahead
SHIFT = 0.4  # m, within which a drawn ground begins; half a turn of the crank walks 0.33 m
RISER_SLOPE = math.radians(75.0)  # of the faces of steps, as x must increase from point to point
LEAST_RUN = 1e-3  # m, of a face however low
PER_WAVE = 8  # vertices
EXTENT = 1000.0  # m, how far the first and the last segment are extended


@stage
def face_run(height):
    """How far the face of a step extends in x, m."""
    return max(abs(height) / mathematics.tan(RISER_SLOPE), LEAST_RUN)


@stage
def count_periods(start, reach, period):
    """Number of periods that have room, at least one."""
    return max(1, int((reach - start) / period))


@stage
def _period(kind, values):
    """Length after which a ground of a kind repeats itself, m."""
    if kind in (STAIRS, ROUGH, STEPS, WAVES):
        return values[1]  # tread, spacing or length
    if kind == STUMPS:
        return values[1] + (values[2] - values[1])
    return 4.0 * values[1]


@stage
def _vertices(kind, count):
    """Number of vertices on one side of the origin of so many periods."""
    if kind == ROUGH:
        return count + 2
    if kind == WAVES:
        return count * PER_WAVE + 1
    return 4 * count if kind in (STUMPS, RAMPS) else 2 * count


@kernel
def count_points(kind: int, values: Floats1, start: float, reach: float) -> int:
    """Count the points of a ground."""
    if kind == SLOPE:
        return 2
    return 2 * _vertices(kind, count_periods(start, reach, _period(kind, values))) + 2


@kernel
def count_draws(kind: int, values: Floats1, start: float, reach: float) -> int:
    """Count the random numbers of a ground that begins at ``start``."""
    if kind == SLOPE:
        return 0
    count = count_periods(start, reach, _period(kind, values))
    return 2 * count if kind == ROUGH else 4 * count if kind == STEPS else 0


@kernel
def draw_start(kind: int, draw: float) -> float:
    """Return where a ground begins by a random number from 0 to 1, m.

    The start is drawn, or the way to its first step could be learned by heart. Slopes and steps
    have none that is drawn.
    """
    return START if kind in (SLOPE, STEPS) else START + ((START + SHIFT) - START) * draw


@kernel
def has_start(kind: int) -> bool:
    """Return whether where a ground begins is drawn."""
    return kind != SLOPE and kind != STEPS


@kernel
def choose_direction(kind: int, draw: float, fixed: Bools1, values: Floats1) -> None:
    """Let a slope or stairs go up or down by a random number from 0 to 1.

    Args:
        fixed: (k,) whether each parameter stays as it is. values: (k,) changed.
    """
    if (kind in (SLOPE, STAIRS)) and draw < 0.5 and not fixed[0]:
        values[0] = -values[0]


@kernel
def put_ground(
    kind: int, values: Floats1, start: float, reach: float, draws: Floats1, points: Floats2
) -> None:
    """Put the points of a ground into (:func:`count_points`, 2), m.

    Args:
        draws: (:func:`count_draws`,) random numbers from 0 to 1, without 1.
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
    """Put vertex ``k`` of a side, 0 the right and 1 the left one, from the origin outwards."""
    middle = len(points) // 2
    if side == 0:
        points[middle + k, 0], points[middle + k, 1] = x, y
    else:
        points[middle - 1 - k, 0], points[middle - 1 - k, 1] = -x, y


@stage
def _end_side(side, points):
    """Let a side go on level."""
    last = len(points) // 2 - 1
    place = points[2 * last] if side == 0 else points[1]
    _put_point(side, last, abs(place[0]) + 1.0, place[1] + 0.0, points)


@stage
def _put_face(side, k, edge, before, height, points):
    """Put the steep face of step ``k`` about an edge: level treads lie between faces."""
    half = 0.5 * face_run(height - before)
    _put_point(side, 2 * k, edge - half, before, points)
    _put_point(side, 2 * k + 1, edge + half, height, points)


@stage(inline=False)
def _put_rough(side, values, start, count, draws, points):
    """Vertices with heights uniform in +- height, level at both ends."""
    height, spacing = values[0], values[1]
    for k in range(count + 2):
        y = 0.0
        if 0 < k <= count:
            y = -height + (height - -height) * draws[side * count + k - 1]
        _put_point(side, k, start + spacing * k, y, points)


@stage(inline=False)
def _put_waves(side, values, start, count, points):
    """Cosine waves of eight segments each."""
    for k in range(count * PER_WAVE + 1):
        turn = 2.0 * math.pi * (k % PER_WAVE) / PER_WAVE
        x = start + values[1] * (k / PER_WAVE)
        _put_point(side, k, x, values[0] * (0.5 - 0.5 * mathematics.cos(turn)), points)


@stage(inline=False)
def _put_stairs(side, values, start, count, points):
    """Stairs that rise towards +x, with a landing around the origin."""
    rise, tread = values[0], values[1]
    way = 1.0 if side == 0 else -1.0
    for k in range(count):
        edge = start + 0.5 * tread + tread * k
        before = 0.0 if k == 0 else way * (rise * k)
        _put_face(side, k, edge, before, way * (rise * (k + 1)), points)


@stage(inline=False)
def _put_steps(side, values, start, count, draws, points):
    """Level pieces of random lengths and heights."""
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
    """Blocks on level ground."""
    height, width = values[0], values[1]
    gap = values[2] - width
    for k in range(count):
        edge = start + 0.5 * gap + (width + gap) * k
        _put_face(side, 2 * k, edge, 0.0, height, points)
        _put_face(side, 2 * k + 1, edge + width, height, 0.0, points)


@stage(inline=False)
def _put_ramps(side, values, start, count, points):
    """Ramps up and down with level pieces between them."""
    rise = mathematics.tan(values[0])
    for k in range(4 * count):
        up = 1.0 if k % 4 == 1 or k % 4 == 2 else 0.0
        _put_point(side, k, start + values[1] * k, up * values[1] * rise, points)


@kernel
def put_line(points: Floats2, line: Floats2) -> float:
    """Put points (n, 2) with both ends extended into (n, 2), m; returns the largest |dy/dx|."""
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
    """Move the outer end of a segment along it."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    place = end if way > 0.0 else start
    x, y = place[0], place[1]
    out[0], out[1] = x + way * (EXTENT * dx / dx), y + way * (EXTENT * dy / dx)
