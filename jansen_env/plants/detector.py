"""The broad phase is pymunk's: pad positions in, candidate segments out, for many robots at once.

The pads are circles on bodies that no solver moves, much enlarged: pymunk says which segments of
the terrain are near a pad, and is asked again when a pad has moved by as much as its circle is
larger. In between, as often as the time stepping asks, the planes near each pad are worked out from
those candidates (:mod:`jansen_env.engine.collision`). The impulses are solved elsewhere, where the
linkage's inertia is known (:mod:`jansen_env.engine.contact_solver`).

All robots share one space. Each stands in a cell of its own with a copy of its terrain, as circles
on one spot would make the broad phase compare each with each. Planes are in the robot's own
coordinates and do not depend on its cell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray

from jansen_env.engine import collision
from jansen_env.engine.collision import PARK, SKIN, SPECULATIVE_MARGIN
from jansen_env.engine.jit import Kernel
from jansen_env.engine.records import PLANE, QUERY, Model, as_bytes
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Rows = NDArray[np.void]

APART = 1000.0  # m, between the terrains of two robots

_Arbiter = pymunk.batch.ArbiterFields
_FIELDS = _Arbiter.BODY_A_ID | _Arbiter.POINT_B_1
_POSITION = pymunk.batch.BodyFields.POSITION


class ContactDetector:
    """The pads of robots over their terrains in one pymunk space.

    A query is a pad near which the ground is looked for: first the toes of all robots, then the
    other pads of those robots that have come near the ground.

    Args:
        robots: (n,) :data:`jansen_env.engine.records.ROBOT`, whose ``status`` is kept here.
        terrains: of each robot. toes: of each robot. radius: of each pad, m.
        capacity: planes kept of a robot; where there are more, the farthest are dropped.

    Attributes:
        queries: (rows,) :data:`jansen_env.engine.records.QUERY`.
        planes: (robots * capacity,) :data:`jansen_env.engine.records.PLANE`, those of a robot from
            its ``first_plane`` to its ``end_plane`` - 1. Until one of its pads has moved by its
            margin, they are all that they can touch.
    """

    def __init__(
        self, robots: Rows, terrains: Sequence[Terrain], toes: int, radius: float, capacity: int
    ) -> None:
        n = len(robots)
        self._robots, self._toes = robots, toes
        surface, bounds, terrain = surfaces(terrains)
        reach = radius + SPECULATIVE_MARGIN + SKIN
        self._terrains = surface, radius, reach, capacity
        self._cells = _cells(surface, n)
        status = robots["status"]
        status["margin"] = SPECULATIVE_MARGIN
        status["first_plane"] = status["end_plane"] = capacity * np.arange(n)
        status["first_vertex"], status["end_vertex"] = bounds[terrain], bounds[terrain + 1]
        status["cell_x"], status["cell_y"] = self._cells.T
        self.planes = np.zeros(n * capacity, PLANE)
        self._space = pymunk.Space()
        self._space.collision_slop = 0.0
        self._space.collision_persistence = 1  # with 0 the batch reader sees nothing
        self._space.iterations = 1  # its solver's answer is not used
        self._add_grounds(terrains)
        self._got = pymunk.batch.Buffer()
        self._bodies: list[pymunk.Body] = []
        self.queries = np.zeros(0, QUERY)
        self._grow(n * toes)
        self.queries["robot"] = np.repeat(np.arange(n), toes)
        self.queries["pad"] = np.tile(np.arange(toes), n)

    def _add_grounds(self, terrains: Sequence[Terrain]) -> None:
        """A copy of its ground in every robot's cell, on one static body."""
        body = pymunk.Body(body_type=pymunk.Body.STATIC)
        segments = [
            segment
            for terrain, cell in zip(terrains, self._cells.tolist(), strict=True)
            for segment in terrain.segments(body, (cell[0], cell[1]))
        ]
        # In the order of the ground pymunk's tree would become a chain.
        shuffled = np.random.default_rng(0).permutation(len(segments))
        self._space.add(body, *(segments[i] for i in shuffled))

    def _grow(self, rows: int) -> None:
        """Have pads for so many rows."""
        for i in range(len(self._bodies), rows):
            body = pymunk.Body(1.0, math.inf)
            body.position = PARK * (i + 1), PARK * (i + 1)  # on one spot each would know each
            circle = pymunk.Circle(body, self._terrains[2])
            circle.filter = pymunk.ShapeFilter(group=1)  # pads never touch one another
            self._space.add(body, circle)
            self._bodies.append(body)
        found = pymunk.batch.Buffer()
        pymunk.batch.get_space_bodies(self._space, pymunk.batch.BodyFields.BODY_ID, found)
        order = list(memoryview(found.int_buf()).cast("P"))
        ids = np.array([body.id for body in self._bodies])
        if order[:rows] != ids.tolist():
            raise RuntimeError("pymunk lists the pads in another order than they were added in")
        self._ids, self._row_of = np.sort(ids), np.argsort(ids)
        queries = np.zeros(rows, QUERY)
        queries[: len(self.queries)] = self.queries
        queries["known_x"] = queries["known_y"] = np.inf  # the broad phase knows none of them
        queries["last_segment"] = -1
        self.queries = queries
        self._rows = as_bytes(self._robots), as_bytes(queries), as_bytes(self.planes)
        # The batch sets every body of the space, the ground's (last) too: it stays at the origin.
        self._placed = np.zeros((len(order), 2))
        self._placed[:rows] = PARK * np.arange(1, rows + 1)[:, None]
        self._set = pymunk.batch.Buffer()
        self._set.set_float_buf(self._placed)

    @property
    def centres(self) -> Array:
        """(rows, 2) centres of the queries' pads, m, a copy."""
        return np.stack([self.queries["x"], self.queries["y"]], axis=1)

    def planes_of(self, robot: int) -> Rows:
        """A robot's planes, a view."""
        status = self._robots[robot]["status"]
        return self.planes[status["first_plane"] : status["end_plane"]]

    def watch(self, states: Array, model: Model, depths: Array, time_step: float) -> None:
        """Say where the robots are from now on.

        Args:
            states: (robots, 8), read at every :meth:`detect`. model: the robots' tables.
            depths: m, how far below the crank axis a pad that is no toe can feel the ground, at
                pitches evenly spread over one turn; and last, how far it can in any direction.
            time_step: s.
        """
        self._watched = (
            states, model.pads, as_bytes(model.layout), depths, time_step, self._toes,
            *self._terrains,
        )  # fmt: skip

    def detect(self, moving_only: bool = False) -> bool:
        """Find the planes near the pads where they are now.

        Args:
            moving_only: whether only for the robots that have steps left.

        Returns:
            Whether a pad of one of them is too deep in the ground.
        """
        rows, stale, too_deep = collision.detect(moving_only, *self._watched, *self._rows)
        if rows > len(self.queries):
            self._grow(max(rows, len(self.queries) * 3 // 2))
            return self.detect(moving_only)
        return self.find_planes(rows, True, moving_only) if stale else bool(too_deep)

    def find_planes(self, rows: int, broad_phase: bool = True, moving_only: bool = False) -> bool:
        """Find the planes near the first rows' pads, after a broad phase or without.

        Args, returns: as of :meth:`detect`.
        """
        if broad_phase:
            self._find_candidates(rows)
        too_deep: bool = collision.find_planes(
            rows, self._robots, moving_only, *self._terrains, self.queries, self.planes
        )
        return too_deep

    def _find_candidates(self, rows: int) -> None:
        """Let pymunk say which segments are near each of the first rows' pads."""
        collision.move_pads(rows, self._robots, self.queries, self._placed)
        pymunk.batch.set_space_bodies(self._space, _POSITION, self._set)
        self._space.step(1e-300)  # detects, moves nothing
        self._got.clear()
        pymunk.batch.get_space_arbiters(self._space, _FIELDS, self._got)
        surface, _, reach, _ = self._terrains
        collision.keep_candidates(
            *self._found(), self._ids, self._row_of, self._robots, surface, reach, self.queries
        )

    def _found(self) -> tuple[Ints, Array]:
        """Bodies and points of pymunk's last broad phase."""
        got = self._got
        return np.frombuffer(got.int_buf(), np.int64), np.frombuffer(got.float_buf())

    def kernels(self) -> list[Kernel]:
        """For :func:`jansen_env.engine.jit.prepare`, after :meth:`watch`."""
        robots, queries, planes = self._robots, self.queries, self.planes
        surface, _, reach, _ = self._terrains
        candidates = *self._found(), self._ids, self._row_of, robots, surface, reach, queries
        near = 0, robots, False, *self._terrains, queries, planes
        every = False, *self._watched, *self._rows
        return [
            Kernel("broad phase", collision.move_pads, (0, robots, queries, self._placed)),
            Kernel("candidates", collision.keep_candidates, candidates),
            Kernel("contact planes", collision.find_planes, near),
            Kernel("collision detection", collision.detect, every),
        ]


def surfaces(terrains: Sequence[Terrain]) -> tuple[Array, Ints, Ints]:
    """Grounds as one array.

    Returns:
        (vertices (total, 2) of all different grounds, m; where each begins and the last ends; which
        ground each of ``terrains`` is, (n,))
    """
    distinct = {id(terrain): terrain for terrain in terrains}
    number = {key: i for i, key in enumerate(distinct)}
    lines = [terrain.polyline for terrain in distinct.values()]
    ground = np.array([number[id(terrain)] for terrain in terrains])
    return np.concatenate(lines), np.cumsum([0, *map(len, lines)]), ground


def _cells(surface: Array, robots: int) -> Array:
    """(robots, 2) origin of each robot's ground, m: in a grid pymunk's tree stays shallow."""
    extent = np.ptp(surface, axis=0) + APART
    columns = math.ceil(math.sqrt(robots))
    return np.stack([np.arange(robots) % columns, np.arange(robots) // columns], axis=1) * extent
