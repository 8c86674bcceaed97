"""The ground: a polyline with friction and restitution, as heights and as pymunk shapes."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar, TypeAlias

import numpy as np
import pymunk
from numpy.typing import ArrayLike, NDArray

from jansen_env.checks import entries, finite, instance, non_negative, positive, shown, within
from jansen_env.engine.mathematics import tan
from jansen_env.terrain import shapes
from jansen_env.terrain.shapes import MAX_SLOPE, MOST_POINTS
from jansen_env.uniform import uniform

Array = NDArray[np.float64]
Maker: TypeAlias = "classmethod[Terrain, ..., Terrain]"

REACH = 1000.0  # m, how far the first and last segment are extended as pymunk's shapes
STEEPEST = (1.0 + 1e-12) * tan(MAX_SLOPE)  # slopes of MAX_SLOPE are rounded
GRADIENT_STEP = 1e-4  # m, to either side
FARTHEST = 1e6  # m, largest coordinate of a point: beyond, a toe's grip drowns in rounding


def heights_of(line: Array, x: ArrayLike) -> Array:
    """Heights, m, of a polyline (n, 2) at ``x`` (any shape); it goes on beyond its ends."""
    x, first, last = np.asarray(x, float), line[1] - line[0], line[-1] - line[-2]
    before, after = np.minimum(x - line[0, 0], 0.0), np.maximum(x - line[-1, 0], 0.0)
    heights: Array = np.interp(x, *line.T)
    return heights + before * first[1] / first[0] + after * last[1] / last[0]


def _maker(points: Callable[..., Array]) -> Maker:
    """A constructor with the arguments of a function that returns points, and a terrain's own."""

    def make(
        cls: type[Terrain],
        *args: object,
        friction: float = 0.8,
        restitution: float = 0.0,
        **named: object,
    ) -> Terrain:
        return cls.of(points(*args, **named), friction, restitution)

    # For help(): the arguments of both.
    signature = inspect.signature(make)
    first, _, *more, _ = signature.parameters.values()
    all_of_them = [first, *inspect.signature(points).parameters.values(), *more]
    make.__signature__ = signature.replace(parameters=all_of_them)  # type: ignore[attr-defined]
    make.__name__, make.__doc__ = points.__name__, points.__doc__
    make.__qualname__ = f"Terrain.{points.__name__}"
    return classmethod(make)


@dataclass(frozen=True)
class Terrain:
    """A ground profile y(x), the same across the whole width of the robot.

    ``waves``, ``stairs``, ``steps``, ``stumps`` and ``ramps`` have the arguments of the functions
    of these names in ``jansen_env.terrain.shapes``, and by name a friction and a restitution.

    Args:
        points: at least two (x, y) vertices, m, x increasing. The first and the last segment go on
            with their slope without end (under the rigid-body plant for ``REACH`` metres).
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
        if not np.isfinite(table).all():
            raise ValueError("Terrain.points holds a number that is not finite")
        if np.abs(table).max() > FARTHEST:
            raise ValueError(
                f"Terrain.points: a coordinate is {np.abs(table).max():g} m, must be within "
                f"{FARTHEST:g} m of the origin"
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
        set_value = functools.partial(object.__setattr__, self)
        set_value("friction", non_negative("Terrain.friction", self.friction))
        set_value("restitution", within("Terrain.restitution", self.restitution, 0.0, 1.0))
        set_value("points", tuple(map(tuple, table.tolist())))
        before = table[0] - REACH * step[0] / step[0, 0]
        after = table[-1] + REACH * step[-1] / step[-1, 0]
        line = np.concatenate([[before], table[1:-1], [after]])
        line.setflags(write=False)
        set_value("_line", line)

    @classmethod
    def flat(cls, friction: float = 0.8, restitution: float = 0.0) -> Terrain:
        """Level ground at y = 0."""
        return cls(friction=friction, restitution=restitution)

    @classmethod
    def slope(cls, angle: float, friction: float = 0.8, restitution: float = 0.0) -> Terrain:
        """A constant slope through the origin, rising towards +x for ``angle`` > 0 (rad)."""
        angle = within("angle", angle, -MAX_SLOPE, MAX_SLOPE)
        rise = tan(angle)
        return cls(((-1.0, -rise), (1.0, rise)), friction, restitution)

    @classmethod
    def rough(
        cls,
        rng: np.random.Generator,
        height: float = 0.02,
        spacing: float = 0.2,
        length: float = 40.0,
        start: float = 1.0,
        friction: float = 0.8,
        restitution: float = 0.0,
    ) -> Terrain:
        """Random vertices from ``start`` on, level before: heights uniform in +- ``height``, m."""
        instance("rng", rng, np.random.Generator)
        height = within("height", height, 0.0, FARTHEST)
        spacing, length = positive("spacing", spacing), positive("length", length)
        start = finite("start", start)
        if length / spacing > MOST_POINTS:
            raise ValueError(
                f"length / spacing is {length / spacing:g}, must be at most {MOST_POINTS}"
            )
        count = max(2, int(length / spacing))
        x = start + spacing * np.arange(1, count + 1)
        y = uniform(rng, -height, height, count)
        lead = [(start - 1.0, 0.0), (start, 0.0)]
        tail = [(x[-1] + spacing, 0.0), (x[-1] + spacing + 1.0, 0.0)]
        return cls(tuple(lead + list(zip(x, y, strict=True)) + tail), friction, restitution)

    waves: ClassVar[Maker] = _maker(shapes.waves)
    stairs: ClassVar[Maker] = _maker(shapes.stairs)
    steps: ClassVar[Maker] = _maker(shapes.steps)
    stumps: ClassVar[Maker] = _maker(shapes.stumps)
    ramps: ClassVar[Maker] = _maker(shapes.ramps)

    @classmethod
    def of(cls, points: Any, friction: float = 0.8, restitution: float = 0.0) -> Terrain:
        """From points in any form, such as an array (n, 2), m."""
        return cls(points, friction, restitution)

    @property
    def polyline(self) -> Array:
        """(n, 2) surface vertices with both ends extended, m."""
        line: Array = self._line  # type: ignore[attr-defined]
        return line

    @property
    def steepest(self) -> float:
        """The largest |dy/dx| of all segments."""
        dx, dy = np.diff(self.polyline, axis=0).T
        return float(np.abs(dy / dx).max())

    def height(self, x: ArrayLike) -> Array:
        """Surface height at ``x`` (any shape), m."""
        return heights_of(self.polyline, x)

    def gradient(self, x: ArrayLike) -> Array:
        """Slope dy/dx at ``x`` (any shape); at a vertex the mean of both sides'."""
        x = np.asarray(x, float)
        rise: Array = self.height(x + GRADIENT_STEP) - self.height(x - GRADIENT_STEP)
        return rise / (2.0 * GRADIENT_STEP)

    def add_to(self, space: pymunk.Space) -> pymunk.Body:
        """Add the ground to a pymunk space as segments on a static body, and return it.

        They know their neighbours, so that no toe trips on a joint between them.
        """
        ground = pymunk.Body(body_type=pymunk.Body.STATIC)
        points, segments = self.polyline.tolist(), []
        for i, (a, b) in enumerate(pairwise(points)):
            segment = pymunk.Segment(ground, a, b, 0.0)
            segment.set_neighbors(points[max(i - 1, 0)], points[min(i + 2, len(points) - 1)])
            segment.friction, segment.elasticity = self.friction, self.restitution
            segments.append(segment)
        space.add(ground, *segments)
        return ground


def _numbers(name: str, value: object) -> Array:
    """An array of floats from numbers nested in any way."""
    try:
        table = np.array(value)
        if table.dtype.kind not in "iufO":  # text and flags are no numbers
            raise TypeError
        return table.astype(float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(
            f"{name} is {shown(value)}, must be at least two (x, y) pairs of numbers"
        ) from None


ALLOWED = "a Terrain, 'flat', 'slope:ANGLE' with an angle in rad, or (x, y) points"


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
            raise ValueError(f"terrain is {shown(terrain)}, must be {ALLOWED}")
        try:
            made = Terrain.flat() if name == "flat" else Terrain.slope(float(number))
        except ValueError as error:
            raise ValueError(f"terrain is {shown(terrain)}, must be {ALLOWED}: {error}") from error
    else:
        made = Terrain(entries("terrain", terrain, ALLOWED))
    return Terrain(
        made.points,
        made.friction if friction is None else friction,
        made.restitution if restitution is None else restitution,
    )
