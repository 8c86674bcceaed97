"""Points of the terrains that :class:`jansen_env.terrain.Terrain` makes by name.

All are level around x = 0, where a robot is placed, and mirrored or drawn on both sides of it, as
commands may be negative. Vertices are few: in a batch, robots exchange their terrains at resets.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import finite, instance, positive, within
from jansen_env.engine.mathematics import cos, tan
from jansen_env.uniform import uniform

Array = NDArray[np.float64]
Random: TypeAlias = np.random.Generator

START = 0.6  # m, from the origin to where a ground begins: the machine's toes reach 0.55 m
REACH = 9.0  # m, to where it ends: 8 m are 10 s at 0.8 m/s, and the toes ahead
MAX_SLOPE = math.radians(80.0)
RISER_SLOPE = math.radians(75.0)  # of the faces of steps, as x must increase from point to point
LEAST_RUN = 1e-3  # m, of a face however low
PER_WAVE = 8  # vertices
MOST_POINTS = 100_000  # of a ground
TALLEST = 100.0  # m, of a step or wave


def level_ends(start: float, reach: float) -> tuple[float, float]:
    """Checked: 0 < start < reach. Raises ValueError."""
    start, reach = positive("start", start), positive("reach", reach)
    if start >= reach:
        raise ValueError(f"start is {start:g}, must be below reach, {reach:g}")
    return start, reach


def periods(start: float, reach: float, period: float) -> int:
    """Return the number of periods that have room, at least one; ValueError beyond MOST_POINTS."""
    count = (reach - start) / period
    if count > MOST_POINTS:
        raise ValueError(
            f"reach / (length of what is repeated) is {count:g}, must be at most {MOST_POINTS}"
        )
    return max(1, int(count))


def both_sides(right: Array, left: Array) -> Array:
    """Two half terrains, each (k, 2) points of x > 0 outwards, as one, level at its ends.

    ``left`` is mirrored to x < 0.
    """
    level = np.array([1.0, 0.0])
    left = np.concatenate([left, left[-1:] + level])[::-1] * np.array([-1.0, 1.0])
    return np.concatenate([left, right, right[-1:] + level])


def treads(edges: Array, heights: Array) -> Array:
    """Level treads with steep faces between them.

    Args:
        edges: (m,) m, increasing: the middles of the faces. heights: (m,) m, of the treads after
            them; the one before the first is at 0.

    Returns:
        (2 m, 2) points.
    """
    before = np.concatenate([[0.0], heights[:-1]])
    run = np.maximum(np.abs(heights - before) / tan(RISER_SLOPE), LEAST_RUN)
    points = np.empty((2 * len(edges), 2))
    points[0::2, 0], points[0::2, 1] = edges - 0.5 * run, before
    points[1::2, 0], points[1::2, 1] = edges + 0.5 * run, heights
    return points


def _room(name: str, value: float, face: float) -> float:
    """A tread's length, m, with room for the face of a step of height ``face``."""
    value = positive(name, value)
    least = max(abs(face) / tan(RISER_SLOPE), LEAST_RUN)
    if value <= least:
        raise ValueError(
            f"{name} is {value:g}, must be above {least:.4g}, the run of a step's face"
        )
    return value


def rough(rng: Random, height: float, spacing: float, start: float, reach: float) -> Array:
    """Vertices at a spacing on both sides, with heights uniform in +- ``height``."""
    instance("rng", rng, np.random.Generator)
    height, spacing = within("height", height, 0.0, TALLEST), positive("spacing", spacing)
    start, reach = level_ends(start, reach)
    count = periods(start, reach, spacing)
    sides = np.zeros((2, count + 2, 2))
    sides[:, :, 0] = start + spacing * np.arange(count + 2)
    sides[:, 1:-1, 1] = uniform(rng, -height, height, (2, count))
    return both_sides(sides[0], sides[1])


def waves(
    height: float = 0.03, length: float = 1.0, start: float = START, reach: float = REACH
) -> Array:
    """Cosine waves on both sides of the origin, of eight segments each.

    Args:
        height: m, from trough to crest; below 0 they begin with a trough. length: of a wave, m.
        start: m from the origin, to where the ground is level. reach: m, where they end, with
            the last that has room; level beyond.
    """
    height, length = within("height", height, -TALLEST, TALLEST), positive("length", length)
    start, reach = level_ends(start, reach)
    count = periods(start, reach, length)
    turns = np.arange(count * PER_WAVE + 1) / PER_WAVE
    wave = [0.5 - 0.5 * cos(2.0 * math.pi * k / PER_WAVE) for k in range(PER_WAVE)]
    side = np.stack([start + length * turns, height * np.resize(wave, len(turns))], axis=1)
    return both_sides(side, side)


def stairs(
    rise: float = 0.03, tread: float = 0.4, start: float = START, reach: float = REACH
) -> Array:
    """Stairs that rise towards +x for ``rise`` > 0, with a landing around the origin.

    The faces of all steps are 75 degrees steep, as x must increase: see ``docs/terrain.md``.

    Args:
        rise: m, of each step. tread: m, from step to step.
        start, reach: m, half the landing but for half a tread, and where the stairs end on
            either side; level beyond.
    """
    rise = within("rise", rise, -TALLEST, TALLEST)
    tread = _room("tread", tread, rise)
    start, reach = level_ends(start, reach)
    steps = np.arange(periods(start, reach, tread), dtype=np.float64)
    heights = rise * (steps + 1.0)
    edges = start + 0.5 * tread + tread * steps
    return both_sides(treads(edges, heights), treads(edges, -heights))


def steps(
    rng: Random,
    height: float = 0.03,
    spacing: float = 0.5,
    start: float = START,
    reach: float = REACH,
) -> Array:
    """Level pieces of random heights and lengths, with steps between them.

    Args:
        rng: the generator that they are drawn from.
        height: m; the pieces' are uniform in +- height / 2, so that no step is higher.
        spacing: m, the mean length of a piece; lengths are uniform in 0.5 to 1.5 times that.
        start, reach: m from the origin, where they begin and about where they end, on both
            sides; level before and beyond.
    """
    instance("rng", rng, np.random.Generator)
    height = within("height", height, 0.0, TALLEST)
    spacing = 2.0 * _room("spacing / 2", 0.5 * finite("spacing", spacing), height)
    start, reach = level_ends(start, reach)
    count = periods(start, reach, spacing)
    lengths = uniform(rng, 0.5 * spacing, 1.5 * spacing, (2, count))
    edges = start + np.cumsum(lengths, axis=1)
    heights = uniform(rng, -0.5 * height, 0.5 * height, (2, count))
    return both_sides(treads(edges[0], heights[0]), treads(edges[1], heights[1]))


def stumps(
    height: float = 0.03,
    width: float = 0.2,
    spacing: float = 1.0,
    start: float = START,
    reach: float = REACH,
) -> Array:
    """Blocks on level ground on both sides of the origin, or ditches for ``height`` < 0.

    Args:
        height, width: m, of a block. spacing: m, from one to the next.
        start, reach: m from the origin, where the ground begins, half a gap before the first
            block, and where it ends; level beyond.
    """
    height = within("height", height, -TALLEST, TALLEST)
    width = _room("width", width, height)
    gap = _room("spacing - width", finite("spacing", spacing) - width, height)
    start, reach = level_ends(start, reach)
    count = periods(start, reach, width + gap)
    edges = np.empty(2 * count)
    edges[0::2] = start + 0.5 * gap + (width + gap) * np.arange(count)
    edges[1::2] = edges[0::2] + width
    side = treads(edges, np.tile([height, 0.0], count))
    return both_sides(side, side)


def ramps(
    angle: float = 0.1, length: float = 0.8, start: float = START, reach: float = REACH
) -> Array:
    """Ramps up and down with level pieces between them, on both sides of the origin.

    Args:
        angle: rad; below 0 they go down first. length: m in x, of a ramp and a level piece.
        start, reach: m from the origin, where they begin and end; level beyond.
    """
    angle, length = within("angle", angle, -MAX_SLOPE, MAX_SLOPE), positive("length", length)
    start, reach = level_ends(start, reach)
    count = periods(start, reach, 4.0 * length)
    side = np.empty((4 * count, 2))
    side[:, 0] = start + length * np.arange(4 * count)
    side[:, 1] = np.tile([0.0, 1.0, 1.0, 0.0], count) * length * tan(angle)
    return both_sides(side, side)
