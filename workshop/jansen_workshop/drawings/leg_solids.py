"""Solids of the legs of a machine: links, feet, and everything on the pins and axles.

All lengths are in mm.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from jansen_env.robot import buildable as built
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.linkage import CRANK, FRAME
from jansen_env.robot.part_sizes import feet_of, radii
from jansen_workshop.drawings.assembly import Assembly
from jansen_workshop.drawings.convex import Round
from jansen_workshop.drawings.materials import PLAY, Row, Stack, standard
from jansen_workshop.drawings.mount import COLLAR, SHOULDER_HEAD, SHOULDER_NUT, SIZES
from jansen_workshop.drawings.outlines import CutPart, toe_way
from jansen_workshop.drawings.shaft_order import Placed
from jansen_workshop.drawings.solids import (
    ALLOY,
    CHASSIS,
    IGLIDUR,
    POM,
    RUBBER,
    SOCKET,
    STEEL,
    THREADED,
    Axis,
    Carrier,
    Cavity,
    Screw,
    Solid,
    box,
)

# Horizontal leg, length and wall thickness of the angle profile of a shoe.
SHOE_PROFILE = 15.0
SHOE_LENGTH = 40.0
SHOE_WALL = 2.0
SHOE_HEIGHTS = (20.0, 25.0, 30.0, 40.0)  # vertical legs in which this profile is sold
SHOE_REACH = 30.0  # largest distance of a shoe's screw from the toe
ARC = 8  # number of solids that represent the rubber strip of a foot
TUBE_WALL = 2.0  # wall thickness of a spacer on an axle
SPACER_WALL = 1.9  # wall thickness of a spacer on a pin
SHOULDER_THREAD = 2.5  # radius of the thread of a shoulder screw, M5


def add_links(assembly: Assembly) -> None:
    """Add the flat parts of all legs, and the bushes pressed into them.

    Args:
        assembly: Machine to add them to.
    """
    for item in assembly.placed:
        stage = {FRAME: "frames", CRANK: "crank"}.get(item.body, "links")
        leg = -1 if item.body in (FRAME, CRANK) else item.leg
        place = {"unit": item.unit, "leg": leg, "body": item.body}
        piece = assembly.add_piece(item.part.name, "", stage, **place)
        solid = assembly.add_solid(_link(assembly, item, piece))
        if item.body == FRAME:
            assembly.frames.append(solid)
        elif item.body == CRANK:
            assembly.webs.append(solid)
        if assembly.metal:
            _add_bushes(assembly, item, stage, place)


def _link(assembly: Assembly, item: Placed, piece: int) -> Solid:
    """Return the solid of a flat part."""
    cavities = tuple(
        Cavity(hole, item.z, item.top, bushed=assembly.metal and hole.fit == "press")
        for hole in (*item.part.windows, *item.part.holes)
    )
    carrier = Carrier(item.leg, item.body)
    outline = item.part.outline
    return Solid(piece, carrier, outline, item.z, item.top, cavities, item.part.density)


def _add_bushes(assembly: Assembly, item: Placed, stage: str, place: dict[str, int]) -> None:
    """Add the bushes that are pressed into a link."""
    pin, bush, *_ = radii(assembly.build)
    for hole in item.part.holes:
        if hole.fit != "press":
            continue
        bore = hole.radius - bush + pin
        size = f"{2 * bore:g} x {2 * hole.radius:g} x {item.part.thickness:g} mm"
        piece = assembly.add_piece("bush", size, stage, **place)
        axis = Axis(Carrier(item.leg, item.body), hole.corners[0])
        assembly.add_ring(piece, axis, (hole.radius, bore), item.z, item.top, IGLIDUR)


# Feet


def add_feet(assembly: Assembly) -> None:
    """Add the shoes or discs, the treads and their screws to all feet.

    Args:
        assembly: Machine to add them to.
    """
    for item in assembly.placed:
        for toe in feet_of(assembly.robot, item.body):
            if assembly.metal:
                _add_shoe(assembly, item, toe)
            else:
                _add_discs_and_strip(assembly, item, toe)


def _place_of_foot(item: Placed, toe: str) -> dict[str, Any]:
    """Return the attributes of the pieces of a foot that tell where they belong."""
    return {"unit": item.unit, "leg": item.leg, "joint": toe}


def _add_shoe(assembly: Assembly, item: Placed, toe: str) -> None:
    """Add two angle profiles, back to back around a foot, each with half of the tread."""
    z = item.part.joints[toe]
    way = toe_way(item.part, toe)
    spots = [
        hole.corners[0]
        for hole in item.part.holes
        if hole.fit == "clear" and abs(hole.corners[0] - z) < SHOE_REACH
    ]
    reach = max(((spot - z) / -way).real for spot in spots) + assembly.screw_size.socket[0]
    height = next(mm for mm in SHOE_HEIGHTS if mm >= reach)
    for face, out in ((item.top, 1), (item.z, -1)):
        _add_angle_profile(assembly, item, toe, spots, height, face, out)
        _add_half_round(assembly, item, toe, face, out)
    _add_shoe_screws(assembly, item, toe, spots)


def _add_angle_profile(
    assembly: Assembly,
    item: Placed,
    toe: str,
    spots: list[complex],
    height: float,
    face: float,
    out: int,
) -> None:
    """Add one angle profile of a shoe.

    Args:
        assembly: Machine to add it to.
        item: Part that carries the foot.
        toe: Name of the toe.
        spots: Positions of the shoe's screws.
        height: Height of the profile.
        face: Position along the shaft of the face of the part that the profile lies on.
        out: Direction along the shaft from the part to the profile, 1 or -1.
    """
    z = item.part.joints[toe]
    way = toe_way(item.part, toe)
    across = 1j * way
    half = 0.5 * SHOE_LENGTH
    ends = [z + side * half * across for side in (-1, 1)]
    upright = box([end - up * way for end in ends for up in (0, height)])
    level = box([end - up * way for end in ends for up in (0, SHOE_WALL)])

    size = f"{height:g} x {SHOE_PROFILE:g} x {SHOE_WALL:g} mm, {SHOE_LENGTH:g} mm long"
    piece = assembly.add_piece("foot-shoe", size, "foot", **_place_of_foot(item, toe))
    carrier = Carrier(item.leg, item.body)
    wall = face + out * SHOE_WALL
    low, high = sorted((face, wall))
    clearance = assembly.screw_size.clearance
    holes = tuple(Cavity(Round((spot,), clearance), low, high) for spot in spots)
    assembly.add_solid(Solid(piece, carrier, upright, low, high, holes, ALLOY))
    low, high = sorted((wall, face + out * SHOE_PROFILE))
    assembly.add_solid(Solid(piece, carrier, level, low, high, density=ALLOY))


def _add_half_round(assembly: Assembly, item: Placed, toe: str, face: float, out: int) -> None:
    """Add the half of a tread that lies under one angle profile."""
    z = item.part.joints[toe]
    way = toe_way(item.part, toe)
    radius = 1e3 * built.FOOT_RADIUS
    turns = np.exp(1j * np.linspace(-0.5 * math.pi, 0.5 * math.pi, 13))
    half_round = box([z + radius * way * turn for turn in turns])
    size = f"half-round, radius {radius:g} mm, {SHOE_PROFILE:g} mm wide"
    piece = assembly.add_piece("tread", size, "foot", **_place_of_foot(item, toe))
    carrier = Carrier(item.leg, item.body)
    low, high = sorted((face, face + out * SHOE_PROFILE))
    assembly.add_solid(Solid(piece, carrier, half_round, low, high, density=RUBBER))


def _add_shoe_screws(assembly: Assembly, item: Placed, toe: str, spots: list[complex]) -> None:
    """Add the screws through a part and the two profiles of its shoe, with their nuts."""
    place = _place_of_foot(item, toe)
    size = assembly.screw_size
    thread = assembly.build.screw
    length = standard(item.part.thickness + 2.0 * SHOE_WALL + size.lock_nut[1])
    for spot in spots:
        axis = Axis(Carrier(item.leg, item.body), spot)
        nut = assembly.add_piece("lock nut DIN 985", thread, "foot", **place)
        bottom = item.z - SHOE_WALL
        into = assembly.add_nut(nut, axis, bottom, -1, size.lock_nut, size.radius)
        name = f"{thread} x {length:g} mm"
        screw = assembly.add_piece("socket screw ISO 4762", name, "foot", **place)
        assembly.add_screw(
            screw,
            axis,
            seat=item.top + SHOE_WALL,
            way=-1,
            radius=size.radius,
            length=length,
            head=size.socket,
            into=into,
            nut=True,
        )


def _add_discs_and_strip(assembly: Assembly, item: Placed, toe: str) -> None:
    """Add a disc on either side of a toe, a screw through both, and a strip around the rims."""
    place = _place_of_foot(item, toe)
    axis = Axis(Carrier(item.leg, item.body), item.part.joints[toe])
    size = SIZES["M3"]
    disc = 500.0 * assembly.build.width
    thickness = item.part.thickness
    low = item.z - thickness
    high = item.top + thickness
    for bottom in (low, item.top):
        piece = assembly.add_piece("foot-disc", "", "foot", **place)
        rims = (disc, size.clearance)
        density = assembly.build.density
        assembly.add_ring(piece, axis, rims, bottom, bottom + thickness, density)
    nut = assembly.add_piece("thin nut DIN 439", "M3", "foot", **place)
    into = assembly.add_nut(nut, axis, low, -1, size.thin_nut, size.radius)
    length = standard(3.0 * thickness + size.thin_nut[1])
    screw = assembly.add_piece("socket screw ISO 4762", f"M3 x {length:g} mm", "foot", **place)
    assembly.add_screw(
        screw,
        axis,
        seat=high,
        way=-1,
        radius=size.radius,
        length=length,
        head=size.socket,
        into=into,
        nut=True,
    )
    _add_strip(assembly, item, toe, disc, 0.5 * (low + high))


def _add_strip(assembly: Assembly, item: Placed, toe: str, disc: float, middle: float) -> None:
    """Add the rubber strip on the rims of a foot's discs.

    Args:
        assembly: Machine to add it to.
        item: Part that carries the foot.
        toe: Name of the toe.
        disc: Radius of the discs.
        middle: Position of the strip's middle along the shaft.
    """
    z = item.part.joints[toe]
    outer = 1e3 * assembly.build.foot_radius
    width = 1e3 * assembly.build.foot_width
    half_angle = tread_arc(item.part, toe)
    size = f"{width:g} x {outer - disc:g} mm, {2.0 * half_angle * outer:.0f} mm long"
    strip = assembly.add_piece("rubber strip", size, "foot", **_place_of_foot(item, toe))
    turns = toe_way(item.part, toe) * np.exp(1j * np.linspace(-half_angle, half_angle, ARC + 1))
    low = middle - 0.5 * width
    high = middle + 0.5 * width
    carrier = Carrier(item.leg, item.body)
    for start, stop in pairwise(turns.tolist()):
        inner = disc / abs(0.5 * (start + stop))  # so that the chord clears the rim
        shape = box([z + inner * start, z + outer * start, z + outer * stop, z + inner * stop])
        assembly.add_solid(Solid(strip, carrier, shape, low, high, density=RUBBER))


def tread_arc(part: CutPart, toe: str) -> float:
    """Return half of the angle around a toe that the strip on the foot's rim covers, in rad.

    Args:
        part: Part that carries the foot.
        toe: Name of the toe.
    """
    z = part.joints[toe]
    way = toe_way(part, toe)
    others = [other - z for name, other in part.joints.items() if name != toe]
    return 0.5 * math.pi - max(abs(float(np.angle(other / -way))) for other in others)


# Pins and axles


def add_pin(assembly: Assembly, stack: Stack) -> None:
    """Add the screw, nut, washers and spacers of a pin that joins links.

    Args:
        assembly: Machine to add them to.
        stack: Entries on the pin.
    """
    first = next(row.item for row in stack.rows if row.item)
    axis = Axis(Carrier(first.leg, first.body), first.part.joints[stack.joint])
    crank = stack.joint == assembly.robot.linkage.bodies[CRANK - 1][1][1]
    stage = "crank" if crank else "pin"
    place = {"unit": stack.unit, "leg": -1 if crank else stack.leg, "joint": stack.joint}
    height = 0.0
    for row in stack.rows:
        if row.item:
            break
        height += row.number * row.height
    start = first.z - height
    end = _add_rows(assembly, stack, stage, axis, start)
    bolt, nut_row = stack.bolt
    nut = assembly.add_piece(nut_row.name, nut_row.size, stage, **place)
    screw = assembly.add_piece(bolt.name, bolt.size, stage, **place)
    if assembly.metal:
        _add_shoulder_screw(assembly, screw, nut, axis, start, start + bolt.height)
        return
    pin = 1e3 * assembly.build.pin_radius
    size = SIZES["M3"]
    into = assembly.add_nut(nut, axis, end, 1, size.lock_nut, pin)
    flush = end + size.lock_nut[1] - start  # the protruding end is sawn off
    assert bolt.height >= flush - 1e-6
    assembly.add_screw(
        screw,
        axis,
        seat=start,
        way=1,
        radius=pin,
        length=flush,
        head=size.socket,
        into=into,
        nut=True,
    )


def _add_shoulder_screw(
    assembly: Assembly, piece: int, nut: int, axis: Axis, start: float, end: float
) -> None:
    """Add a shoulder screw, whose shoulder lies between ``start`` and ``end``, and its nut."""
    pin = 1e3 * assembly.build.pin_radius
    into = assembly.add_nut(nut, axis, end, 1, SHOULDER_NUT, SHOULDER_THREAD)
    head_radius, head_height = SHOULDER_HEAD
    carrier = axis.carrier
    cap = axis.circle(head_radius)
    assembly.add_solid(Solid(piece, carrier, cap, start - head_height, start, density=SOCKET))
    shoulder = assembly.add_solid(Solid(piece, carrier, axis.circle(pin), start, end))
    assembly.screws.append(Screw(shoulder, pin, shoulder, nut=False))
    thread = axis.circle(SHOULDER_THREAD)
    tip = assembly.add_solid(Solid(piece, carrier, thread, end, end + SHOULDER_NUT[1]))
    assembly.screws.append(Screw(tip, SHOULDER_THREAD, into, nut=True))


def add_axle(assembly: Assembly, stack: Stack) -> None:
    """Add an axle through the machine, the pieces on it, and the fasteners at its ends.

    Args:
        assembly: Machine to add them to.
        stack: Entries on the axle.
    """
    joints = assembly.robot.linkage.joints
    at = joint_positions(assembly.robot, stack.side, 0.0) @ np.array([1e3, 1e3j])  # type: ignore[arg-type]
    centre = complex(at[joints.index(stack.joint)] - at[assembly.robot.linkage.axis])
    axis = Axis(CHASSIS, centre)
    start = assembly.outside if stack.rows[0].name == "frame-doubler" else 0.0
    _add_rows(assembly, stack, "frames", axis, start)

    rod, fastener = stack.bolt
    fasteners = [
        assembly.add_piece(fastener.name, fastener.size, "frames", joint=stack.joint)
        for _ in range(2)
    ]
    piece = assembly.add_piece(rod.name, rod.size, "frames", joint=stack.joint)
    pin = 1e3 * assembly.build.pin_radius
    low = 0.5 * (start + assembly.end - rod.height)
    density = STEEL if assembly.metal else THREADED
    shank = assembly.add_solid(
        Solid(piece, CHASSIS, axis.circle(pin), low, low + rod.height, density=density)
    )
    if assembly.metal:
        collar_radius, collar_length = COLLAR
        seats = (start - PLAY - collar_length, assembly.end + PLAY)
        for collar, seat in zip(fasteners, seats, strict=True):
            rims = (collar_radius, pin)
            assembly.add_ring(collar, axis, rims, seat, seat + collar_length, STEEL)
        assembly.screws.append(Screw(shank, pin, shank, nut=False))
    else:
        size = SIZES["M3"].lock_nut
        for nut, seat, way in zip(fasteners, (start, assembly.end), (-1, 1), strict=True):
            into = assembly.add_nut(nut, axis, seat, way, size, pin)
            assembly.screws.append(Screw(shank, pin, into, nut=True))


def _add_rows(assembly: Assembly, stack: Stack, stage: str, axis: Axis, start: float) -> float:
    """Add the washers, spacers and rings of a stack, and return where they end.

    Args:
        assembly: Machine to add them to.
        stack: Entries on a pin or axle.
        stage: Stage at which they are assembled.
        axis: Axis of the pin or axle.
        start: Position along the shaft at which the first entry begins.
    """
    pin = 1e3 * assembly.build.pin_radius
    tube = 1e3 * assembly.build.tube_radius
    place = {"unit": stack.unit, "leg": stack.leg, "joint": stack.joint}
    z = start
    spacer_low = start
    for row in stack.rows:
        if row.item:
            z = row.item.top
        elif row.name == "frame-doubler":
            for _ in range(row.number):
                _add_doubler(assembly, z)
                z += row.height
        elif row.name == "ring":  # one ring in either end of the preceding spacer
            for low in (spacer_low, z - row.height):
                piece = assembly.add_piece(row.name, row.size, stage, **place)
                rims = (tube - TUBE_WALL, pin)
                assembly.add_ring(piece, axis, rims, low, low + row.height, POM)
        else:
            spacer_low = z
            rims, density = _tube(assembly, stack, row)
            for _ in range(row.number):
                piece = assembly.add_piece(row.name, row.size, stage, **place)
                assembly.add_ring(piece, axis, rims, z, z + row.height, density)
                z += row.height
    return z


def _tube(assembly: Assembly, stack: Stack, row: Row) -> tuple[tuple[float, float], float]:
    """Return the outer radius and the bore of a spacer or washer, and its density."""
    flat = 1e3 * assembly.build.spacer_radius
    if row.name != "spacer":
        return (flat, 1e3 * assembly.build.pin_radius), POM
    if stack.axle and assembly.metal:
        tube = 1e3 * assembly.build.tube_radius
        return (tube, tube - TUBE_WALL), ALLOY
    return (flat, flat - SPACER_WALL), ALLOY


def _add_doubler(assembly: Assembly, z: float) -> None:
    """Add a copy of the first frame in front of it, with its lower face at ``z``."""
    piece = assembly.add_piece("frame-doubler", "", "ties")
    first = assembly.placed[0]
    top = z + assembly.thickness
    holes = tuple(Cavity(hole, z, top) for hole in first.part.holes)
    carrier = Carrier(first.leg, FRAME)
    outline = first.part.outline
    assembly.add_solid(Solid(piece, carrier, outline, z, top, holes, first.part.density))
