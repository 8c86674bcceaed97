"""Solids that represent the pieces of a machine.

Each solid is a convex outline, enlarged by a radius, between two heights along the shaft. Cavities
of the same kind are removed from it. A solid moves with a part of a leg, or is fixed in the
chassis. All lengths are in mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jansen_workshop.drawings.convex import Round, hull

# Densities, in kg/m^3.
STEEL = 7850.0
ALLOY = 2700.0
POM = 1410.0
IGLIDUR = 1490.0
RUBBER = 1000.0
# Mass per volume of the cylinders that represent threads, socket heads and nuts, in kg/m^3.
THREADED = 0.79 * STEEL
SOCKET = 0.75 * STEEL
HEXAGON = 0.6 * STEEL
SPOT = 0.05  # radius of the corners of a box


class Carrier(NamedTuple):
    """Part of a leg, or the chassis, that carries solids.

    Attributes:
        leg: Index of the leg; -1 for the chassis.
        body: Number of the body in the leg, from 1 on; 0 for the chassis.
    """

    leg: int
    body: int


CHASSIS = Carrier(-1, 0)


class Axis(NamedTuple):
    """Axis parallel to the shaft, on which screws, nuts and rings are placed.

    Attributes:
        carrier: Part that carries the axis.
        centre: Position of the axis in the axes of the carrying part.
    """

    carrier: Carrier
    centre: complex

    def circle(self, radius: float) -> Round:
        """Return a circle around the axis.

        Args:
            radius: Radius of the circle.
        """
        return Round((self.centre,), radius)


SHAFT_AXIS = Axis(CHASSIS, 0j)


class Cavity(NamedTuple):
    """Cavity in a solid: a hole, a countersink or a thread.

    Attributes:
        outline: Outline of the cavity, in the axes of the solid.
        low: Lower end along the shaft.
        high: Upper end along the shaft.
        thread: Whether the cavity is a thread.
        bushed: Whether a bush fills the cavity. The hole for the screw is then in the bush.
    """

    outline: Round
    low: float
    high: float
    thread: bool = False
    bushed: bool = False


class Solid(NamedTuple):
    """Solid that represents a piece, or a portion of a piece.

    Attributes:
        piece: Index of the piece in :attr:`jansen_workshop.drawings.assembly.Assembly.pieces`.
        carrier: Part of a leg that carries the solid; :data:`CHASSIS` if it is fixed.
        outline: Outline in the axes of the carrying part, or in those of the chassis with the crank
            axis at the origin.
        low: Position of the lower face along the shaft, from the machine's first frame on.
        high: Position of the upper face along the shaft.
        cavities: Cavities that are removed from the solid.
        density: Density in kg/m^3; 0 for a bought component, whose mass is known.
        drilled: Names of the pieces that are drilled together with the solid, so that it may cross
            them.
    """

    piece: int
    carrier: Carrier
    outline: Round
    low: float
    high: float
    cavities: tuple[Cavity, ...] = ()
    density: float = STEEL
    drilled: tuple[str, ...] = ()

    @property
    def fixed(self) -> bool:
        """Whether the solid is fixed in the chassis."""
        return self.carrier.leg < 0

    @property
    def mass(self) -> float:
        """Mass computed from the volume, in kg.

        Where one cavity lies inside another, only the larger cavity is counted.
        """
        volume = self.outline.area * (self.high - self.low)
        for cavity in self.cavities:
            height = min(cavity.high, self.high) - max(cavity.low, self.low)
            area = cavity.outline.area - sum(shape.area for shape in self._inside(cavity))
            volume -= max(height, 0.0) * area
        return 1e-9 * self.density * volume

    def _inside(self, cavity: Cavity) -> list[Round]:
        """Return the outlines of the narrower cavities that pass through a whole cavity."""
        return [
            other.outline
            for other in self.cavities
            if other.low <= cavity.low
            and other.high >= cavity.high
            and other.outline.corners == cavity.outline.corners
            and other.outline.radius < cavity.outline.radius
        ]


class AssemblyPiece(NamedTuple):
    """Piece that is cut, sawn or bought.

    Attributes:
        name: Name in the bill of materials.
        size: Size in the bill of materials.
        stage: Name of the page of the instructions on which the piece is assembled.
        unit: Index of its unit; -1 for the whole machine.
        leg: Index of its leg; -1 if it belongs to no leg, or to several.
        joint: Name of the joint of its pin; empty if there is none.
        body: Number of the body that the piece is, or that it is pressed into, from 1 on; 0 for
            other pieces.
    """

    name: str
    size: str
    stage: str
    unit: int = -1
    leg: int = -1
    joint: str = ""
    body: int = 0


class Screw(NamedTuple):
    """Shank of a screw.

    Attributes:
        shank: Index of the shank's solid.
        radius: Radius of the shank.
        into: Index of the solid whose thread the shank must enter; ``shank`` itself if there is
            none.
        nut: Whether this solid is a nut, which the shank must pass through completely.
    """

    shank: int
    radius: float
    into: int
    nut: bool


def box(corners: Sequence[complex]) -> Round:
    """Return a convex polygon with slightly rounded corners, so that distances are signed.

    Args:
        corners: Points whose convex hull is the polygon.
    """
    shape = np.array(hull(corners))
    before = np.roll(shape, 1)
    after = np.roll(shape, -1)
    into = (shape - before) / abs(shape - before)
    out = (after - shape) / abs(after - shape)
    # Move every side inwards by the radius.
    cross = (into.conj() * out).imag
    moved = shape + SPOT * (out - into) / cross
    return Round(tuple(moved.tolist()), SPOT)
