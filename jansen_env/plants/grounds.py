"""Ground of each robot, in the forms in which kernels and pymunk use it.

If the ground of a robot is a height line (:class:`jansen_env.Terrain`), the kernels
(:mod:`jansen_env.engine.collision`) derive the contact planes from the line. The status of the
robot contains the stretch of the line that the robot can reach until it has moved by
:data:`MARGIN` and one more step. If the ground consists of pymunk's shapes
(:class:`jansen_env.terrain.Shapes`), pymunk lists the planes
(:mod:`jansen_env.plants.shape_planes`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jansen_env.arrays import Array, Rows
from jansen_env.engine.collision import LARGEST_MARGIN, MARGIN, WAY_OUT
from jansen_env.plants.shape_planes import ShapePlanes
from jansen_env.terrain import Ground, Shapes

LEAST_ROOM = 64  # smallest number of vertices that are reserved for a ground that is exchanged
FASTEST = 200.0  # in m/s; a faster robot counts as diverged if it leaves its stretch of ground


class Grounds:
    """The grounds of n robots.

    Args:
        grounds: Ground of each robot.
        status: Records ``STATUS`` of :mod:`jansen_env.engine.records`, shape (n,). This class keeps
            their fields about the ground up to date.

    Attributes:
        surface: Height lines of all robots, in m, shape (vertices, 2). The line of a robot on
            shapes has the heights that the robot observes, see :meth:`look_down`.
        status: The records that were passed.
        shapes: Shapes of each robot's ground in pymunk, or None for a height line.
        any_shapes: Whether any robot is on shapes.
    """

    def __init__(self, grounds: Sequence[Ground], status: Rows) -> None:
        self.status = status
        count = len(grounds)
        distinct = {id(ground): ground for ground in grounds if not isinstance(ground, Shapes)}
        lines = {key: ground.polyline for key, ground in distinct.items()}
        self.surface = np.concatenate([*lines.values(), np.zeros((0, 2))])
        bounds = dict[int, tuple[int, int]]()
        end = 0
        for key, line in lines.items():
            bounds[key] = end, end + len(line)
            end += len(line)
        # First vertex and room of the ground that belongs to a single robot. At first, several
        # robots may share a ground, and no robot has one to itself.
        self._rooms = np.zeros((count, 2), np.int64)
        self._used = len(self.surface)
        self.shapes: list[ShapePlanes | None] = [None] * count
        self.any_shapes = False
        known = dict[int, ShapePlanes]()  # robots on the same ground share its shapes
        for row, ground in enumerate(grounds):
            if isinstance(ground, Shapes):
                self.set_ground(row, ground, known.get(id(ground)))
                known[id(ground)] = self.shapes_of(row)
            else:
                status["first_vertex"][row], status["end_vertex"][row] = bounds[id(ground)]
        status["ground_x"] = np.inf

    def set_ground(self, row: int, ground: Ground, shapes: ShapePlanes | None = None) -> None:
        """Replace a robot's ground.

        If there is too little room for a height line, :attr:`surface` becomes a new array.

        Args:
            row: Index of the robot.
            ground: The new ground.
            shapes: The ground in pymunk, if it exists already.
        """
        on_shapes = isinstance(ground, Shapes)
        if on_shapes or self.shapes[row] is not None:
            self.shapes[row] = shapes or (ShapePlanes(ground) if on_shapes else None)
            self.any_shapes = any(shapes is not None for shapes in self.shapes)
        self.status["on_shapes"][row] = on_shapes
        self.status["waits"][row] = False
        if isinstance(ground, Shapes):
            self.set_line(row, np.array([[-1.0, ground.lowest], [1.0, ground.lowest]]))
        else:
            self.set_line(row, ground.polyline)
        self.status["ground_x"][row] = np.inf

    def shapes_of(self, row: int) -> ShapePlanes:
        """Return the shapes in pymunk for a robot that is on shapes."""
        shapes = self.shapes[row]
        assert shapes is not None
        return shapes

    def set_line(self, row: int, line: Array) -> None:
        """Replace a robot's height line.

        Args:
            row: Index of the robot.
            line: The new line, in m, shape (vertices, 2).
        """
        status = self.status[row]
        first, room = self._rooms[row].tolist()
        if len(line) > room:
            first = self._used
            room = max(len(line), 2 * room, LEAST_ROOM)
            self._rooms[row] = (first, room)
            self._used = first + room
            if self._used > len(self.surface):
                larger = np.zeros((2 * self._used, 2))
                larger[: len(self.surface)] = self.surface
                self.surface = larger
        self.surface[first : first + len(line)] = line
        status["first_vertex"] = first
        status["end_vertex"] = first + len(line)

    def find_stretch(self, row: int, x: float, extent: float, duration: float) -> None:
        """Find the vertices of its height line that a robot may reach, and put them in its status.

        Args:
            row: Index of the robot.
            x: Position of the crank axis, in m.
            extent: Largest distance of a pad's centre from the axis, in m.
            duration: Duration of the robot's longest step, in s.
        """
        status = self.status[row]
        first, end = int(status["first_vertex"]), int(status["end_vertex"])
        room = MARGIN + FASTEST * duration
        if not status["on_shapes"]:
            reach = room + extent + float(status["pad_radius"]) + max(WAY_OUT, LARGEST_MARGIN)
            line = self.surface[first:end, 0]
            left = int(line.searchsorted(x - reach, "right")) - 1
            right = int(line.searchsorted(x + reach, "left"))
            # The ground continues beyond its ends.
            left = min(max(left, 0), len(line) - 2)
            right = max(min(right, len(line) - 1), left + 1)
            first, end = first + left, first + right + 1
        status["first_near"] = first
        status["end_near"] = end
        status["ground_x"] = x
        status["room"] = room

    def look_down(self, row: int, x: float, y: float, scan: Array) -> None:
        """Measure the ground below a robot on shapes, and at the positions of its height scan.

        Args:
            row: Index of the robot.
            x: Position of the crank axis, in m.
            y: Height of the crank axis, in m. Shapes above it do not count as ground below it.
            scan: Positions relative to the axis at which the robot observes the ground, in m.
        """
        self.set_line(row, self.shapes_of(row).line_below(x, y, scan))
