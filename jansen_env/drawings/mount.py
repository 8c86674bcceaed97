"""How the motor is mounted and the frames are tied, in mm: screws, standoffs, coupling, motor.

The motor sits on a plate that two standoffs hold in front of the first frame. The same two holes of
a frame take the screws of the brace, which ties a fore frame to a back frame.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

from jansen_env.robot import Robot
from jansen_env.robot.buildable import ALUMINIUM, Build


class Size(NamedTuple):
    """Sizes of a metric screw and of what goes with it, mm; radii are half of a diameter.

    Heads and nuts are as large as their standards allow; a nut's radius reaches to its corners.
    """

    radius: float
    clearance: float  # radius of a hole that it goes through
    socket: tuple[float, float]  # radius and height of the head, ISO 4762
    countersunk: tuple[float, float]  # ISO 10642
    lock_nut: tuple[float, float]  # DIN 985
    thin_nut: tuple[float, float]  # DIN 439


SIZES = {
    "M3": Size(1.5, 1.6, (2.75, 3.0), (3.0, 1.7), (3.18, 4.0), (3.18, 1.8)),
    "M4": Size(2.0, 2.25, (3.5, 4.0), (4.0, 2.3), (4.04, 5.0), (4.04, 2.2)),
}
SHOULDER_HEAD = 5.0, 4.5  # radius and height, of a shoulder screw of 6 mm, ISO 7379
SHOULDER_NUT = 4.62, 2.7  # of its thin nut M5
COLLAR = 6.0, 8.0  # radius and length, of a shaft collar of 6 mm, DIN 705


class Mount(NamedTuple):
    """Sizes about a build's motor, mm.

    Attributes:
        screws: distance of the two holes of a frame from the crank axis, along its bar.
        standoff: length of the standoffs between frame and motor plate.
        standoff_radius: to the corners of a standoff's hexagon.
        doublers: further frames that are glued to the first one, on the motor's side.
        motor: radius and length of the motor.
        motor_shaft: radius and length of the motor's shaft; length 0 for a flange.
        coupling: radius and length of the coupling of the two shafts, or of the hub on the motor's
            flange without the flange.
        flange: radius and thickness of that hub's flange, and radius of its circle of screws;
            zeros for a coupling.
        plate: corners of the motor plate, the crank axis at the origin and the frame's bar along x.
        plate_margin: what the plate reaches beyond these corners.
        plate_hole: radius of the hole about the crank axis.
        plate_text: ends of the line that has the plate's name.
        motor_screws: places of the screws into the motor.
        into_motor: length of the screws in the motor's threads.
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
    """Return the sizes about a build's motor."""
    return ALUMINIUM_MOUNT if build is ALUMINIUM else PLYWOOD_MOUNT


def units(robot: Robot) -> list[tuple[int, ...]]:
    """Legs on each crank pin, one of either side at most."""
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
    """Number of neighbouring frames of two units that face two ways, each tied by a brace."""
    return sum(
        robot.legs[before[-1]].side != robot.legs[after[0]].side
        for before, after in pairwise(units(robot))
    )
