"""Model of a machine as pieces and solids, with the sizes and positions that its parts share.

:func:`jansen_workshop.drawings.machine_solids.assemble` fills the model. All lengths are in mm.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.robot import Robot
from jansen_env.robot.buildable import ALUMINIUM
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.linkage import FRAME
from jansen_workshop.drawings.convex import Points
from jansen_workshop.drawings.mount import SIZES, Size, mount_of
from jansen_workshop.drawings.outlines import frame_ways, link_part
from jansen_workshop.drawings.shaft_order import Placed, carried
from jansen_workshop.drawings.solids import (
    HEXAGON,
    SOCKET,
    THREADED,
    AssemblyPiece,
    Axis,
    Cavity,
    Screw,
    Solid,
)


class Assembly:
    """Pieces of a machine and the solids that represent them.

    Args:
        robot: Robot that the machine is built from.
        placed: Parts of the robot along the shaft, as returned by
            :func:`jansen_workshop.drawings.shaft_order.layers`.

    Attributes:
        robot: Robot that the machine is built from.
        placed: Parts of the robot along the shaft.
        build: Sizes and materials of the build.
        mount: Sizes of the motor and its mounting.
        metal: Whether the build is the one of aluminium.
        parts: Flat part of each body.
        ways: Direction from the crank axis along the frame's bar, by side.
        thickness: Thickness of a frame.
        outside: Position of the outer face on the motor's side along the shaft.
        end: Position of the outer face on the other side along the shaft.
        pieces: All pieces.
        solids: All solids.
        screws: Shanks of all screws.
        frames: Indices of the frames' solids, in order along the shaft.
        webs: Indices of the cranks' solids, in order along the shaft.
    """

    def __init__(self, robot: Robot, placed: Sequence[Placed]) -> None:
        self.robot = robot
        self.placed = placed
        self.build = robot.build
        self.mount = mount_of(robot.build)
        self.metal = self.build is ALUMINIUM
        self.parts = [link_part(robot, body) for body in range(1, len(robot.bodies) + 1)]
        self.ways = frame_ways(robot)
        self.thickness = self.parts[FRAME - 1].thickness
        self.outside = -self.mount.doublers * self.thickness
        self.end = placed[-1].top
        self.pieces: list[AssemblyPiece] = []
        self.solids: list[Solid] = []
        self.screws: list[Screw] = []
        self.frames: list[int] = []
        self.webs: list[int] = []

    @property
    def screw_size(self) -> Size:
        """Sizes of the screws that hold frames, motor and shoes."""
        return SIZES[self.build.screw]

    @property
    def motor_plate(self) -> tuple[float, float]:
        """Positions of the lower and upper faces of the motor plate along the shaft."""
        inner = self.outside - self.mount.standoff
        return inner - 1e3 * self.build.plate_thickness, inner

    @property
    def shaft_end(self) -> float:
        """End of the shaft on the motor's side, 1 mm from the motor's shaft or flange."""
        return self.motor_plate[0] + self.mount.motor_shaft[1] + 1.0

    # Adding pieces and solids

    def add_piece(self, name: str, size: str, stage: str, **place: Any) -> int:
        """Add a piece and return its index.

        Args:
            name: Name in the bill of materials.
            size: Size in the bill of materials.
            stage: Name of the page of the instructions on which the piece is assembled.
            **place: Further attributes of :class:`~jansen_workshop.drawings.solids.AssemblyPiece`.
        """
        self.pieces.append(AssemblyPiece(name, size, stage, **place))
        return len(self.pieces) - 1

    def add_solid(self, solid: Solid) -> int:
        """Add a solid and return its index.

        Args:
            solid: Solid to add.
        """
        self.solids.append(solid)
        return len(self.solids) - 1

    def cut_cavity(self, solid: int, cavity: Cavity) -> None:
        """Remove a cavity from a solid.

        Args:
            solid: Index of the solid.
            cavity: Cavity to remove.
        """
        whole = self.solids[solid]
        self.solids[solid] = whole._replace(cavities=(*whole.cavities, cavity))

    def add_ring(
        self,
        piece: int,
        axis: Axis,
        radii: tuple[float, float],
        low: float,
        high: float,
        density: float,
    ) -> int:
        """Add a disc with a bore, such as a washer, spacer, bush or hub; return its index.

        Args:
            piece: Index of the ring's piece.
            axis: Axis of the ring.
            radii: Outer radius, and radius of the bore.
            low: Position of the lower face along the shaft.
            high: Position of the upper face along the shaft.
            density: Density in kg/m^3; 0 for a bought component.
        """
        outer, bore = radii
        hole = Cavity(axis.circle(bore), low, high)
        disc = axis.circle(outer)
        return self.add_solid(Solid(piece, axis.carrier, disc, low, high, (hole,), density))

    def add_nut(
        self,
        piece: int,
        axis: Axis,
        seat: float,
        way: int,
        size: tuple[float, float],
        radius: float,
    ) -> int:
        """Add a nut and return the index of its solid.

        Args:
            piece: Index of the nut's piece.
            axis: Axis of the nut.
            seat: Position along the shaft at which the nut is seated.
            way: Direction along the shaft in which the nut extends from there, 1 or -1.
            size: Radius to the nut's corners, and its height.
            radius: Radius of the thread.
        """
        corner_radius, height = size
        low, high = sorted((seat, seat + way * height))
        thread = Cavity(axis.circle(radius), low, high, thread=True)
        shape = axis.circle(corner_radius)
        return self.add_solid(Solid(piece, axis.carrier, shape, low, high, (thread,), HEXAGON))

    def add_screw(
        self,
        piece: int,
        axis: Axis,
        *,
        seat: float,
        way: int,
        radius: float,
        length: float,
        head: tuple[float, float],
        into: int,
        nut: bool = False,
        sunk: int | None = None,
    ) -> int:
        """Add a screw and return the index of its shank's solid.

        Args:
            piece: Index of the screw's piece.
            axis: Axis of the screw.
            seat: Position along the shaft at which the head is seated.
            way: Direction of the shank along the shaft, 1 or -1.
            radius: Radius of the shank.
            length: Length of the screw.
            head: Radius and height of the head.
            into: Index of the solid whose thread the screw enters.
            nut: Whether this solid is a nut.
            sunk: Index of the solid in which a countersunk head lies, flush with its face. None for
                a screw with a socket head.
        """
        head_radius, head_height = head
        if sunk is None:
            top = seat - way * head_height
            bottom = seat
        else:
            top = seat
            bottom = seat + way * head_height
        cap = axis.circle(head_radius)
        low, high = sorted((top, bottom))
        self.add_solid(Solid(piece, axis.carrier, cap, low, high, density=SOCKET))
        if sunk is not None:
            self.cut_cavity(sunk, Cavity(cap, low, high))
        low, high = sorted((bottom, seat + way * length))
        shank = axis.circle(radius)
        solid = self.add_solid(Solid(piece, axis.carrier, shank, low, high, density=THREADED))
        self.screws.append(Screw(solid, radius, into, nut))
        return solid

    def countersink_frame(
        self, frame: int, reach: float, seat: float, way: int, head: tuple[float, float]
    ) -> None:
        """Remove a countersunk head from a frame.

        Args:
            frame: Index of the frame's solid.
            reach: Distance of the screw from the crank axis, along the frame's bar.
            seat: Position along the shaft of the face with which the head is flush.
            way: Direction of the shank along the shaft, 1 or -1.
            head: Radius and height of the head.
        """
        joints = self.parts[FRAME - 1].joints
        axis = joints[self.robot.linkage.joints[self.robot.linkage.axis]]
        pivot = next(z for z in joints.values() if z != axis)
        spot = axis + reach * (pivot - axis) / abs(pivot - axis)
        head_radius, head_height = head
        low, high = sorted((seat, seat + way * head_height))
        outline = Axis(self.solids[frame].carrier, spot).circle(head_radius)
        self.cut_cavity(frame, Cavity(outline, low, high))

    # Quantities computed from the solids

    @property
    def count(self) -> Counter[tuple[str, str]]:
        """Number of pieces of each name and size."""
        return Counter((piece.name, piece.size) for piece in self.pieces)

    @property
    def extent(self) -> tuple[float, float]:
        """Positions of the lowest and highest faces of all solids along the shaft."""
        return min(solid.low for solid in self.solids), max(solid.high for solid in self.solids)

    def masses(self) -> list[float]:
        """Return the mass of each piece by its volume, in kg; 0 for a bought component."""
        masses = [0.0] * len(self.pieces)
        for solid in self.solids:
            masses[solid.piece] += solid.mass
        return masses

    def corner_positions(self, solid: Solid, psi: NDArray[np.float64]) -> Points:
        """Return the positions of a solid's corners in the axes of the chassis.

        Args:
            solid: Solid whose corners are located.
            psi: Crank angles, in rad, shape (angles,).

        Returns:
            Positions in mm, shape (angles, corners), or (1, corners) for a solid that is fixed in
            the chassis.
        """
        return self.positions(solid, solid.outline.corners, psi)

    def positions(
        self, solid: Solid, points: Sequence[complex], psi: NDArray[np.float64]
    ) -> Points:
        """Return the positions in the axes of the chassis of points on a solid.

        Args:
            solid: Solid that carries the points.
            points: Points in the axes of the solid, in mm.
            psi: Crank angles, in rad, shape (angles,).

        Returns:
            Positions in mm, shape (angles, points), or (1, points) for a solid that is fixed in the
            chassis.
        """
        if solid.fixed:
            return np.array([points])
        leg = self.robot.legs[solid.carrier.leg]
        linkage = self.robot.linkage
        at = joint_positions(self.robot, leg.side, psi + leg.phase) @ np.array([1e3, 1e3j])
        at = at - at[:, [linkage.axis]]
        part = self.parts[solid.carrier.body - 1]
        joints = at[:, [linkage.joints.index(joint) for joint in part.joints]]
        return carried(part, points, joints, leg.side)
