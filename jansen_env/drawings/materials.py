"""Bill of materials, with the masses of the built robot; the machine of these parts as a robot."""

from __future__ import annotations

import csv
import io
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.drawings.outlines import (
    BUSH,
    HUB,
    PIN,
    SHAFT,
    CutPart,
    Round,
    feet_of,
    hull,
    link_part,
)
from jansen_env.drawings.shaft_order import GAP, HUB_LENGTH, SPACER, TUBE, Placed, units
from jansen_env.robot import Plate, Robot, Triangle
from jansen_env.robot import buildable as built
from jansen_env.robot.designs import with_built_feet
from jansen_env.robot.linkage import CRANK, FRAME

BAR, SHEET = "EN AW-6060 T66 flat bar", "EN AW-6060 T66 sheet, laser cut"
SHAFT_END = 10.0  # mm, of the shaft beyond the machine's frames
CIRCLE = np.exp(2j * np.pi * np.arange(64) / 64)
TOLERANCE = 0.5  # mm, that washers make up
COLUMNS = ("name", "material", "stock size", "thickness mm", "number", "each g", "note")


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
    return number | {"foot-shoe": legs * len(robot.linkage.toes), "motor-plate": 1}


def bill_of_materials(robot: Robot) -> list[Part]:
    """All parts of a robot as it would be built; those of the built robot add up to its mass.

    Raises ValueError: a link that cannot be made.
    """
    legs, toes, links = len(robot.legs), len(robot.legs) * len(robot.linkage.toes), []
    for body, (name, link) in enumerate(zip(robot.linkage.names, robot.bodies, strict=True), 1):
        part = link_part(robot, body)
        thick, material = part.thickness, SHEET
        if len(part.outline.corners) == 2:
            length = max(abs(p - q) for p, q in combinations(part.joints.values(), 2))
            width, material = 2e-3 * part.outline.radius, BAR
            size = f"{1e3 * width:g} x {thick:g} mm, {length:.1f} mm between pins"
            each = built.flat_bar(1e-3 * length, width, 0.0, 1e-3 * thick).mass
        elif isinstance(link, Triangle):
            sides = " / ".join(f"{1e3 * side:.1f}" for side in link.sides)
            size = f"{thick:g} mm, pins' triangle {sides} mm"
            each = built.triangular_plate(link.sides, 0.0).mass
        else:
            box = part.lying().outline.box[1]
            size, each = f"{thick:g} mm, {box.real:.0f} x {box.imag:.0f} mm", part.mass
        note = f"{1e3 * part.mass:.1f} g as drawn"
        links.append(Part(name, material, size, counts(robot)[name], each, thick, note))
    links.sort(key=lambda part: part.material)
    pin = "shoulder screw, nut, washers, spacer; iglidur J200 bush, 6 mm"
    tread = f"natural rubber, {built.RUBBER_HARDNESS:g} Shore A, bonded to its shoe"
    radius, wide = 1e3 * built.FOOT_RADIUS, 1e3 * built.FOOT_WIDTH
    ends = legs * len(robot.linkage.holes)
    pivots = len({leg.side for leg in robot.legs}) * (len(robot.linkage.bodies[0][1]) - 1)
    return [
        *links,
        Part("pin and bush, a link's share", pin, "half a joint", ends, built.PIN_SHARE),
        Part("foot's tread", tread, f"half-round, radius {radius:g} mm, {wide:g} mm wide", toes,
             built.TREAD_MASS),
        Part("foot's shoe", "EN AW-6060 sheet, two M4 screws", "40 x 30 x 3 mm", toes,
             built.SHOE_MASS, 3.0),
        Part("crankshaft, at O", "steel C45; hubs of EN AW-6060", "12 x 160 mm; 4 hubs 25 x 10 mm",
             1, built.CRANKSHAFT_MASS),
        Part("motor plate, at O", "EN AW-6060 sheet", "100 x 100 x 4 mm, hole 60 mm", 1,
             built.MOTOR_PLATE_MASS, 4.0),
        Part("cross-member, at P", "EN AW-6060 T66 tube", "20 x 2 mm, 200 mm", pivots,
             built.CROSS_MEMBER_MASS),
        Part("gearmotor, at O", "T-Motor AK80-6", "98 x 38.5 mm", 1, built.MOTOR_MASS),
        Part("battery, controller, cables", "LiPo 6S", "in two halves, at P", 1,
             built.BATTERY_MASS),
    ]  # fmt: skip


def hardware(robot: Robot, placed: Sequence[Placed]) -> list[Part]:
    """Pins, axles, spacers and pieces of the shaft, as long as the layers make them.

    Their masses are in the shares of :func:`bill_of_materials`.
    """
    axis, crank_pin, *_ = [*robot.linkage.bodies[CRANK - 1][1]]
    end, pieces = placed[-1].top, Counter[tuple[str, str, str, str]]()
    stacks = defaultdict[tuple[str, object, bool], list[tuple[float, float]]](list)
    for item in placed:
        for joint in item.part.joints:
            axle = joint in item.through
            where: object = item.unit if joint == crank_pin else (item.unit, item.leg)
            where = robot.legs[item.leg].side if axle else where
            stacks[joint, where, axle].append((item.z, item.top))
    for (joint, _, axle), stack in stacks.items():
        if joint == axis:
            continue
        faces = sorted([*stack, (0.0, 0.0), (end, end)] if axle else stack)
        name, radius, wall, owner = "pin", SPACER, 1.9, "link's"
        if axle:
            name, radius, wall, owner = "axle", TUBE, 2.0, "cross-member"
        if len(faces) > 1:  # a toe has no pin
            size = f"{2 * PIN:g} x {faces[-1][1] - faces[0][0]:.1f} mm"
            pieces[f"{name}, at {joint}", "steel", size, owner] += 1
        for (_, top), (bottom, _) in pairwise(faces):
            if bottom - top > GAP + TOLERANCE:
                size = f"{2 * radius:g} x {wall:g} x {bottom - top:.1f} mm"
                pieces[f"spacer, at {joint}", "EN AW-6060 tube", size, owner] += 1
    webs = [item for item in placed if item.body == CRANK]
    tops = [-SHAFT_END, *(item.top for item in webs[1::2])]
    bottoms = [*(item.z for item in webs[::2]), end + SHAFT_END]
    for top, bottom in zip(tops, bottoms, strict=True):
        size = f"{2 * SHAFT:g} x {bottom - top:.1f} mm"
        pieces["shaft, at O", "steel C45", size, "crankshaft"] += 1
    size = f"{2 * HUB:g} x {HUB_LENGTH:g} mm, bore {2 * SHAFT:g}, spigot {2 * PIN:g}, two screws M3"
    pieces["hub, at O", "EN AW-6060", size, "crankshaft"] += len(webs)
    size = f"{2 * SHAFT:g} x {2 * (SHAFT + BUSH - PIN):g} mm"
    pieces["bush, at O", "iglidur J200", size, "crankshaft"] += len(webs)  # one in each frame
    return [Part(name, material, size, number, 0.0, note=f"counted in the {owner} mass")
            for (name, material, size, owner), number in pieces.items()]  # fmt: skip


def to_csv(parts: Sequence[Part]) -> str:
    """The bill of materials as CSV; parts that are counted in others have no mass."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(COLUMNS)
    for part in parts:
        numbers = part.thickness, 1e3 * part.each
        thick, mass = (f"{value:.6g}" if value else "" for value in numbers)
        size = part.dimensions
        rows.writerow((part.name, part.material, size, thick, part.number, mass, part.note))
    return text.getvalue()


def machine(robot: Robot) -> Robot:
    """Return a robot as it would be cut: its parts, with the built robot's feet and motor.

    Joints keep their places and their friction.

    Raises ValueError: a part cannot be made; names it.
    """
    masses = {part.name: part.mass for part in bill_of_materials(robot)}
    links = (_link(robot, k, masses[name]) for k, name in enumerate(robot.linkage.names, 1))
    return with_built_feet(replace(robot, bodies=tuple(links)))


def _link(robot: Robot, body: int, flat: float) -> Plate:
    """Return a body of a leg: its flat parts, and pins, feet, motor and battery as point masses.

    ``flat``: mass of its flat parts in all legs, kg.
    """
    part, legs = link_part(robot, body), len(robot.legs)
    mass = flat / legs
    area, centre, inertia = _moments(part)
    points = [(mass, centre)]
    points += [(built.PIN_SHARE, part.joints[joint])
               for index, joint in robot.linkage.holes if index == body]  # fmt: skip
    points += [(built.FOOT_MASS, part.joints[toe]) for toe in feet_of(robot, body)]
    if body == FRAME:
        axis = part.joints[robot.linkage.bodies[CRANK - 1][1][0]]
        pivots = [z for z in part.joints.values() if z != axis]
        sides = len({leg.side for leg in robot.legs})
        share = sides * built.CROSS_MEMBER_MASS + built.BATTERY_MASS / len(pivots)
        points += [(built.AXIS_MASS / legs, axis), *((share / legs, pivot) for pivot in pivots)]
    masses, places = np.array([weight for weight, _ in points]), np.array([z for _, z in points])
    middle = masses @ places / masses.sum()
    turning = mass * inertia / area + float(masses @ abs(places - middle) ** 2)
    joints = [1e-3 * (z - middle) for z in part.joints.values()]
    corners = tuple((float(z.real), float(z.imag)) for z in joints)
    return Plate(corners, float(masses.sum()), 1e-6 * turning)


def _moments(part: CutPart) -> tuple[float, complex, float]:
    """Return area, mm^2, centroid, mm, and second moment about it, mm^4, of a part as drawn."""
    signed = [(1.0, part.outline), *((-1.0, shape) for shape in (*part.windows, *part.holes))]
    moments = np.array([sign * about_origin(shape) for sign, shape in signed]).sum(axis=0)
    area, centre = float(moments[0].real), complex(moments[1] / moments[0])
    return area, centre, float(moments[2].real) - area * abs(centre) ** 2


def about_origin(shape: Round) -> NDArray[np.complex128]:
    """Return area, first and second moment about the origin of a polygon with round corners."""
    p = np.array(hull(z + shape.radius * turn for z in shape.corners for turn in CIRCLE))
    q = np.roll(p, -1)
    cross = (p.conj() * q).imag
    squares = abs(p) ** 2 + (p.conj() * q).real + abs(q) ** 2
    return np.array([cross.sum() / 2, (p + q) @ cross / 6, squares @ cross / 12])
