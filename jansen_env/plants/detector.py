"""The broad phase is pymunk's: robots in, candidate segments out, for many robots at once.

A robot is a circle around all that its pads can reach, larger by a skin: pymunk says which segments
of the terrain touch it, and is asked again when the robot has left the skin. In between, the planes
near each pad come from those candidates (:mod:`jansen_env.engine.collision`).

All robots share one space. Each stands in a cell of its own with a copy of its terrain, as circles
on one spot would make the broad phase compare each with each. Planes are in the robot's own
coordinates. For pymunk the ground is cut into stretches, thick segments that hold all of it within
them: few, so that a robot's ground is exchanged at little cost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray

from jansen_env.engine import collision, mathematics
from jansen_env.engine.collision import SKIN, SPECULATIVE_MARGIN
from jansen_env.engine.records import PLANE
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Rows = NDArray[np.void]

APART = 1000.0  # m, between the terrains of two robots
STRETCH = 3.0  # m, along the ground, that pymunk knows as one thick segment
LEAST_ROOM = 64  # vertices, for a ground that may be exchanged
FAR = 1e7  # m, where robots wait that have not been placed yet, and how far apart

MOST_ASKED = 16  # robots about whom pymunk is asked one by one
NO_ROBOTS = pymunk.ShapeFilter(group=1)  # robots never touch one another

_Arbiter = pymunk.batch.ArbiterFields
_FIELDS = _Arbiter.BODY_A_ID | _Arbiter.POINT_B_1
_POSITION = pymunk.batch.BodyFields.POSITION


class ContactDetector:
    """Robots over their terrains in one pymunk space.

    Args:
        robots: (n,) :data:`jansen_env.engine.records.ROBOT`, whose ``status`` is kept here.
        terrains: of each robot. world: (1,) :data:`jansen_env.engine.records.WORLD`.
        extent: (n,) how far from the crank axis a pad's centre may be, m.

    Attributes:
        surface: (vertices, 2) m, of all terrains.
        planes: (robots * capacity,) :data:`jansen_env.engine.records.PLANE`, those of a robot from
            its ``first_plane`` to its ``end_plane`` - 1. Until one of its pads has moved by its
            margin, they are all that they can touch.
    """

    def __init__(
        self, robots: Rows, terrains: Sequence[Terrain], world: Rows, extent: Array
    ) -> None:
        n, capacity = len(robots), int(world["capacity"][0])
        self._robots, self._world = robots, world
        self.surface, bounds, terrain = _surfaces(terrains)
        self._circles = extent + robots["status"]["pad_radius"] + SPECULATIVE_MARGIN + SKIN
        self._cells = _cells(self.surface, n)
        status = robots["status"]
        status["margin"] = SPECULATIVE_MARGIN
        status["first_plane"] = status["end_plane"] = capacity * np.arange(n)
        status["first_vertex"], status["end_vertex"] = bounds[terrain], bounds[terrain + 1]
        # No part of the surface is a robot's alone yet: others may be on its ground.
        self._own, self._used = np.zeros((n, 2), np.int64), len(self.surface)
        status["cell_x"], status["cell_y"] = self._cells.T
        for name in ("known_x", "known_y", "home_x", "home_y"):
            status[name] = np.inf  # the broad phase knows none of them
        status["last_segment"] = status["home_last"] = -1
        self.planes = np.zeros(n * capacity, PLANE)
        self._space = pymunk.Space()
        self._space.collision_slop = 0.0
        self._space.collision_persistence = 1  # with 0 the batch reader sees nothing
        self._space.iterations = 1  # its solver's answer is not used
        self._add_grounds(terrains)
        self._add_robots(n)
        self._got = pymunk.batch.Buffer()

    def _add_grounds(self, terrains: Sequence[Terrain]) -> None:
        """Add a copy of its ground in every robot's cell, on one static body."""
        self._ground = pymunk.Body(body_type=pymunk.Body.STATIC)
        known: dict[int, tuple[Array, Array]] = {}
        self._segments = []
        for terrain, cell in zip(terrains, self._cells, strict=True):
            if id(terrain) not in known:
                known[id(terrain)] = _stretches(terrain.polyline)
            self._segments.append(self._placed_segments(*known[id(terrain)], cell))
        every = [segment for segments in self._segments for segment in segments]
        # In the order of the ground pymunk's tree would become a chain.
        shuffled = np.random.default_rng(0).permutation(len(every))
        self._space.add(self._ground, *(every[i] for i in shuffled))

    def _placed_segments(self, ends: Array, radii: Array, cell: Array) -> list[pymunk.Segment]:
        """The stretches of a ground in a robot's cell, as pymunk has them."""
        return [
            pymunk.Segment(self._ground, start, end, radius)
            for (start, end), radius in zip((ends + cell).tolist(), radii.tolist(), strict=True)
        ]

    def set_terrain(self, row: int, terrain: Terrain) -> None:
        """Give a robot another ground; where there is no room, :attr:`surface` is a new array."""
        line, status = terrain.polyline, self._robots[row]["status"]
        first, room = self._own[row].tolist()
        if len(line) > room:
            first, room = self._used, max(len(line), 2 * room, LEAST_ROOM)
            self._own[row], self._used = (first, room), first + room
            if self._used > len(self.surface):
                larger = np.zeros((2 * self._used, 2))
                larger[: len(self.surface)] = self.surface
                self.surface = larger
        self.surface[first : first + len(line)] = line
        status["first_vertex"], status["end_vertex"] = first, first + len(line)
        self._forget(row)
        self._exchange(row, *_stretches(line))

    def set_extent(self, row: int, extent: float) -> None:
        """Give a robot's circle the radius of another robot, see the class."""
        radius = self._robots["status"]["pad_radius"][row]
        self._circles[row] = extent + radius + SPECULATIVE_MARGIN + SKIN
        self._shapes[row].unsafe_set_radius(float(self._circles[row]))
        self._forget(row)

    def _forget(self, row: int) -> None:
        """Let a robot be unknown to the broad phase."""
        for name in ("known_x", "known_y", "home_x", "home_y"):
            self._robots["status"][name][row] = np.inf

    def _exchange(self, row: int, ends: Array, radii: Array) -> None:
        """Let pymunk have these stretches in a robot's cell: the same segments, moved."""
        segments, cell = self._segments[row], self._cells[row]
        if len(segments) < len(radii):
            more = slice(len(segments), None)
            new = self._placed_segments(ends[more], radii[more], cell)
            self._space.add(*new)
            segments += new
        # Those that are too many lie on the last stretch.
        last = len(radii) - 1
        places, thick = (ends + cell).tolist(), radii.tolist()
        for i, segment in enumerate(segments):
            segment.unsafe_set_endpoints(*places[min(i, last)])
            segment.unsafe_set_radius(thick[min(i, last)])
            self._space.reindex_shape(segment)

    def _add_robots(self, count: int) -> None:
        """A circle for each robot."""
        bodies, self._shapes = [], []
        for i in range(count):
            body = pymunk.Body(1.0, math.inf)
            body.position = FAR * (i + 1), FAR * (i + 1)  # on one spot each would know each
            circle = pymunk.Circle(body, float(self._circles[i]))
            circle.filter = NO_ROBOTS
            self._space.add(body, circle)
            bodies.append(body)
            self._shapes.append(circle)
        found = pymunk.batch.Buffer()
        pymunk.batch.get_space_bodies(self._space, pymunk.batch.BodyFields.BODY_ID, found)
        order = list(memoryview(found.int_buf()).cast("P"))
        ids = np.array([body.id for body in bodies])
        if order[:count] != ids.tolist():
            raise RuntimeError("pymunk lists the robots in another order than they were added in")
        self._ids, self._row_of = np.sort(ids), np.argsort(ids)
        self._place_of = np.argsort(self._row_of)  # of each robot in them
        # The batch sets every body of the space, the ground's (last) too: it stays at the origin.
        self._placed = np.zeros((len(order), 2))
        self._placed[:count] = FAR * np.arange(1, count + 1)[:, None]
        self._set = pymunk.batch.Buffer()
        self._set.set_float_buf(self._placed)

    def planes_of(self, robot: int) -> Rows:
        """A robot's planes, a view."""
        status = self._robots[robot]["status"]
        return self.planes[status["first_plane"] : status["end_plane"]]

    def planes_near(self, robot: int, centres: Array) -> Rows:
        """A robot's planes near its pads' centres (pads, 2), m, among its candidates: a view."""
        self._robots["status"]["margin"][robot] = SPECULATIVE_MARGIN
        collision.planes_near(robot, centres, self._robots, self.surface, self._world, self.planes)
        return self.planes_of(robot)

    def find_candidates(self, rows: Ints, states: Array) -> None:
        """Let pymunk say which segments are near some robots; states: (n, 8) of all."""
        collision.move_robots(rows, states, self._robots, self._placed)
        pymunk.batch.set_space_bodies(self._space, _POSITION, self._set)
        self._space.step(1e-300)  # detects, moves nothing
        self._got.clear()
        pymunk.batch.get_space_arbiters(self._space, _FIELDS, self._got)
        collision.keep_candidates(rows, *self._candidates())

    def recall(self, rows: Ints, states: Array) -> None:
        """Know the candidates of robots that have been placed, from the last time if possible."""
        status = self._robots["status"]
        if collision.recall(rows, states, self._robots):
            if len(rows) > MOST_ASKED:
                self.find_candidates(rows, states)
            else:
                for row in rows.tolist():
                    self._ask(row, states[row])
            for home, known in (("x", "known_x"), ("y", "known_y"), ("first", "first_segment"),
                                ("last", "last_segment")):  # fmt: skip
                status[f"home_{home}"][rows] = status[known][rows]

    def _ask(self, row: int, state: Array) -> None:
        """Let pymunk say which segments are near one robot: less than a look at the whole space."""
        status = self._robots[row]["status"]
        status["known_x"], status["known_y"] = x, y = state[:2].tolist()
        place = float(x + status["cell_x"]), float(y + status["cell_y"])
        found = self._space.point_query(place, float(self._circles[row]), NO_ROBOTS)
        points = np.array([(hit.point.x, hit.point.y) for hit in found]).reshape(-1)
        ids = np.full(len(found), self._ids[self._place_of[row]])
        _, _, *others = self._candidates()
        collision.keep_candidates(np.array([row]), ids, points, *others)

    def _candidates(self) -> tuple[Any, ...]:
        """Arguments of :func:`jansen_env.engine.collision.keep_candidates`, but for the rows."""
        got = self._got
        ids, points = np.frombuffer(got.int_buf(), np.int64), np.frombuffer(got.float_buf())
        return ids, points, self._ids, self._row_of, self._robots, self.surface, self._circles


def _surfaces(terrains: Sequence[Terrain]) -> tuple[Array, Ints, Ints]:
    """Vertices (total, 2) of all different terrains, m, the first of each, and which (n,) are."""
    distinct = {id(terrain): terrain for terrain in terrains}
    number = {key: i for i, key in enumerate(distinct)}
    lines = [terrain.polyline for terrain in distinct.values()]
    ground = np.array([number[id(terrain)] for terrain in terrains])
    return np.concatenate(lines), np.cumsum([0, *map(len, lines)]), ground


def _stretches(line: Array) -> tuple[Array, Array]:
    """A polyline (n, 2) as few thick segments that hold it: ends (k, 2, 2) and radii (k,), m."""
    place = np.floor((line[:, 0] - line[1, 0]) / STRETCH)
    cut = np.ones(len(line), bool)
    cut[2:-2] = place[2:-2] != place[1:-3]
    cuts = np.flatnonzero(cut)
    start, end = line[cuts[:-1]], line[cuts[1:]]
    owner = np.minimum(np.cumsum(cut), len(cuts) - 1) - 1
    chord, away = (end - start)[owner], line - start[owner]
    share = np.clip((away * chord).sum(axis=1) / (chord**2).sum(axis=1), 0.0, 1.0)
    apart = mathematics.lengths_of(away - share[:, None] * chord)
    return np.stack([start, end], axis=1), np.maximum.reduceat(apart, cuts[:-1])


def _cells(surface: Array, robots: int) -> Array:
    """(robots, 2) origin of each robot's ground, m: in a grid pymunk's tree stays shallow."""
    extent = np.ptp(surface, axis=0) + APART
    columns = math.ceil(math.sqrt(robots))
    return np.stack([np.arange(robots) % columns, np.arange(robots) // columns], axis=1) * extent
