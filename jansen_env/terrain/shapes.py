"""The ground as pymunk's static shapes: boxes, walls, overhangs, whatever is no height line."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple, TypeAlias, cast

import numpy as np
import pymunk

from jansen_env import checks
from jansen_env.terrain.ground import FARTHEST, MOST_POINTS, Terrain, make_terrain

FRICTION = 0.8  # of shapes that have pymunk's own default of 0
LEAST_AREA = 1e-9  # m^2, of a polygon
DEPTH = 1.0  # m, by which the polygons under a height line reach below its lowest point

Point: TypeAlias = tuple[float, float]
ShapeSource: TypeAlias = pymunk.Space | Sequence[pymunk.Shape]


class Piece(NamedTuple):
    """A convex shape: the hull of some points, and everything within a radius of it.

    Attributes:
        points: World coordinates in m: one for a circle, two for a segment, three or more,
            counter-clockwise, for a polygon.
        radius: In m. A segment of radius 0 is a plate without inside; both sides carry.
    """

    points: tuple[Point, ...]
    radius: float = 0.0

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, bottom, right and top, m."""
        x, y = zip(*self.points, strict=True)
        r = self.radius
        return min(x) - r, min(y) - r, max(x) + r, max(y) + r

    def shape(self, body: pymunk.Body) -> pymunk.Shape:
        """Return a new pymunk shape of a body at the origin."""
        if len(self.points) == 1:
            return pymunk.Circle(body, self.radius, self.points[0])
        if len(self.points) == 2:
            return pymunk.Segment(body, *self.points, self.radius)
        return pymunk.Poly(body, self.points, radius=self.radius)


@dataclass(frozen=True)
class Shapes:
    """A ground of static shapes, with one friction and one restitution.

    The ground keeps copies: later changes to a user's shapes have no effect on it, and the user's
    shapes are never changed. Where shapes meet, let them overlap if pads may sink as deep as their
    radius: a pad that deep leaves a shape by its nearest side, and finds no way out by a side that
    another shape touches.

    Attributes:
        pieces: The shapes. One of them is above or below x = 0, where robots are placed.
        friction: Coulomb coefficient between toe and ground.
        restitution: Newton's coefficient of restitution, 0 to 1.

    Raises:
        ValueError: If a shape has no extent, is not convex or lies beyond
            :data:`jansen_env.terrain.ground.FARTHEST`, if there is none at x = 0, or if a
            coefficient is out of range.
    """

    pieces: tuple[Piece, ...]
    friction: float = FRICTION
    restitution: float = 0.0

    def __post_init__(self) -> None:
        if not 1 <= len(self.pieces) <= MOST_POINTS:
            raise ValueError(f"terrain must have 1 to {MOST_POINTS} shapes, got {len(self.pieces)}")
        pieces = tuple(_checked(f"terrain[{i}]", piece) for i, piece in enumerate(self.pieces))
        object.__setattr__(self, "pieces", pieces)
        checks.set_checked(self, checks.non_negative, "friction")
        checks.set_checked(self, functools.partial(checks.within, low=0.0, high=1.0), "restitution")
        if not any(piece.box[0] <= 0.0 <= piece.box[2] for piece in pieces):
            left = min(piece.box[0] for piece in pieces)
            right = max(piece.box[2] for piece in pieces)
            raise ValueError(
                "terrain must have a shape at x = 0, where robots are placed, got shapes between "
                f"x = {left:g} m and x = {right:g} m, none of them at x = 0"
            )

    @classmethod
    def under(cls, terrain: Terrain, depth: float = DEPTH) -> Shapes:
        """Return the ground below a height line as polygons, one under each of its segments.

        Args:
            terrain: The height line.
            depth: By which they reach below its lowest point, in m.
        """
        line = terrain.polyline.tolist()
        bottom = min(y for _, y in line) - checks.positive("depth", depth)
        pieces = [
            Piece(((ax, bottom), (bx, bottom), (bx, by), (ax, ay)))
            for (ax, ay), (bx, by) in pairwise(line)
        ]
        return cls(tuple(pieces), terrain.friction, terrain.restitution)

    @property
    def steepest(self) -> float:
        """Infinite: a wall may be vertical."""
        return math.inf

    @property
    def lowest(self) -> float:
        """The lowest point of all shapes, m."""
        return min(piece.box[1] for piece in self.pieces)

    @property
    def highest(self) -> float:
        """The highest point of all shapes, m."""
        return max(piece.box[3] for piece in self.pieces)

    def add_to(self, space: pymunk.Space) -> list[pymunk.Shape]:
        """Add the shapes to a pymunk space on a new static body, and return them in their order."""
        ground = pymunk.Body(body_type=pymunk.Body.STATIC)
        shapes = [piece.shape(ground) for piece in self.pieces]
        for shape in shapes:
            shape.friction, shape.elasticity = self.friction, self.restitution
        space.add(ground, *shapes)
        return shapes


Ground: TypeAlias = Terrain | Shapes
"""What robots walk on."""


def _checked(name: str, piece: Piece) -> Piece:
    """Return a piece as plain numbers; ValueError: no extent, not convex, or too far away."""
    points = tuple((float(x), float(y)) for x, y in piece.points)
    radius = float(piece.radius)
    numbers = [radius, *(number for point in points for number in point)]
    if not all(abs(number) <= FARTHEST for number in numbers) or radius < 0.0 or not points:
        raise ValueError(
            f"{name} must have coordinates within {FARTHEST:g} m of the origin and a radius of at "
            f"least 0, got {checks.shown(piece)}"
        )
    got = f"got {checks.shown(piece)}"
    if len(points) == 1 and radius == 0.0:
        raise ValueError(f"{name} must be a circle with a radius above 0, {got}")
    if len(points) == 2 and points[0] == points[1]:
        raise ValueError(f"{name} must be a segment with a length above 0, {got}")
    if len(points) > 2:
        x, y = np.array(points).T
        ex, ey = np.roll(x, -1) - x, np.roll(y, -1) - y
        turns = ex * np.roll(ey, -1) - ey * np.roll(ex, -1)
        area = 0.5 * float(((x - x[0]) * ey - (y - y[0]) * ex).sum())
        if area < LEAST_AREA or (turns < -1e-12).any():
            raise ValueError(
                f"{name} must be a convex polygon of at least {LEAST_AREA:g} m^2 with its points "
                f"in counter-clockwise order, {got}"
            )
    return Piece(points, radius)


def is_shapes(value: object) -> bool:
    """Whether a value is a space, or a list with shapes in it."""
    if isinstance(value, pymunk.Space):
        return True
    if not isinstance(value, (list, tuple)):
        return False
    return any(isinstance(entry, pymunk.Shape) for entry in value)


def ground_of(source: ShapeSource) -> Ground:
    """Return the ground that static shapes make: a height line where they are one.

    Segments of radius 0 that join from left to right are the points of a
    :class:`jansen_env.Terrain`, which goes on beyond them; all else is :class:`Shapes`. A friction
    of 0, pymunk's default, stands for :data:`FRICTION`.

    Args:
        source: A space, or a list of shapes. Neither is changed or kept.

    Raises:
        ValueError: If a shape is not static, is a sensor, moves its surface, filters what it
            touches, is of an unknown kind or differs from others in friction or elasticity.
    """
    shapes = list(source.shapes) if isinstance(source, pymunk.Space) else list(source)
    if not shapes:
        raise ValueError("terrain must have at least one static shape, got an empty space")
    pieces = tuple(_piece(f"terrain[{i}]", shape) for i, shape in enumerate(shapes))
    if isinstance(source, pymunk.Space):  # whose shapes have no order
        pieces = tuple(sorted(pieces))
    friction = _common("friction", (shape.friction for shape in shapes)) or FRICTION
    restitution = _common("elasticity", (shape.elasticity for shape in shapes))
    points = _height_line(pieces)
    if points is not None:
        return Terrain(points, friction, restitution)
    return Shapes(pieces, friction, restitution)


def _piece(name: str, shape: object) -> Piece:
    """Return a copy of a user's shape; ValueError: it cannot be ground."""
    if not isinstance(shape, (pymunk.Circle, pymunk.Segment, pymunk.Poly)):
        kinds = "a pymunk.Circle, Segment or Poly"
        raise ValueError(f"{name} must be {kinds}, got {checks.shown(shape)}")
    body = shape.body
    if body is None:
        raise ValueError(
            f"{name} must be a shape of a static body, got a shape without a body; keep a "
            "reference to the body, because a shape does not keep one"
        )
    if body.body_type != pymunk.Body.STATIC:
        raise ValueError(
            f"{name} must be a shape of a static body, got a shape of a body that can move"
        )
    if shape.sensor:
        raise ValueError(f"{name} must be solid, got a sensor")
    if tuple(shape.surface_velocity) != (0.0, 0.0):
        raise ValueError(
            f"{name} must have a surface_velocity of (0, 0), got {tuple(shape.surface_velocity)}"
        )
    if shape.filter != pymunk.ShapeFilter():
        raise ValueError(f"{name} must have pymunk's default filter, got {shape.filter}")
    if isinstance(shape, pymunk.Circle):
        local = [shape.offset]
    elif isinstance(shape, pymunk.Segment):
        local = [shape.a, shape.b]
    else:
        local = shape.get_vertices()
    points = [body.local_to_world(point) for point in local]
    return Piece(tuple((point.x, point.y) for point in points), shape.radius)


def _common(name: str, values: Iterable[float]) -> float:
    """Return the value that all shapes have; ValueError: they differ."""
    different = sorted({*values})
    if len(different) > 1:
        raise ValueError(
            f"all shapes of a terrain must have the same {name}, got {different[0]} to "
            f"{different[-1]}"
        )
    return different[0]


def _height_line(pieces: Sequence[Piece]) -> tuple[Point, ...] | None:
    """Return the points of segments of radius 0 that join from left to right, None for others."""
    if any(len(piece.points) != 2 or piece.radius > 0.0 for piece in pieces):
        return None
    segments = sorted(sorted(piece.points) for piece in pieces)
    if any(before[1] != after[0] for before, after in pairwise(segments)):
        return None
    points = segments[0][0], *(segment[1] for segment in segments)
    try:
        Terrain(points)
    except ValueError:  # a vertical face
        return None
    return points


def make_ground(
    ground: Ground | ShapeSource | str | Sequence[Sequence[float]],
    friction: float | None = None,
    restitution: float | None = None,
) -> Ground:
    """Return a ground from a user's argument: shapes, or whatever ``make_terrain`` takes.

    Args:
        ground: The argument.
        friction: Replaces the ground's own; None keeps it.
        restitution: Likewise.

    Raises:
        ValueError: If it is no ground, or a coefficient is out of range.
    """
    made = ground_of(cast("ShapeSource", ground)) if is_shapes(ground) else ground
    if not isinstance(made, Shapes):
        return make_terrain(cast("Terrain", made), friction, restitution)
    friction = made.friction if friction is None else friction
    restitution = made.restitution if restitution is None else restitution
    return replace(made, friction=friction, restitution=restitution)
