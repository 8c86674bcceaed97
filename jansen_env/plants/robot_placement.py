"""Placement of robots at rest on height lines or pymunk's shapes, for both simulation backends."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Ints
from jansen_env.engine import placement
from jansen_env.engine.collision import SPECULATIVE_MARGIN
from jansen_env.engine.records import PLANE, Designs
from jansen_env.plants.base import resting_depth
from jansen_env.plants.kernel_arrays import KernelArrays

MOST_MOVES = 50  # largest number of moves by which a robot is brought into contact with shapes
SETTLED = 1e-9  # length of a move, in m, below which the robot counts as in contact
UPWARDS = 0.1  # y component of a normal above which its plane may carry a robot


class RobotPlacement:
    """Placement of robots on their lowest toes.

    The toes are :data:`placement.PLACEMENT_DEPTH` deep in the ground, so that they carry the robot
    at once.

    Args:
        arrays: Kernel arrays of all n robots in the batch.
    """

    def __init__(self, arrays: KernelArrays) -> None:
        self._arrays = arrays
        robots, pads = arrays.records.statistics.shape
        toes = arrays.records.slip.shape[1]
        self._place = placement.place.bound()
        self._angles = np.zeros(robots)  # crank angles, in rad
        # Work space of the kernels.
        self._centres = np.zeros((max(pads, toes + 1), 2))
        self._planes = np.zeros(int(arrays.designs.world["capacity"][0]), PLANE)

    def place(self, rows: Ints, crank_angles: ArrayLike, x: float, pitch: float) -> None:
        """Place robots at rest.

        The records of robots on height lines must contain the stretch of ground around ``x``; see
        ``KernelArrays.find_ground``.

        Args:
            rows: Indices of the robots, shape (k,).
            crank_angles: Crank angle of each of these robots, in rad, shape (k,).
            x: Position of the crank axis, in m.
            pitch: Pitch of the chassis, in rad. NaN selects the pitch at which both the fore and
                the back feet carry a robot.

        Raises:
            ValueError: If the feet of a robot are too soft to carry it, or no shape is below a
                robot.
        """
        arrays = self._arrays
        self._angles[rows] = crank_angles
        lines, on_shapes = arrays.split(rows)
        self._place_on(arrays.designs, lines, x, pitch)
        for row in on_shapes:
            self._place_on_shapes(row, x, pitch)

    def _place_on(self, designs: Designs, rows: Ints, x: float, pitch: float) -> None:
        """Place robots on the height lines of ``designs``.

        If the feet of one of the robots are too soft to carry it, no robot is placed.

        Raises:
            ValueError: If the feet of a robot are too soft to carry it.
        """
        records = self._arrays.records
        too_soft = self._place(
            rows, self._angles, x, pitch, designs, records.motions, self._centres, self._planes
        )
        if too_soft >= 0:
            properties = records.properties[too_soft]
            resting_depth(properties["mass"], properties["stiffness"][0], -properties["gravity_y"])

    def _place_on_shapes(self, row: int, x: float, pitch: float) -> None:
        """Place a robot on the profile of its shapes, then move it until its pads touch them."""
        arrays = self._arrays
        shapes = arrays.grounds.shapes_of(row)
        reach = float(arrays.tables.extent[arrays.tables.number[row]]) + 1.0
        profile = shapes.profile(x - reach, x + reach)
        status = arrays.records.status[row]
        stretch = status["first_near"], status["end_near"]
        status["first_near"] = 0
        status["end_near"] = len(profile)
        self._place_on(arrays.designs._replace(surface=profile), np.array([row]), x, pitch)
        status["first_near"], status["end_near"] = stretch

        state = arrays.records.states[row]
        properties = arrays.records.properties[row]
        radius = float(properties["pad_radius"])
        for _ in range(MOST_MOVES):
            planes = shapes.find(arrays.pad_centres(row), radius + SPECULATIVE_MARGIN)
            gaps = [
                (plane.distance - radius) / plane.normal_y
                for plane in planes
                if plane.normal_y > UPWARDS
            ]
            if not gaps:
                raise ValueError(
                    f"terrain must carry the robot at x = {x:g} m, got no shape below its pads"
                )
            state[1] -= min(gaps)
            if abs(min(gaps)) < SETTLED:
                break
        depth = placement.resting_depth(
            properties["mass"], properties["stiffness"][0], -properties["gravity_y"]
        )
        state[1] -= placement.PLACEMENT_DEPTH + depth
