"""Terrain as a height line with friction and restitution, and its conversion to pymunk shapes."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import pymunk
from numpy.typing import ArrayLike

from jansen_env import checks
from jansen_env.arrays import Array
from jansen_env.engine.ground_lines import (
    KINDS,
    REACH,
    START,
    count_draws,
    count_points,
    face_run,
    put_ground,
    put_line,
)
from jansen_env.engine.mathematics import tan
from jansen_env.uniform import uniform

Random: TypeAlias = np.random.Generator
Points: TypeAlias = tuple[tuple[float, float], ...]

MAX_SLOPE = math.radians(80.0)
MOST_POINTS = 100_000  # largest number of points of a terrain
TALLEST = 100.0  # largest height of a step or wave, in m
STEEPEST = (1.0 + 1e-12) * tan(MAX_SLOPE)  # largest dy/dx, with a margin for rounding
GRADIENT_STEP = 1e-4  # step to either side in a difference quotient, in m
FARTHEST = 1e6  # largest coordinate, in m; beyond it, rounding errors disturb the contacts


def heights_of(line: Array, x: ArrayLike) -> Array:
    """Return the heights of a polyline, which continues with its slope beyond its ends.

    Args:
        line: Points of the polyline, in m, shape (n, 2).
        x: Horizontal positions, in m, any shape.

    Returns:
        Heights in m, in the shape of ``x``.
    """
    x = np.asarray(x, float)
    first = line[1] - line[0]
    last = line[-1] - line[-2]
    before = np.minimum(x - line[0, 0], 0.0)
    after = np.maximum(x - line[-1, 0], 0.0)
    heights: Array = np.interp(x, *line.T)
    return heights + before * first[1] / first[0] + after * last[1] / last[0]


def check_room(start: float, reach: float, period: float) -> None:
    """Check where the features of a terrain begin and end, and how many periods fit in between.

    Args:
        start: Distance from the origin at which the features begin, in m.
        reach: Distance from the origin at which the features end, in m.
        period: Length of a period, in m.

    Raises:
        ValueError: If 0 < start < reach does not hold, or more than MOST_POINTS periods fit.
    """
    start = checks.positive("start", start)
    reach = checks.positive("reach", reach)
    if start >= reach:
        raise ValueError(f"start must be below reach ({reach:g}), got {start:g}")
    count = (reach - start) / period
    if count > MOST_POINTS:
        raise ValueError(
            f"start and reach must leave room for at most {MOST_POINTS} repetitions, got {count:g}"
        )


def profile(
    name: str,
    values: ArrayLike,
    start: float = START,
    reach: float = REACH,
    rng: Random | None = None,
) -> Points:
    """Return the points (x, y) of a terrain, in m.

    Args:
        name: Kind of the terrain, one of :data:`jansen_env.engine.ground_lines.KINDS`.
        values: Parameters of the terrain, in the order of that module, shape (k,).
        start: Distance from the origin at which the features begin, in m.
        reach: Distance from the origin at which the features end, in m.
        rng: Random number generator. It may be None for a terrain without random numbers.
    """
    kind = KINDS.index(name)
    given = np.array(values, float)
    points = np.empty((count_points(kind, given, start, reach), 2))
    draws = np.empty(0) if rng is None else rng.random(count_draws(kind, given, start, reach))
    put_ground(kind, given, start, reach, draws, points)
    return tuple((x, y) for x, y in points.tolist())


def _room(name: str, value: float, face: float) -> float:
    """Return the length of a tread after checking that it has room for the face of a step.

    Args:
        name: Name of the argument.
        value: Length of the tread, in m.
        face: Height of the step, in m.

    Raises:
        ValueError: If the tread is too short.
    """
    value = checks.positive(name, value)
    least = face_run(face)
    if value <= least:
        raise checks.invalid(name, value, f"above {least:.4g}, the run of a step's face")
    return value


@dataclass(frozen=True)
class Terrain:
    """A terrain with the height profile y(x), which is the same across the width of the robot.

    The terrains of ``waves``, ``stairs``, ``steps``, ``stumps`` and ``ramps`` are level around
    x = 0, where a robot is placed. Because commands may be negative, they have features on both
    sides of the origin, which are mirrored or random. The features begin at the distance ``start``
    from the origin and end near the distance ``reach``, and the terrain is level before and beyond
    them. These terrains have few vertices, because the robots of a batch get new terrains at
    resets. To change the friction or restitution of a terrain, use ``dataclasses.replace``.

    Args:
        points: At least two vertices (x, y), in m, with increasing x. The first and the last
            segment continue endlessly with their slope. In the rigid-body backend they continue for
            :data:`jansen_env.engine.ground_lines.EXTENT` metres.
        friction: Coulomb friction coefficient between toe and ground.
        restitution: Newton's coefficient of restitution, from 0 to 1. If an impact with friction
            would gain energy, the restitution of this impact is smaller.

    Raises:
        ValueError: If there are fewer than two points, a coordinate is larger than
            ``FARTHEST``, x does not increase, a slope is steeper than 80 degrees, or a
            coefficient is out of range. The class methods raise it, too, if an argument is out of
            range, or there are more than ``MOST_POINTS`` vertices, waves, steps, blocks or
            ramps.
    """

    points: tuple[tuple[float, float], ...] = ((-1.0, 0.0), (1.0, 0.0))
    friction: float = 0.8
    restitution: float = 0.0

    def __post_init__(self) -> None:
        table = _numbers("Terrain.points", self.points)
        if table.ndim != 2 or table.shape[1] != 2 or len(table) < 2:
            raise ValueError(
                f"Terrain.points must be at least two (x, y) pairs, got the shape {table.shape}"
            )
        if not (np.abs(table) <= FARTHEST).all():
            raise ValueError(
                f"Terrain.points must be within {FARTHEST:g} m of the origin, got a coordinate of "
                f"{np.abs(table).max():g} m"
            )
        step = np.diff(table, axis=0)
        if (step[:, 0] <= 0.0).any():
            where = int(np.argmax(step[:, 0] <= 0.0))
            raise ValueError(
                f"x must increase in Terrain.points, got point {where + 1} at "
                f"{table[where + 1, 0]} after {table[where, 0]}"
            )
        if (np.abs(step[:, 1]) > STEEPEST * step[:, 0]).any():
            steepest = float(np.abs(np.arctan2(step[:, 1], step[:, 0])).max())
            raise ValueError(
                f"slopes of Terrain.points must be at most {MAX_SLOPE:.3f} rad, got one of "
                f"{steepest:.3f} rad"
            )
        checks.set_checked(self, checks.non_negative, "friction")
        checks.set_checked(self, functools.partial(checks.within, low=0.0, high=1.0), "restitution")
        object.__setattr__(self, "points", tuple(map(tuple, table.tolist())))

    @classmethod
    def flat(cls, friction: float = 0.8, restitution: float = 0.0) -> Terrain:
        """Return level terrain at y = 0.

        Args:
            friction: Coulomb friction coefficient.
            restitution: Coefficient of restitution, from 0 to 1.
        """
        return cls(friction=friction, restitution=restitution)

    @classmethod
    def slope(cls, angle: float, friction: float = 0.8, restitution: float = 0.0) -> Terrain:
        """Return a constant slope through the origin.

        Args:
            angle: Angle of the slope, in rad. If it is positive, the terrain rises towards +x.
            friction: Coulomb friction coefficient.
            restitution: Coefficient of restitution, from 0 to 1.
        """
        angle = checks.within("angle", angle, -MAX_SLOPE, MAX_SLOPE)
        return cls(profile("slope", (angle,)), friction, restitution)

    @classmethod
    def rough(
        cls,
        rng: np.random.Generator,
        height: float = 0.02,
        spacing: float = 0.2,
        length: float = 40.0,
        start: float = 1.0,
    ) -> Terrain:
        """Return terrain with vertices of random heights, level before ``start``.

        Args:
            rng: Random number generator.
            height: Largest height, in m. Heights are uniform between ``-height`` and ``height``.
            spacing: Horizontal distance between vertices, in m.
            length: Length of the part with random heights, in m.
            start: Position x at which this part begins, in m.
        """
        checks.instance("rng", rng, np.random.Generator)
        height = checks.within("height", height, 0.0, FARTHEST)
        spacing = checks.positive("spacing", spacing)
        length = checks.positive("length", length)
        start = checks.finite("start", start)
        if length / spacing > MOST_POINTS:
            raise checks.invalid("length / spacing", length / spacing, f"at most {MOST_POINTS}")
        count = max(2, int(length / spacing))
        x = start + spacing * np.arange(1, count + 1)
        y = uniform(rng, -height, height, count)
        lead = [(start - 1.0, 0.0), (start, 0.0)]
        tail = [(x[-1] + spacing, 0.0), (x[-1] + spacing + 1.0, 0.0)]
        return cls(tuple(lead + list(zip(x, y, strict=True)) + tail))

    @classmethod
    def waves(
        cls, height: float = 0.03, length: float = 1.0, start: float = START, reach: float = REACH
    ) -> Terrain:
        """Return terrain with cosine waves on both sides of the origin.

        Each wave consists of eight segments.

        Args:
            height: Height from trough to crest, in m. If it is negative, the waves begin with a
                trough.
            length: Length of a wave, in m.
            start: Distance from the origin at which the waves begin, in m.
            reach: Distance from the origin within which the last complete wave ends, in m.
        """
        height = checks.within("height", height, -TALLEST, TALLEST)
        length = checks.positive("length", length)
        check_room(start, reach, length)
        return cls(profile("waves", (height, length), start, reach))

    @classmethod
    def stairs(
        cls, rise: float = 0.03, tread: float = 0.4, start: float = START, reach: float = REACH
    ) -> Terrain:
        """Return stairs with a landing around the origin.

        The faces of all steps have a slope of 75 degrees, because x must increase along them; see
        ``docs/terrain.md``.

        Args:
            rise: Height of each step, in m. If it is positive, the stairs rise towards +x.
            tread: Distance from step to step, in m.
            start: Half the length of the landing minus half a tread, in m.
            reach: Distance from the origin near which the stairs end, in m.
        """
        rise = checks.within("rise", rise, -TALLEST, TALLEST)
        tread = _room("tread", tread, rise)
        check_room(start, reach, tread)
        return cls(profile("stairs", (rise, tread), start, reach))

    @classmethod
    def steps(
        cls,
        rng: Random,
        height: float = 0.03,
        spacing: float = 0.5,
        start: float = START,
        reach: float = REACH,
    ) -> Terrain:
        """Return level pieces of random heights and lengths, with steps between them.

        Args:
            rng: Random number generator.
            height: Largest height of a step, in m. The heights of the pieces are uniform between
                ``-height / 2`` and ``height / 2``.
            spacing: Mean length of a piece, in m. The lengths are uniform between 0.5 and 1.5 times
                this value.
            start: Distance from the origin at which the first piece begins, in m.
            reach: Distance from the origin near which the pieces end, in m.
        """
        checks.instance("rng", rng, np.random.Generator)
        height = checks.within("height", height, 0.0, TALLEST)
        spacing = 2.0 * _room("spacing / 2", 0.5 * checks.finite("spacing", spacing), height)
        check_room(start, reach, spacing)
        return cls(profile("steps", (height, spacing), start, reach, rng))

    @classmethod
    def stumps(
        cls,
        height: float = 0.03,
        width: float = 0.2,
        spacing: float = 1.0,
        start: float = START,
        reach: float = REACH,
    ) -> Terrain:
        """Return level terrain with blocks or ditches on both sides of the origin.

        Args:
            height: Height of a block, in m. If it is negative, it is the depth of a ditch.
            width: Width of a block, in m.
            spacing: Distance from one block to the next, in m.
            start: Distance from the origin to half a gap before the first block, in m.
            reach: Distance from the origin near which the blocks end, in m.
        """
        height = checks.within("height", height, -TALLEST, TALLEST)
        width = _room("width", width, height)
        gap = _room("spacing - width", checks.finite("spacing", spacing) - width, height)
        check_room(start, reach, width + gap)
        return cls(profile("stumps", (height, width, spacing), start, reach))

    @classmethod
    def ramps(
        cls, angle: float = 0.1, length: float = 0.8, start: float = START, reach: float = REACH
    ) -> Terrain:
        """Return ramps up and down with level pieces between them, on both sides of the origin.

        Args:
            angle: Angle of the ramps, in rad. If it is negative, the first ramp goes down.
            length: Horizontal length of each ramp and of each level piece, in m.
            start: Distance from the origin at which the ramps begin, in m.
            reach: Distance from the origin near which the ramps end, in m.
        """
        angle = checks.within("angle", angle, -MAX_SLOPE, MAX_SLOPE)
        length = checks.positive("length", length)
        check_room(start, reach, 4.0 * length)
        return cls(profile("ramps", (angle, length), start, reach))

    @functools.cached_property
    def _extended(self) -> tuple[Array, float]:
        """Points with both ends extended, and the largest slope.

        They are computed at the first use. The import of the package, which creates terrains,
        therefore needs no kernel.
        """
        points = np.array(self.points)
        line = np.empty_like(points)
        steepest: float = put_line(points, line)
        line.setflags(write=False)
        return line, steepest

    @property
    def polyline(self) -> Array:
        """Vertices of the surface with both ends extended, in m, shape (n, 2)."""
        return self._extended[0]

    @property
    def steepest(self) -> float:
        """Largest |dy/dx| of all segments."""
        return self._extended[1]

    def height(self, x: ArrayLike) -> Array:
        """Return the height of the surface in m at positions ``x`` in m, of any shape."""
        return heights_of(self.polyline, x)

    def gradient(self, x: ArrayLike) -> Array:
        """Return the slope dy/dx at positions ``x`` in m, of any shape.

        At a vertex it is the mean of the slopes on both sides.
        """
        x = np.asarray(x, float)
        rise: Array = self.height(x + GRADIENT_STEP) - self.height(x - GRADIENT_STEP)
        return rise / (2.0 * GRADIENT_STEP)

    def add_to(self, space: pymunk.Space) -> list[pymunk.Shape]:
        """Add the terrain to a pymunk space as segments on a new static body.

        The segments have references to their neighbours, so that no toe trips where two segments
        meet.

        Returns:
            The segments, in their order.
        """
        ground = pymunk.Body(body_type=pymunk.Body.STATIC)
        points = self.polyline.tolist()
        segments: list[pymunk.Shape] = []
        for i, (a, b) in enumerate(pairwise(points)):
            segment = pymunk.Segment(ground, a, b, 0.0)
            segment.set_neighbors(points[max(i - 1, 0)], points[min(i + 2, len(points) - 1)])
            segment.friction = self.friction
            segment.elasticity = self.restitution
            segments.append(segment)
        space.add(ground, *segments)
        return segments


def one_step(at: float, height: float) -> Terrain:
    """Return level terrain with a single step, seen from the origin.

    Args:
        at: Position x of the step, in m. It may be negative.
        height: Height of the step, in m. If it is positive, a robot that comes from the origin
            climbs it.
    """
    half = 0.5 * face_run(height)
    face = [(abs(at) - half, 0.0), (abs(at) + half, height)]
    points = (-1.0, 0.0), *face, (abs(at) + half + 1.0, height)
    return Terrain(points if at > 0.0 else tuple((-x, y) for x, y in reversed(points)))


def _numbers(name: str, value: object) -> Array:
    """Return numbers in nested sequences as an array of floats.

    Raises:
        ValueError: If an entry is not a number, or the sequences do not form an array.
    """
    try:
        table = np.array(value)
        if table.dtype.kind not in "iufO":  # texts and bools do not count as numbers
            raise TypeError
        return table.astype(float)
    except (TypeError, ValueError, OverflowError):
        raise checks.invalid(name, value, "at least two (x, y) pairs of numbers") from None


ALLOWED = (
    "a Terrain, 'flat', 'slope:ANGLE' with an angle in rad, (x, y) points, a pymunk.Space, or a "
    "list of static pymunk shapes"
)


def make_terrain(
    terrain: Terrain | str | Sequence[Sequence[float]],
    friction: float | None = None,
    restitution: float | None = None,
) -> Terrain:
    """Return the terrain that a user's argument describes.

    Args:
        terrain: A terrain, ``"flat"``, ``"slope:ANGLE"`` with an angle in rad, or points (x, y) in
            m.
        friction: Coulomb friction coefficient that replaces that of the terrain. None keeps the
            latter.
        restitution: Coefficient of restitution that replaces that of the terrain. None keeps the
            latter.

    Raises:
        ValueError: If ``terrain`` is something else, or a coefficient is out of range. The message
            lists the allowed values.
    """
    if isinstance(terrain, Terrain):
        made = terrain
    elif isinstance(terrain, str):
        name, _, number = terrain.partition(":")
        if name not in ("flat", "slope") or (name == "flat" and number):
            raise checks.invalid("terrain", terrain, ALLOWED)
        try:
            made = Terrain.flat() if name == "flat" else Terrain.slope(float(number))
        except ValueError as error:
            reason = checks.one_line(error)
            raise checks.invalid("terrain", terrain, f"{ALLOWED}: {reason}") from error
    else:
        made = Terrain(checks.entries("terrain", terrain, ALLOWED))
    friction = made.friction if friction is None else friction
    return Terrain(made.points, friction, made.restitution if restitution is None else restitution)
