"""Records of n robots, one per robot, and their parts as arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Array, Bools, Ints, Rows
from jansen_env.engine.records import UNKNOWN_DEFLECTION, Motions, record_dtype

OF_PROCESS = (
    "first_plane",
    "end_plane",
    "first_vertex",
    "end_vertex",
    "first_near",
    "end_near",
    "ground_x",
    "room",
    "on_shapes",
    "waits",
)
"""Fields of a robot's status that are valid only in this process.

They are not restored from a copy; the process computes them again.
"""


class RobotRecords:
    """Values of n robots that change during an episode or at a reset, one record per robot.

    The records do not contain the robots with their link lengths, the terrains, the levels in the
    curriculum or the random number generators. The attributes are views of the records.

    Args:
        count: Number of robots n.
        toes: Number of toes of each robot.
        pads: Number of contact pads of each robot, toes included.
        delayed: Number of torques that are kept for the longest delay.
        pushes: Number of scheduled pushes for which the records have room at first.
        task: Data type of the task's part of a record. None for no such part.

    Attributes:
        data: The records, shape (n,); see :func:`jansen_env.engine.records.record_dtype`.
        robots: Parts whose size is the same for every robot, ``ROBOT`` of
            :mod:`jansen_env.engine.records`, shape (n,).
        states: x, y, theta, psi and their rates, in m, rad and s, shape (n, 8). x and y are the
            position of the crank axis.
        properties: Values that kernels read, ``PROPERTIES``, computed from the robot and
            :attr:`parameters`, shape (n,).
        parameters: Parameters of the current episodes, ``PARAMETERS``, shape (n,).
        status: Pose and contacts between collision detection and time steps, ``STATUS``, shape
            (n,).
        accumulators: Sums over the last control step, ``ACCUMULATORS``, shape (n,).
        statistics: Sums over the last control step for each pad, ``CONTACT_STATISTICS``, shape
            (n, pads).
        deflection: Compression and bend of compliant pads, in m, shape (n, pads, 2).
        slip: Distance that each toe slid under load in the last step, in m, shape (n, toes).
        contact_force: Mean tangential and normal force on each toe in the last step, in N, shape
            (n, toes, 2).
        loads: Normal force on each toe divided by the weight, shape (n, toes).
        torques: Commanded torques, in N m, latest first, shape (n, delayed).
        schedule: Scheduled pushes: start in s, and impulse in x and y in N s, shape (n, pushes, 3).
        task: Records of the task, shape (n,).
        diverged: Whether the last step of each robot was rejected, shape (n,).
        motions: Parts of the records that kernels of the dynamics take.
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
        """Make the attributes views of these records."""
        self.data = data
        self._bytes: NDArray[np.uint8] = data.view(np.uint8).reshape(len(data), -1)
        robots: Any = data["robot"]
        self.robots: Rows = robots
        self.states: Array = robots["state"]
        self.properties: Rows = robots["properties"]
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
        """Return a copy of the records of some robots, for :meth:`restore`.

        Args:
            rows: Indices of the robots, shape (k,).
        """
        return self._bytes.take(rows, axis=0)  # take is faster than indexing

    def restore(self, rows: Ints, saved: NDArray[np.uint8]) -> None:
        """Restore the records of some robots.

        The fields :data:`OF_PROCESS` and the rows of the robots' designs keep their present values.

        Args:
            rows: Indices of the robots, shape (k,).
            saved: Copy of their records that :meth:`copy` returned.
        """
        found = self.status[[*OF_PROCESS]][rows]
        design = self.properties["design"][rows]
        self._bytes[rows] = saved
        self.status[[*OF_PROCESS]][rows] = found
        self.properties["design"][rows] = design

    def make_room(self, pushes: int) -> bool:
        """Make room for a longer schedule of pushes.

        Args:
            pushes: Number of pushes that the schedule has to hold.

        Returns:
            Whether the records, and therefore all views of them, have been replaced by new arrays.
        """
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
