"""Placement of robots on their terrains, and where their pads are."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import finite
from jansen_env.engine import collision, placement
from jansen_env.engine.collision import MARGIN, SPECULATIVE_MARGIN
from jansen_env.plants.batch_robots import BatchRobots
from jansen_env.plants.grounds import Grounds
from jansen_env.plants.initial_pose import resting_depth

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class PlacedRobots(BatchRobots):
    """Robots of a batch that are set down, see :class:`jansen_env.plants.batch.Batch`."""

    toes: int
    states: Array
    _grounds: Grounds
    _longest: float  # s, of a step
    planes: NDArray[np.void]  # PLANE
    _world: NDArray[np.void]  # WORLD
    _centres: Array  # work space, of toes and centre of mass or of pads

    @property
    def surface(self) -> Array:
        """(vertices, 2) m, of all terrains: a robot's are in its row's status."""
        return self._grounds.surface

    def _ask_ground(self, rows: Ints) -> None:
        """Ask pymunk for the ground of those robots (k,) that have moved by the margin."""
        if self.held:
            return
        moved = np.abs(self.states[rows, 0] - self.rows["status"]["asked_x"][rows])
        for row in rows[~(moved <= MARGIN)].tolist():
            extent = float(self.designs.extent[self.designs.number[row]])
            self._grounds.find_stretch(row, float(self.states[row, 0]), extent, self._longest)

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
        self.states[rows, 0] = places
        self._ask_ground(rows)
        placement.lower(*self._arguments_of_lower(rows, places, angles, pitches))
        self.rows["status"]["margin"][rows] = SPECULATIVE_MARGIN
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
            self.rows, self.surface, self._world, self._centres,
        )  # fmt: skip

    def _arguments_of_settle(self, rows: Ints, depths: Array) -> tuple[Any, ...]:
        model = self.designs.model
        return (
            rows, depths, self.states, model.pads, model.layout, self.rows,
            self.surface, self._world, self._centres, self.planes,
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
        status = self.rows["status"][row]
        status["margin"] = SPECULATIVE_MARGIN
        collision.planes_near(row, centres, self.rows, self.surface, self._world, self.planes)
        planes = self.planes[status["first_plane"] : status["end_plane"]]
        for plane in planes[::-1]:  # a pad's nearest comes last
            pad, normal = plane["pad"], np.array([plane["normal_x"], plane["normal_y"]])
            points[pad] = centres[pad] - radius * normal
            tangents[pad] = normal[1], -normal[0]
        return points, tangents
