"""The bill of materials of the built robot, from the numbers of its code."""

from __future__ import annotations

from typing import NamedTuple

from benchmarks.measure import table
from jansen_env import Robot
from jansen_env.robot import buildable as built

MATERIALS = {"flat bar": "EN AW-6060 T66 flat bar", "plate": "EN AW-6060 T66 sheet, laser cut"}


class Part(NamedTuple):
    """A line of the bill of materials.

    Attributes:
        each: kg. price: class: A below 10 EUR, B 10 to 100 EUR, C above (for all of them).
    """

    name: str
    material: str
    dimensions: str
    number: int
    each: float
    price: str

    @property
    def mass(self) -> float:
        """Mass of all of them, kg."""
        return self.number * self.each


def bill_of_materials(robot: Robot) -> list[Part]:
    """All parts of the built robot; their masses add up to the robot's."""
    legs, parts, ends = len(robot.legs), [], 0
    for name in ("frame", "crank", "upper_rod", "rocker", "lower_rod", "coupler"):
        link, width = robot.body(name), built.FRAME_WIDTH if name == "frame" else built.WIDTH
        thickness = built.bar_thickness(name)
        size = f"{1e3 * width:g} x {1e3 * thickness:g} mm, {1e3 * link.length:.1f} mm"
        bare = built.flat_bar(link.length, width, 0.0, thickness).mass
        parts.append(Part(name, MATERIALS["flat bar"], f"{size} between pins", legs, bare, "A"))
        ends += 2 * legs
    for name in ("upper_triangle", "foot"):
        sides = robot.body(name).sides
        pins = " / ".join(f"{1e3 * side:.1f}" for side in sides)
        size = f"{1e3 * built.PLATE_THICKNESS:g} mm, pins' triangle {pins} mm"
        bare = built.triangular_plate(sides, 0.0).mass
        parts.append(Part(name, MATERIALS["plate"], size, legs, bare, "B"))
        ends += 3 * legs
    ends -= legs  # the toes
    pin = "shoulder screw, nut, washers, spacer; iglidur J200 bush, 6 mm"
    tread = f"natural rubber, {built.RUBBER_HARDNESS:g} Shore A, bonded to its shoe"
    round_ = (
        f"half-round, radius {1e3 * built.FOOT_RADIUS:g} mm, {1e3 * built.FOOT_WIDTH:g} mm wide"
    )
    return [
        *parts,
        Part("pin and bush, a link's share", pin, "half a joint", ends, built.PIN_SHARE, "B"),
        Part("foot's tread", tread, round_, legs, built.TREAD_MASS, "B"),
        Part("foot's shoe", "EN AW-6060 sheet, two M4 screws", "40 x 30 x 3 mm", legs,
             built.SHOE_MASS, "A"),
        Part("crankshaft, at O", "steel C45; hubs of EN AW-6060", "12 x 160 mm; 4 hubs 25 x 10 mm",
             1, built.CRANKSHAFT_MASS, "B"),
        Part("motor plate, at O", "EN AW-6060 sheet", "100 x 100 x 4 mm, hole 60 mm", 1,
             built.MOTOR_PLATE_MASS, "A"),
        Part("cross-member, at P", "EN AW-6060 T66 tube", "20 x 2 mm, 200 mm", 2,
             built.CROSS_MEMBER_MASS, "A"),
        Part("gearmotor, at O", "T-Motor AK80-6", "98 x 38.5 mm", 1, built.MOTOR_MASS, "C"),
        Part("battery, controller, cables", "LiPo 6S", "in two halves, at P", 1,
             built.BATTERY_MASS, "C"),
    ]  # fmt: skip


def parts_table(robot: Robot) -> str:
    """The bill of materials."""
    parts = bill_of_materials(robot)
    head = ("part", "material", "dimensions", "number", "each (g)", "all (g)", "price class")
    rows = [(p.name, p.material, p.dimensions, p.number, f"{1e3 * p.each:.1f}",
             f"{1e3 * p.mass:.0f}", p.price) for p in parts]  # fmt: skip
    total = ("all", "", "", "", "", f"{1e3 * sum(p.mass for p in parts):.0f}", "")
    return table(head, [*rows, total])
