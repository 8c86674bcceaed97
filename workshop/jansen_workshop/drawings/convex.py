"""Convex polygons, in mm: the shapes of all lines that are cut or drawn.

Points are complex numbers x + i y.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.complex128]
T = TypeVar("T")

CIRCLE = np.exp(2j * np.pi * np.arange(64) / 64)
STRAIGHT = 1e-6  # points count as in line if the height / length of their polygon is lower


class Round(NamedTuple):
    """Convex polygon that is enlarged by a radius on all sides.

    Attributes:
        corners: Corners of the polygon, counter-clockwise, in mm.
        radius: Radius by which the polygon is enlarged, in mm.
        fit: Class of a hole, one of :data:`jansen_workshop.drawings.outlines.CLASSES`.
    """

    corners: tuple[complex, ...]
    radius: float = 0.0
    fit: str = "clear"

    @property
    def box(self) -> tuple[complex, complex]:
        """Lower left and upper right corners of the bounding box, in mm."""
        xs = [z.real for z in self.corners]
        ys = [z.imag for z in self.corners]
        out = complex(self.radius, self.radius)
        return complex(min(xs), min(ys)) - out, complex(max(xs), max(ys)) + out

    @property
    def closed(self) -> bool:
        """Whether the line encloses an area; a line between two points does not."""
        return self.radius > 0.0 or len(self.corners) > 2

    @property
    def around(self) -> float:
        """Total length of the polygon's sides, before the enlargement, in mm."""
        return sum(abs(q - p) for p, q in sides(self.corners))

    @property
    def area(self) -> float:
        """Area of the enlarged polygon, in mm^2."""
        inner = sum(0.5 * (p.conjugate() * q).imag for p, q in sides(self.corners))
        return inner + self.around * self.radius + math.pi * self.radius**2

    @property
    def path(self) -> list[tuple[complex, float]]:
        """Corners of the line, each with the bulge of the edge that follows, as in a DXF polyline.

        A circle, which has one corner, has no path.
        """
        if not self.radius:
            return [(z, 0.0) for z in self.corners]
        points = []
        for (a, b), (_, c) in sides(sides(self.corners)):
            start, end = (-1j * self.radius * (q - p) / abs(q - p) for p, q in ((a, b), (b, c)))
            bulge = math.tan(abs(cmath.phase((c - b) / (b - a))) / 4.0)
            points += [(b + start, bulge), (b + end, 0.0)]
        return points

    @property
    def polygon(self) -> tuple[complex, ...]:
        """Corners of a polygon that approximates the line, with 64 corners per full turn."""
        if not self.radius:
            return self.corners
        return hull(z + self.radius * turn for z in self.corners for turn in CIRCLE)

    def moved(self, turn: complex, shift: complex) -> Round:
        """Return the polygon turned about the origin, then shifted.

        Args:
            turn: Complex number of magnitude 1 by which the corners are multiplied.
            shift: Displacement in mm.
        """
        return self._replace(corners=tuple(turn * z + shift for z in self.corners))


def rectangle(size: complex) -> Round:
    """Return a rectangle whose lower left corner is the origin.

    Args:
        size: Width and height, in mm, as a complex number.
    """
    return Round((0j, complex(size.real), size, complex(0.0, size.imag)))


def sides(corners: Sequence[T]) -> list[tuple[T, T]]:
    """Return the start and end of each side of a polygon.

    Args:
        corners: Corners of the polygon.
    """
    return [*zip(corners, [*corners[1:], *corners[:1]], strict=True)]


def hull(points: Iterable[complex]) -> tuple[complex, ...]:
    """Return the corners of the convex hull of points, counter-clockwise.

    If all points are in line, the corners are the two ends.

    Args:
        points: Points inside the hull.
    """
    ordered = sorted(points, key=lambda z: (z.real, z.imag))
    corners: list[complex] = []
    for row in (ordered, ordered[::-1]):
        chain: list[complex] = []
        for z in row:
            while len(chain) > 1:
                way = z - chain[-2]
                last = chain[-1] - chain[-2]
                if (last.conjugate() * way).imag >= STRAIGHT * abs(last) * abs(way):
                    break
                chain.pop()
            chain.append(z)
        corners += chain[:-1]
    return tuple(corners)


def gap(polygon: Points, other: Points) -> NDArray[np.float64]:
    """Return the least distances between convex polygons.

    Args:
        polygon: Corners of the first polygons, shape (..., corners).
        other: Corners of the second polygons, shape (..., corners).

    Returns:
        Distances, shape (...), which are 0 where two polygons meet.
    """
    least = np.full(polygon.shape[:-1], np.inf)
    signs = []
    for a, b in ((polygon, other), (other, polygon)):
        p = b[..., None, :]
        way = np.roll(p, -1, axis=-1) - p
        z = a[..., :, None] - p
        along = (z * way.conj()).real / np.maximum(abs(way) ** 2, 1e-12)
        least = np.minimum(least, abs(z - np.clip(along, 0.0, 1.0) * way).min(axis=(-2, -1)))
        # Whether each corner of polygon a is to the left of each side of polygon b.
        left = np.sign((way.conj() * z).imag)
        within = abs(left.sum(axis=-1)) == max(3, b.shape[-1])
        least = np.where(within.any(axis=-1), 0.0, least)
        signs.append(left * np.roll(left, -1, axis=-2) < 0.0)
    crossing = signs[0] & signs[1].swapaxes(-1, -2)
    return np.where(crossing.any(axis=(-2, -1)), 0.0, least)
