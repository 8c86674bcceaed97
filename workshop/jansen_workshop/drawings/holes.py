"""List of the holes of all flat parts, for a builder who drills them."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from jansen_env.robot import Robot
from jansen_env.robot.buildable import ALUMINIUM
from jansen_workshop.drawings.materials import counts
from jansen_workshop.drawings.outlines import CutPart

USES = {
    True: {"press": "bush", "slide": "fixed pin", "clear": "clearance"},
    False: {"press": "turning screw or shaft", "slide": "fixed screw", "clear": "clearance"},
}
"""Use of each class of holes, for machines with bushes and for machines without bushes."""
COLUMNS = ("part", "name", "diameter mm", "use", "holes each", "parts", "holes in all")


class HoleLine(NamedTuple):
    """Equal holes of one flat part.

    Attributes:
        number: Number of the part in the bill of materials.
        name: Name of the part.
        diameter: Diameter to drill, in mm, including the allowance of the fit.
        use: What the holes are for.
        each: Number of these holes in one part.
        parts: Number of such parts.
    """

    number: int
    name: str
    diameter: float
    use: str
    each: int
    parts: int

    @property
    def total(self) -> int:
        """Number of these holes in all parts."""
        return self.each * self.parts


def list_holes(robot: Robot, parts: Sequence[CutPart]) -> list[HoleLine]:
    """Return a line for every size and use of holes in each part.

    Args:
        robot: Robot to which the parts belong.
        parts: Every flat part of the robot once, with the allowances of its holes, but not of the
            kerf.
    """
    uses = USES[robot.build is ALUMINIUM]
    number = counts(robot)
    lines = []
    for part in sorted(parts, key=lambda part: part.number):
        holes = Counter((round(2.0 * hole.radius, 2), hole.fit) for hole in part.holes)
        for (diameter, fit), each in sorted(holes.items()):
            cut = number[part.name]
            lines.append(HoleLine(part.number, part.name, diameter, uses[fit], each, cut))
    return lines


def count_by_diameter(lines: Sequence[HoleLine]) -> dict[float, int]:
    """Return the number of all holes by their diameter in mm, the smallest diameter first."""
    count: Counter[float] = Counter()
    for line in lines:
        count[line.diameter] += line.total
    return dict(sorted(count.items()))


def to_csv(lines: Sequence[HoleLine]) -> str:
    """Return the list of holes as a CSV table."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for line in lines:
        writer.writerow([*line, line.total])
    return out.getvalue()
