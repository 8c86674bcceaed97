"""The ground of each robot: pymunk's shapes, asked which stretch of it a robot can reach.

For pymunk a ground is cut into stretches, segments from end to end: few, so that a robot's ground
is exchanged at little cost. A query answers with those above which a robot can be until it has
moved by :data:`MARGIN` and one more step; their vertices are all that the kernels
(:mod:`jansen_env.engine.collision`) know of the ground.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pymunk

from jansen_env.arrays import Array, Rows
from jansen_env.engine.collision import LARGEST_MARGIN, MARGIN, WAY_OUT
from jansen_env.terrain import Terrain

STRETCH = 6.0  # m along the ground in a segment, at least
MOST_STRETCHES = 100
LEAST_ROOM = 64  # vertices, for a ground that may be exchanged
HIGH = 1e9  # m, above and below all ground
FASTEST = 200.0  # m/s along x: what is faster counts as diverged once it leaves its stretch


class Shapes(NamedTuple):
    """A ground in pymunk."""

    space: pymunk.Space
    vertices: dict[pymunk.Shape, tuple[int, int]]  # first and last of each
    first_x: float  # m, where the shapes end
    last_x: float


class Grounds:
    """The grounds of n robots.

    Args:
        terrains: of each robot. status: (n,) STATUS of :mod:`jansen_env.engine.records`, which are
            kept here: ``first_vertex`` and ``end_vertex`` of the terrain, and those of the stretch.

    Attributes:
        surface: (vertices, 2) m, of all terrains.
        status: as given.
    """

    def __init__(self, terrains: Sequence[Terrain], status: Rows) -> None:
        self.status = status
        distinct = {id(terrain): terrain for terrain in terrains}
        shapes = {key: make_shapes(terrain.polyline) for key, terrain in distinct.items()}
        self._shapes = [shapes[id(terrain)] for terrain in terrains]
        lines = [terrain.polyline for terrain in distinct.values()]
        self.surface = np.concatenate(lines)
        number = {key: i for i, key in enumerate(distinct)}
        ground = np.array([number[id(terrain)] for terrain in terrains])
        bounds = np.cumsum([0, *map(len, lines)])
        status["first_vertex"], status["end_vertex"] = bounds[ground], bounds[ground + 1]
        status["asked_x"] = np.inf
        # First vertex and room of a robot's own ground: at first others may be on it.
        self._rooms, self._used = np.zeros((len(terrains), 2), np.int64), len(self.surface)

    def set_terrain(self, row: int, terrain: Terrain) -> None:
        """Give a robot another ground; where there is no room, :attr:`surface` is a new array."""
        line, status = terrain.polyline, self.status[row]
        first, room = self._rooms[row].tolist()
        if len(line) > room:
            first, room = self._used, max(len(line), 2 * room, LEAST_ROOM)
            self._rooms[row], self._used = (first, room), first + room
            if self._used > len(self.surface):
                larger = np.zeros((2 * self._used, 2))
                larger[: len(self.surface)] = self.surface
                self.surface = larger
        self.surface[first : first + len(line)] = line
        status["first_vertex"], status["end_vertex"] = first, first + len(line)
        status["asked_x"] = np.inf
        self._shapes[row] = make_shapes(line)

    def find_stretch(self, row: int, x: float, extent: float, duration: float) -> None:
        """Ask pymunk for the ground that a robot may reach from ``x``, m, of its crank axis.

        Args:
            extent: m, of its pads' centres from the axis. duration: s, of its longest step.

        Raises:
            ValueError: pymunk finds none.
        """
        shapes, status = self._shapes[row], self.status[row]
        room = MARGIN + FASTEST * duration
        reach = room + extent + float(status["pad_radius"]) + max(WAY_OUT, LARGEST_MARGIN)
        left = min(max(x - reach, shapes.first_x), shapes.last_x)
        right = max(min(x + reach, shapes.last_x), shapes.first_x)
        near = shapes.space.bb_query(pymunk.BB(left, -HIGH, right, HIGH), pymunk.ShapeFilter())
        if not near:
            raise ValueError(f"pymunk finds no ground at x = {x} m")
        first, last = zip(*(shapes.vertices[shape] for shape in near), strict=True)
        status["first_near"] = status["first_vertex"] + min(first)
        status["end_near"] = status["first_vertex"] + max(last) + 1
        status["asked_x"], status["room"] = x, room


def make_shapes(line: Array) -> Shapes:
    """A polyline (n, 2), m, as a few pymunk segments, each from end to end of a stretch."""
    length = max(STRETCH, (line[-2, 0] - line[1, 0]) / MOST_STRETCHES)
    place = np.floor((line[:, 0] - line[1, 0]) / length)
    cut = np.ones(len(line), bool)
    cut[2:-2] = place[2:-2] != place[1:-3]
    cuts = np.flatnonzero(cut).tolist()
    space, vertices = pymunk.Space(), dict[pymunk.Shape, tuple[int, int]]()
    for first, last in pairwise(cuts):
        a, b = line[[first, last]].tolist()
        vertices[pymunk.Segment(space.static_body, a, b, 0.0)] = first, last
    space.add(*vertices)
    return Shapes(space, vertices, float(line[0, 0]), float(line[-1, 0]))
