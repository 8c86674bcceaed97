"""Contact planes from pymunk's queries, for grounds of shapes and to check height lines.

``Space.point_query`` returns every shape within reach of a pad, with its nearest point, distance
and gradient, which define one plane per shape. Planes at points that another shape covers are left
out, so that a pad on a floor of boxes does not feel the sides at which the boxes meet.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pymunk

from jansen_env.arrays import Array
from jansen_env.engine import mathematics
from jansen_env.engine.collision import FACE, SAME
from jansen_env.terrain.shapes import Ground, Piece, Shapes

TOUCHING = 1e-8  # largest distance of a point that lies on a shape, in m
BESIDE = 1e-7  # distance from a corner, to either side, at which a profile is sampled, in m
GAP = 1e-6  # least height of air between shapes that makes an overhang, in m
ARC = 24  # number of samples of a profile over a round shape
EVERY = pymunk.ShapeFilter()  # filter that accepts every shape

Face = tuple[float, float]


class ContactPlane(NamedTuple):
    """Plane in which a pad may touch the ground, ``PLANE`` of :mod:`jansen_env.engine.records`."""

    normal_x: float
    normal_y: float
    offset: float
    distance: float
    pad: int


class ShapePlanes:
    """A ground in its own pymunk space, with queries for contact planes and heights.

    Args:
        ground: The ground. For a height line, the planes are correct only for pads above it.

    Attributes:
        space: pymunk space that contains the shapes of the ground.
        lowest: Height of the lowest point of all shapes, in m.
        highest: Height of the highest point of all shapes, in m.
    """

    def __init__(self, ground: Ground) -> None:
        self.space = pymunk.Space()
        shapes = ground.add_to(self.space)
        if isinstance(ground, Shapes):
            self._pieces = list(ground.pieces)
        else:
            line = [(x, y) for x, y in ground.polyline.tolist()]
            self._pieces = [Piece(ends) for ends in pairwise(line)]
        self._place = {shape: i for i, shape in enumerate(shapes)}
        self._faces = [_faces(piece) for piece in self._pieces]
        self._boxes = [piece.box for piece in self._pieces]
        self.lowest = min(box[1] for box in self._boxes)
        self.highest = max(box[3] for box in self._boxes)
        self._last_profile = (0.0, 0.0), np.zeros((0, 2))

    def find(self, centres: Array, near: float) -> list[ContactPlane]:
        """Return the contact planes near pads, sorted by pad and then by distance.

        Args:
            centres: Centre of each pad, in m, shape (pads, 2).
            near: Distance between a centre and a shape below which the plane is returned, in m.
        """
        xs, ys = centres.T.tolist()  # Python's min is faster than NumPy's for so few numbers
        reach = pymunk.BB(min(xs) - near, min(ys) - near, max(xs) + near, max(ys) + near)
        boxes = [self._boxes[self._place[s]] for s in self.space.bb_query(reach, EVERY)]
        planes: list[ContactPlane] = []
        if not boxes:
            return planes
        for pad, (x, y) in enumerate(zip(xs, ys, strict=True)):
            for left, bottom, right, top in boxes:
                if left - near < x < right + near and bottom - near < y < top + near:
                    planes += self._of_pad(pad, x, y, near)
                    break
        return planes

    def _of_pad(self, pad: int, x: float, y: float, near: float) -> list[ContactPlane]:
        """Return the planes of a pad whose centre is at (x, y)."""
        place = self._place
        answer = [hit for hit in self.space.point_query((x, y), near, EVERY) if hit.distance < near]
        answer.sort(key=lambda hit: (hit.distance, place[hit.shape]))
        seen = [hit for hit in answer if not _is_covered(hit, answer)]
        if answer and answer[0].distance < 0.0 and (not seen or seen[0].distance >= 0.0):
            seen.insert(0, max((h for h in answer if h.distance < 0.0), key=lambda h: h.distance))
        planes: list[ContactPlane] = []
        for hit in seen:
            nx, ny = hit.gradient
            for face_x, face_y in self._faces[place[hit.shape]]:
                # On a straight face, use its exact normal, because pymunk's gradient is rounded.
                if abs(nx * face_y - ny * face_x) < FACE and nx * face_x + ny * face_y > 0.0:
                    nx, ny = face_x, face_y
                    break
            offset = nx * hit.point.x + ny * hit.point.y
            if not any(_is_same(other, nx, ny, offset) for other in planes):
                planes.append(ContactPlane(nx, ny, offset, hit.distance, pad))
        return planes

    def distances(self, centres: Array) -> Array:
        """Return the distance of each point from the nearest shape, in m.

        The distance is negative inside a shape.

        Args:
            centres: The points, in m, shape (n, 2).
        """
        nearest = [self.nearest(x, y).distance for x, y in centres.tolist()]
        return np.array(nearest)

    def nearest(self, x: float, y: float) -> pymunk.PointQueryInfo:
        """Return pymunk's query result for the shape nearest to a point.

        If shapes contain the point, this is the shape in which it lies deepest.
        """
        answer = self.space.point_query_nearest((x, y), np.inf, EVERY)
        assert answer is not None, "a ground has shapes"
        return answer

    def height_below(self, x: float, y: float) -> float:
        """Return the height of the ground below a point, in m.

        Where no shape lies below the point, this is the height of the lowest point of all shapes.
        """
        hit = self.space.segment_query_first((x, y), (x, self.lowest - 1.0), 0.0, EVERY)
        return self.lowest if hit is None else float(hit.point.y)

    def line_below(self, x: float, y: float, scan: Array) -> Array:
        """Return the heights of the ground that a robot observes, as a height line.

        Args:
            x: Position of the crank axis, in m.
            y: Height of the crank axis, in m. Shapes above the axis do not count as ground below
                it.
            scan: Positions relative to the axis at which the robot observes the ground, in m, shape
                (k,).

        Returns:
            Height line with a vertex at each of these positions, in m, shape (n, 2).
        """
        heights = {x: self.height_below(x, y)}
        for place in scan.tolist():
            heights[x + place] = self.height_below(x + place, self.highest + 1.0)
        heights.setdefault(x + 1.0, heights[x])
        return np.array(sorted(heights.items()))

    def count_crossing(self, sides: Array) -> int:
        """Count the straight lines that pass through shapes.

        Args:
            sides: End points of the lines, in m, shape (n, 2, 2).
        """
        count = 0
        for a, b in sides[sides[:, :, 1].min(axis=1) < self.highest].tolist():
            count += self.space.segment_query_first(tuple(a), tuple(b), 0.0, EVERY) is not None
        return count

    def profile(self, left: float, right: float) -> Array:
        """Return the upper surface between two x as a height line, in m, shape (n, 2).

        The surface is sampled at both ends and at the positions of :meth:`_corners`.
        """
        if self._last_profile[0] != (left, right):  # environments place robots at the same x
            x = np.unique([left, right, *self._corners(left, right)])
            top = self.highest + 1.0
            line = np.array([(at, self.height_below(at, top)) for at in x.tolist()])
            self._last_profile = (left, right), line
        return self._last_profile[1]

    @functools.cached_property
    def line(self) -> Array:
        """The :meth:`profile` from 1 m left of all shapes to 1 m right of them."""
        left = min(box[0] for box in self._boxes)
        right = max(box[2] for box in self._boxes)
        return self.profile(left - 1.0, right + 1.0)

    def find_overhang(self) -> float | None:
        """Return an x, in m, with air below a shape, or None if there is no overhang."""
        top, bottom = self.highest + 1.0, self.lowest - 1.0
        for x in self._corners(-np.inf, np.inf):
            spans = []
            for hit in self.space.segment_query((x, top), (x, bottom), 0.0, EVERY):
                from_below = hit.shape.segment_query((x, bottom), (x, top))
                if from_below is not None:
                    spans.append((from_below.point.y, hit.point.y))
            spans.sort()
            reached = spans[0][1] if spans else 0.0
            for low, high in spans:
                if low > reached + GAP:
                    return x
                reached = max(reached, high)
        return None

    def _corners(self, left: float, right: float) -> list[float]:
        """Return the x between two limits that lie next to corners or over round shapes, in m."""
        places = set[float]()
        for piece, box in zip(self._pieces, self._boxes, strict=True):
            if box[2] < left or box[0] > right:
                continue
            for x, _ in piece.points:
                for end in (x - piece.radius, x + piece.radius):
                    places |= {end - BESIDE, end + BESIDE}
                if piece.radius > 0.0:
                    places |= {*np.linspace(x - piece.radius, x + piece.radius, ARC).tolist()}
        return sorted(x for x in places if left <= x <= right)


def check_scan(grounds: Iterable[Ground]) -> None:
    """Check that a height scan need not see through an overhang.

    Raises:
        ValueError: If a ground of shapes has an overhang.
    """
    different = {id(ground): ground for ground in grounds if isinstance(ground, Shapes)}
    for ground in different.values():
        x = ShapePlanes(ground).find_overhang()
        if x is not None:
            raise ValueError(
                "height_scan must be None on a ground with overhangs, which has several heights at "
                f"one x, got a scan although there is air below a shape at x = {x:.6g} m"
            )


def _is_covered(hit: pymunk.PointQueryInfo, answer: list[pymunk.PointQueryInfo]) -> bool:
    """Return whether another shape of a query result covers the point of a hit.

    If the pad's centre is outside all shapes, only a nearer shape can cover the point. If it is
    inside a shape, the other shape must contain the point in its interior, as two shapes may have a
    side in common.
    """
    outside = hit.distance >= 0.0
    most = TOUCHING if outside else -TOUCHING
    for other in answer:
        if other is hit or (outside and other.distance >= hit.distance):
            continue
        if other.shape.point_query(hit.point).distance <= most:
            return True
    return False


def _is_same(plane: ContactPlane, nx: float, ny: float, offset: float) -> bool:
    """Return whether a plane has this normal and offset, up to rounding."""
    apart = abs(plane.normal_x - nx) + abs(plane.normal_y - ny) + abs(plane.offset - offset)
    return apart < SAME


def _faces(piece: Piece) -> list[Face]:
    """Return the outward unit normals of a piece's straight faces."""
    points = piece.points
    faces: list[Face] = []
    if len(points) == 1:
        return faces
    for (ax, ay), (bx, by) in zip(points, points[1:] + points[:1], strict=True):
        ex, ey = bx - ax, by - ay
        length = float(mathematics.hypot(ex, ey))
        faces.append((ey / length, -ex / length))
    return faces
