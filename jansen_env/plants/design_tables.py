"""Tables of the designs in a batch: each design once, however many robots are of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.reduced import Tables
from jansen_env.engine.collision import SPECULATIVE_MARGIN
from jansen_env.engine.records import Model
from jansen_env.engine.tables import kernel_model

Array = NDArray[np.float64]

PITCHES = 256  # at which it is known how deep the pads that are no toes reach
SPARSE = 2  # intervals of a table between two angles at which such pads are looked at
BETWEEN = 1.01  # what lies between such angles is farther by less than this


class DesignTables:
    """The kernels' arrays of designs. A robot's design is a row of each.

    Args:
        tables: of each robot, with the same pads.

    Attributes:
        number: (robots,) row of each robot. model: of all designs, along the first axis.
        depths: (designs, PITCHES + 1) of :func:`non_toe_depths`.
    """

    def __init__(self, tables: Sequence[Tables]) -> None:
        self.number = np.zeros(len(tables), np.int64)
        self.model, self.depths = kernel_model(tables[0]), non_toe_depths(tables[0])[None]
        self._users = np.array([len(tables)])
        self._kept: dict[int, Tables] = {0: tables[0]}  # by their rows
        self._rows = {id(tables[0].body): 0}
        for robot, own in enumerate(tables):
            self.set(robot, own)

    def set(self, robot: int, tables: Tables) -> None:
        """Give a robot a design; where there is no room, all arrays are new ones."""
        self._users[self.number[robot]] -= 1
        row = self._rows.get(id(tables.body))
        if row is None:
            row = self._free_row()
            if row in self._kept:
                del self._rows[id(self._kept[row].body)]
            self._rows[id(tables.body)], self._kept[row] = row, tables
            for every, own in zip(self.model, kernel_model(tables), strict=True):
                every[row] = own[0]
            self.depths[row] = non_toe_depths(tables)
        self.number[robot] = row
        self._users[row] += 1

    def _free_row(self) -> int:
        """Return a row that no robot has."""
        if self._users.all():
            self.model = Model(*(np.concatenate([one, one]) for one in self.model))
            self.depths = np.concatenate([self.depths, self.depths])
            self._users = np.append(self._users, np.zeros_like(self._users))
        return int(np.argmin(self._users))


def farthest_pad(tables: Tables) -> float:
    """Return how far from the crank axis a pad's centre can be, m."""
    x, y = tables.pads[:, :, 0, 0], tables.pads[:, :, 0, 1]
    return BETWEEN * float(np.hypot(x, y).max())


def non_toe_depths(tables: Tables) -> Array:
    """Return the reach of pads that are no toes below the axis, m, by pitch; and the most.

    With what counts as near: their radius and the speculative margin.
    """
    joints = np.unique(tables.layout.joint[tables.layout.toes :])
    places = BETWEEN * tables.pads[joints, ::SPARSE, 0, :2].reshape(-1, 2)
    mirrors = {1.0 if leg.side == "fore" else -1.0 for leg in tables.robot.legs}
    places = np.concatenate([places * (mirror, 1.0) for mirror in sorted(mirrors)])
    farthest = float(np.hypot(*places.T).max())
    pitch = 2.0 * math.pi * (np.arange(PITCHES) + 0.5) / PITCHES
    down = -np.stack([np.sin(pitch), np.cos(pitch)], axis=1).reshape(-1, 8, 2)  # small products
    depth = (down @ places.T).max(axis=2).ravel()
    next_entry = farthest * math.pi / PITCHES
    near = tables.robot.pad_radius + SPECULATIVE_MARGIN
    return np.append(depth + next_entry, farthest) + near
