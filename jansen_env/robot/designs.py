"""Built-in designs: the paper's robot, the "holy numbers", and robots that can be built."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np

from jansen_env.arrays import Ints
from jansen_env.checks import invalid, listed
from jansen_env.engine.link_shapes import (
    FOOT_PLATE,
    FRAME_BAR,
    LOWER_ROD,
    ROD,
    TRIANGULAR,
    put_built_parts,
)
from jansen_env.engine.mathematics import atan2, hypot
from jansen_env.robot import buildable as built
from jansen_env.robot.buildable import PLYWOOD
from jansen_env.robot.linkage import JANSEN
from jansen_env.robot.links import (
    CRANK_RADIUS,
    MOST_PHASES,
    Bar,
    Compliance,
    Link,
    Plate,
    Triangle,
    phased_legs,
)
from jansen_env.robot.motor import MOTORS
from jansen_env.robot.robot import Robot
from jansen_env.robot.robot_arrays import leg_links
from jansen_env.robot.zoo import ZOO


def paper_robot(phases: int = 2) -> Robot:
    """Return the paper's robot.

    Args:
        phases: Number of crank pins, each of which drives two legs. The paper's robot has 2 crank
            pins and four legs.
    """
    return Robot(legs=phased_legs(phases))


def holy_numbers_robot(phases: int = 2) -> Robot:
    """Return a robot with Theo Jansen's "holy numbers", scaled to the crank length of the paper.

    Source: T. Jansen, *The Great Pretender* (2007): a 38, b 41.5, c 39.3, d 40.1, e 55.8, f 39.4,
    g 36.7, h 65.7, i 49, j 50, k 61.9, l 7.8, m 15.

    Args:
        phases: Number of crank pins, each of which drives two legs.
    """
    s = CRANK_RADIUS / 15.0
    bodies: dict[str, Link] = {
        "frame": Bar(s * hypot(38.0, 7.8)),
        "crank": Bar(CRANK_RADIUS),
        "upper_rod": Bar(s * 50.0),
        "upper_triangle": Triangle.from_sides(s * 41.5, s * 55.8, s * 40.1),
        "rocker": Bar(s * 39.3),
        "lower_rod": Bar(s * 61.9),
        "coupler": Bar(s * 39.4),
        "foot": Triangle.from_sides(s * 36.7, s * 65.7, s * 49.0, outward=True),
    }
    return _with_links(atan2(7.8, 38.0), bodies, phases)


def _with_links(frame_angle: float, bodies: dict[str, Link], phases: int) -> Robot:
    """Return a robot with Jansen's linkage, and with other links than the paper's.

    Args:
        frame_angle: Angle of the frame, in rad.
        bodies: The new links, by name.
        phases: Number of crank pins.
    """
    return Robot(frame_angle=frame_angle, legs=phased_legs(phases)).with_bodies(**bodies)


FOUND: dict[str, tuple[float, dict[str, Link]]] = {
    "economy": (0.1301, {
        "frame": Bar(0.3556), "crank": Bar(0.1082), "upper_rod": Bar(0.3527),
        "upper_triangle": Triangle.from_sides(0.2995, 0.3853, 0.2268),
        "rocker": Bar(0.2238), "lower_rod": Bar(0.4173), "coupler": Bar(0.2277),
        "foot": Triangle.from_sides(0.2250, 0.3918, 0.3367, outward=True),
    }),
    "climber": (0.1461, {
        "frame": Bar(0.3250), "crank": Bar(0.1324), "upper_rod": Bar(0.2733),
        "upper_triangle": Triangle.from_sides(0.1986, 0.3386, 0.2537),
        "rocker": Bar(0.2630), "lower_rod": Bar(0.3602), "coupler": Bar(0.2267),
        "foot": Triangle.from_sides(0.2967, 0.3083, 0.3881, outward=True),
    }),
    "hiker": (0.1441, {
        "frame": Bar(0.3351), "crank": Bar(0.1265), "upper_rod": Bar(0.2891),
        "upper_triangle": Triangle.from_sides(0.2313, 0.3526, 0.2420),
        "rocker": Bar(0.2642), "lower_rod": Bar(0.3774), "coupler": Bar(0.2271),
        "foot": Triangle.from_sides(0.2857, 0.3644, 0.3451, outward=True),
    }),
    "stroller": (0.1217, {
        "frame": Bar(0.3231), "crank": Bar(0.1273), "upper_rod": Bar(0.3376),
        "upper_triangle": Triangle.from_sides(0.3412, 0.4397, 0.2082),
        "rocker": Bar(0.2560), "lower_rod": Bar(0.4113), "coupler": Bar(0.2610),
        "foot": Triangle.from_sides(0.1846, 0.3979, 0.3701, outward=True),
    }),
}  # fmt: skip
"""Frame angle in rad and links of the robots whose lengths were found by searches.

The searches optimised for little work at 0.5 m/s (``economy``), for high steps (``climber``), for
rough terrain (``hiker``), and for little work at 0.3 m/s (``stroller``).
"""

WEEKEND = {
    "frame": Plate(((-0.0496789, 0.0), (0.0392211, 0.0)), 7.0014e-02, 1.3364e-04),
    "crank": Plate(((-0.0129047, 0.0), (0.0141953, 0.0)), 3.1671e-03, 5.5996e-07),
    "upper_rod": Plate(((-0.0441202, 0.0), (0.0440798, 0.0)), 4.3287e-03, 6.1322e-06),
    "upper_triangle": Plate(((-0.03182, 0.0009162), (0.0270256, -0.0454217),
                   (0.0008555, 0.0472541)), 8.1472e-03, 1.1726e-05),
    "rocker": Plate(((-0.0279349, 0.0), (0.0279651, 0.0)), 3.6698e-03, 2.3032e-06),
    "lower_rod": Plate(((-0.05215, 0.0), (0.05215, 0.0)), 4.6551e-03, 8.8572e-06),
    "coupler": Plate(((-0.0284653, 0.0), (0.0284347, 0.0)), 3.6902e-03, 2.3913e-06),
    "foot": Plate(((0.0423264, 0.0087808), (0.0087867, 0.054),
                   (-0.0287008, -0.0364384)), 1.0061e-02, 1.7474e-05),
}  # fmt: skip
"""Plywood links of the robot ``weekend``, a quarter of the size of those of ``economy``.

Each link includes the parts that are fixed to it. The masses and inertias are those of
:func:`jansen_workshop.drawings.materials.machine`.
"""

BEARING_LOADS = {
    "built": (17.0, 13.0, 11.0, 14.0, 23.0, 14.0, 11.0, 20.0, 11.0, 10.0),
    "economy": (12.6, 8.3, 8.7, 8.4, 17.7, 10.9, 8.5, 14.6, 10.3, 10.1),
    "climber": (24.3, 18.2, 10.7, 17.9, 34.6, 12.0, 10.3, 15.1, 19.3, 19.2),
    "hiker": (17.4, 10.8, 11.1, 10.7, 21.4, 5.5, 10.8, 12.2, 12.1, 12.0),
    "stroller": (16.1, 10.8, 8.8, 11.2, 25.3, 18.5, 8.5, 22.7, 14.1, 13.6),
    "weekend": (1.09, 0.77, 0.73, 0.78, 1.53, 1.05, 0.73, 1.44, 0.89, 0.88),
}
"""Mean load of each bearing of the robots that can be built, in N, by name.

The loads are those of walking at a crank speed of 2 rad/s, or 4 rad/s for the robot ``weekend``.
"""


def built_robot(phases: int = 2) -> Robot:
    """Return a robot that can be built: the paper's linkage in aluminium, with a gearmotor.

    The robot has flat bars, plates with windows, pins in dry plain bearings, and rubber feet; see
    :mod:`jansen_env.robot.buildable`. The bearings have only Coulomb friction, which follows from
    their mean loads.

    Args:
        phases: Number of crank pins, each of which drives two legs.
    """
    return _with_hardware(paper_robot(phases), BEARING_LOADS["built"])


def found_robot(name: str, phases: int = 2) -> Robot:
    """Return a robot that is built like :func:`built_robot`, with links from :data:`FOUND`.

    Args:
        name: Key of :data:`FOUND`.
        phases: Number of crank pins, each of which drives two legs.
    """
    return _with_hardware(_with_links(*FOUND[name], phases), BEARING_LOADS[name])


def weekend_robot(phases: int = 2) -> Robot:
    """Return a quarter-size ``economy`` robot of plywood and M3 screws, with a hobby gearmotor.

    Args:
        phases: Number of crank pins, each of which drives two legs.
    """
    frame = WEEKEND["frame"]
    legs = len(phased_legs(phases))
    # Each leg carries a fraction of the motor and battery. The plywood of the frame is only 7 % of
    # the frame's mass, so that the whole mass is scaled.
    share = 4.0 / legs
    frame = replace(frame, mass=share * frame.mass, inertia=share * frame.inertia)
    robot = _with_links(0.1301, {**WEEKEND, "frame": frame}, phases)
    robot = replace(robot, material="plywood")
    friction = tuple(round(built.dry_torque(load, PLYWOOD), 5) for load in BEARING_LOADS["weekend"])
    robot = replace(robot, damping=(0.0,) * len(JANSEN.damped), bearing_friction=friction)
    return with_built_feet(robot)


def _with_hardware(robot: Robot, bearing_loads: tuple[float, ...]) -> Robot:
    """Return a copy of the robot with built parts, dry bearings, built feet and the gearmotor.

    Args:
        robot: The robot.
        bearing_loads: Mean load of each bearing, in N.
    """
    robot = with_built_feet(with_built_parts(robot))
    friction = tuple(round(built.dry_torque(load), 4) for load in bearing_loads)
    return replace(robot, damping=(0.0,) * len(JANSEN.damped), bearing_friction=friction)


def with_built_feet(robot: Robot) -> Robot:
    """Return a copy of the robot with the rubber feet and the motor that belong to its material."""
    build = robot.build
    normal, tangential = build.foot_stiffness
    damping = [round(built.foot_damping(k, robot.mass, build), 1) for k in build.foot_stiffness]
    give = Compliance(normal, damping[0], tangential, damping[1])
    return replace(
        robot, pad_radius=build.foot_radius, motor=MOTORS[build.motor], pad_compliance=give
    )


def with_built_parts(robot: Robot) -> Robot:
    """Return a copy of the robot with the masses and inertias of aluminium parts of its lengths.

    The parts are flat bars and triangular plates. The rubber foot is at the third joint of the body
    ``foot``. The frame carries the motor, the crankshaft, the battery and the cross-members.
    """
    links, points, _ = leg_links(robot)
    put_built_parts(links, points, built_parts_of(robot), len(robot.legs), built.build_row())
    inertial = zip(links["mass"].tolist(), links["inertia"].tolist(), strict=True)
    bodies = zip(robot.bodies, inertial, strict=True)
    return replace(robot, bodies=tuple(replace(link, mass=m, inertia=J) for link, (m, J) in bodies))


def built_parts_of(robot: Robot) -> Ints:
    """Return the kind of built part for each body, shape (bodies,).

    The numbers of the kinds are those of
    :func:`jansen_env.engine.link_shapes.put_built_parts`.
    """
    bars = {"frame": FRAME_BAR, "lower_rod": LOWER_ROD}
    return np.array(
        [
            (FOOT_PLATE if name == "foot" else TRIANGULAR)
            if isinstance(link, Triangle)
            else bars.get(name, ROD)
            for name, link in zip(robot.linkage.names, robot.bodies, strict=True)
        ]
    )


def is_of_built_parts(robot: Robot) -> bool:
    """Return whether a robot has the masses and inertias of :func:`with_built_parts`."""
    known = not any(isinstance(link, Plate) for link in robot.bodies)
    return known and with_built_parts(robot).bodies == robot.bodies


ROBOTS: dict[str, Callable[..., Robot]] = {
    "paper": paper_robot,
    "paper_slender": lambda phases=2: paper_robot(phases).with_slender_inertias(),
    "holy": holy_numbers_robot,
    "holy_slender": lambda phases=2: holy_numbers_robot(phases).with_slender_inertias(),
    "built": built_robot,
    **{name: partial(found_robot, name) for name in FOUND},
    "weekend": weekend_robot,
    **ZOO,
}
"""Functions that return built-in designs, by name.

The argument of each function is the number of crank pins. Each crank pin drives two toes.
"""


@cache
def named_robot(name: str, argument: str = "robot") -> Robot:
    """Return the built-in design for a name such as "built" or "built:12".

    Args:
        name: A key of :data:`ROBOTS`. A colon and a number of legs may follow, for example
            "built:12". The legs are in pairs on evenly spaced crank pins. A unit of "strider"
            counts as two legs.
        argument: Name of the argument, for the error message.

    Raises:
        ValueError: If there is no such design, or if the text after the colon is not an even
            number from 2 to 200.
    """
    design, colon, legs = name.partition(":")
    if design not in ROBOTS:
        known = listed(sorted(ROBOTS), design)
        raise invalid(argument, name, f"a robot file (.json) or one of {known}")
    if not colon:
        return ROBOTS[design]()
    if not legs.isdecimal() or int(legs) % 2 or not 1 <= int(legs) // 2 <= MOST_PHASES:
        allowed = f"{design!r}, ':' and an even number of legs from 2 to {2 * MOST_PHASES}"
        raise invalid(argument, name, allowed)
    return ROBOTS[design](int(legs) // 2)
