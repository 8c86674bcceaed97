"""Terrain of static pymunk shapes, such as boxes, walls and overhangs."""

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

FRICTION = 0.8  # coefficient for shapes that have pymunk's default of 0
LEAST_AREA = 1e-9  # smallest area of a polygon, m^2
DEPTH = 1.0  # depth of polygons under a height line below its lowest point, in m

Point: TypeAlias = tuple[float, float]
ShapeSource: TypeAlias = pymunk.Space | Sequence[pymunk.Shape]


class Piece(NamedTuple):
    """A convex shape: the convex hull of some points, and everything within a radius of it.

    Attributes:
        points: World coordinates in m: one point for a circle, two points for a segment, and three
            points or more, counter-clockwise, for a polygon.
        radius: Radius in m. A segment of radius 0 is a plate without thickness that carries pads on
            both sides.
    """

    points: tuple[Point, ...]
    radius: float = 0.0

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, bottom, right and top of the bounding box, in m."""
        x, y = zip(*self.points, strict=True)
        r = self.radius
        return min(x) - r, min(y) - r, max(x) + r, max(y) + r

    def shape(self, body: pymunk.Body) -> pymunk.Shape:
        """Return a new pymunk shape for a body at the origin."""
        if len(self.points) == 1:
            return pymunk.Circle(body, self.radius, self.points[0])
        if len(self.points) == 2:
            return pymunk.Segment(body, *self.points, self.radius)
        return pymunk.Poly(body, self.points, radius=self.radius)


@dataclass(frozen=True)
class Shapes:
    """A terrain of static shapes, with one friction and one restitution for all of them.

    The terrain contains copies of a user's shapes. It never changes the originals, and later
    changes of the originals do not affect it.

    Where shapes meet, let them overlap if pads may sink in as deep as their radius. A pad that is
    so deep leaves a shape through its nearest side. If shapes merely abut, this side may be the
    seam between them, and the pad is pushed along the floor. A side that lies inside another shape
    is ignored.

    Attributes:
        pieces: The shapes. At least one of them is above or below x = 0, where robots are placed.
        friction: Coulomb coefficient between toe and ground.
        restitution: Newton's coefficient of restitution, 0 to 1.

    Raises:
        ValueError: If a shape has no extent, is not convex or lies beyond
            :data:`jansen_env.terrain.ground.FARTHEST`, if there is no shape at x = 0, or if a
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
        """Return the ground below a height line as polygons, one under each segment of the line.

        Args:
            terrain: The height line.
            depth: Distance by which the polygons reach below the line's lowest point, in m.
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
        """Always infinite, as a wall may be vertical."""
        return math.inf

    @property
    def lowest(self) -> float:
        """Height of the lowest point of all shapes, in m."""
        return min(piece.box[1] for piece in self.pieces)

    @property
    def highest(self) -> float:
        """Height of the highest point of all shapes, in m."""
        return max(piece.box[3] for piece in self.pieces)

    def add_to(self, space: pymunk.Space) -> list[pymunk.Shape]:
        """Add the shapes to a pymunk space on a new static body, and return them in their order."""
        ground = pymunk.Body(body_type=pymunk.Body.STATIC)
        shapes = [piece.shape(ground) for piece in self.pieces]
        for shape in shapes:
            shape.friction = self.friction
            shape.elasticity = self.restitution
        space.add(ground, *shapes)
        return shapes


Ground: TypeAlias = Terrain | Shapes
"""Type of a terrain on which robots walk."""


def _checked(name: str, piece: Piece) -> Piece:
    """Return a piece whose numbers are plain floats.

    Raises:
        ValueError: If the piece has no extent, is not convex, or is too far away.
    """
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
    """Return whether a value is a pymunk space, or a list or tuple that contains a pymunk shape."""
    if isinstance(value, pymunk.Space):
        return True
    if not isinstance(value, (list, tuple)):
        return False
    return any(isinstance(entry, pymunk.Shape) for entry in value)


def ground_of(source: ShapeSource) -> Ground:
    """Return the ground that consists of static shapes.

    Segments of radius 0 that join from left to right become the points of a height line
    (:class:`jansen_env.Terrain`), which continues beyond its ends. All other shapes become
    :class:`Shapes`. A friction of 0, pymunk's default, is replaced by :data:`FRICTION`.

    Args:
        source: A space, or a list of shapes. It is neither changed nor kept.

    Raises:
        ValueError: If a shape is not static, is a sensor, has a moving surface, has a filter, is of
            an unknown kind, or differs from the others in friction or elasticity.
    """
    shapes = list(source.shapes) if isinstance(source, pymunk.Space) else list(source)
    if not shapes:
        raise ValueError("terrain must have at least one static shape, got an empty space")
    pieces = tuple(_piece(f"terrain[{i}]", shape) for i, shape in enumerate(shapes))
    if isinstance(source, pymunk.Space):  # the shapes of a space have no order
        pieces = tuple(sorted(pieces))
    friction = _common("friction", (shape.friction for shape in shapes)) or FRICTION
    restitution = _common("elasticity", (shape.elasticity for shape in shapes))
    points = _height_line(pieces)
    if points is not None:
        return Terrain(points, friction, restitution)
    return Shapes(pieces, friction, restitution)


def _piece(name: str, shape: object) -> Piece:
    """Return a copy of a user's shape.

    Raises:
        ValueError: If the shape cannot be ground.
    """
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
    """Return the value that all shapes have in common.

    Raises:
        ValueError: If the values differ.
    """
    different = sorted({*values})
    if len(different) > 1:
        raise ValueError(
            f"all shapes of a terrain must have the same {name}, got {different[0]} to "
            f"{different[-1]}"
        )
    return different[0]


def _height_line(pieces: Sequence[Piece]) -> tuple[Point, ...] | None:
    """Return the points of segments of radius 0 that join from left to right, else None."""
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
    """Return a user's ground, given as shapes or in any form that ``make_terrain`` accepts.

    Args:
        ground: The user's argument.
        friction: Coulomb coefficient that replaces that of the ground. None keeps the latter.
        restitution: Coefficient of restitution that replaces that of the ground. None keeps the
            latter.

    Raises:
        ValueError: If ``ground`` is not valid, or a coefficient is out of range.
    """
    made = ground_of(cast("ShapeSource", ground)) if is_shapes(ground) else ground
    if not isinstance(made, Shapes):
        return make_terrain(cast("Terrain", made), friction, restitution)
    friction = made.friction if friction is None else friction
    restitution = made.restitution if restitution is None else restitution
    return replace(made, friction=friction, restitution=restitution)
