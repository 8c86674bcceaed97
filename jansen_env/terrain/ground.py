"""The ground: a polyline with friction and restitution, as heights and as pymunk shapes."""

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
MOST_POINTS = 100_000  # of a ground
TALLEST = 100.0  # m, of a step or wave
STEEPEST = (1.0 + 1e-12) * tan(MAX_SLOPE)  # slopes of MAX_SLOPE are rounded
GRADIENT_STEP = 1e-4  # m, to either side
FARTHEST = 1e6  # m, largest coordinate of a point: beyond, a toe's grip drowns in rounding


def heights_of(line: Array, x: ArrayLike) -> Array:
    """Heights, m, of a polyline (n, 2) at ``x`` (any shape); it goes on beyond its ends."""
    x, first, last = np.asarray(x, float), line[1] - line[0], line[-1] - line[-2]
    before, after = np.minimum(x - line[0, 0], 0.0), np.maximum(x - line[-1, 0], 0.0)
    heights: Array = np.interp(x, *line.T)
    return heights + before * first[1] / first[0] + after * last[1] / last[0]


def check_room(start: float, reach: float, period: float) -> None:
    """Check where a ground begins and ends, and how many periods fit in between.

    Args:
        start: Distance from the origin at which the ground begins, in m.
        reach: Distance from the origin at which the ground ends, in m.
        period: Length of a period, in m.

    Raises:
        ValueError: If 0 < start < reach does not hold, or more than MOST_POINTS periods fit.
    """
    start, reach = checks.positive("start", start), checks.positive("reach", reach)
    if start >= reach:
        raise ValueError(f"start must be below reach ({reach:g}), got {start:g}")
    count = (reach - start) / period
    if count > MOST_POINTS:
        raise ValueError(
            f"start and reach leave room for {count:g} repetitions, must be at most {MOST_POINTS}"
        )


def profile(
    name: str,
    values: ArrayLike,
    start: float = START,
    reach: float = REACH,
    rng: Random | None = None,
) -> Points:
    """Return the points (x, y) of a ground, in m.

    Args:
        name: One of :data:`jansen_env.engine.ground_lines.KINDS`.
        values: Parameters of the ground, in the order of that module, shape (k,).
        start: Distance from the origin at which the ground begins, in m.
        reach: Distance from the origin at which the ground ends, in m.
        rng: Random number generator. None is possible for a ground without random numbers.
    """
    kind, given = KINDS.index(name), np.array(values, float)
    points = np.empty((count_points(kind, given, start, reach), 2))
    draws = np.empty(0) if rng is None else rng.random(count_draws(kind, given, start, reach))
    put_ground(kind, given, start, reach, draws, points)
    return tuple((x, y) for x, y in points.tolist())


def _room(name: str, value: float, face: float) -> float:
    """A tread's length, m, with room for the face of a step of height ``face``."""
    value = checks.positive(name, value)
    least = face_run(face)
    if value <= least:
        raise checks.invalid(name, value, f"above {least:.4g}, the run of a step's face")
    return value


@dataclass(frozen=True)
class Terrain:
    """A ground profile y(x), the same across the whole width of the robot.

    ``waves``, ``stairs``, ``steps``, ``stumps`` and ``ramps`` are level around x = 0, where a
    robot is placed, and mirrored or drawn on both sides of it, as commands may be negative. Their
    vertices are few: in a batch, robots exchange their terrains at resets. They begin at ``start``
    and end about at ``reach``, m from the origin on either side; the ground is level before and
    beyond. For other friction and restitution there is ``dataclasses.replace``.

    Args:
        points: at least two (x, y) vertices, m, x increasing. The first and the last segment go on
            with their slope without end (under the rigid-body plant for ``EXTENT`` metres).
        friction: Coulomb coefficient between toe and ground.
        restitution: Newton's coefficient of restitution, 0 to 1; where an impact with friction
            would gain energy by it, it bounces less.

    Raises:
        ValueError: fewer than two points, one farther than ``FARTHEST``, x not increasing, a
            slope beyond 80 degrees, or a coefficient out of range. Constructors: an argument out of
            range, or more than ``MOST_POINTS`` vertices, waves, steps, blocks or ramps.
    """

    points: tuple[tuple[float, float], ...] = ((-1.0, 0.0), (1.0, 0.0))
    friction: float = 0.8
    restitution: float = 0.0

    def __post_init__(self) -> None:
        table = _numbers("Terrain.points", self.points)
        if table.ndim != 2 or table.shape[1] != 2 or len(table) < 2:
            raise ValueError(
                f"Terrain.points has shape {table.shape}, must be at least two (x, y) pairs"
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
                f"Terrain.points: x must increase, but point {where + 1} is at "
                f"{table[where + 1, 0]} after {table[where, 0]}"
            )
        if (np.abs(step[:, 1]) > STEEPEST * step[:, 0]).any():
            steepest = float(np.abs(np.arctan2(step[:, 1], step[:, 0])).max())
            raise ValueError(
                f"Terrain.points: a segment has a slope of {steepest:.3f} rad, allowed are "
                f"{MAX_SLOPE:.3f}"
            )
        checks.set_checked(self, checks.non_negative, "friction")
        checks.set_checked(self, functools.partial(checks.within, low=0.0, high=1.0), "restitution")
        object.__setattr__(self, "points", tuple(map(tuple, table.tolist())))

    @classmethod
    def flat(cls, friction: float = 0.8, restitution: float = 0.0) -> Terrain:
        """Level ground at y = 0."""
        return cls(friction=friction, restitution=restitution)

    @classmethod
    def slope(cls, angle: float, friction: float = 0.8, restitution: float = 0.0) -> Terrain:
        """A constant slope through the origin, rising towards +x for ``angle`` > 0 (rad)."""
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
        """Random vertices from ``start`` on, level before: heights uniform in +- ``height``, m."""
        checks.instance("rng", rng, np.random.Generator)
        height = checks.within("height", height, 0.0, FARTHEST)
        spacing, length = checks.positive("spacing", spacing), checks.positive("length", length)
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
        """Cosine waves on both sides of the origin, of eight segments each.

        Args:
            height: m, from trough to crest; below 0 they begin with a trough. length: of a wave, m.
            reach: m, within which they end, with the last that has room.
        """
        height = checks.within("height", height, -TALLEST, TALLEST)
        length = checks.positive("length", length)
        check_room(start, reach, length)
        return cls(profile("waves", (height, length), start, reach))

    @classmethod
    def stairs(
        cls, rise: float = 0.03, tread: float = 0.4, start: float = START, reach: float = REACH
    ) -> Terrain:
        """Stairs that rise towards +x for ``rise`` > 0, with a landing around the origin.

        The faces of all steps are 75 degrees steep, as x must increase: see ``docs/terrain.md``.

        Args:
            rise: m, of each step. tread: m, from step to step.
            start: m, half the landing but for half a tread.
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
        """Level pieces of random heights and lengths, with steps between them.

        Args:
            rng: the generator that they are drawn from.
            height: m; the pieces' are uniform in +- height / 2, so that no step is higher.
            spacing: m, the mean length of a piece; lengths are uniform in 0.5 to 1.5 times that.
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
        """Blocks on level ground on both sides of the origin, or ditches for ``height`` < 0.

        Args:
            height, width: m, of a block. spacing: m, from one to the next.
            start: m, half a gap before the first block.
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
        """Ramps up and down with level pieces between them, on both sides of the origin.

        Args:
            angle: rad; below 0 they go down first. length: m in x, of a ramp and a level piece.
        """
        angle = checks.within("angle", angle, -MAX_SLOPE, MAX_SLOPE)
        length = checks.positive("length", length)
        check_room(start, reach, 4.0 * length)
        return cls(profile("ramps", (angle, length), start, reach))

    @functools.cached_property
    def _extended(self) -> tuple[Array, float]:
        """The points with both ends extended, and the largest slope.

        They are computed at the first use, so that an import of the package, which makes grounds,
        needs no kernel.
        """
        points = np.array(self.points)
        line = np.empty_like(points)
        steepest: float = put_line(points, line)
        line.setflags(write=False)
        return line, steepest

    @property
    def polyline(self) -> Array:
        """(n, 2) surface vertices with both ends extended, m."""
        return self._extended[0]

    @property
    def steepest(self) -> float:
        """The largest |dy/dx| of all segments."""
        return self._extended[1]

    def height(self, x: ArrayLike) -> Array:
        """Surface height at ``x`` (any shape), m."""
        return heights_of(self.polyline, x)

    def gradient(self, x: ArrayLike) -> Array:
        """Slope dy/dx at ``x`` (any shape); at a vertex the mean of both sides'."""
        x = np.asarray(x, float)
        rise: Array = self.height(x + GRADIENT_STEP) - self.height(x - GRADIENT_STEP)
        return rise / (2.0 * GRADIENT_STEP)

    def add_to(self, space: pymunk.Space) -> list[pymunk.Shape]:
        """Add the ground to a pymunk space as segments on a new static body; return them in order.

        The segments know their neighbours, so that no toe trips at a joint between them.
        """
        ground = pymunk.Body(body_type=pymunk.Body.STATIC)
        points = self.polyline.tolist()
        segments: list[pymunk.Shape] = []
        for i, (a, b) in enumerate(pairwise(points)):
            segment = pymunk.Segment(ground, a, b, 0.0)
            segment.set_neighbors(points[max(i - 1, 0)], points[min(i + 2, len(points) - 1)])
            segment.friction, segment.elasticity = self.friction, self.restitution
            segments.append(segment)
        space.add(ground, *segments)
        return segments


def one_step(at: float, height: float) -> Terrain:
    """Return level ground with a step up, m, at ``at``, m, as one comes from the origin."""
    half = 0.5 * face_run(height)
    face = [(abs(at) - half, 0.0), (abs(at) + half, height)]
    points = (-1.0, 0.0), *face, (abs(at) + half + 1.0, height)
    return Terrain(points if at > 0.0 else tuple((-x, y) for x, y in reversed(points)))


def _numbers(name: str, value: object) -> Array:
    """An array of floats from numbers nested in any way."""
    try:
        table = np.array(value)
        if table.dtype.kind not in "iufO":  # text and flags are no numbers
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
    """Return a terrain from a user's argument.

    ``friction`` and ``restitution`` replace the terrain's own where given. Raises ValueError for
    anything but :data:`jansen_env.terrain.ground.ALLOWED`.
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
