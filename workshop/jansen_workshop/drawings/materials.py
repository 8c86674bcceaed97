"""Masses of a simulated robot's parts, stacks on its pins, and the machine as a robot."""

import csv
import io
import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.robot import Plate, Robot, Triangle
from jansen_env.robot import buildable as built
from jansen_env.robot.buildable import ALUMINIUM, Build
from jansen_env.robot.designs import with_built_feet
from jansen_env.robot.linkage import CRANK, FRAME
from jansen_env.robot.part_sizes import feet_of
from jansen_workshop.drawings.convex import Round
from jansen_workshop.drawings.mount import mount_of, ties, units
from jansen_workshop.drawings.outlines import BRACE, CutPart, link_part
from jansen_workshop.drawings.shaft_order import Placed

BAR = "EN AW-6060 T66 flat bar"
SHEET = "EN AW-6060 T66 sheet, laser cut"
WASHERS = 3.0  # widest gap that is filled by washers instead of a spacer, in mm
PLAY = 0.1  # least play along a pin, in mm
NUT_LENGTH = 5.0  # length of thread for a lock nut, in mm
COLLAR_LENGTH = 9.0  # length of axle for a collar, in mm
NUT_WASHERS = 3.0  # largest height of the washers under a thin nut, in mm
ALL_WASHERS = 4.0  # largest height of the washers under nut and head together, in mm
# Standard lengths of screws, in mm.
LENGTHS = (6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0)
COLUMNS = (
    "part",
    "name",
    "material",
    "stock size",
    "thickness mm",
    "number",
    "each g",
    "each EUR",
    "note",
)


class Part(NamedTuple):
    """Line of the bill of materials.

    Attributes:
        name: Name of the part.
        material: Material of the part.
        dimensions: Sizes of the part.
        number: Number of such parts.
        each: Mass of one part, in kg.
        thickness: Thickness of a flat part, in mm; 0 for other parts.
        note: Remark.
        price: Price of one part, in EUR.
    """

    name: str
    material: str
    dimensions: str
    number: int
    each: float
    thickness: float = 0.0
    note: str = ""
    price: float = 0.0

    @property
    def mass(self) -> float:
        """Mass of all parts of this line, in kg."""
        return self.number * self.each


def flat_size(robot: Robot, part: CutPart) -> str:
    """Return the size of a flat part as written in its line of the bill of materials.

    Args:
        robot: Robot that the part belongs to.
        part: Flat part.
    """
    thick = part.thickness
    if robot.build is ALUMINIUM and len(part.outline.corners) == 2 and part.joints:
        length = max(abs(p - q) for p, q in combinations(part.joints.values(), 2))
        return f"{2.0 * part.outline.radius:g} x {thick:g} mm, {length:.1f} mm between pins"
    low, high = (part if len(part.outline.corners) == 1 else part.lying()).outline.box
    return f"{thick:g} mm, {(high - low).real:.0f} x {(high - low).imag:.0f} mm"


def counts(robot: Robot) -> dict[str, int]:
    """Return the number of each flat part by name.

    Each crank pin has two cranks, which are its webs, and two frames.

    Args:
        robot: Robot that the parts belong to.
    """
    legs = len(robot.legs)
    names = robot.linkage.names
    number = dict.fromkeys(names, legs)
    for body in (FRAME, CRANK):
        number[names[body - 1]] = max(legs, 2 * len(units(robot)))
    toes = legs * len(robot.linkage.toes)
    mount = mount_of(robot.build)
    plies = 1
    if robot.build is not ALUMINIUM:
        number["foot-disc"] = 2 * toes
        plies = round(1e-3 * BRACE / robot.build.plate_thickness)
    number["motor-plate"] = 1
    if mount.doublers:
        number["frame-doubler"] = mount.doublers
    if ties(robot):
        number["brace"] = plies * ties(robot)
    return number


def bill_of_materials(robot: Robot) -> list[Part]:
    """Return the parts of the simulated robot: its links, and its shares of the joining parts.

    For the built robot and the weekend robot, the masses add up to the mass of the robot. The parts
    to cut and to buy are listed by :class:`jansen_workshop.drawings.order.Order`.

    Args:
        robot: The simulated robot.

    Raises:
        ValueError: If a link cannot be made.
    """
    links = [
        _link_line(robot, body, counts(robot)[name])
        for body, name in enumerate(robot.linkage.names, 1)
    ]
    shares = _aluminium_shares(robot) if robot.build is ALUMINIUM else _plywood_shares(robot)
    return [*links, *shares]


def _link_line(robot: Robot, body: int, number: int) -> Part:
    """Return the line of one body's flat parts, of which there is a ``number``."""
    build = robot.build
    metal = build is ALUMINIUM
    link = robot.bodies[body - 1]
    part = link_part(robot, body)
    thick = part.thickness
    material = SHEET if metal else build.material
    if metal and len(part.outline.corners) == 2:
        length = max(abs(p - q) for p, q in combinations(part.joints.values(), 2))
        width = 2e-3 * part.outline.radius
        material = BAR
        size = f"{1e3 * width:g} x {thick:g} mm, {length:.1f} mm between pins"
        each = built.flat_bar(1e-3 * length, width, 0.0, 1e-3 * thick).mass
    elif metal and isinstance(link, Triangle):
        sides = " / ".join(f"{1e3 * side:.1f}" for side in link.sides)
        size = f"{thick:g} mm, pins' triangle {sides} mm"
        each = built.triangular_plate(link.sides, 0.0).mass
    else:
        box = part.lying().outline.box[1]
        size = f"{thick:g} mm, {box.real:.0f} x {box.imag:.0f} mm"
        each = part.mass
    note = f"{1e3 * part.mass:.1f} g as drawn"
    return Part(robot.linkage.names[body - 1], material, size, number, each, thick, note)


def _plywood_shares(robot: Robot) -> list[Part]:
    """Return the shares of the joining parts in a simulated robot of plywood."""
    build = robot.build
    toes = len(robot.legs) * len(robot.linkage.toes)
    ends = len(robot.legs) * len(robot.linkage.holes)
    return [
        Part(
            "pin, a link's share",
            "M3 screw in plain holes, lock nut, washers",
            "half a joint",
            ends,
            build.pin_share,
        ),
        Part(
            "foot's tread",
            "discs, M3 screw and nut, strip of rubber",
            "a share",
            toes,
            build.foot_mass,
        ),
        Part("shaft, hubs, gearmotor and its plate, at O", "", "a share", 1, build.axis_mass),
        Part("cross-members, battery, boards, at P", "", "a share", 1, build.battery_mass),
    ]


def _aluminium_shares(robot: Robot) -> list[Part]:
    """Return the shares of the joining parts in a simulated robot of aluminium."""
    toes = len(robot.legs) * len(robot.linkage.toes)
    ends = len(robot.legs) * len(robot.linkage.holes)
    sides = len({leg.side for leg in robot.legs})
    pivots = sides * (len(robot.linkage.bodies[0][1]) - 1)
    radius = 1e3 * built.FOOT_RADIUS
    width = 1e3 * built.FOOT_WIDTH
    return [
        Part("foot's shoe", "EN AW-6060, two M4 screws", "a share", toes, built.SHOE_MASS),
        Part("motor's plate", "EN AW-6060", "a share, at O", 1, built.MOTOR_PLATE_MASS),
        Part(
            "pin and bush, a link's share",
            "shoulder screw, nut, washers, spacer; iglidur J200 bush, 6 mm",
            "half a joint",
            ends,
            built.PIN_SHARE,
        ),
        Part(
            "foot's tread",
            f"natural rubber, {built.RUBBER_HARDNESS:g} Shore A, bonded to its shoe",
            f"half-round, radius {radius:g} mm, {width:g} mm wide",
            toes,
            built.TREAD_MASS,
        ),
        Part(
            "crankshaft, at O",
            "steel; hubs and coupling of EN AW-6060",
            "a share",
            1,
            built.CRANKSHAFT_MASS,
        ),
        Part(
            "cross-member, at P",
            "axle; tube of EN AW-6060 T66",
            "a share",
            pivots,
            built.CROSS_MEMBER_MASS,
        ),
        Part("gearmotor, at O", "T-Motor AK80-6", "98 x 38.5 mm", 1, built.MOTOR_MASS),
        Part(
            "battery, controller, cables", "LiPo 6S", "in two halves, at P", 1, built.BATTERY_MASS
        ),
    ]


class Row(NamedTuple):
    """Entry of a pin's stack: a link, a spacer or a fastener.

    Attributes:
        number: Number of equal pieces.
        name: Name of the piece.
        size: Size of the piece; empty for a link.
        item: Placed part of a link; None for other pieces.
        height: Height of one piece along the pin, in mm; 0 for a link.
    """

    number: int
    name: str
    size: str = ""
    item: Placed | None = None
    height: float = 0.0


class Stack(NamedTuple):
    """Pin of a leg, or axle through the machine, with everything on it.

    Attributes:
        joint: Name of the joint.
        unit: Index of the unit.
        leg: Index of the leg.
        side: Side of the leg.
        axle: Whether this is an axle through the machine.
        rows: Entries in order along the shaft, from the head of the screw or from the first end of
            the axle.
        bolt: Screw or axle through the entries, and its nut or collars.
    """

    joint: str
    unit: int
    leg: int
    side: str
    axle: bool
    rows: tuple[Row, ...]
    bolt: tuple[Row, Row]

    @property
    def bodies(self) -> set[int]:
        """Numbers of the bodies on the pin, from 1 on."""
        return {row.item.body for row in self.rows if row.item}


def stacks(robot: Robot, placed: Sequence[Placed]) -> list[Stack]:
    """Return the pins and axles of a machine, with the washers, spacers and screws of each.

    Args:
        robot: Robot that the machine is built from.
        placed: Parts of the robot along the shaft.
    """
    axis = robot.linkage.bodies[CRANK - 1][1][0]
    return [
        _stack(robot, placed, joint, axle, sorted(items, key=lambda item: item.z))
        for (joint, _, axle), items in _parts_on_pins(robot, placed).items()
        if joint != axis and (len(items) > 1 or axle)  # a toe has no pin
    ]


def _parts_on_pins(
    robot: Robot, placed: Sequence[Placed]
) -> dict[tuple[str, object, bool], list[Placed]]:
    """Return the parts on each pin or axle.

    The keys are the name of the joint, the unit, leg or side to which the pin or axle belongs, and
    whether it is an axle.
    """
    crank_pin = robot.linkage.bodies[CRANK - 1][1][1]
    groups = defaultdict[tuple[str, object, bool], list[Placed]](list)
    for item in placed:
        for joint in item.part.joints:
            axle = joint in item.through
            owner: object = (item.unit, item.leg)
            if axle:
                owner = robot.legs[item.leg].side
            elif joint == crank_pin:
                owner = item.unit
            groups[joint, owner, axle].append(item)
    return groups


def _stack(
    robot: Robot, placed: Sequence[Placed], joint: str, axle: bool, items: Sequence[Placed]
) -> Stack:
    """Return one pin or axle with everything on it.

    Args:
        robot: Robot that the machine is built from.
        placed: Parts of the robot along the shaft.
        joint: Name of the joint.
        axle: Whether this is an axle through the machine.
        items: Parts on the pin or axle, in order along the shaft.
    """
    build = robot.build
    start = 0.0 if axle else items[0].z
    end = placed[-1].top if axle else items[-1].top
    rows: list[Row] = []
    z = start
    for item in items:
        rows += [*_between(build, item.z - z, axle), Row(1, item.part.name, "", item)]
        z = item.top
    rows += _between(build, end - z, axle)
    if axle and items[0] is placed[0]:  # doublers are glued to the first frame
        thickness = items[0].part.thickness
        size = flat_size(robot, items[0].part)
        doublers = mount_of(build).doublers
        start -= doublers * thickness
        rows = [Row(1, "frame-doubler", size, height=thickness)] * doublers + rows
    if axle:
        bolt = _axle(build, end - start)
    elif build is not ALUMINIUM:
        bolt = _plain_screw(build, end - start)
    else:
        bolt = _shoulder_screw(build, end - start)
        spare = min(bolt[0].height - end + start - PLAY, ALL_WASHERS)
        under_head = _between(build, spare - NUT_WASHERS)
        under_nut = _between(build, min(spare, NUT_WASHERS))
        rows = [*under_head, *rows, *under_nut]
    unit = items[0].unit
    leg = items[0].leg
    return Stack(joint, unit, leg, robot.legs[leg].side, axle, tuple(rows), bolt)


def _shoulder_screw(build: Build, length: float) -> tuple[Row, Row]:
    """Return a shoulder screw for a stack of a length (mm), and its thin nut."""
    shoulder = standard(length + PLAY)
    size = f"{2e3 * build.pin_radius:g} x {shoulder:g} mm, M5"
    screw = Row(1, "shoulder screw ISO 7379", size, height=shoulder)
    return screw, Row(1, "thin nut DIN 439", "M5")


def _axle(build: Build, length: float) -> tuple[Row, Row]:
    """Return an axle for a stack of a length (mm), and the collars or nuts at its ends."""
    size = f"{2e3 * build.pin_radius:g}"
    if build is ALUMINIUM:
        long = length + 2.0 * COLLAR_LENGTH
        rod = Row(1, "axle", f"{size} x {long:.1f} mm", height=long)
        return rod, Row(2, "shaft collar DIN 705", f"{size} mm")
    long = length + 2.0 * NUT_LENGTH
    rod = Row(1, "axle", f"threaded rod M{size} x {long:.1f} mm", height=long)
    return rod, Row(2, "lock nut DIN 985", f"M{size}")


def _plain_screw(build: Build, length: float) -> tuple[Row, Row]:
    """Return a screw and its lock nut for links that turn on its thread; ``length`` is in mm."""
    size = f"M{2e3 * build.pin_radius:g}"
    long = standard(length + NUT_LENGTH)
    screw = Row(1, "socket screw ISO 4762", f"{size} x {long:g} mm", height=long)
    return screw, Row(1, "lock nut DIN 985", size)


def _between(build: Build, gap: float, axle: bool = False) -> list[Row]:
    """Return what fills a gap (mm): washers, rounded down to half a millimetre, or a spacer.

    A spacer on an axle of the aluminium build comes with two rings.
    """
    pin = 2e3 * build.pin_radius
    spacer = 2e3 * build.spacer_radius
    tube = 2e3 * build.tube_radius
    if gap > WASHERS and axle and build is ALUMINIUM:
        ends = f"{tube - 4:g} x {pin:g} x 3 mm, in a spacer's ends"
        size = f"{tube:g} x 2 x {gap:.1f} mm"
        return [Row(1, "spacer", size, height=gap), Row(2, "ring", ends, height=3.0)]
    if gap > WASHERS:
        return [Row(1, "spacer", f"{spacer:g} x 1.9 x {gap:.1f} mm", height=gap)]
    whole, half = divmod(max(math.floor(2.0 * gap + 1e-6), 0), 2)
    return [
        Row(count, "washer", f"{pin:g} x {spacer:g} x {thick:g} mm", height=thick)
        for count, thick in ((whole, 1.0), (half, 0.5))
        if count
    ]


def standard(length: float) -> float:
    """Return the shortest standard screw length that is at least a given length.

    Args:
        length: Least length, in mm.
    """
    return next((x for x in LENGTHS if x >= length - 1e-6), 10.0 * math.ceil(0.1 * length))


def to_csv(parts: Sequence[Part]) -> str:
    """Return the bill of materials as CSV, with numbered lines.

    The mass is left empty for parts whose mass is counted in other parts.

    Args:
        parts: Lines of the bill.
    """
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(COLUMNS)
    for k, part in enumerate(parts, 1):
        thick, mass = (f"{n:.6g}" if n else "" for n in (part.thickness, 1e3 * part.each))
        price = f"{part.price:.4g}" if part.price else ""
        rows.writerow((k, *part[:3], thick, part.number, mass, price, part.note))
    return text.getvalue()


def machine(robot: Robot) -> Robot:
    """Return the robot that simulates the machine as it would be cut.

    The robot has the masses of the cut parts, and the feet and motor of its build. The joints keep
    their positions and their friction.

    Args:
        robot: Robot whose parts are cut.

    Raises:
        ValueError: If a part cannot be made. The message names the part.
    """
    masses = {part.name: part.mass for part in bill_of_materials(robot)}
    links = (
        _link(robot, k, masses[name] / len(robot.legs))
        for k, name in enumerate(robot.linkage.names, 1)
    )
    return with_built_feet(replace(robot, bodies=tuple(links)))


def _link(robot: Robot, body: int, mass: float) -> Plate:
    """Return a body of a leg, with pins, feet, motor and battery as point masses.

    Args:
        robot: Robot that the body belongs to.
        body: Number of the body, from 1 on.
        mass: Mass of the body's flat parts per leg, in kg.
    """
    part = link_part(robot, body)
    signed = [(1.0, part.outline), *((-1.0, shape) for shape in (*part.windows, *part.holes))]
    moments = np.array([sign * about_origin(shape) for sign, shape in signed]).sum(axis=0)
    area = float(moments[0].real)
    centre = complex(moments[1] / moments[0])
    inertia = float(moments[2].real) - area * abs(centre) ** 2
    points = [(mass, centre), *_point_masses(robot, body, part)]
    masses = np.array([weight for weight, _ in points])
    places = np.array([z for _, z in points])
    middle = masses @ places / masses.sum()
    turning = mass * inertia / area + float(masses @ abs(places - middle) ** 2)
    joints = [1e-3 * (z - middle) for z in part.joints.values()]
    corners = tuple((float(z.real), float(z.imag)) for z in joints)
    return Plate(corners, float(masses.sum()), 1e-6 * turning)


def _point_masses(robot: Robot, body: int, part: CutPart) -> list[tuple[float, complex]]:
    """Return the masses (kg) of what is fixed to a body of one leg, each with its position."""
    build = robot.build
    legs = len(robot.legs)
    points = [
        (build.pin_share, part.joints[joint])
        for index, joint in robot.linkage.holes
        if index == body
    ]
    points += [(build.foot_mass, part.joints[toe]) for toe in feet_of(robot, body)]
    if body == FRAME:
        axis = part.joints[robot.linkage.bodies[CRANK - 1][1][0]]
        pivots = [z for z in part.joints.values() if z != axis]
        sides = len({leg.side for leg in robot.legs})
        at_pivot = sides * build.cross_member_mass + build.battery_mass / len(pivots)
        points.append((build.axis_mass / legs, axis))
        points += [(at_pivot / legs, pivot) for pivot in pivots]
    return points


def about_origin(shape: Round) -> NDArray[np.complex128]:
    """Return the area, and the first and second moments about the origin, of a rounded polygon.

    Args:
        shape: Rounded polygon.
    """
    p = np.array(shape.polygon)
    q = np.roll(p, -1)
    cross = (p.conj() * q).imag
    squares = abs(p) ** 2 + (p.conj() * q).real + abs(q) ** 2
    return np.array([cross.sum() / 2, (p + q) @ cross / 6, squares @ cross / 12])
