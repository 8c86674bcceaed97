"""Sizes, in mm, of the parts that mount the motor and tie the frames to one another.

The motor sits on a plate that two standoffs hold in front of the first frame. In the other frames,
the same two holes take the screws of the brace, which ties a fore frame to a back frame.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

from jansen_env.robot import Robot
from jansen_env.robot.buildable import ALUMINIUM, Build


class Size(NamedTuple):
    """Sizes of a metric screw, its clearance hole, its heads and its nuts, in mm.

    Heads and nuts have the largest size that their standards allow. The radius of a nut reaches to
    its corners.

    Attributes:
        radius: Radius of the screw's shank.
        clearance: Radius of a hole through which the screw passes.
        socket: Radius and height of a socket head, ISO 4762.
        countersunk: Radius and height of a countersunk head, ISO 10642.
        lock_nut: Radius and height of a lock nut, DIN 985.
        thin_nut: Radius and height of a thin nut, DIN 439.
    """

    radius: float
    clearance: float
    socket: tuple[float, float]
    countersunk: tuple[float, float]
    lock_nut: tuple[float, float]
    thin_nut: tuple[float, float]


SIZES = {
    "M3": Size(1.5, 1.6, (2.75, 3.0), (3.0, 1.7), (3.18, 4.0), (3.18, 1.8)),
    "M4": Size(2.0, 2.25, (3.5, 4.0), (4.0, 2.3), (4.04, 5.0), (4.04, 2.2)),
}
SHOULDER_HEAD = 5.0, 4.5  # radius and height of the head of a 6 mm shoulder screw, ISO 7379
SHOULDER_NUT = 4.62, 2.7  # radius and height of its thin nut, M5
COLLAR = 6.0, 8.0  # radius and length of a 6 mm shaft collar, DIN 705


class Mount(NamedTuple):
    """Sizes of the motor and its mounting in one build, in mm.

    Points are complex numbers x + i y. Their origin is the crank axis, and x points along the bar
    of the frame.

    Attributes:
        screws: Distances of a frame's two mounting holes from the crank axis, along its bar.
        standoff: Length of the standoffs between the first frame and the motor plate.
        standoff_radius: Radius to the corners of a standoff's hexagon.
        doublers: Number of additional frames glued to the first frame, on the motor's side.
        motor: Radius and length of the motor.
        motor_shaft: Radius and length of the motor's shaft. The length is 0 for a motor with a
            flange.
        coupling: Radius and length of the coupling between the two shafts. For a motor with a
            flange, radius and length of the boss of the hub on that flange.
        flange: Radius and thickness of this hub's flange, and radius of its circle of screws. All
            are zero for a coupling.
        plate: Corners of the motor plate.
        plate_margin: Distance by which the plate extends beyond these corners.
        plate_hole: Radius of the plate's hole around the crank axis.
        plate_text: Ends of the line on which the plate's name is engraved.
        motor_screws: Positions of the screws that enter the motor.
        into_motor: Length of these screws inside the motor's threads.
    """

    screws: tuple[float, float]
    standoff: float
    standoff_radius: float
    doublers: int
    motor: tuple[float, float]
    motor_shaft: tuple[float, float]
    coupling: tuple[float, float]
    flange: tuple[float, float, float]
    plate: tuple[complex, ...]
    plate_margin: float
    plate_hole: float
    plate_text: tuple[complex, complex]
    motor_screws: tuple[complex, ...]
    into_motor: float


ALUMINIUM_MOUNT = Mount(
    screws=(60.0, 95.0),
    standoff=25.0,
    standoff_radius=4.04,
    doublers=0,
    motor=(49.0, 38.5),
    motor_shaft=(0.0, 0.0),
    coupling=(12.5, 19.0),
    flange=(22.0, 6.0, 17.0),
    plate=(-40 + 0j, -40j, 95 + 0j, 40j),
    plate_margin=8.0,
    plate_hole=30.0,
    plate_text=(62 + 0j, 93 + 0j),
    motor_screws=(40 + 0j, 40j, -40 + 0j, -40j),
    into_motor=6.0,
)
PLYWOOD_MOUNT = Mount(
    screws=(17.0, 32.0),
    standoff=25.0,
    standoff_radius=3.18,
    doublers=1,
    motor=(12.5, 69.0),
    motor_shaft=(2.0, 12.5),
    coupling=(5.0, 20.0),
    flange=(0.0, 0.0, 0.0),
    plate=(-12 + 0j, -8.5j, 32 + 0j, 8.5j),
    plate_margin=6.0,
    plate_hole=4.1,
    plate_text=(5 + 5.2j, 24 + 5.2j),
    motor_screws=(8.5j, -8.5j),
    into_motor=3.0,
)


def mount_of(build: Build) -> Mount:
    """Return the sizes of the motor and its mounting for a build.

    Args:
        build: Sizes and materials of the parts.
    """
    return ALUMINIUM_MOUNT if build is ALUMINIUM else PLYWOOD_MOUNT


def units(robot: Robot) -> list[tuple[int, ...]]:
    """Return the indices of the legs on each crank pin.

    A crank pin carries at most one fore leg and one back leg. Two legs share a pin if they are on
    different sides and their phases are equal.

    Args:
        robot: Robot that the legs belong to.
    """
    pins: list[tuple[int, ...]] = []
    for i, leg in enumerate(robot.legs):
        for k, (other, *more) in enumerate(pins):
            turn = math.remainder(leg.phase - robot.legs[other].phase, 2.0 * math.pi)
            if not more and abs(turn) < 1e-9 and robot.legs[other].side != leg.side:
                pins[k] = (other, i)
                break
        else:
            pins.append((i,))
    return pins


def ties(robot: Robot) -> int:
    """Return the number of places where a brace ties two neighbouring frames.

    A brace ties the frames of two neighbouring units whose legs at that place face opposite ways.

    Args:
        robot: Robot that the machine is built from.
    """
    return sum(
        robot.legs[before[-1]].side != robot.legs[after[0]].side
        for before, after in pairwise(units(robot))
    )
