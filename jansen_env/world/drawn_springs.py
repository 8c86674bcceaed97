"""Springs in pictures: the joints between which they are drawn, and the lines that show them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array
from jansen_env.robot import Robot, Spring

COILS = 7  # number of coils of a linear spring
LEAD = 0.14  # length of the straight line at each of its ends, as a fraction of the whole length
TURNS = 1  # number of whole turns of a torsion spring, in addition to its angle
SPIRAL_POINTS = 48  # number of lines of a torsion spring
MOST_SPRINGS = 128  # largest number of springs in a picture


class DrawnSpring(NamedTuple):
    """A spring of one leg.

    Attributes:
        leg: Index of the leg.
        joints: Indices of joints of the leg. A linear spring has those of its ends: two, or one if
            its second end is on the chassis. A torsion spring has three: its pin, another joint of
            the first link, and another joint of the second link.
        anchor: End on the chassis, in the chassis frame, in m. None if there is none.
    """

    leg: int
    joints: tuple[int, ...]
    anchor: tuple[float, float] | None = None


def drawn_springs(robot: Robot) -> list[DrawnSpring]:
    """Return the springs of all legs, at most :data:`MOST_SPRINGS`."""
    index = robot.linkage.joints.index
    members = {name: joints for name, joints in robot.linkage.bodies}
    drawn = []
    for leg, placed in enumerate(robot.legs):
        for spring in robot.springs:
            if not isinstance(spring, Spring):
                first, second = members[spring.first], members[spring.second]
                pin = next(joint for joint in first if joint in second)
                others = (next(joint for joint in link if joint != pin) for link in (first, second))
                drawn.append(DrawnSpring(leg, (index(pin), *map(index, others))))
            elif spring.end:
                drawn.append(DrawnSpring(leg, (index(spring.start), index(spring.end))))
            else:
                x, y = spring.anchor
                mirrored = (x if placed.side == "fore" else -x, y)
                drawn.append(DrawnSpring(leg, (index(spring.start),), mirrored))
    return drawn[:MOST_SPRINGS]


def coil(start: ArrayLike, end: ArrayLike, width: float) -> Array:
    """Return the zigzag line of a linear spring.

    Args:
        start: First end, shape (2,).
        end: Second end, shape (2,).
        width: Width of the coils.

    Returns:
        Points of the line, shape (points, 2).
    """
    first, last = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    way = last - first
    length = float(np.hypot(*way))
    side = np.array([-way[1], way[0]]) / length if length > 0.0 else np.array([0.0, 1.0])
    peaks = 2 * COILS
    share = LEAD + (1.0 - 2.0 * LEAD) * (np.arange(peaks) + 0.5) / peaks
    offset = np.where(np.arange(peaks) % 2 == 0, 0.5, -0.5) * width
    zigzag = first + share[:, None] * way + offset[:, None] * side
    straight = [first, first + LEAD * way], [last - LEAD * way, last]
    return np.concatenate([straight[0], zigzag, straight[1]])


def spiral(pin: ArrayLike, first: ArrayLike, second: ArrayLike, radius: float) -> Array:
    """Return the spiral of a torsion spring, from the first link to the second.

    Args:
        pin: Pin of the two links, shape (2,).
        first: Another joint of the first link, shape (2,).
        second: Another joint of the second link, shape (2,).
        radius: Outer radius. The inner radius is half of it.

    Returns:
        Points of the line, shape (points, 2).
    """
    centre = np.asarray(pin, dtype=float)
    begin, end = (math.atan2(y, x) for x, y in (first - centre, second - centre))
    turned = (end - begin) % (2.0 * math.pi) + 2.0 * math.pi * TURNS
    share = np.linspace(0.0, 1.0, SPIRAL_POINTS + 1)
    angle = begin + share * turned
    reach = radius * (0.5 + 0.5 * share)
    return centre + reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
