"""Bill of materials, with the masses of the built robot; the machine of these parts as a robot."""

import csv
import io
import math
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.drawings.outlines import SHOE_THICKNESS, Round, feet_of, link_part, radii
from jansen_env.drawings.shaft_order import UNIT_GAP, Placed, units
from jansen_env.plain_yaml import read_yaml
from jansen_env.robot import Plate, Robot, Triangle
from jansen_env.robot import buildable as built
from jansen_env.robot.buildable import ALUMINIUM, Build
from jansen_env.robot.designs import with_built_feet
from jansen_env.robot.kinematics import joint_positions
from jansen_env.robot.linkage import CRANK, FRAME

BAR, SHEET = "EN AW-6060 T66 flat bar", "EN AW-6060 T66 sheet, laser cut"
SHAFT_END = 10.0  # mm, of the shaft beyond the machine's frames
WASHERS = 3.0  # mm, the widest gap that has no spacer
PLAY, NUT, COLLAR = 0.1, 5.0, 9.0  # mm: least of a pin; for a lock nut; for a collar
SPARE, MOST_SPARE = 3.0, 4.0  # mm: most that washers fill under a thin nut; there and at the head
LENGTHS = (6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0)  # mm, of screws
PARTS = Path(__file__).with_name("parts.yml")
FOOT_DISC = 1.5e-4  # kg
COLUMNS = ("part", "name", "material", "stock size", "thickness mm", "number", "each g", "note")


class Part(NamedTuple):
    """A line of the bill of materials.

    ``each`` is in kg, ``thickness`` in mm, 0 for what is not flat.
    """

    name: str
    material: str
    dimensions: str
    number: int
    each: float
    thickness: float = 0.0
    note: str = ""

    @property
    def mass(self) -> float:
        """Mass of all of them, kg."""
        return self.number * self.each


def counts(robot: Robot) -> dict[str, int]:
    """Number of each flat part: on each crank pin two cranks as its webs, and two frames."""
    legs, names = len(robot.legs), robot.linkage.names
    number = dict.fromkeys(names, legs)
    for body in (FRAME, CRANK):
        number[names[body - 1]] = max(legs, 2 * len(units(robot)))
    toes = legs * len(robot.linkage.toes)
    feet = {"foot-shoe": toes} if robot.build is ALUMINIUM else {"foot-disc": 2 * toes}
    return number | feet | {"motor-plate": 1}


def bill_of_materials(robot: Robot) -> list[Part]:
    """All parts of a robot as it would be built, the flat ones first, by number.

    Masses of the built and of the weekend robot's add up to its mass.

    Raises ValueError: a link that cannot be made.
    """
    legs, toes, links = len(robot.legs), len(robot.legs) * len(robot.linkage.toes), []
    build = robot.build
    metal = build is ALUMINIUM
    for body, (name, link) in enumerate(zip(robot.linkage.names, robot.bodies, strict=True), 1):
        part = link_part(robot, body)
        thick, material = part.thickness, SHEET if metal else build.material
        if metal and len(part.outline.corners) == 2:
            length = max(abs(p - q) for p, q in combinations(part.joints.values(), 2))
            width, material = 2e-3 * part.outline.radius, BAR
            size = f"{1e3 * width:g} x {thick:g} mm, {length:.1f} mm between pins"
            each = built.flat_bar(1e-3 * length, width, 0.0, 1e-3 * thick).mass
        elif metal and isinstance(link, Triangle):
            sides = " / ".join(f"{1e3 * side:.1f}" for side in link.sides)
            size = f"{thick:g} mm, pins' triangle {sides} mm"
            each = built.triangular_plate(link.sides, 0.0).mass
        else:
            box = part.lying().outline.box[1]
            size, each = f"{thick:g} mm, {box.real:.0f} x {box.imag:.0f} mm", part.mass
        note = f"{1e3 * part.mass:.1f} g as drawn"
        links.append(Part(name, material, size, counts(robot)[name], each, thick, note))
    tread = f"natural rubber, {built.RUBBER_HARDNESS:g} Shore A, bonded to its shoe"
    radius, wide = 1e3 * built.FOOT_RADIUS, 1e3 * built.FOOT_WIDTH
    ends = legs * len(robot.linkage.holes)
    if not metal:
        tread = "M3 screw and nut, rubber strip 2 x 9 mm, 45 mm long"
        return [
            *links,
            Part("foot-disc", build.material, "3 mm, 10 mm", 2 * toes, FOOT_DISC, 3.0),
            Part("motor-plate", f"{build.material}, two M3", "40 x 40 x 3 mm", 1, 0.005, 3.0),
            Part("pin, a link's share", "M3 screw in plain holes, lock nut, washers",
                 "half a joint", ends, build.pin_share),
            Part("foot's tread", tread, "radius 7 mm", toes, build.foot_mass - 2.0 * FOOT_DISC),
            *(Part(*bought) for bought in read_yaml(PARTS)["bought"]),
        ]  # fmt: skip
    pivots = len({leg.side for leg in robot.legs}) * (len(robot.linkage.bodies[0][1]) - 1)
    return [
        *links,
        Part("foot-shoe", "EN AW-6060 sheet, two M4 screws", "40 x 30 x 3 mm", toes,
             built.SHOE_MASS, 3.0),
        Part("motor-plate", "EN AW-6060 sheet", "100 x 100 x 4 mm, hole 60 mm", 1,
             built.MOTOR_PLATE_MASS, 4.0),
        Part("pin and bush, a link's share", "shoulder screw, nut, washers, spacer; iglidur J200 "
             "bush, 6 mm", "half a joint", ends, built.PIN_SHARE),
        Part("foot's tread", tread, f"half-round, radius {radius:g} mm, {wide:g} mm wide", toes,
             built.TREAD_MASS),
        Part("crankshaft, at O", "steel C45; hubs of EN AW-6060", "12 x 160 mm; 4 hubs 25 x 10 mm",
             1, built.CRANKSHAFT_MASS),
        Part("cross-member, at P", "EN AW-6060 T66 tube", "20 x 2 mm, 200 mm", pivots,
             built.CROSS_MEMBER_MASS),
        Part("gearmotor, at O", "T-Motor AK80-6", "98 x 38.5 mm", 1, built.MOTOR_MASS),
        Part("battery, controller, cables", "LiPo 6S", "in two halves, at P", 1,
             built.BATTERY_MASS),
    ]  # fmt: skip


class Row(NamedTuple):
    """An entry of a pin's stack: a link, or a spacer or fastener."""

    number: int
    name: str
    size: str = ""
    item: Placed | None = None


class Stack(NamedTuple):
    """A pin of a leg, or an axle through the machine.

    ``rows`` are in order along the shaft, from the screw's head or the axle's first end. ``bolt``
    is the screw or axle through them, and its nut or collars.
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
        """Numbers of the bodies on it."""
        return {row.item.body for row in self.rows if row.item}


def stacks(robot: Robot, placed: Sequence[Placed]) -> list[Stack]:
    """Pins and axles of a machine, with washers, spacers and screws for the stack on each."""
    build = robot.build
    metal = build is ALUMINIUM
    axis, crank_pin, *_ = [*robot.linkage.bodies[CRANK - 1][1]]
    groups = defaultdict[tuple[str, object, bool], list[Placed]](list)
    for item in placed:
        for joint in item.part.joints:
            axle = joint in item.through
            where: object = item.unit if joint == crank_pin else (item.unit, item.leg)
            where = robot.legs[item.leg].side if axle else where
            groups[joint, where, axle].append(item)
    found = []
    for (joint, _, axle), items in groups.items():
        if joint == axis or (len(items) < 2 and not axle):  # a toe has no pin
            continue
        items.sort(key=lambda item: item.z)
        start, end = (0.0, placed[-1].top) if axle else (items[0].z, items[-1].top)
        tops, rows = [start, *(item.top for item in items)], list[Row]()
        for top, item in zip(tops, items, strict=False):
            rows += [*_between(build, item.z - top, axle), Row(1, item.part.name, "", item)]
        rows += _between(build, end - tops[-1], axle)
        size = f"{2e3 * build.pin_radius:g}"
        if axle and metal:
            rod = f"{size} x {end - start + 2.0 * COLLAR:.1f} mm"
            bolt = Row(1, "axle", rod), Row(2, "shaft collar DIN 705", f"{size} mm")
        elif axle:
            rod = f"threaded rod M{size} x {end - start + 2.0 * NUT:.1f} mm"
            bolt = Row(1, "axle", rod), Row(2, "lock nut DIN 985", f"M{size}")
        elif not metal:
            screw = f"M{size} x {_standard(end - start + NUT):g} mm"
            bolt = Row(1, "socket screw ISO 4762", screw), Row(1, "lock nut DIN 985", f"M{size}")
        else:
            shoulder = _standard(end - start + PLAY)
            spare = min(shoulder - end + start - PLAY, MOST_SPARE)
            rows = [*_between(build, spare - SPARE), *rows, *_between(build, min(spare, SPARE))]
            screw = f"{size} x {shoulder:g} mm, M5"
            bolt = Row(1, "shoulder screw ISO 7379", screw), Row(1, "thin nut DIN 439", "M5")
        unit, leg, side = items[0].unit, items[0].leg, robot.legs[items[0].leg].side
        found.append(Stack(joint, unit, leg, side, axle, tuple(rows), bolt))
    return found


def _between(build: Build, gap: float, axle: bool = False) -> list[Row]:
    """Washers that fill a gap, mm, to half a millimetre, or a spacer; none for no gap."""
    pin, spacer, tube = 2e3 * build.pin_radius, 2e3 * build.spacer_radius, 2e3 * build.tube_radius
    if gap > WASHERS and axle and build is ALUMINIUM:
        ends = f"{tube - 4:g} x {pin:g} x 3 mm, in a spacer's ends"
        return [Row(1, "spacer", f"{tube:g} x 2 x {gap:.1f} mm"), Row(2, "ring", ends)]
    if gap > WASHERS:
        return [Row(1, "spacer", f"{spacer:g} x 1.9 x {gap:.1f} mm")]
    whole, half = divmod(max(math.floor(2.0 * gap + 1e-6), 0), 2)
    return [Row(count, "washer", f"{pin:g} x {spacer:g} x {thick:g} mm")
            for count, thick in ((whole, 1.0), (half, 0.5)) if count]  # fmt: skip


def brace(robot: Robot) -> dict[str, object]:
    """Return the brace that ties a fore frame to a back frame, as fields of the instructions.

    ``angle`` between the frames, degrees; distance ``apart`` of their pivots ``pivot``, mm;
    ``size``; ``grams``, which are not in the model's mass.
    """
    axis, joints = robot.linkage.axis, robot.linkage.joints
    pivot = next(joint for joint in robot.linkage.bodies[FRAME - 1][1] if joint != joints[axis])
    at = 1e3 * joint_positions(robot, "fore", 0.0)
    x, y = (at[joints.index(pivot)] - at[axis]).tolist()
    angle = 2.0 * math.atan2(abs(x), -y)
    build = robot.build
    long, hole = 1e3 * build.brace_length, 2e3 * build.shaft_radius + 0.5
    high = build.frame_width * 1e3 + 0.5 * long * math.sin(abs(math.pi - angle))
    size = f"{long:g} x {high:.0f} x {UNIT_GAP:g} mm, hole {hole:g}"
    grams = 1e-6 * build.density * long * high * UNIT_GAP
    return {"pivot": pivot, "angle": math.degrees(angle), "apart": 2.0 * abs(x), "size": size,
            "grams": grams}  # fmt: skip


def _standard(length: float) -> float:
    """The next length of screws, mm."""
    return next((x for x in LENGTHS if x >= length - 1e-6), 10.0 * math.ceil(0.1 * length))


def hardware(robot: Robot, placed: Sequence[Placed]) -> list[Part]:
    """All that joins the flat parts, counted, as long as the layers make it.

    Its masses are in the shares of :func:`bill_of_materials`.
    """
    pieces, end, build = Counter[tuple[str, str]](), placed[-1].top, robot.build
    metal, (pin, bush, shaft, hub) = build is ALUMINIUM, radii(build)
    for stack in stacks(robot, placed):
        for row in (*stack.bolt, *stack.rows):
            pieces[row.name, row.size] += row.number if row.item is None else 0
    thick = {item.body: item.part.thickness for item in placed}
    for item in placed:
        for hole in item.part.holes:
            if metal and hole.fit == "press":
                bore = 2.0 * (hole.radius - bush + pin)
                size = f"{bore:g} x {2 * hole.radius:g} x {thick[item.body]:g} mm"
                pieces["bush", size] += 1
        for _ in feet_of(robot, item.body):
            sides, count = (1, 2) if metal else (2, 1)  # sides of the foot with a shoe; screws
            length = _standard(thick[item.body] + sides * SHOE_THICKNESS + NUT)
            pieces["socket screw ISO 4762", f"{build.screw} x {length:g} mm"] += count
            pieces["lock nut DIN 985", build.screw] += count
    webs = [item for item in placed if item.body == CRANK]
    tops = [-SHAFT_END, *(item.top for item in webs[1::2])]
    bottoms = [*(item.z for item in webs[::2]), end + SHAFT_END]
    for top, bottom in zip(tops, bottoms, strict=True):
        pieces["shaft", f"{2 * shaft:g} x {bottom - top:.1f} mm"] += 1
    spigot = f"spigot {2 * pin:g}" if metal else "set screw"
    size = f"{2 * hub:g} x {1e3 * build.hub_length:g} mm, bore {2 * shaft:g}"
    pieces["hub", f"{size}, {spigot}, two threads M3"] += len(webs)
    length = _standard(thick[CRANK] + 2.0 * 3.0)  # twice M3 of thread in the hub
    pieces["countersunk screw ISO 10642", f"M3 x {length:g} mm"] += 2 * len(webs)
    if metal:
        pieces["spring pin ISO 8752", f"3 x {2.0 * hub - 1.0:g} mm"] += len(webs)
    length = _standard(thick[FRAME] + SHAFT_END + 1e3 * build.plate_thickness + NUT)
    pieces["countersunk screw ISO 10642", f"{build.screw} x {length:g} mm"] += 2
    pieces["lock nut DIN 985", build.screw] += 2
    if len({leg.side for leg in robot.legs}) > 1:
        ties = max(len(units(robot)) - 1, 1)
        pieces["brace", str(brace(robot)["size"])] += ties
        pieces["countersunk screw ISO 10642", f"{build.screw} x 10 mm"] += 4 * ties
    pieces["spacer", f"{2e3 * build.spacer_radius:g} x 1.9 x {SHAFT_END:g} mm"] += 2
    note = "counted in the masses above"
    materials = {**read_yaml(PARTS)["materials"], "brace": build.material}
    return [Part(name, materials.get(name, "steel"), size, number, 0.0, note=note)
            for (name, size), number in sorted(pieces.items(), key=_by_size) if number]  # fmt: skip


def _by_size(piece: tuple[tuple[str, str], int]) -> tuple[str, list[float]]:
    (name, size), _ = piece
    return name, [*map(float, re.findall(r"\d+\.?\d*", size))]


def to_csv(parts: Sequence[Part]) -> str:
    """The bill of materials as CSV, numbered; parts that are counted in others have no mass."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(COLUMNS)
    for k, part in enumerate(parts, 1):
        thick, mass = (f"{n:.6g}" if n else "" for n in (part.thickness, 1e3 * part.each))
        rows.writerow((k, *part[:3], thick, part.number, mass, part.note))
    return text.getvalue()


def machine(robot: Robot) -> Robot:
    """Return a robot as it would be cut: its parts, with its build's feet and motor.

    Joints keep their places and their friction.

    Raises ValueError: a part cannot be made; names it.
    """
    masses = {part.name: part.mass for part in bill_of_materials(robot)}
    links = (_link(robot, k, masses[name] / len(robot.legs))
             for k, name in enumerate(robot.linkage.names, 1))  # fmt: skip
    return with_built_feet(replace(robot, bodies=tuple(links)))


def _link(robot: Robot, body: int, mass: float) -> Plate:
    """Return a body of a leg: its flat parts of a mass, kg, and pins, feet, motor and battery as
    point masses."""
    part, legs, build = link_part(robot, body), len(robot.legs), robot.build
    signed = [(1.0, part.outline), *((-1.0, shape) for shape in (*part.windows, *part.holes))]
    moments = np.array([sign * about_origin(shape) for sign, shape in signed]).sum(axis=0)
    area, centre = float(moments[0].real), complex(moments[1] / moments[0])
    inertia = float(moments[2].real) - area * abs(centre) ** 2
    points = [(mass, centre)]
    points += [(build.pin_share, part.joints[joint])
               for index, joint in robot.linkage.holes if index == body]  # fmt: skip
    points += [(build.foot_mass, part.joints[toe]) for toe in feet_of(robot, body)]
    if body == FRAME:
        axis = part.joints[robot.linkage.bodies[CRANK - 1][1][0]]
        pivots = [z for z in part.joints.values() if z != axis]
        sides = len({leg.side for leg in robot.legs})
        share = sides * build.cross_member_mass + build.battery_mass / len(pivots)
        points += [(build.axis_mass / legs, axis), *((share / legs, pivot) for pivot in pivots)]
    masses, places = np.array([weight for weight, _ in points]), np.array([z for _, z in points])
    middle = masses @ places / masses.sum()
    turning = mass * inertia / area + float(masses @ abs(places - middle) ** 2)
    joints = [1e-3 * (z - middle) for z in part.joints.values()]
    corners = tuple((float(z.real), float(z.imag)) for z in joints)
    return Plate(corners, float(masses.sum()), 1e-6 * turning)


def about_origin(shape: Round) -> NDArray[np.complex128]:
    """Return area, first and second moment about the origin of a polygon with round corners."""
    p = np.array(shape.polygon)
    q = np.roll(p, -1)
    cross = (p.conj() * q).imag
    squares = abs(p) ** 2 + (p.conj() * q).real + abs(q) ** 2
    return np.array([cross.sum() / 2, (p + q) @ cross / 6, squares @ cross / 12])
