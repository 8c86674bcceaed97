"""pymunk finds the ground: pad positions in, contact planes out.

Only pymunk's geometry is used. The pads are circles on bodies that no solver moves; they are
enlarged by a margin, so that planes are known before a pad touches and can be kept for a few time
steps. The impulses are solved elsewhere, where the linkage's inertia is known (``kernels.py``).
"""

from __future__ import annotations

import math

import numpy as np
import pymunk
import pymunk.batch
from numba import njit
from numpy.typing import NDArray

from jansen_env.terrain import Terrain

Array = NDArray[np.float64]

MARGIN = 0.05  # m, added to a pad's radius: a toe at 5 m/s crosses it in 10 ms
PARK = 1e6  # m above, where pads wait that are not looked at

_Arbiter = pymunk.batch.ArbiterFields
_FIELDS = _Arbiter.BODY_A_ID | _Arbiter.NORMAL | _Arbiter.POINT_B_1
_BODY_FIELDS = pymunk.batch.BodyFields.POSITION


class ContactDetector:
    """One robot's pads over one terrain in one pymunk space.

    Args:
        terrain: the ground.
        pads: number of pads. radius: of each, m.
        capacity: planes kept at most; where there are more, the farthest are dropped.

    Attributes:
        positions: (pads, 2) pad centres, m: write them here before :meth:`detect`.
    """

    def __init__(self, terrain: Terrain, pads: int, radius: float, capacity: int) -> None:
        self._space = pymunk.Space()
        self._space.collision_slop = 0.0
        self._space.collision_persistence = 1  # with 0 the batch reader sees nothing
        terrain.add_to(self._space)
        bodies = []
        for _ in range(pads):
            body = pymunk.Body(1.0, math.inf)
            circle = pymunk.Circle(body, radius + MARGIN)
            circle.filter = pymunk.ShapeFilter(group=1)  # pads never touch one another
            self._space.add(body, circle)
            bodies.append(body)
        found = pymunk.batch.Buffer()
        pymunk.batch.get_space_bodies(self._space, pymunk.batch.BodyFields.BODY_ID, found)
        order = list(memoryview(found.int_buf()).cast("P"))
        self._ids = np.array([body.id for body in bodies], dtype=np.uintp)
        if order[:pads] != self._ids.tolist():
            raise RuntimeError("pymunk lists the pads in another order than they were added in")
        # The batch sets every body of the space, the ground's (last) too: it stays at the origin.
        rows = np.zeros((len(order), 2))
        self.positions = rows[:pads]
        self._set = pymunk.batch.Buffer()
        self._set.set_float_buf(rows)
        self._got = pymunk.batch.Buffer()
        self._gaps = np.zeros(capacity)
        self._looked_at = pads
        self._bodies = bodies  # keeps them alive

    def detect(self, count: int, planes: Array, pad: NDArray[np.int64]) -> int:
        """Find the planes near the first ``count`` pads, as they stand in :attr:`positions`.

        Args:
            count: pads looked at; the others are parked out of the way.
            planes: out, (capacity, 3) unit normal pointing out of the ground, and its offset
                n . point: a pad's gap is n . centre - offset - radius.
            pad: out, (capacity,) the pad each plane is for.

        Returns:
            How many planes were found, ordered by pad, then nearest first.
        """
        if count < self._looked_at:
            parked = self.positions[count:]
            parked[:, 0] = PARK * np.arange(1, len(parked) + 1)
            parked[:, 1] = PARK
        self._looked_at = count
        pymunk.batch.set_space_bodies(self._space, _BODY_FIELDS, self._set)
        self._space.step(1e-300)  # detects, moves nothing
        got = self._got
        got.clear()
        pymunk.batch.get_space_arbiters(self._space, _FIELDS, got)
        ids = np.frombuffer(got.int_buf(), dtype=np.uintp)
        values = np.frombuffer(got.float_buf()).reshape(-1, 4)
        return int(_collect(ids, values, self._ids, self.positions, planes, pad, self._gaps))


@njit(cache=True)
def _collect(
    ids: NDArray[np.uintp],
    values: Array,
    known: NDArray[np.uintp],
    positions: Array,
    planes: Array,
    pad: NDArray[np.int64],
    gaps: Array,
) -> int:
    """Sort the contacts by pad, nearest first: pymunk's order is that of pointers, never the same.

    Where there are more than fit, those with the widest gaps are left out.
    """
    count = 0
    for row in range(len(ids)):
        # pymunk's normal points from the pad (always body A) into the ground.
        nx, ny = -values[row, 0], -values[row, 1]
        offset = nx * values[row, 2] + ny * values[row, 3]
        index = 0
        while known[index] != ids[row]:
            index += 1
        gap = nx * positions[index, 0] + ny * positions[index, 1] - offset
        place = count
        if count == len(pad):
            place = int(np.argmax(gaps[:count]))
            if gap >= gaps[place]:
                continue
        else:
            count += 1
        pad[place], gaps[place] = index, gap
        planes[place, 0], planes[place, 1], planes[place, 2] = nx, ny, offset
    for i in range(1, count):  # insertion sort
        k = i
        while k > 0 and (pad[k], gaps[k]) < (pad[k - 1], gaps[k - 1]):
            pad[k], pad[k - 1] = pad[k - 1], pad[k]
            gaps[k], gaps[k - 1] = gaps[k - 1], gaps[k]
            for j in range(3):
                planes[k, j], planes[k - 1, j] = planes[k - 1, j], planes[k, j]
            k -= 1
    return count
