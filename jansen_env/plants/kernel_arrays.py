"""Arguments of the kernels that place and move robots: tables of designs, grounds, and records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jansen_env.arrays import Array, Ints, Rows
from jansen_env.dynamics.pads import pad_sides
from jansen_env.engine import collision
from jansen_env.engine.records import Designs
from jansen_env.plants.design_tables import DesignTables
from jansen_env.plants.grounds import Grounds
from jansen_env.plants.robot_records import RobotRecords
from jansen_env.robot import Robot
from jansen_env.terrain import Ground


class KernelArrays:
    """Arrays of n robots, in the form in which kernels take them.

    Kernels remember their arguments. The arrays are therefore the same objects in every call, until
    a ground, a design or the records need more room.

    Args:
        robots: The robots. All of them have the same pads.
        terrains: Ground of each robot.
        records: Records of the robots.
        engine_settings: Data that the robots have in common, ``WORLD`` of
            :mod:`jansen_env.engine.records`, shape (1,).
        fixed_chassis: Whether all chassis are fixed, so that no robot touches its ground.

    Attributes:
        records: The records that were passed.
        tables: Tables of the robots' designs.
        grounds: Grounds of the robots.
        designs: Tables and grounds that the robots share, in the form in which kernels take them.
        sides: Indices of the two pads at the ends of each side of a link, shape (sides, 2).
        longest_step: Duration of the longest step, in s, for which the stretches of ground in the
            robots' records are long enough.

    Raises:
        ValueError: If the tables of a design have not converged.
        LinkageError: If a robot cannot turn its crank through a full revolution.
    """

    designs: Designs

    def __init__(
        self,
        robots: Sequence[Robot],
        terrains: Sequence[Ground],
        records: RobotRecords,
        engine_settings: Rows,
        fixed_chassis: bool,
    ) -> None:
        self.records = records
        self.tables = DesignTables(robots)
        self.grounds = Grounds(terrains, records.status)
        self.sides = pad_sides(robots[0])
        self.longest_step = float(engine_settings["time_step"][0])
        self._engine_settings = engine_settings
        self._fixed_chassis = fixed_chassis
        self._find_centres = collision.pad_centres.bound()
        self._centres = np.zeros((records.statistics.shape[1], 2))
        self.refresh()

    def refresh(self) -> None:
        """Collect the arrays again after any of them has been replaced by a new array."""
        status = self.records.status
        self.grounds.status = status
        self._ground_x: Array = status["ground_x"]
        model = self.tables.model
        self.designs = Designs(
            self._engine_settings, *model, self.sides, self.tables.depths, self.grounds.surface
        )
        self._centre_arguments = dict[int, tuple[object, ...]]()

    def set_robots(self, rows: Ints, robots: Sequence[Robot]) -> None:
        """Replace the designs of some robots.

        Args:
            rows: Indices of the robots, shape (k,).
            robots: Robots with the new designs, k of them.
        """
        self.tables.set(rows, robots)
        self._ground_x[rows] = np.inf
        self.refresh()

    def set_terrain(self, row: int, terrain: Ground) -> None:
        """Replace the ground of a robot.

        Args:
            row: Index of the robot.
            terrain: The new ground.
        """
        self.grounds.set_ground(row, terrain)
        self._take_surface()

    def look_down(self, row: int, scan: Array) -> None:
        """Measure the ground that a robot on shapes observes; see :meth:`Grounds.look_down`.

        Args:
            row: Index of the robot.
            scan: Positions relative to the crank axis at which the robot observes the height of the
                ground, in m, shape (points,).
        """
        x, y = self.records.states[row, :2].tolist()
        self.grounds.look_down(row, x, y, scan)
        self._take_surface()

    def _take_surface(self) -> None:
        """Use the current array of ground vertices, which may have become a larger array."""
        if self.designs.surface is not self.grounds.surface:
            self.designs = self.designs._replace(surface=self.grounds.surface)

    def split(self, rows: Ints) -> tuple[Ints, list[int]]:
        """Separate robots on height lines from robots on shapes.

        Args:
            rows: Indices of the robots, shape (k,).

        Returns:
            The indices of the robots on height lines, and a list of the indices of the robots on
            shapes. Robots with a fixed chassis count as robots on height lines.
        """
        if self._fixed_chassis or not self.grounds.any_shapes:
            return rows, []
        on_shapes = self.records.status["on_shapes"][rows]
        return rows[~on_shapes], rows[on_shapes].tolist()

    def find_ground(self, row: int, x: float) -> None:
        """Find the stretch of ground that a robot can reach, and store it in the robot's status.

        The method does nothing if the robot is still close to the position for which its stretch
        was found last, or if the chassis is fixed.

        Args:
            row: Index of the robot.
            x: Position of the crank axis, in m.
        """
        if not self._fixed_chassis and not abs(x - self._ground_x[row]) <= collision.MARGIN:
            extent = float(self.tables.extent[self.tables.number[row]])
            self.grounds.find_stretch(row, x, extent, self.longest_step)

    def pad_centres(self, row: int) -> Array:
        """Return the centres of a robot's pads, toes first, in m, shape (pads, 2)."""
        if row not in self._centre_arguments:
            design = self.tables.number[row]
            self._centre_arguments[row] = (
                self.records.states[row],
                self.designs.pads[design],
                self.designs.layout[design],
                self._centres,
            )
        self._find_centres(self._centre_arguments[row])
        return self._centres.copy()
