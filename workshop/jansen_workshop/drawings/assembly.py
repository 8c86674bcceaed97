"""Solid model of a machine, with every part and fastener, and a check that it can be built.

Each solid is a convex outline, enlarged by a radius, between two heights along the shaft. Cavities
of the same kind are removed from it. A solid moves with a part of a leg, or is fixed in the
chassis. All lengths are in mm.

:func:`faults` turns the crank and lists what cannot be built: solids that overlap, screws without
an aligned hole of their size, screws that do not reach their nut or do not enter their thread far
enough, and threads in materials other than metal.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.files.plain_yaml import read_yaml
from jansen_env.robot import Robot
from jansen_env.robot import buildable as built
from jansen_env.robot.buildable import ALUMINIUM
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.linkage import CRANK, FRAME
from jansen_env.robot.part_sizes import feet_of, radii
from jansen_workshop.drawings.materials import LENGTHS, PLAY, Stack, stacks, standard
from jansen_workshop.drawings.mount import (
    COLLAR,
    SHOULDER_HEAD,
    SHOULDER_NUT,
    SIZES,
    mount_of,
)
from jansen_workshop.drawings.outlines import (
    BRACE,
    CutPart,
    Points,
    Round,
    brace,
    frame_ways,
    gap,
    hull,
    link_part,
    motor_plate,
    toe_way,
)
from jansen_workshop.drawings.shaft_order import Placed, carried

STEEL, ALLOY, POM, IGLIDUR, RUBBER = 7850.0, 2700.0, 1410.0, 1490.0, 1000.0  # densities, kg/m^3
METAL = 2500.0  # kg/m^3, lowest density of a metal
THREADED, SOCKET, HEXAGON = 0.79 * STEEL, 0.75 * STEEL, 0.6 * STEEL
"""Mass per volume of the cylinders that represent threads, socket heads and nuts, in kg/m^3."""
TURN = 180  # number of crank angles at which the check is made
TOUCH = 1e-3  # largest overlap that rounding causes between two faces that touch
ALIGNED = 0.02  # largest distance between the axes of a screw and its hole
LOOSE = 0.4  # largest difference between the radii of a hole and its screw
OPEN = 1.0  # least clearance around a screw in an opening that is not its hole
SHAFT_OUT = 3.0  # length of the shaft beyond the last frame
# Horizontal leg, length and wall thickness of the angle profile of a shoe.
SHOE_PROFILE, SHOE_LENGTH, SHOE_WALL = 15.0, 40.0, 2.0
# Distance from a frame to the components tied to it: foam fills it and leaves room for axle ends.
PADDED = 10.0
MAGNET = 4.0, 2.0  # diameter and thickness of the magnet
SPOT = 0.05  # radius of the corners of a box
ARC = 8  # number of solids that represent the rubber strip of a foot


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
        piece: Index of the piece in :attr:`Assembly.pieces`.
        leg: Index of the leg whose part carries the solid; -1 if it is fixed in the chassis.
        body: Number of the body that carries the solid, from 1 on; 0 in the chassis.
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
    leg: int
    body: int
    outline: Round
    low: float
    high: float
    cavities: tuple[Cavity, ...] = ()
    density: float = STEEL
    drilled: tuple[str, ...] = ()

    @property
    def mass(self) -> float:
        """Mass computed from the volume, in kg.

        Where one cavity lies inside another, only the larger cavity is counted.
        """
        volume = self.outline.area * (self.high - self.low)
        for k, cavity in enumerate(self.cavities):
            tall = min(cavity.high, self.high) - max(cavity.low, self.low)
            inner = [
                other.outline
                for i, other in enumerate(self.cavities)
                if i != k
                and other.low <= cavity.low
                and other.high >= cavity.high
                and other.outline.corners == cavity.outline.corners
                and other.outline.radius < cavity.outline.radius
            ]
            area = cavity.outline.area - sum(shape.area for shape in inner)
            volume -= max(tall, 0.0) * area
        return 1e-9 * self.density * volume


class Piece(NamedTuple):
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


class Assembly:
    """All solids of a machine, made from the positions of its parts along the shaft.

    Args:
        robot: Robot that the machine is built from.
        placed: Parts of the robot along the shaft, as returned by
            :func:`jansen_workshop.drawings.shaft_order.layers`.
    """

    def __init__(self, robot: Robot, placed: Sequence[Placed]) -> None:
        self.robot, self.placed = robot, placed
        self.build, self.mount = robot.build, mount_of(robot.build)
        self.metal = self.build is ALUMINIUM
        self.pieces: list[Piece] = []
        self.solids: list[Solid] = []
        self.screws: list[Screw] = []
        self.parts = [link_part(robot, body) for body in range(1, len(robot.bodies) + 1)]
        self.ways = frame_ways(robot)
        self.thickness = self.parts[FRAME - 1].thickness
        self.outside = -self.mount.doublers * self.thickness  # outer face, on the motor's side
        self.end = placed[-1].top
        self.frames: list[int] = []  # indices of the frames' solids, in order
        self.webs: list[int] = []
        self._links()
        self._feet()
        for stack in stacks(robot, placed):
            self._axle(stack) if stack.axle else self._pin(stack)
        self._hubs()
        self._ties()
        self._motor()
        self._bought()

    # Single pieces and solids

    def _piece(self, name: str, size: str, stage: str, **where: Any) -> int:
        """Add a piece and return its index."""
        self.pieces.append(Piece(name, size, stage, **where))
        return len(self.pieces) - 1

    def _add(self, solid: Solid) -> int:
        """Add a solid and return its index."""
        self.solids.append(solid)
        return len(self.solids) - 1

    def _sink(self, solid: int, cavity: Cavity) -> None:
        """Remove a cavity from a solid."""
        whole = self.solids[solid]
        self.solids[solid] = whole._replace(cavities=(*whole.cavities, cavity))

    def _chassis(self, piece: int, outline: Round, low: float, high: float, **more: Any) -> int:
        """Add a solid that is fixed in the chassis."""
        return self._add(Solid(piece, -1, 0, outline, low, high, **more))

    def _screw(
        self,
        piece: int,
        carrier: tuple[int, int],
        centre: complex,
        seat: float,
        way: int,
        radius: float,
        length: float,
        head: tuple[float, float],
        into: int,
        *,
        nut: bool = False,
        sunk: int | None = None,
    ) -> int:
        """Add a screw and return the index of its shank's solid.

        Args:
            piece: Index of the screw's piece.
            carrier: Leg and body that carry the screw.
            centre: Position of the screw's axis.
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
        wide, high = head
        top = seat - way * high if sunk is None else seat
        bottom = seat if sunk is None else seat + way * high
        cap = Round((centre,), wide)
        self._add(Solid(piece, *carrier, cap, min(top, bottom), max(top, bottom), (), SOCKET))
        if sunk is not None:
            self._sink(sunk, Cavity(cap, min(top, bottom), max(top, bottom)))
        tip = seat + way * length
        shank = Round((centre,), radius)
        ends = min(bottom, tip), max(bottom, tip)
        solid = self._add(Solid(piece, *carrier, shank, *ends, (), THREADED))
        self.screws.append(Screw(solid, radius, into, nut))
        return solid

    def _nut(
        self,
        piece: int,
        carrier: tuple[int, int],
        centre: complex,
        seat: float,
        way: int,
        size: tuple[float, float],
        radius: float,
    ) -> int:
        """Add a nut that is seated at ``seat`` and extends along ``way`` (1 or -1)."""
        wide, high = size
        low, top = min(seat, seat + way * high), max(seat, seat + way * high)
        thread = Cavity(Round((centre,), radius), low, top, thread=True)
        shape = Round((centre,), wide)
        return self._add(Solid(piece, *carrier, shape, low, top, (thread,), HEXAGON))

    def _ring(
        self,
        piece: int,
        carrier: tuple[int, int],
        centre: complex,
        radii_: tuple[float, float],
        low: float,
        high: float,
        density: float,
    ) -> int:
        """Add a disc with a bore: a washer, spacer, bush or hub."""
        outer, bore = radii_
        hole = Cavity(Round((centre,), bore), low, high)
        return self._add(
            Solid(piece, *carrier, Round((centre,), outer), low, high, (hole,), density)
        )

    # Legs

    def _links(self) -> None:
        """Add the flat parts of all legs, and the bushes pressed into them."""
        pin, bush, *_ = radii(self.build)
        for item in self.placed:
            stage = {FRAME: "frames", CRANK: "crank"}.get(item.body, "links")
            leg = -1 if item.body in (FRAME, CRANK) else item.leg
            where = {"unit": item.unit, "leg": leg, "body": item.body}
            piece = self._piece(item.part.name, "", stage, **where)
            holes = (*item.part.windows, *item.part.holes)
            cavities = tuple(
                Cavity(hole, item.z, item.top, bushed=self.metal and hole.fit == "press")
                for hole in holes
            )
            carrier = item.leg, item.body
            solid = self._add(
                Solid(
                    piece,
                    *carrier,
                    item.part.outline,
                    item.z,
                    item.top,
                    cavities,
                    item.part.density,
                )
            )
            if item.body == FRAME:
                self.frames.append(solid)
            elif item.body == CRANK:
                self.webs.append(solid)
            for hole in item.part.holes:
                if self.metal and hole.fit == "press":
                    bore = hole.radius - bush + pin
                    size = f"{2 * bore:g} x {2 * hole.radius:g} x {item.part.thickness:g} mm"
                    ring = self._piece("bush", size, stage, **where)
                    self._ring(
                        ring,
                        carrier,
                        hole.corners[0],
                        (hole.radius, bore),
                        item.z,
                        item.top,
                        IGLIDUR,
                    )

    def _feet(self) -> None:
        """Add the shoes or discs, the treads and their screws to all feet."""
        for item in self.placed:
            for toe in feet_of(self.robot, item.body):
                way = toe_way(item.part, toe)
                if self.metal:
                    self._shoe(item, toe, way)
                else:
                    self._strip(item, toe, way)

    def _shoe(self, item: Placed, toe: str, way: complex) -> None:
        """Add two angle profiles, back to back around a foot, each with half of the tread."""
        where = {"unit": item.unit, "leg": item.leg, "joint": toe}
        carrier = item.leg, item.body
        z = item.part.joints[toe]
        spots = [
            hole.corners[0]
            for hole in item.part.holes
            if hole.fit == "clear" and abs(hole.corners[0] - z) < 30.0
        ]
        size = SIZES[self.build.screw]
        reach = max(((spot - z) / -way).real for spot in spots) + size.socket[0]
        tall = next(mm for mm in (20.0, 25.0, 30.0, 40.0) if mm >= reach)
        half, across = 0.5 * SHOE_LENGTH, 1j * way
        plate = _box([z + side * half * across - up * way for side in (-1, 1) for up in (0, tall)])
        level = _box(
            [z + side * half * across - up * way for side in (-1, 1) for up in (0, SHOE_WALL)]
        )
        round_ = 1e3 * built.FOOT_RADIUS
        turns = np.exp(1j * np.linspace(-0.5 * math.pi, 0.5 * math.pi, 13))
        half_round = _box([z + round_ * way * turn for turn in turns])
        holes = tuple(Round((spot,), size.clearance) for spot in spots)
        outer = []
        for face, out in ((item.top, 1), (item.z, -1)):
            profile = f"{tall:g} x {SHOE_PROFILE:g} x {SHOE_WALL:g} mm, {SHOE_LENGTH:g} mm long"
            angle = self._piece("foot-shoe", profile, "foot", **where)
            wall, edge = face + out * SHOE_WALL, face + out * SHOE_PROFILE
            low, high = min(face, wall), max(face, wall)
            cavities = tuple(Cavity(hole, low, high) for hole in holes)
            self._add(Solid(angle, *carrier, plate, low, high, cavities, ALLOY))
            low, high = min(wall, edge), max(wall, edge)
            self._add(Solid(angle, *carrier, level, low, high, (), ALLOY))
            tread = f"half-round, radius {round_:g} mm, {SHOE_PROFILE:g} mm wide"
            rubber = self._piece("tread", tread, "foot", **where)
            low, high = min(face, edge), max(face, edge)
            self._add(Solid(rubber, *carrier, half_round, low, high, (), RUBBER))
            outer.append(wall)
        top, bottom = outer
        thick = item.part.thickness + 2.0 * SHOE_WALL
        length = standard(thick + size.lock_nut[1])
        for spot in spots:
            nut = self._piece("lock nut DIN 985", self.build.screw, "foot", **where)
            into = self._nut(nut, carrier, spot, bottom, -1, size.lock_nut, size.radius)
            name = f"{self.build.screw} x {length:g} mm"
            piece = self._piece("socket screw ISO 4762", name, "foot", **where)
            self._screw(
                piece, carrier, spot, top, -1, size.radius, length, size.socket, into, nut=True
            )

    def _strip(self, item: Placed, toe: str, way: complex) -> None:
        """Add a disc on either side of a toe, a screw through both, and a strip around the rims."""
        where = {"unit": item.unit, "leg": item.leg, "joint": toe}
        carrier = item.leg, item.body
        z, size = item.part.joints[toe], SIZES["M3"]
        disc, thick = 500.0 * self.build.width, item.part.thickness
        low, high = item.z - thick, item.top + thick
        for bottom in (low, item.top):
            piece = self._piece("foot-disc", "", "foot", **where)
            self._ring(
                piece,
                carrier,
                z,
                (disc, size.clearance),
                bottom,
                bottom + thick,
                self.build.density,
            )
        nut = self._piece("thin nut DIN 439", "M3", "foot", **where)
        into = self._nut(nut, carrier, z, low, -1, size.thin_nut, size.radius)
        length = standard(3.0 * thick + size.thin_nut[1])
        piece = self._piece("socket screw ISO 4762", f"M3 x {length:g} mm", "foot", **where)
        self._screw(piece, carrier, z, high, -1, size.radius, length, size.socket, into, nut=True)
        outer = 1e3 * self.build.foot_radius
        wide, half = 1e3 * self.build.foot_width, tread_arc(item.part, toe)
        size_ = f"{wide:g} x {outer - disc:g} mm, {2.0 * half * outer:.0f} mm long"
        strip = self._piece("rubber strip", size_, "foot", **where)
        turns = way * np.exp(1j * np.linspace(-half, half, ARC + 1))
        middle = 0.5 * (low + high)
        for start, stop in pairwise(turns.tolist()):
            inner = disc / abs(0.5 * (start + stop))  # so that the chord clears the rim
            shape = _box([z + inner * start, z + outer * start, z + outer * stop, z + inner * stop])
            ends = middle - 0.5 * wide, middle + 0.5 * wide
            self._add(Solid(strip, *carrier, shape, *ends, (), RUBBER))

    # Pins and axles

    def _rows(
        self, stack: Stack, stage: str, carrier: tuple[int, int], centre: complex, start: float
    ) -> float:
        """Add the washers, spacers and rings of a stack from ``start`` on; return their end."""
        pin, tube = 1e3 * self.build.pin_radius, 1e3 * self.build.tube_radius
        flat = 1e3 * self.build.spacer_radius
        where = {"unit": stack.unit, "leg": stack.leg, "joint": stack.joint}
        z, before = start, start
        for row in stack.rows:
            if row.item:
                z = row.item.top
                continue
            before = z
            for _ in range(row.number):
                if row.name == "frame-doubler":
                    self._doubler(self._piece(row.name, "", "ties"), z)
                    z += row.height
                    continue
                piece = self._piece(row.name, row.size, stage, **where)
                if row.name == "ring":  # rings sit in both ends of the previous spacer
                    continue
                if row.name == "spacer" and stack.axle and self.metal:
                    self._ring(piece, carrier, centre, (tube, tube - 2.0), z, z + row.height, ALLOY)
                elif row.name == "spacer":
                    bore = flat - 1.9
                    self._ring(piece, carrier, centre, (flat, bore), z, z + row.height, ALLOY)
                else:
                    self._ring(piece, carrier, centre, (flat, pin), z, z + row.height, POM)
                z += row.height
            if row.name == "ring":
                rings = range(len(self.pieces) - row.number, len(self.pieces))
                for ring, low in zip(rings, (self.solids[-1].low, before - 3.0), strict=True):
                    self._ring(ring, carrier, centre, (tube - 2.0, pin), low, low + 3.0, POM)
        return z

    def _doubler(self, piece: int, z: float) -> None:
        """Add a copy of the first frame in front of it."""
        first = self.placed[0]
        holes = tuple(Cavity(hole, z, z + self.thickness) for hole in first.part.holes)
        shape, density = first.part.outline, first.part.density
        self._add(Solid(piece, first.leg, FRAME, shape, z, z + self.thickness, holes, density))

    def _pin(self, stack: Stack) -> None:
        """Add the screw, nut, washers and spacers of a pin that joins links."""
        items = [row.item for row in stack.rows if row.item]
        carrier = items[0].leg, items[0].body
        centre = items[0].part.joints[stack.joint]
        crank = stack.joint == self.robot.linkage.bodies[CRANK - 1][1][1]
        stage = "crank" if crank else "pin"
        where = {"unit": stack.unit, "leg": -1 if crank else stack.leg, "joint": stack.joint}
        before = 0.0
        for row in stack.rows:
            if row.item:
                break
            before += row.number * row.height
        start = items[0].z - before
        end = self._rows(stack, stage, carrier, centre, start)
        pin = 1e3 * self.build.pin_radius
        bolt, nut_row = stack.bolt
        nut = self._piece(nut_row.name, nut_row.size, stage, **where)
        piece = self._piece(bolt.name, bolt.size, stage, **where)
        if self.metal:
            end = start + bolt.height
            into = self._nut(nut, carrier, centre, end, 1, SHOULDER_NUT, 2.5)
            cap = Round((centre,), SHOULDER_HEAD[0])
            ends = start - SHOULDER_HEAD[1], start
            self._add(Solid(piece, *carrier, cap, *ends, (), SOCKET))
            shoulder = self._add(Solid(piece, *carrier, Round((centre,), pin), start, end))
            self.screws.append(Screw(shoulder, pin, shoulder, nut=False))
            thread = Round((centre,), 2.5)
            tip = self._add(Solid(piece, *carrier, thread, end, end + SHOULDER_NUT[1]))
            self.screws.append(Screw(tip, 2.5, into, nut=True))
        else:
            size = SIZES["M3"]
            into = self._nut(nut, carrier, centre, end, 1, size.lock_nut, pin)
            flush = end + size.lock_nut[1] - start  # the protruding end is sawn off
            assert bolt.height >= flush - 1e-6
            self._screw(piece, carrier, centre, start, 1, pin, flush, size.socket, into, nut=True)

    def _axle(self, stack: Stack) -> None:
        """Add an axle through the machine, the pieces on it, and the fasteners at its ends."""
        joints = self.robot.linkage.joints
        at = joint_positions(self.robot, stack.side, 0.0) @ np.array([1e3, 1e3j])  # type: ignore[arg-type]
        centre = complex(at[joints.index(stack.joint)] - at[self.robot.linkage.axis])
        carrier = -1, 0
        first = stack.rows[0]
        start = self.outside if first.name == "frame-doubler" else 0.0
        self._rows(stack, "frames", carrier, centre, start)
        pin = 1e3 * self.build.pin_radius
        rod, held = stack.bolt
        ends = [self._piece(held.name, held.size, "frames", joint=stack.joint) for _ in range(2)]
        piece = self._piece(rod.name, rod.size, "frames", joint=stack.joint)
        long = rod.height
        low = 0.5 * (start + self.end - long)
        density = STEEL if self.metal else THREADED
        ends_of = low, low + long
        shank = self._chassis(piece, Round((centre,), pin), *ends_of, density=density)
        if self.metal:
            for end, seat in zip(ends, (start - PLAY - COLLAR[1], self.end + PLAY), strict=True):
                self._ring(end, carrier, centre, (COLLAR[0], pin), seat, seat + COLLAR[1], STEEL)
            self.screws.append(Screw(shank, pin, shank, nut=False))
        else:
            size = SIZES["M3"].lock_nut
            for end, seat, way in zip(ends, (start, self.end), (-1, 1), strict=True):
                into = self._nut(end, carrier, centre, seat, way, size, pin)
                self.screws.append(Screw(shank, pin, into, nut=True))

    # Shaft

    def _hubs(self) -> None:
        """Add the hubs with their screws, and the pieces of the shaft."""
        pin, _, shaft, radius = radii(self.build)
        length, three = 1e3 * self.build.hub_length, SIZES["M3"]
        screws = [hole.corners[0] for hole in self.parts[CRANK - 1].holes[-2:]]
        axis = self.parts[CRANK - 1].joints[self.robot.linkage.bodies[CRANK - 1][1][0]]
        kind = f"spigot {2 * pin:g}" if self.metal else "set screw"
        size = f"{2 * radius:g} x {length:g} mm, bore {2 * shaft:g}, {kind}, two threads M3"
        for k, web in enumerate(self.webs):
            plate = self.solids[web]
            carrier, unit = (plate.leg, plate.body), self.pieces[plate.piece].unit
            out = 1 if k % 2 else -1  # direction from the web to the hub
            face, inner = (plate.high, plate.low) if k % 2 else (plate.low, plate.high)
            low, high = min(face, face + out * length), max(face, face + out * length)
            piece = self._piece("hub", size, "crank", unit=unit)
            hub = self._ring(piece, carrier, axis, (radius, shaft), low, high, ALLOY)
            if self.metal:
                ends = min(face, inner) + 0.5, max(face, inner)
                self._add(Solid(piece, *carrier, Round((axis,), pin), *ends, (), ALLOY))
            for spot in screws:
                thread = Round((spot,), three.radius)
                self._sink(hub, Cavity(thread, low, high, thread=True))
                reach = plate.high - plate.low + min(length, 3.0 * 2.5)
                long = max(mm for mm in LENGTHS if mm <= reach + 1e-6)
                name = f"M3 x {long:g} mm"
                screw = self._piece("countersunk screw ISO 10642", name, "crank", unit=unit)
                self._screw(
                    screw,
                    carrier,
                    spot,
                    inner,
                    out,
                    three.radius,
                    long,
                    three.countersunk,
                    hub,
                    sunk=web,
                )
            if self.metal:
                name = f"3 x {2.0 * radius - 1.0:g} mm"
                piece = self._piece("spring pin ISO 8752", name, "phases", unit=unit)
                half, middle = radius - 0.5, 0.5 * (low + high)
                across = 1j * (screws[0] - axis) / abs(screws[0] - axis)
                shape = Round((axis - (half - 1.5) * across, axis + (half - 1.5) * across), 1.5)
                ends = middle - 1.5, middle + 1.5
                solid = Solid(piece, *carrier, shape, *ends, (), STEEL, ("hub", "shaft"))
                self._add(solid)
        bottoms = [self.shaft_end, *(self.solids[web].high for web in self.webs[1::2])]
        tops = [*(self.solids[web].low for web in self.webs[::2]), self.end + SHAFT_OUT]
        for low, high in zip(bottoms, tops, strict=True):
            piece = self._piece("shaft", f"{2 * shaft:g} x {high - low:.1f} mm", "frames")
            self._chassis(piece, Round((0j,), shaft), low, high)

    @property
    def plate(self) -> tuple[float, float]:
        """Positions of the lower and upper faces of the motor plate along the shaft, in mm."""
        inner = self.outside - self.mount.standoff
        return inner - 1e3 * self.build.plate_thickness, inner

    @property
    def shaft_end(self) -> float:
        """End of the shaft on the motor's side, 1 mm from the motor's shaft or flange, in mm."""
        return self.plate[0] + self.mount.motor_shaft[1] + 1.0

    def _ties(self) -> None:
        """Add a brace between neighbouring units whose adjacent frames face opposite ways."""
        part = brace(self.robot)
        size = SIZES[self.build.screw]
        for last, first in zip(self.frames[1:-1:2], self.frames[2::2], strict=True):
            pair = [self.solids[last], self.solids[first]]
            sides = [self.robot.legs[frame.leg].side for frame in pair]
            if part is None or sides[0] == sides[1]:
                continue
            low, high = pair[0].high, pair[1].low
            z = low
            while z < high - 1e-6:
                cavities = tuple(Cavity(hole, z, z + part.thickness) for hole in part.holes)
                piece = self._piece("brace", "", "ties")
                shape = part.outline
                self._chassis(
                    piece, shape, z, z + part.thickness, cavities=cavities, density=part.density
                )
                z += part.thickness
            length = standard(self.thickness + BRACE + size.thin_nut[1])
            name = f"{self.build.screw} x {length:g} mm"
            for solid, side, seat, nut_seat, way in (
                (last, sides[0], pair[0].low, high, 1),
                (first, sides[1], pair[1].high, low, -1),
            ):
                for reach in self.mount.screws:
                    centre = reach * self.ways[side]
                    nut = self._piece("thin nut DIN 439", self.build.screw, "ties")
                    into = self._nut(
                        nut, (-1, 0), centre, nut_seat, way, size.thin_nut, size.radius
                    )
                    piece = self._piece("countersunk screw ISO 10642", name, "ties")
                    self._screw(
                        piece,
                        (-1, 0),
                        centre,
                        seat,
                        way,
                        size.radius,
                        length,
                        size.countersunk,
                        into,
                        nut=True,
                    )
                    self._countersink(solid, reach, seat, way, size.countersunk)

    def _countersink(
        self, frame: int, reach: float, seat: float, way: int, head: tuple[float, float]
    ) -> None:
        """Remove a screw's head from a frame, at the distance ``reach`` from the crank axis."""
        joints = self.parts[FRAME - 1].joints
        axis = joints[self.robot.linkage.joints[self.robot.linkage.axis]]
        pivot = next(z for z in joints.values() if z != axis)
        spot = axis + reach * (pivot - axis) / abs(pivot - axis)
        low, high = sorted((seat, seat + way * head[1]))
        self._sink(frame, Cavity(Round((spot,), head[0]), low, high))

    # Motor

    def _motor(self) -> None:
        """Add the motor, its plate on standoffs, and the coupling or hub that drives the shaft."""
        mount, size = self.mount, SIZES[self.build.screw]
        side = self.robot.legs[self.placed[0].leg].side
        turn = self.ways[side]
        low, high = self.plate
        part = motor_plate(self.robot).moved(turn, 0j)
        piece = self._piece("motor-plate", "", "motor")
        cavities = tuple(Cavity(hole, low, high) for hole in part.holes)
        self._chassis(piece, part.outline, low, high, cavities=cavities, density=part.density)
        name = self.build.screw
        for reach in mount.screws:
            centre = reach * turn
            standoff = self._piece("standoff", f"{name} x {mount.standoff:g} mm", "ties")
            ends = high, self.outside
            thread = Cavity(Round((centre,), size.radius), *ends, thread=True)
            shape = Round((centre,), mount.standoff_radius)
            into = self._chassis(standoff, shape, *ends, cavities=(thread,), density=ALLOY)
            thick = self.thickness * (1 + mount.doublers)
            long = max(mm for mm in LENGTHS if mm <= thick + 2.0 * 2.0 * size.radius)
            inner = self._piece("countersunk screw ISO 10642", f"{name} x {long:g} mm", "ties")
            self._screw(
                inner,
                (-1, 0),
                centre,
                self.thickness,
                -1,
                size.radius,
                long,
                size.countersunk,
                into,
            )
            self._countersink(self.frames[0], reach, self.thickness, -1, size.countersunk)
            long = standard(high - low + 2.0 * size.radius + 1.0)
            outer = self._piece("socket screw ISO 4762", f"{name} x {long:g} mm", "motor")
            self._screw(outer, (-1, 0), centre, low, 1, size.radius, long, size.socket, into)
        self._motor_itself(turn, low, high)

    def _motor_itself(self, turn: complex, low: float, high: float) -> None:
        """Add the motor with its shaft and screws, and the coupling or the hub on its flange."""
        mount, size, name = self.mount, SIZES[self.build.screw], self.build.screw
        radius, long = mount.motor
        shaft = 1e3 * self.build.shaft_radius
        deep = mount.into_motor
        size_ = next(row[3] for row in bought_parts()[self.robot.material] if row[1] == "gearmotor")
        motor = self._piece("gearmotor", size_, "motor")
        threads = [Round((turn * z,), size.radius) for z in mount.motor_screws]
        wide, thick, circle = mount.flange
        places = [circle * turn * 1j**k for k in range(4)] if circle else []
        threads += [Round((z,), size.radius) for z in places]
        cavities = tuple(Cavity(thread, low - deep, low, thread=True) for thread in threads)
        body = self._chassis(
            motor, Round((0j,), radius), low - long, low, cavities=cavities, density=0.0
        )
        if mount.motor_shaft[1]:
            tip = low + mount.motor_shaft[1]
            self._chassis(motor, Round((0j,), mount.motor_shaft[0]), low, tip, density=0.0)
        for z in mount.motor_screws:
            length = high - low + deep
            piece = self._piece("socket screw ISO 4762", f"{name} x {length:g} mm", "motor")
            self._screw(piece, (-1, 0), turn * z, high, -1, size.radius, length, size.socket, body)
        outer, tall = mount.coupling
        if not circle:
            start = self.shaft_end - 0.5 * tall
            text = f"{2 * shaft:g} to {2 * mount.motor_shaft[0]:g} mm, {2 * outer:g} x {tall:g} mm"
            piece = self._piece("coupling", f"{text}, set screws", "motor")
            self._ring(piece, (-1, 0), 0j, (outer, shaft), start, start + tall, ALLOY)
            return
        size_ = f"flange {2 * wide:g} x {thick:g} mm, boss {2 * outer:g} x {tall:g} mm, bore "
        piece = self._piece("motor-hub", f"{size_}{2 * shaft:g} mm", "motor")
        top = low + thick
        holes = [Round((0j,), shaft), *(Round((z,), size.clearance) for z in places)]
        cavities = tuple(Cavity(hole, low, top) for hole in holes)
        self._chassis(piece, Round((0j,), wide), low, top, cavities=cavities, density=ALLOY)
        self._ring(piece, (-1, 0), 0j, (outer, shaft), top, top + tall, ALLOY)
        pin = self._piece("spring pin ISO 8752", f"3 x {2.0 * outer - 1.0:g} mm", "motor")
        half, middle = outer - 2.0, top + tall - 6.0
        shape = Round((-half * turn, half * turn), 1.5)
        self._chassis(pin, shape, middle - 1.5, middle + 1.5, drilled=("motor-hub", "shaft"))
        for z in places:
            screw = self._piece("socket screw ISO 4762", f"{name} x {thick + deep:g} mm", "motor")
            self._screw(screw, (-1, 0), z, top, -1, size.radius, thick + deep, size.socket, body)

    def _bought(self) -> None:
        """Add the bought components, with the space that batteries, boards and sensors occupy.

        All of them are outside of the outer frames, where nothing moves.
        """
        for stage, name, _, size, number, _, _, place, room in bought_parts()[self.robot.material]:
            if name == "gearmotor":
                continue
            places = {"both": ["first", "last"], "": []}.get(place, [place])
            for k in range(number):
                piece = self._piece(name, size, stage)
                if k < len(places):
                    self._room(piece, places[k], *room)
                elif name == "magnet" and not self.mount.flange[0]:
                    self._magnet(piece)

    def _room(
        self, piece: int, place: str, along: float, across: float, deep: float, shift: float
    ) -> None:
        """Add a box for a bought component, on top of the components that are already there.

        Args:
            piece: Index of the component's piece.
            place: Place of the component, as explained in ``parts.yml``.
            along: Length of the box along the frame's bar.
            across: Width of the box across the bar.
            deep: Depth of the box along the shaft.
            shift: Displacement of the box along the bar.
        """
        first = place in ("first", "plate")
        frame = self.placed[0] if first else self.placed[-1]
        turn = self.ways[self.robot.legs[frame.leg].side]
        joints = frame.part.joints
        axis = joints[self.robot.linkage.joints[self.robot.linkage.axis]]
        reach = abs(next(z for z in joints.values() if z != axis) - axis)
        middle = turn * (shift + (reach if place in ("first", "last") else 0.0))
        half = 0.5 * complex(along, across)
        corners = [half, half.conjugate(), -half, -half.conjugate()]
        shape = _box([middle + turn * corner for corner in corners])
        hardware = self.outside if place == "first" else self.end
        if place == "plate":
            seat, way = self.plate[1], 1
        elif place == "first":
            seat, way = hardware - PADDED, -1
        else:
            seat, way = hardware + PADDED, 1
        below = [
            solid
            for solid in self.solids
            if solid.density == 0.0 and solid.leg < 0 and (solid.low - seat) * way >= 0.0
        ]
        for solid in below:  # boards are stacked on one another
            if solid.piece != piece and _apart(solid.outline, shape) < 0.0:
                top = solid.high if way > 0 else solid.low
                seat = max(seat * way, top * way) * way
        ends = sorted((seat, seat + way * deep))
        self._chassis(piece, shape, *ends, density=0.0)

    def _magnet(self, piece: int) -> None:
        """Add the magnet on the coupling, represented by the ring that it sweeps."""
        outer = self.mount.coupling[0]
        # The magnet is beyond the heads of the motor's screws.
        low = self.plate[1] + SIZES[self.build.screw].socket[1] + 1.0
        rim = outer + MAGNET[1], outer
        self._ring(piece, (-1, 0), 0j, rim, low, low + MAGNET[0], 0.0)

    # Quantities computed from the solids

    @property
    def count(self) -> Counter[tuple[str, str]]:
        """Number of pieces of each name and size."""
        return Counter((piece.name, piece.size) for piece in self.pieces)

    @property
    def extent(self) -> tuple[float, float]:
        """Positions of the lowest and highest faces of all solids along the shaft, in mm."""
        return min(solid.low for solid in self.solids), max(solid.high for solid in self.solids)

    def masses(self) -> list[float]:
        """Return the mass of each piece by its volume, in kg; 0 for a bought component."""
        masses = [0.0] * len(self.pieces)
        for solid in self.solids:
            masses[solid.piece] += solid.mass
        return masses

    def places(self, solid: Solid, psi: NDArray[np.float64]) -> Points:
        """Return the positions of a solid's corners in the axes of the chassis.

        Args:
            solid: Solid whose corners are located.
            psi: Crank angles, in rad, shape (angles,).

        Returns:
            Positions in mm, shape (angles, corners), or (1, corners) for a solid that is fixed in
            the chassis.
        """
        return self.at(solid, solid.outline.corners, psi)

    def at(self, solid: Solid, points: Sequence[complex], psi: NDArray[np.float64]) -> Points:
        """Return the positions in the chassis of points that are given in the axes of a solid.

        Args:
            solid: Solid that carries the points.
            points: Points in the axes of the solid, in mm.
            psi: Crank angles, in rad, shape (angles,).

        Returns:
            Positions in mm, shape (angles, points), or (1, points) for a solid that is fixed in the
            chassis.
        """
        if solid.leg < 0:
            return np.array([points])
        leg, linkage = self.robot.legs[solid.leg], self.robot.linkage
        at = joint_positions(self.robot, leg.side, psi + leg.phase) @ np.array([1e3, 1e3j])
        at = at - at[:, [linkage.axis]]
        part = self.parts[solid.body - 1]
        joints = at[:, [linkage.joints.index(joint) for joint in part.joints]]
        return carried(part, points, joints, leg.side)


def bought_parts() -> dict[str, Any]:
    """Return the bought components, and the materials and prices of the joining parts."""
    return read_yaml(Path(__file__).with_name("parts.yml"))


def _apart(outline: Round, other: Round) -> float:
    """Return the distance of two outlines, in mm; negative where they overlap."""
    room = gap(np.array(outline.corners), np.array(other.corners))
    return float(room) - outline.radius - other.radius


def tread_arc(part: CutPart, toe: str) -> float:
    """Return half of the angle around a toe that the strip on the foot's rim covers, in rad.

    Args:
        part: Part that carries the foot.
        toe: Name of the toe.
    """
    z, way = part.joints[toe], toe_way(part, toe)
    others = [other - z for name, other in part.joints.items() if name != toe]
    return 0.5 * math.pi - max(abs(float(np.angle(other / -way))) for other in others)


def _box(corners: Sequence[complex]) -> Round:
    """Return a convex polygon with slightly rounded corners, so that distances are signed."""
    shape = np.array(hull(corners))
    before, after = np.roll(shape, 1), np.roll(shape, -1)
    into = (shape - before) / abs(shape - before)
    out = (after - shape) / abs(after - shape)
    # Move every side inwards by the radius.
    cross = (into.conj() * out).imag
    moved = shape + SPOT * (out - into) / cross
    return Round(tuple(moved.tolist()), SPOT)


def _inside(place: Points, radius: float, hole: Points, room: float) -> bool:
    """Return whether an outline lies within a round hole at all crank angles."""
    return bool((abs(place - hole[..., :1]).max() + radius) <= room + TOUCH)


def faults(assembly: Assembly, angles: int = TURN) -> list[str]:
    """Return the reasons why a machine cannot be built.

    Args:
        assembly: Solids of the machine.
        angles: Number of crank angles at which overlaps are checked.

    Returns:
        One sentence per fault. The list is empty if there are no faults.
    """
    return [*_overlaps(assembly, angles), *_misfits(assembly)]


def _overlaps(assembly: Assembly, angles: int) -> Iterator[str]:
    """Yield a description of each pair of solids that overlap at some crank angle."""
    psi = np.linspace(0.0, 2.0 * math.pi, angles, endpoint=False)
    solids = assembly.solids
    places = [assembly.places(solid, psi) for solid in solids]
    middles = [place.mean(axis=-1) for place in places]
    reaches = [
        float(abs(place - middle[:, None]).max()) + solid.outline.radius
        for place, middle, solid in zip(places, middles, solids, strict=True)
    ]
    order = sorted(range(len(solids)), key=lambda k: solids[k].low)
    seen = set()
    for n, i in enumerate(order):
        for k in order[n + 1 :]:
            if solids[k].low > solids[i].high - TOUCH:
                break
            pair = solids[i], solids[k]
            low, high = pair[1].low, min(pair[0].high, pair[1].high)
            if high - low < TOUCH or pair[0].piece == pair[1].piece:
                continue
            near = abs(middles[i] - middles[k]).min()
            if near > reaches[i] + reaches[k]:
                continue
            pieces = [assembly.pieces[solid.piece] for solid in pair]
            if any(a.name in s.drilled for a, s in ((pieces[0], pair[1]), (pieces[1], pair[0]))):
                continue
            depth = _depth(assembly, pair, (places[i], places[k]), (low, high), psi)
            if depth > TOUCH:
                names = " and ".join(f"{piece.name} {piece.size}".strip() for piece in pieces)
                text = f"{names} overlap by {depth:.2f} mm in the plane and {high - low:.2f} along"
                where = f", between {low:.1f} and {high:.1f} mm"
                if names not in seen:
                    yield text + where
                seen.add(names)


def _depth(
    assembly: Assembly,
    pair: tuple[Solid, Solid],
    places: tuple[Points, Points],
    ends: tuple[float, float],
    psi: NDArray[np.float64],
) -> float:
    """Return how far two solids overlap in the plane, in mm; 0 if one is in a hole of the other."""
    a, b = places
    times = max(len(a), len(b))
    a = np.broadcast_to(a, (times, a.shape[1]))
    b = np.broadcast_to(b, (times, b.shape[1]))
    apart = gap(a, b) - pair[0].outline.radius - pair[1].outline.radius
    if apart.min() >= -TOUCH:
        return 0.0
    for outer, inner, place in ((pair[0], pair[1], b), (pair[1], pair[0], a)):
        for cavity in outer.cavities:
            covers = cavity.low <= ends[0] + TOUCH and cavity.high >= ends[1] - TOUCH
            if covers and len(cavity.outline.corners) == 1:
                hole = assembly.at(outer, cavity.outline.corners, psi)
                if _inside(place, inner.outline.radius, hole, cavity.outline.radius):
                    return 0.0
    return -float(apart.min())


def _misfits(assembly: Assembly) -> Iterator[str]:
    """Yield screws without an aligned hole of their size, and threads that do not hold."""
    psi = np.array([0.0, 1.0, 2.5, 4.0])
    solids, pieces = assembly.solids, assembly.pieces
    for solid in solids:
        if any(cavity.thread for cavity in solid.cavities) and 0.0 < solid.density < METAL:
            yield f"{pieces[solid.piece].name} has a thread, but is not of metal"
    for screw in assembly.screws:
        shank = solids[screw.shank]
        name = f"{pieces[shank.piece].name} {pieces[shank.piece].size}"
        axis = assembly.places(shank, psi)
        for solid in solids:
            low, high = max(solid.low, shank.low), min(solid.high, shank.high)
            if high - low < TOUCH or solid.piece == shank.piece:
                continue
            place = assembly.places(solid, psi)
            times = max(len(place), len(axis))
            over = gap(
                np.broadcast_to(place, (times, place.shape[1])),
                np.broadcast_to(axis, (times, 1)),
            )
            if over.min() > solid.outline.radius:
                continue
            rooms = []
            for cavity in solid.cavities:
                covers = cavity.low <= low + TOUCH and cavity.high >= high - TOUCH
                if covers and len(cavity.outline.corners) == 1:
                    off = abs(assembly.at(solid, cavity.outline.corners, psi) - axis).max()
                    room = cavity.outline.radius
                    if off < ALIGNED or off < room - screw.radius - OPEN:
                        rooms.append(screw.radius if cavity.bushed or off >= ALIGNED else room)
            other = pieces[solid.piece].name
            if not rooms:
                yield f"{name} has no aligned hole in {other}"
            elif other not in ("spacer", "ring") and min(rooms) > screw.radius + LOOSE:
                yield f"{name} has a hole of {2 * min(rooms):.2f} mm in {other}"
        if screw.into == screw.shank:
            continue
        held = solids[screw.into]
        depth = min(held.high, shank.high) - max(held.low, shank.low)
        wanted = held.high - held.low if screw.nut else 2.0 * screw.radius
        if depth < wanted - TOUCH:
            yield f"{name} enters {pieces[held.piece].name} by {depth:.1f} mm of {wanted:.1f}"
