"""Solids of a whole machine: legs, drive, braces between the frames, and bought components.

All lengths are in mm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from jansen_env.robot import Robot
from jansen_workshop.drawings.assembly import Assembly
from jansen_workshop.drawings.bought import read_catalogue
from jansen_workshop.drawings.convex import Round, gap
from jansen_workshop.drawings.drive_solids import (
    MOTOR,
    SHAFT_OUT,
    add_hubs,
    add_motor,
    add_motor_plate,
    add_shaft,
)
from jansen_workshop.drawings.leg_solids import add_axle, add_feet, add_links, add_pin
from jansen_workshop.drawings.materials import stacks, standard
from jansen_workshop.drawings.outlines import BRACE, CutPart, brace
from jansen_workshop.drawings.shaft_order import Placed
from jansen_workshop.drawings.solids import CHASSIS, SHAFT_AXIS, Axis, Cavity, Solid, box

# Distance from a frame to the components tied to it: foam fills it and leaves room for axle ends.
PADDED = 10.0
PLACES = {"both": [("first", 1), ("last", 1)], "beside": [("shaft", 1), ("shaft", -1)], "": []}
"""Places of several equal components, with the sign of their shift along the bar.

Any other place is that of a single component, whose shift has the sign 1.
"""
MAGNET_DIAMETER = 4.0
MAGNET_THICKNESS = 2.0
ENCODER_MAGNET = 2.5  # thickness of the magnet at the end of the shaft
ENCODER_CHIP = 1.2  # height of the encoder's chip on its board, which faces the magnet


def assemble(robot: Robot, placed: Sequence[Placed]) -> Assembly:
    """Return the solid model of a machine.

    Args:
        robot: Robot that the machine is built from.
        placed: Parts of the robot along the shaft, as returned by
            :func:`jansen_workshop.drawings.shaft_order.layers`.
    """
    assembly = Assembly(robot, placed)
    add_links(assembly)
    add_feet(assembly)
    for stack in stacks(robot, placed):
        if stack.axle:
            add_axle(assembly, stack)
        else:
            add_pin(assembly, stack)
    add_hubs(assembly)
    add_shaft(assembly)
    _add_braces(assembly)
    add_motor_plate(assembly)
    add_motor(assembly)
    _add_components(assembly)
    return assembly


# Braces


def _add_braces(assembly: Assembly) -> None:
    """Add a brace between neighbouring units whose adjacent frames face opposite ways."""
    part = brace(assembly.robot)
    if part is None:
        return
    for last, first in zip(assembly.frames[1:-1:2], assembly.frames[2::2], strict=True):
        if _side(assembly, last) != _side(assembly, first):
            low = assembly.solids[last].high
            high = assembly.solids[first].low
            _add_plies(assembly, part, low, high)
            _add_brace_screws(assembly, last, assembly.solids[last].low, high, 1)
            _add_brace_screws(assembly, first, assembly.solids[first].high, low, -1)


def _side(assembly: Assembly, frame: int) -> str:
    """Return the side that a frame faces."""
    return assembly.robot.legs[assembly.solids[frame].carrier.leg].side


def _add_plies(assembly: Assembly, part: CutPart, low: float, high: float) -> None:
    """Add the plates of a brace, which fill the gap between two frames."""
    z = low
    while z < high - 1e-6:
        top = z + part.thickness
        cavities = tuple(Cavity(hole, z, top) for hole in part.holes)
        piece = assembly.add_piece("brace", "", "ties")
        assembly.add_solid(Solid(piece, CHASSIS, part.outline, z, top, cavities, part.density))
        z = top


def _add_brace_screws(
    assembly: Assembly, frame: int, seat: float, nut_seat: float, way: int
) -> None:
    """Add the screws that tie a frame to a brace, with their nuts.

    Args:
        assembly: Machine to add them to.
        frame: Index of the frame's solid.
        seat: Position along the shaft at which the screws' heads are seated.
        nut_seat: Position along the shaft at which the nuts are seated.
        way: Direction of the screws along the shaft, 1 or -1.
    """
    size = assembly.screw_size
    length = standard(assembly.thickness + BRACE + size.thin_nut[1])
    name = f"{assembly.build.screw} x {length:g} mm"
    for reach in assembly.mount.screws:
        axis = Axis(CHASSIS, reach * assembly.ways[_side(assembly, frame)])
        nut = assembly.add_piece("thin nut DIN 439", assembly.build.screw, "ties")
        into = assembly.add_nut(nut, axis, nut_seat, way, size.thin_nut, size.radius)
        screw = assembly.add_piece("countersunk screw ISO 10642", name, "ties")
        assembly.add_screw(
            screw,
            axis,
            seat=seat,
            way=way,
            radius=size.radius,
            length=length,
            head=size.countersunk,
            into=into,
            nut=True,
        )
        assembly.countersink_frame(frame, reach, seat, way, size.countersunk)


# Bought components


def _add_components(assembly: Assembly) -> None:
    """Add the bought components, with the space that batteries, boards and sensors occupy.

    All of them are outside the outer frames, where nothing moves.
    """
    for component in read_catalogue(assembly.robot.material).components:
        if component.name == MOTOR:
            continue
        places = PLACES.get(component.place, [(component.place, 1)])
        for k in range(component.number):
            piece = assembly.add_piece(component.name, component.size, component.stage)
            if k < len(places):
                place, sign = places[k]
                *size, shift = component.room
                _add_component_box(assembly, piece, place, (*size, sign * shift))
            elif component.name == "magnet" and not assembly.mount.flange[0]:
                _add_magnet(assembly, piece)


def _add_component_box(assembly: Assembly, piece: int, place: str, room: Sequence[float]) -> None:
    """Add a box for a bought component, on top of the components that are already there.

    Args:
        assembly: Machine to add it to.
        piece: Index of the component's piece.
        place: Place of the component, as explained in ``parts.yml``.
        room: Length of the box along the frame's bar, its width across the bar, its depth along the
            shaft, and its displacement along the bar.
    """
    along, across, depth, shift = room
    turn, reach = _bar(assembly, place)
    middle = turn * (shift + reach)
    half = 0.5 * complex(along, across)
    corners = [half, half.conjugate(), -half, -half.conjugate()]
    shape = box([middle + turn * corner for corner in corners])
    seat, way = _component_seat(assembly, place)
    below = [
        solid
        for solid in assembly.solids
        if solid.density == 0.0 and solid.fixed and (solid.low - seat) * way >= 0.0
    ]
    for solid in below:  # boards are stacked on one another
        if solid.piece != piece and _overlap(solid.outline, shape):
            top = solid.high if way > 0 else solid.low
            seat = max(seat * way, top * way) * way
    low, high = sorted((seat, seat + way * depth))
    assembly.add_solid(Solid(piece, CHASSIS, shape, low, high, density=0.0))


def _bar(assembly: Assembly, place: str) -> tuple[complex, float]:
    """Return the direction of the bar that carries a component, and its distance from the axis.

    The distance is that of the bar's pivot for a component at the pivot, and 0 for one at the crank
    axis.
    """
    frame = assembly.placed[0] if place in ("first", "plate") else assembly.placed[-1]
    turn = assembly.ways[assembly.robot.legs[frame.leg].side]
    if place not in ("first", "last"):
        return turn, 0.0
    joints = frame.part.joints
    axis = joints[assembly.robot.linkage.joints[assembly.robot.linkage.axis]]
    pivot = next(z for z in joints.values() if z != axis)
    return turn, abs(pivot - axis)


def _component_seat(assembly: Assembly, place: str) -> tuple[float, int]:
    """Return where a component is seated along the shaft, and its direction from there."""
    if place == "plate":
        return assembly.motor_plate[1], 1
    if place == "first":
        return assembly.outside - PADDED, -1
    if place == "shaft":
        return assembly.end, 1
    return assembly.end + PADDED, 1


def encoder_gap(assembly: Assembly) -> float:
    """Return the distance from the magnet at the end of the shaft to the encoder's chip.

    Args:
        assembly: Machine with the encoder.

    Returns:
        The distance in mm; NaN for a machine without this encoder.
    """
    boards = [
        solid for solid in assembly.solids if assembly.pieces[solid.piece].name == "crank encoder"
    ]
    if not boards:
        return math.nan
    return boards[0].low - ENCODER_CHIP - (assembly.end + SHAFT_OUT + ENCODER_MAGNET)


def _overlap(outline: Round, other: Round) -> bool:
    """Return whether two outlines overlap."""
    distance = gap(np.array(outline.corners), np.array(other.corners))
    return bool(float(distance) - outline.radius - other.radius < 0.0)


def _add_magnet(assembly: Assembly, piece: int) -> None:
    """Add the magnet on the coupling, represented by the ring that it sweeps."""
    radius, _ = assembly.mount.coupling
    # The magnet is beyond the heads of the motor's screws.
    low = assembly.motor_plate[1] + assembly.screw_size.socket[1] + 1.0
    rims = (radius + MAGNET_THICKNESS, radius)
    assembly.add_ring(piece, SHAFT_AXIS, rims, low, low + MAGNET_DIAMETER, 0.0)
