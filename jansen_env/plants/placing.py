"""Placement of robots on their terrains, and where their pads are."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import finite
from jansen_env.dynamics.reduced import Tables
from jansen_env.engine import collision, placement
from jansen_env.engine.jit import Kernel
from jansen_env.plants.batch_robots import BatchRobots
from jansen_env.plants.detector import ContactDetector
from jansen_env.plants.initial_pose import resting_depth

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

PITCHES = 256  # at which it is known how deep the pads that are no toes reach


class PlacedRobots(BatchRobots):
    """Robots of a batch that are set down, see :class:`jansen_env.plants.batch.Batch`."""

    toes: int
    states: Array
    detector: ContactDetector
    _world: NDArray[np.uint8]  # WORLD, as bytes
    _centres: Array  # work space, of toes and centre of mass or of pads

    def _lower(self, rows: Ints, crank_angles: Array, x: float, pitch: float | None) -> None:
        """Lower robots (k,) onto their terrains, see ``Batch.place_at``."""
        places = np.full(len(rows), finite("x", x))
        pitches = np.full(len(rows), math.nan if pitch is None else finite("pitch", pitch))
        depths = np.zeros(len(rows))
        if self.any_gives:
            params = self.params[rows]
            weighed = np.stack([params["mass"], params["stiffness"][:, 0], -params["gravity_y"]], 1)
            depths[:] = [resting_depth(*each) for each in weighed.tolist()]
        angles = np.ascontiguousarray(crank_angles)  # other layouts would be compiled apart
        placement.lower(*self._arguments_of_lower(rows, places, angles, pitches))
        self.detector.recall(rows, self.states)
        placement.settle(*self._arguments_of_settle(rows, depths))

    def _placing_kernels(self) -> list[Kernel]:
        rows, number = np.arange(1), np.zeros(1)
        return [
            Kernel("pads", collision.pad_centres, self._arguments_of_pads(0)),
            Kernel("placement", placement.lower, self._arguments_of_lower(rows, *[number] * 3)),
            Kernel("settling", placement.settle, self._arguments_of_settle(rows, number)),
        ]

    def _arguments_of_pads(self, row: int) -> tuple[Any, ...]:
        return self.states[row], self.model.pads, self.model.layout, self._centres

    def _arguments_of_lower(
        self, rows: Ints, x: Array, angles: Array, pitches: Array
    ) -> tuple[Any, ...]:
        model = self.model
        return (
            rows, x, angles, pitches, self.states, model.body, model.pads, model.layout,
            self.rows, self.detector.surface, self._world, self._centres,
        )  # fmt: skip

    def _arguments_of_settle(self, rows: Ints, depths: Array) -> tuple[Any, ...]:
        model, detector = self.model, self.detector
        return (
            rows, depths, self.states, model.pads, model.layout, self.rows,
            detector.surface, self._world, self._centres, detector.planes,
        )  # fmt: skip

    def pad_centres(self, row: int) -> Array:
        """(pads, 2) centres of a robot's pads, toes first, m."""
        collision.pad_centres(*self._arguments_of_pads(row))
        return self._centres[: len(self.model.layout)].copy()

    def contact_frames(self, row: int) -> tuple[Array, Array]:
        """See :meth:`jansen_env.plants.base.BatchedPlant.contact_frames`."""
        centres, radius = self.pad_centres(row)[: self.toes], self.robots[0].pad_radius
        self.detector.find_candidates(np.array([row]), self.states)
        planes = self.detector.planes_near(row, centres)
        points = centres - np.array([0.0, radius])
        tangents = np.tile([1.0, 0.0], (self.toes, 1))
        for plane in planes[::-1]:  # a pad's nearest comes last
            pad, normal = plane["pad"], np.array([plane["normal_x"], plane["normal_y"]])
            points[pad] = centres[pad] - radius * normal
            tangents[pad] = normal[1], -normal[0]
        return points, tangents


def farthest_pad(tables: Tables) -> float:
    """Return how far from the crank axis a pad's centre can be, m."""
    x, y = tables.pads[:, :, :2, 0].reshape(-1, 2).T
    return 1.01 * float(np.hypot(x, y).max())  # of what lies between the tables' angles


def non_toe_depths(tables: Tables, toes: int, margin: float) -> Array:
    """Return the reach of pads that are no toes below the axis, m, by pitch; and the most."""
    rows = np.unique(tables.layout.table[toes:])
    x, y = tables.pads[rows][:, :, :2, 0].reshape(-1, 2).T
    farthest = float(np.hypot(x, y).max())
    pitch = 2.0 * math.pi * (np.arange(PITCHES) + 0.5) / PITCHES
    depth = -(np.outer(np.sin(pitch), x) + np.outer(np.cos(pitch), y)).min(axis=1)
    between = farthest * math.pi / PITCHES  # to the next entry
    return np.append(depth + between, farthest) + margin
