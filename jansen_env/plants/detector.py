"""pymunk finds the ground: pad positions in, contact planes out, for any number of robots at once.

The pads are circles on bodies that no solver moves, much enlarged: pymunk says which stretch of the
ground is near a pad, and is asked again when a pad has moved by as much as its circle is larger.
In between, as often as the time stepping asks, the planes near each pad are worked out from those
stretches. The impulses are solved elsewhere, where the linkage's inertia is known (``kernels.py``).

All robots share one space. Each stands in a cell of its own with a copy of its ground, as circles
on one spot would make the broad phase compare each with each. Planes are in the robot's own
coordinates and do not depend on its cell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray

from jansen_env.engine import collision
from jansen_env.engine.collision import ITS_PAD, MARGIN, PARK, ROBOT, SPECULATIVE_MARGIN, STRIDE
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

APART = 1000.0  # m, between the grounds of two robots

_Arbiter = pymunk.batch.ArbiterFields
_FIELDS = _Arbiter.BODY_A_ID | _Arbiter.POINT_B_1
_POSITION = pymunk.batch.BodyFields.POSITION


class ContactDetector:
    """The pads of robots over their grounds in one pymunk space.

    A row is a pad that is looked at: first the toes of all robots, then the bumpers of those
    robots that have come near the ground.

    Args:
        terrains: the ground of each robot.
        toes: toes of each robot. radius: of each pad, m.
        most: planes kept of a robot; where there are more, the farthest are dropped.

    Attributes:
        spans: (robots, 2) robot r's planes are those from spans[r, 0] to spans[r, 1] - 1, ordered
            by pad, then nearest first.
        planes: (robots * most, 3) unit normal pointing out of the ground, and its offset n . point:
            a pad's gap is n . centre - offset - radius.
        contacts: (robots * most, 2) of each plane its PAD and MODE.
        status: (robots, 3) STEPS_LEFT, SPECULATIVE_MARGIN and TOO_DEEP of each robot. Until one of
            its pads has moved by the margin, its planes are all that they can touch.
        owner: (rows, 2) ROBOT and ITS_PAD. centres: (rows, 2) pad centres, m.
    """

    def __init__(self, terrains: Sequence[Terrain], toes: int, radius: float, most: int) -> None:
        robots = len(terrains)
        self._toes, self._radius, self._far = toes, radius, radius + MARGIN + STRIDE
        self.status = np.zeros((robots, 3))
        self.status[:, SPECULATIVE_MARGIN] = MARGIN
        self.surface, self.bounds, self.ground = surfaces(terrains)
        self._cells = _cells(self.surface, robots)
        self._space = pymunk.Space()
        self._space.collision_slop = 0.0
        self._space.collision_persistence = 1  # with 0 the batch reader sees nothing
        self._space.iterations = 1  # its solver's answer is not used
        self._add_grounds(terrains)
        self._got = pymunk.batch.Buffer()
        self._bodies: list[pymunk.Body] = []
        self.owner = np.zeros((0, 2), np.int64)
        self.centres = np.zeros((0, 2))
        self._asked_at = np.zeros((0, 2))  # where the pads were when pymunk was asked
        self._stretch = np.zeros((0, 2), np.int64)  # first and last segment near each then
        self._grow(robots * toes)
        self.owner[:, ROBOT] = np.repeat(np.arange(robots), toes)
        self.owner[:, ITS_PAD] = np.tile(np.arange(toes), robots)
        begin = most * np.arange(robots)
        self.spans = np.column_stack([begin, begin])
        self._most = most
        self.planes = np.zeros((robots * most, 3))
        self.contacts = np.zeros((robots * most, 2), np.int64)
        self._gaps = np.zeros(robots * most)

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
            circle = pymunk.Circle(body, self._far)
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
        self.owner, self.centres = _extended(self.owner, rows), _extended(self.centres, rows)
        self._asked_at = np.full((rows, 2), np.inf)  # nothing is known of the new ones
        self._stretch = np.zeros((rows, 2), np.int64)
        # The batch sets every body of the space, the ground's (last) too: it stays at the origin.
        self._placed = np.zeros((len(order), 2))
        self._placed[:rows] = PARK * np.arange(1, rows + 1)[:, None]
        self._set = pymunk.batch.Buffer()
        self._set.set_float_buf(self._placed)

    def look(
        self,
        states: Array,
        parameters: Array,
        pads: Array,
        layout: Array,
        depths: Array,
        time_step: float,
        moving_only: bool = False,
    ) -> bool:
        """Find the planes near the pads where they are in ``states`` (robots, 8).

        Args:
            parameters, pads, layout: of the robots, see :mod:`jansen_env.engine.tables`.
            depths: m, how far below the crank axis a bumper can feel the ground, at pitches evenly
                spread over one turn; and last, how far it can in any direction.
            time_step: s.
            moving_only: whether only for the robots that have steps left.

        Returns:
            Whether a pad of one of them is too deep in the ground.
        """
        rows, stale, too_deep = collision.look(
            states, parameters, pads, layout, depths, time_step, moving_only, self._toes,
            self.surface, self.bounds, self.ground, self._radius, self._far, self._most,
            self._stretch, self.owner, self.centres, self._asked_at, self.status, self.spans,
            self.planes, self.contacts, self._gaps,
        )  # fmt: skip
        if rows > len(self.owner):
            self._grow(max(rows, len(self.owner) * 3 // 2))
            return self.look(states, parameters, pads, layout, depths, time_step, moving_only)
        return self.find(rows, True, moving_only) if stale else bool(too_deep)

    def find(self, rows: int, ask: bool = True, moving_only: bool = False) -> bool:
        """Find the planes near the first rows' :attr:`centres`, after asking pymunk or without.

        Args, returns: as of :meth:`look`.
        """
        if ask:
            self._ask(rows)
        too_deep: bool = collision.find_planes(
            rows, moving_only, self.surface, self.bounds, self.ground, self._radius, self._far,
            self._most, self._stretch, self.owner, self.centres, self.status, self.spans,
            self.planes, self.contacts, self._gaps,
        )  # fmt: skip
        return too_deep

    def _ask(self, rows: int) -> None:
        """Let pymunk say which stretch of the ground is near each of the first rows."""
        collision.move_pads(
            rows, self.centres, self.owner, self._cells, self._asked_at, self._placed
        )
        pymunk.batch.set_space_bodies(self._space, _POSITION, self._set)
        self._space.step(1e-300)  # detects, moves nothing
        got = self._got
        got.clear()
        pymunk.batch.get_space_arbiters(self._space, _FIELDS, got)
        ids, points = np.frombuffer(got.int_buf(), np.int64), np.frombuffer(got.float_buf())
        collision.remember(
            ids, points, self._ids, self._row_of, self.owner, self._asked_at, self._cells,
            self.surface, self.bounds, self.ground, self._far, self._stretch,
        )  # fmt: skip


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


def _extended(array: NDArray[Any], rows: int) -> NDArray[Any]:
    """A copy with so many rows, the new ones 0."""
    new = np.zeros((rows, *array.shape[1:]), array.dtype)
    new[: len(array)] = array
    return new
