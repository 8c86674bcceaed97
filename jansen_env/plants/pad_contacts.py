"""Pads of the rigid-body plant on the ground: what pymunk's contacts did, and who lands next."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray

from jansen_env.plants.snapshot import Snapshot, Sums
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

CONTACT_HYSTERESIS = 2e-3  # s for which a loaded pad may be off the ground and count as on it
SLOP = 1e-5  # m, how deep a resting toe may sink in
_Arbiter = pymunk.batch.ArbiterFields
_CONTACT = _Arbiter.BODY_A_ID | _Arbiter.TOTAL_IMPULSE | _Arbiter.NORMAL | _Arbiter.POINT_A_1


class PadContacts:
    """Pads, m in ``radius``, of the bodies ``owners`` on the ``ground`` of a space.

    ``index``: of bodies, by pymunk's ids.
    """

    def __init__(
        self,
        space: pymunk.Space,
        ground: Terrain,
        owners: Sequence[int],
        index: Mapping[int, int],
        radius: float,
        time_step: float,
    ) -> None:
        self._space, self._ground, self._owners, self._index = space, ground, owners, index
        self._radius, self._time_step = radius, time_step
        self._pads_of = {
            body: [k for k, b in enumerate(owners) if b == body] for body in set(owners)
        }
        self._touched = pymunk.batch.Buffer()
        self._off = np.full(len(owners), math.inf)  # s since a pad was last on the ground
        self._pending = np.zeros(len(owners))  # m it moved along the ground since then
        self._normals = np.tile([0.0, 1.0], (len(owners), 1))
        self._gaps = np.full(len(owners), math.inf)  # at first all may land

    @property
    def pressed(self) -> Bools:
        """(pads,) the pads on the ground now or within :data:`CONTACT_HYSTERESIS`."""
        return self._off <= CONTACT_HYSTERESIS

    def set_pressed(self, pressed: Bools | None) -> None:
        """Take (pads,) the pads on the ground just before; None: not known, none."""
        self._off[:] = math.inf if pressed is None else np.where(pressed, 0.0, math.inf)
        self._pending[:] = 0.0

    def note(self, touching: Bools) -> None:
        """Note (pads,) the pads that touched in a time step."""
        self._off = np.where(touching, 0.0, self._off + self._time_step)

    def book(self, now: Snapshot, sums: Sums) -> tuple[float, bool]:
        """Book slip and impulses of a time step; friction's loss, and whether a pad landed.

        A loaded pad hops by nanometres, off the ground for a few time steps: what it slides then is
        counted when it is back within :data:`CONTACT_HYSTERESIS`, and coming back is no landing.
        """
        self._touched.clear()
        pymunk.batch.get_space_arbiters(self._space, _CONTACT, self._touched)
        ids = np.frombuffer(self._touched.int_buf(), dtype=np.uintp).tolist()
        values = np.frombuffer(self._touched.float_buf()).reshape(-1, 6).tolist()
        touching, loss = np.zeros(len(self._owners), bool), 0.0
        # pymunk's order is that of pointers: by position it is the same in every process.
        for (px, py, nx, ny, x, y), name in sorted(zip(values, ids, strict=True)):
            normal = -(px * nx + py * ny)
            if normal <= 0.0:
                continue
            body = self._index[name]
            pad = min(self._pads_of[body], key=lambda k: self._off_rim(now.pads[k], x, y))
            tangential = -px * ny + py * nx
            speed = now.speed_along(body, x, y, -ny, nx)
            sums.slip[pad] += self._time_step * abs(speed)
            sums.impulse[pad] += tangential, normal
            loss -= tangential * speed
            touching[pad] = True
            self._normals[pad] = -nx, -ny
        back = touching & (self._off <= CONTACT_HYSTERESIS)
        sums.slip[back] += self._pending[back]
        landed = bool((touching & (self._off > CONTACT_HYSTERESIS)).any())
        self._off = np.where(touching, 0.0, self._off + self._time_step)
        self._pending[self._off == 0.0] = 0.0
        for pad in np.flatnonzero((self._off > 0.0) & (self._off <= CONTACT_HYSTERESIS)).tolist():
            (nx, ny), (x, y) = self._normals[pad].tolist(), now.pads[pad].tolist()
            x, y = x - self._radius * nx, y - self._radius * ny
            speed = now.speed_along(self._owners[pad], x, y, ny, -nx)
            self._pending[pad] += self._time_step * abs(speed)
        return loss, landed

    def _off_rim(self, pad: Array, x: float, y: float) -> float:
        """Return the distance of a point from the rim of a pad, m: two pads may be on one body."""
        return abs(math.hypot(x - pad[0], y - pad[1]) - self._radius)

    def landing_soon(self, now: Snapshot) -> bool:
        """Whether a pad that is not on the ground may touch it within the next two time steps.

        By the ground straight below it: on rough ground some landings go unforeseen.
        """
        x, y = now.pads.T
        tilt = np.sqrt(1.0 + self._ground.gradient(x) ** 2)
        gaps = (y - self._ground.height(x)) / tilt - self._radius
        fallen = self._gaps - gaps
        self._gaps = gaps
        return bool(((self._off > 0.0) & (gaps - 2.0 * fallen < SLOP)).any())
