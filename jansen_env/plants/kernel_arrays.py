"""What kernels take to place and move robots: tables of designs, grounds, and records."""

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
    """The arrays of n robots that kernels take.

    Kernels remember their arguments, so that these are the same objects in each call, until a
    ground, a design or the records need more room.

    Args:
        robots: The robots; all have the same pads.
        terrains: Ground of each robot.
        records: Records of the robots.
        world: Shape (1,), ``WORLD`` of :mod:`jansen_env.engine.records`.
        held: Whether all chassis are held, so that no robot meets its ground.

    Attributes:
        records: The records that were passed.
        tables: Tables of the robots' designs.
        grounds: Grounds of the robots.
        designs: What the robots share, as kernels take it.
        sides: Pads at the ends of links' sides, shape (sides, 2).
        longest_step: Duration of the robots' longest step in s, for which they know their ground.

    Raises:
        ValueError: If tables have not converged.
        LinkageError: If a robot cannot turn its crank.
    """

    designs: Designs

    def __init__(
        self,
        robots: Sequence[Robot],
        terrains: Sequence[Ground],
        records: RobotRecords,
        world: Rows,
        held: bool,
    ) -> None:
        self.records = records
        self.tables = DesignTables(robots)
        self.grounds = Grounds(terrains, records.status)
        self.sides = pad_sides(robots[0])
        self.longest_step = float(world["time_step"][0])
        self._world = world
        self._held = held
        self._find_centres = collision.pad_centres.bound()
        self._centres = np.zeros((records.statistics.shape[1], 2))
        self.refresh()

    def refresh(self) -> None:
        """Take the arrays again, after any of them has been made anew."""
        status = self.records.status
        self.grounds.status = status
        self._asked_x: Array = status["asked_x"]
        model = self.tables.model
        self.designs = Designs(
            self._world, *model, self.sides, self.tables.depths, self.grounds.surface
        )
        self._centre_arguments = dict[int, tuple[object, ...]]()

    def set_robots(self, rows: Ints, robots: Sequence[Robot]) -> None:
        """Give robots (k,) other designs."""
        self.tables.set(rows, robots)
        self._asked_x[rows] = np.inf
        self.refresh()

    def set_terrain(self, row: int, terrain: Ground) -> None:
        """Give a robot another ground."""
        self.grounds.set_ground(row, terrain)
        self._take_surface()

    def look_down(self, row: int, scan: Array) -> None:
        """Measure the ground that a robot on shapes observes, see :meth:`Grounds.look_down`."""
        x, y = self.records.states[row, :2].tolist()
        self.grounds.look_down(row, x, y, scan)
        self._take_surface()

    def _take_surface(self) -> None:
        """Take the vertices of the grounds, which may have been moved to a larger array."""
        if self.designs.surface is not self.grounds.surface:
            self.designs = self.designs._replace(surface=self.grounds.surface)

    def split(self, rows: Ints) -> tuple[Ints, list[int]]:
        """Return those of robots (k,) that are on height lines, and those on shapes."""
        if self._held or not self.grounds.any_shapes:
            return rows, []
        on_shapes = self.records.status["on_shapes"][rows]
        return rows[~on_shapes], rows[on_shapes].tolist()

    def ask_ground(self, row: int, x: float) -> None:
        """Note the stretch of ground that a robot at x, m, can reach, unless it is known there."""
        if not self._held and not abs(x - self._asked_x[row]) <= collision.MARGIN:
            extent = float(self.tables.extent[self.tables.number[row]])
            self.grounds.find_stretch(row, x, extent, self.longest_step)

    def pad_centres(self, row: int) -> Array:
        """Return the centres (pads, 2) of a robot's pads in m, toes first."""
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
