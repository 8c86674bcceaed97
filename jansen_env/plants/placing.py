"""Placement of robots on their terrains, and where their pads are."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import finite
from jansen_env.engine import collision, placement
from jansen_env.plants.batch_robots import BatchRobots
from jansen_env.plants.detector import ContactDetector
from jansen_env.plants.initial_pose import resting_depth

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class PlacedRobots(BatchRobots):
    """Robots of a batch that are set down, see :class:`jansen_env.plants.batch.Batch`."""

    toes: int
    states: Array
    detector: ContactDetector
    _world: NDArray[np.void]  # WORLD
    _centres: Array  # work space, of toes and centre of mass or of pads

    def _lower(self, rows: Ints, crank_angles: Array, x: float, pitch: float | None) -> None:
        """Lower robots (k,) onto their terrains, see ``Batch.place_at``."""
        if self.held:
            self.states[rows] = 0.0
            self.states[rows, 0], self.states[rows, 3] = finite("x", x), crank_angles
            self.states[rows, 2] = 0.0 if pitch is None else finite("pitch", pitch)
            return
        places = np.full(len(rows), finite("x", x))
        pitches = np.full(len(rows), math.nan if pitch is None else finite("pitch", pitch))
        depths = np.zeros(len(rows))
        if self.any_gives:
            params = self.params[rows]
            weighed = np.stack([params["mass"], params["stiffness"][:, 0], -params["gravity_y"]], 1)
            depths[:] = [resting_depth(*each) for each in weighed.tolist()]
        angles = np.ascontiguousarray(crank_angles)
        placement.lower(*self._arguments_of_lower(rows, places, angles, pitches))
        self.detector.recall(rows, self.states)
        placement.settle(*self._arguments_of_settle(rows, depths))

    def _arguments_of_pads(self, row: int) -> tuple[Any, ...]:
        model, design = self.designs.model, self.designs.number[row]
        return self.states[row], model.pads[design], model.layout[design], self._centres

    def _arguments_of_lower(
        self, rows: Ints, x: Array, angles: Array, pitches: Array
    ) -> tuple[Any, ...]:
        model = self.designs.model
        return (
            rows, x, angles, pitches, self.states, model.body, model.pads, model.layout,
            self.rows, self.detector.surface, self._world, self._centres,
        )  # fmt: skip

    def _arguments_of_settle(self, rows: Ints, depths: Array) -> tuple[Any, ...]:
        model, detector = self.designs.model, self.detector
        return (
            rows, depths, self.states, model.pads, model.layout, self.rows,
            detector.surface, self._world, self._centres, detector.planes,
        )  # fmt: skip

    def pad_centres(self, row: int) -> Array:
        """(pads, 2) centres of a robot's pads, toes first, m."""
        collision.pad_centres(*self._arguments_of_pads(row))
        return self._centres[: self.pads].copy()

    def contact_frames(self, row: int) -> tuple[Array, Array]:
        """See :meth:`jansen_env.plants.base.BatchedPlant.contact_frames`."""
        centres, radius = self.pad_centres(row)[: self.toes], self.robots[row].pad_radius
        points = centres - np.array([0.0, radius])
        tangents = np.tile([1.0, 0.0], (self.toes, 1))
        if self.held:
            return points, tangents
        self.detector.find_candidates(np.array([row]), self.states)
        planes = self.detector.planes_near(row, centres)
        for plane in planes[::-1]:  # a pad's nearest comes last
            pad, normal = plane["pad"], np.array([plane["normal_x"], plane["normal_y"]])
            points[pad] = centres[pad] - radius * normal
            tangents[pad] = normal[1], -normal[0]
        return points, tangents
