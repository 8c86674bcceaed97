"""Tables of the designs in a batch. Robots of the same design share one set of tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Ints
from jansen_env.dynamics.reduced import Tables, compile_robot, design_of
from jansen_env.engine.reaches import measure_reach
from jansen_env.engine.records import Model
from jansen_env.robot import Robot
from jansen_env.robot.robot_arrays import leg_rows

PITCHES = 256  # number of pitches for which the depth of pads other than toes is known


class DesignTables:
    """The kernels' arrays of designs. A robot's design is a row of each array.

    Args:
        robots: All robots of the batch. All of them have the same pads.

    Attributes:
        number: Row of each robot, shape (robots,).
        model: Tables of all designs, along the first axis of each array.
        depths: Depths of pads other than toes, in m, shape (designs, PITCHES + 1); see
            :func:`jansen_env.engine.reaches.measure_reach`.
        extent: Largest distance of a pad's centre from the crank axis, in m, shape (designs,).
        farthest: Largest |c| and |c'| of a robot without its load, in kg m, and largest |p| and
            |p'| of its pads, in m, shape (designs, 2, 2).

    Raises:
        ValueError: If the tables of a design have not converged.
        LinkageError: If a robot cannot turn its crank through a full revolution.
    """

    def __init__(self, robots: Sequence[Robot]) -> None:
        tables = compile_robot(robots[0])
        self.number = np.zeros(len(robots), np.int64)
        self._users = np.array([len(robots)])
        self.model = kernel_model(tables)
        self.depths = np.zeros((1, PITCHES + 1))
        self.extent = np.zeros(1)
        self.farthest = np.zeros((1, 2, 2))
        self._designs: list[Robot | None] = [None]
        self._rows: dict[Robot, int] = {}
        self._put(0, design_of(robots[0]), tables)
        self.set(np.arange(len(robots)), robots)

    def set(self, rows: Ints, robots: Sequence[Robot]) -> None:
        """Set the designs of some robots. After an error, nothing has changed.

        If there is too little room for new designs, all arrays are replaced by larger ones.

        Args:
            rows: Indices of the robots, shape (k,).
            robots: Robots with the new designs, k of them.

        Raises:
            ValueError: If the tables of a design have not converged.
            LinkageError: If a robot cannot turn its crank through a full revolution.
        """
        designs = {id(robot): design_of(robot) for robot in {id(r): r for r in robots}.values()}
        each = [designs[id(robot)] for robot in robots]
        new = {key: compile_robot(key) for key in designs.values() if key not in self._rows}
        np.subtract.at(self._users, self.number[rows], 1)
        np.add.at(self._users, [self._rows[key] for key in each if key in self._rows], 1)
        free = np.flatnonzero(self._users == 0)
        if len(free) < len(new):
            self._grow(len(new) - len(free))
            free = np.flatnonzero(self._users == 0)
        for row, (design, tables) in zip(free.tolist(), new.items(), strict=False):
            self._put(row, design, tables)
            self._users[row] = each.count(design)
        self.number[rows] = [self._rows[key] for key in each]

    def _grow(self, count: int) -> None:
        """Make room for ``count`` additional designs."""

        def longer(old: NDArray[Any]) -> NDArray[Any]:
            # Memory of zeros costs nothing until it is written to.
            grown = np.zeros((len(old) + count, *old.shape[1:]), old.dtype)
            grown[: len(old)] = old
            return grown

        self.model = Model(*map(longer, self.model))
        for name in ("depths", "extent", "farthest", "_users"):
            setattr(self, name, longer(getattr(self, name)))
        self._designs += [None] * count

    def _put(self, row: int, design: Robot, tables: Tables) -> None:
        """Write the tables of a design into a row whose present design no robot uses.

        Args:
            row: The row.
            design: The new design.
            tables: Tables of the new design.
        """
        if (old := self._designs[row]) is not None:
            del self._rows[old]
        self._designs[row] = design
        self._rows[design] = row
        for all_tables, table in zip(self.model, kernel_model(tables), strict=True):
            all_tables[row] = table[0]
        self.extent[row] = measure_reach(
            tables.body,
            tables.pads,
            len(tables.robot.linkage.toes),
            leg_rows(tables.robot),
            self.farthest[row],
            self.depths[row],
            np.empty(PITCHES),
        )


def kernel_model(tables: Tables) -> Model:
    """Return the tables of one design in the form in which kernels take them.

    The first axis of each array has length 1.
    """
    views = tables.body, tables.pads, tables.layout.rows, tables.bearings, tables.springs
    return Model(*(np.array([table]) for table in views))
