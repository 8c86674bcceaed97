"""The records of n robots, one for each, and their parts as arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Array, Bools, Ints, Rows
from jansen_env.engine.records import UNKNOWN_DEFLECTION, Motions, record_dtype

OF_PROCESS = (
    "first_plane", "end_plane", "first_vertex", "end_vertex", "first_near", "end_near", "asked_x",
    "room", "on_shapes", "waits",
)  # fmt: skip
"""Fields of a robot's status that only this process understands: they are found again."""


class RobotRecords:
    """Everything that the future of n robots depends on, one record per robot.

    A copy of a record is a copy of the robot. The attributes are views of the records.

    Args:
        count: Number of robots n.
        toes: Number of toes of each robot.
        pads: Number of contact pads of each robot, toes included.
        delayed: Number of torques kept for the longest delay.
        pushes: Number of pushes for which schedules have room at first.
        task: Record of the task; None for none.

    Attributes:
        data: Shape (n,), the records, see :func:`jansen_env.engine.records.record_dtype`.
        robots: Shape (n,), ``ROBOT`` of :mod:`jansen_env.engine.records`.
        states: Shape (n, 8), x, y, theta, psi and their rates in m, rad and s; x, y the crank axis.
        params: Shape (n,), ``PARAMS``, derived from the robot and :attr:`parameters`.
        parameters: Shape (n,), ``PARAMETERS`` of the present episodes.
        status: Shape (n,), ``STATUS``.
        accumulators: Shape (n,), ``ACCUMULATORS``, sums over the last control step.
        statistics: Shape (n, pads), ``CONTACT_STATISTICS``, sums over the same step.
        deflection: Shape (n, pads, 2), compression and bend of compliant pads in m.
        slip: Shape (n, toes), path in m that each toe slid while loaded in the last step.
        contact_force: Shape (n, toes, 2), mean tangential and normal forces in N.
        loads: Shape (n, toes), normal forces divided by the weight.
        torques: Shape (n, delayed), commanded torques in N m, latest first.
        schedule: Shape (n, pushes, 3), start in s and impulse in N s.
        task: Shape (n,), record of the task.
        diverged: Shape (n,), whether the last step was refused.
        motions: The parts that kernels of the dynamics take.
    """

    def __init__(
        self,
        count: int,
        toes: int,
        pads: int,
        delayed: int = 2,
        pushes: int = 0,
        task: np.dtype[np.void] | None = None,
    ) -> None:
        self._sizes = (toes, pads, delayed, pushes, task)
        self._connect(np.zeros(count, record_dtype(*self._sizes)))
        self.deflection[:] = UNKNOWN_DEFLECTION

    def _connect(self, data: Rows) -> None:
        """Let the attributes be views of these records."""
        self.data = data
        self._bytes: NDArray[np.uint8] = data.view(np.uint8).reshape(len(data), -1)
        robots: Any = data["robot"]
        self.robots: Rows = robots
        self.states: Array = robots["state"]
        self.params: Rows = robots["params"]
        self.parameters: Rows = robots["parameters"]
        self.status: Rows = robots["status"]
        self.accumulators: Rows = robots["accumulators"]
        self.diverged: Bools = robots["diverged"]
        self.statistics: Rows = data["statistics"]
        self.deflection: Array = self.statistics["deflection"]
        self.slip: Array = data["slip"]
        self.contact_force: Array = data["contact_force"]
        self.loads: Array = data["load"]
        self.torques: Array = data["torques"]
        self.schedule: Array = data["schedule"]
        self.task: Rows = data["task"]
        self.motions = Motions(self.robots, self.statistics, self.slip, self.contact_force)

    def copy(self, rows: Ints) -> NDArray[np.uint8]:
        """Return a copy of the records of robots (k,), for :meth:`restore`."""
        return self._bytes.take(rows, axis=0)  # quicker than an index

    def restore(self, rows: Ints, saved: NDArray[np.uint8]) -> None:
        """Make the records of robots (k,) what they were, but for what the process found."""
        found = self.status[[*OF_PROCESS]][rows]
        design = self.params["design"][rows]
        self._bytes[rows] = saved
        self.status[[*OF_PROCESS]][rows] = found
        self.params["design"][rows] = design

    def make_room(self, pushes: int) -> bool:
        """Make room for a longer schedule; return whether all views are others now."""
        toes, pads, delayed, room, task = self._sizes
        if pushes <= room:
            return False
        self._sizes = (toes, pads, delayed, pushes, task)
        data = np.zeros(len(self.data), record_dtype(*self._sizes))
        for name in self.data.dtype.names or ():
            if name != "schedule":
                data[name] = self.data[name]
        data["schedule"][:, :room] = self.data["schedule"]
        self._connect(data)
        return True

    def __getstate__(self) -> dict[str, Any]:
        return {"sizes": self._sizes, "data": self.data}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self._sizes = saved["sizes"]
        data = np.zeros(len(saved["data"]), record_dtype(*self._sizes))
        data.view(np.uint8)[:] = saved["data"].view(np.uint8)
        self._connect(data)
