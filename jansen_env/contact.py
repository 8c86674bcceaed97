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
from numpy.typing import NDArray

from jansen_env.compiling import compiled
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]

MARGIN = 0.05  # m, added to a pad's radius: a toe at 5 m/s crosses it in 10 ms
FACE = 1e-6  # rad, how far a contact's normal may be off a segment's to be taken as the face's
SAME = 1e-9  # difference of two planes' numbers below which they are one
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
        self._surface = terrain.polyline
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
        return int(
            _collect(ids, values, self._ids, self.positions, self._surface, planes, pad, self._gaps)
        )


@compiled
def _collect(
    ids: NDArray[np.uintp],
    values: Array,
    known: NDArray[np.uintp],
    positions: Array,
    surface: Array,
    planes: Array,
    pad: NDArray[np.int64],
    gaps: Array,
) -> int:
    """Planes from pymunk's contacts: (n, 4) normal from pad to ground and point on the ground.

    Sorted by pad, nearest first, because pymunk's own order is that of pointers. Where there are
    more than fit, those with the widest gaps are left out.
    """
    count = 0
    for row in range(len(ids)):
        nx, ny = -values[row, 0], -values[row, 1]
        px, py = values[row, 2], values[row, 3]
        index = 0
        while known[index] != ids[row]:
            index += 1
        x, y = positions[index, 0], positions[index, 1]
        if ny < 0.0:  # the pad's centre is behind that segment
            k = _segment(surface, x)
            slope = (surface[k + 1, 1] - surface[k, 1]) / (surface[k + 1, 0] - surface[k, 0])
            if y > surface[k, 1] + slope * (x - surface[k, 0]):
                continue  # yet above the ground: it sees the far side of a ridge
            nx, ny = -nx, -ny  # it has sunk in
        # On a face, take the face's own normal: the direction to the nearest point is rounded.
        k = _segment(surface, px)
        ex, ey = surface[k + 1, 0] - surface[k, 0], surface[k + 1, 1] - surface[k, 1]
        length = np.hypot(ex, ey)
        if abs(nx * ex + ny * ey) < FACE * length:
            nx, ny, px, py = -ey / length, ex / length, surface[k, 0], surface[k, 1]
        offset = nx * px + ny * py
        gap = nx * x + ny * y - offset
        if _listed(index, nx, ny, offset, planes, pad, count):
            continue  # a vertex is found from both its sides
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


@compiled
def _listed(
    index: int,
    nx: float,
    ny: float,
    offset: float,
    planes: Array,
    pad: NDArray[np.int64],
    count: int,
) -> bool:
    """Whether that plane is among the first ``count`` ones already."""
    for k in range(count):
        if pad[k] == index:
            apart = abs(planes[k, 0] - nx) + abs(planes[k, 1] - ny) + abs(planes[k, 2] - offset)
            if apart < SAME:
                return True
    return False


@compiled
def _segment(surface: Array, x: float) -> int:
    """Index of the segment of the surface above or below ``x``."""
    low, high = 0, len(surface) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if surface[middle, 0] <= x:
            low = middle
        else:
            high = middle
    return low
