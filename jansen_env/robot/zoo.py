"""Other legs with one crank, scaled to the height and mass of the paper's robot.

The link lengths are those that the authors of the legs published. A leg is described as it is
drawn: each body lists its joints and their positions in axes that belong to the body, in the length
unit of the source. All links are slender rods or uniform plates of equal mass.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jansen_env.checks import entries, instance, invalid, positive
from jansen_env.engine.closure import mean, put_lowest_toes, put_turn_angles
from jansen_env.engine.mathematics import hypot
from jansen_env.robot.kinematics import joints_of_legs
from jansen_env.robot.linkage import Dyad, Linkage
from jansen_env.robot.links import Bar, Leg, Link, Plate, phased_legs, point
from jansen_env.robot.robot import Robot
from jansen_env.robot.robot_arrays import toe_joints

Place = tuple[float, float]
Body = dict[str, Place]
"""Names and positions of the joints of a body."""

DAMPING = 0.1  # viscous coefficient of every pin, as in the paper's Table 1, in N m s/rad


def robot_from_joints(
    bodies: dict[str, Body],
    dyads: Sequence[tuple[str, str, str, int]],
    toes: str,
    legs: Sequence[Leg],
    *,
    mass: float = 3.2,
    height: float | None = None,
) -> Robot:
    """Return a robot whose legs are any linkage with one crank.

    Links with two joints are slender rods, and all other links are uniform plates. All links have
    the same mass.

    Args:
        bodies: The bodies of a leg by name, the frame first and the crank second. Each body maps
            its joints, which are single letters, to their positions in m. The positions of the
            frame's joints are in the axes of the chassis, with the crank axis at the origin. The
            first joint of the crank is the crank axis. The positions of the joints of the crank and
            of all other bodies are in any axes that are fixed to the body. The angle of a body is
            that of its axes, or, for a body with two joints, that of the line from the first joint
            to the second.
        dyads: Tuples (joint, start, end, branch) in the order in which the joints are computed; see
            :class:`jansen_env.robot.Dyad`.
        toes: Joints that touch the ground.
        legs: Side and crank phase of each leg.
        mass: Mass of the robot, in kg.
        height: Mean height of the crank axis above the lowest toe over a turn, in m. All lengths
            are scaled so that the robot has this height. None keeps the lengths.

    Raises:
        ValueError: If the joints do not form a leg with one degree of freedom, or ``height`` is
            given and the toes are above the crank axis.
        LinkageError: If ``height`` is given and the linkage does not close.
    """
    named = []
    for name, body in instance("bodies", bodies, dict).items():
        where = f"bodies[{name!r}]"
        for joint, place in instance(where, body, dict).items():
            if not isinstance(joint, str) or len(joint) != 1:
                raise invalid(f"a joint of {where}", joint, "a letter")
            point(f"{where}[{joint!r}]", place)
        named.append((name, "".join(body)))
    linkage = Linkage(tuple(named), dyads, toes)  # type: ignore[arg-type] # it makes dyads of them
    legs = entries("legs", legs, "at least one Leg")
    each = positive("mass", mass) / max(1, len(legs) * len(bodies))
    pins = len(linkage.pins)
    frame, *others = (list(joints.values()) for joints in bodies.values())

    def of_scale(scale: float) -> Robot:
        links = [_link(places, scale, each) for places in others]
        chassis = Plate.uniform([(scale * x, scale * y) for x, y in frame], each)
        return Robot(
            linkage=linkage,
            bodies=(chassis, *links),
            frame_angle=0.0,
            legs=legs,
            damping=(DAMPING,) * pins,
            bearing_friction=(0.0,) * pins,
        )

    unscaled = of_scale(1.0)
    if height is None:
        return unscaled
    stands = standing_height(unscaled)
    if stands <= 0.0:
        raise ValueError(
            f"height must be None because the toes are {-stands:g} m above O, got {height}"
        )
    return of_scale(positive("height", height) / stands)


def _as_the_paper(
    bodies: dict[str, Body], dyads: list[Dyad], toes: str, legs: tuple[Leg, ...]
) -> Robot:
    """Return a robot with the height and mass of the paper's four-legged robot."""
    paper = Robot()
    return robot_from_joints(
        bodies, dyads, toes, legs, mass=paper.mass, height=standing_height(paper)
    )


def _link(places: list[Place], scale: float, mass: float) -> Link:
    if len(places) == 2:
        (x, y), (u, v) = places
        return Bar(scale * hypot(u - x, v - y), mass).slender()
    return Plate.uniform([(scale * x, scale * y) for x, y in places], mass)


HEIGHT_SAMPLES = 360  # number of crank angles per turn


def standing_height(robot: Robot, samples: int = HEIGHT_SAMPLES) -> float:
    """Return the mean height of the crank axis above the lowest toe over a turn, in m.

    The chassis is kept level during the turn.

    Args:
        robot: The robot.
        samples: Number of crank angles in the turn.

    Raises:
        LinkageError: If the linkage does not close.
    """
    psi = np.empty(samples)
    heights = np.empty(samples)
    put_turn_angles(0.0, psi)
    put_lowest_toes(joints_of_legs(robot, psi), toe_joints(robot), heights)
    return -float(mean(heights))


def klann_robot(phases: int = 2) -> Robot:
    """Return a robot with Joe Klann's leg of six bodies.

    Source: J. Klann, US patent 6,260,862 (2001), coordinates of the example leg. In the patent, the
    toe T is the foot 33, the crank axis is 15, the crank pin 29, the pivots are 11 and 9, the elbow
    is 27, the knee 35 and the hip 37.
    """
    bodies = {
        "frame": {"O": (0.0, 0.0), "B": (-0.590, -0.176), "C": (-0.233, 0.616)},
        "crank": {"O": (0.0, 0.0), "A": (0.268, 0.0)},
        "rod": {"A": (0.0, 0.0), "D": (-0.590, 0.0), "E": (-1.099, 0.116)},
        "lower_rocker": {"B": (1.009, 0.574), "D": (0.741, 0.750)},
        "upper_rocker": {"C": (1.366, 1.366), "F": (0.866, 1.5)},
        "foot": {"E": (0.0, 0.0), "F": (0.634, 0.634), "T": (-0.232, -0.866)},
    }
    dyads = [Dyad("D", "A", "B", -1), Dyad("F", "E", "C", 1)]
    return _as_the_paper(bodies, dyads, "T", phased_legs(phases))


def chebyshev_robot(phases: int = 2) -> Robot:
    """Return a robot with Pafnuty Chebyshev's lambda linkage, whose foot stays parallel.

    The lengths of crank, coupler, rocker and frame (1 : 5 : 2.5 : 2) are those of Chebyshev's
    plantigrade machine (1878). The straight part of the path faces the frame. Therefore the linkage
    stands upright, and its point F moves a foot that is below it. The depth of the foot (7), and
    the links that keep it parallel (the second rocker G-H, the tie B-H and the link H-J), are this
    project's own design.
    """
    bodies = {
        "frame": {"O": (0.0, 0.0), "Q": (2.0, 0.0), "G": (4.0, 0.0)},
        "crank": {"O": (0.0, 0.0), "A": (1.0, 0.0)},
        "coupler": {"A": (0.0, 0.0), "B": (2.5, 0.0), "F": (5.0, 0.0)},
        "rocker": {"Q": (0.0, 0.0), "B": (2.5, 0.0)},
        "second_rocker": {"G": (0.0, 0.0), "H": (2.5, 0.0)},
        "tie": {"B": (0.0, 0.0), "H": (2.0, 0.0)},
        "link": {"H": (0.0, 0.0), "J": (2.5, 0.0)},
        "foot": {"F": (0.0, 0.0), "J": (2.0, 0.0), "T": (0.0, -7.0)},
    }
    dyads = [Dyad("B", "A", "Q", 1), Dyad("H", "B", "G", 1), Dyad("J", "F", "H", 1)]
    return _as_the_paper(bodies, dyads, "T", phased_legs(phases))


def trotbot_robot(phases: int = 2) -> Robot:
    """Return a robot with Wade Vagle's TrotBot leg of eight bodies, without heel and toe links.

    Source: the plans of TrotBot and the author's linkage simulator at diywalkers.com, in LEGO
    units. In the original, the rear legs have their own crank axis. Here all legs share one axis.
    """
    bodies = {
        "frame": {"O": (0.0, 0.0), "P": (-7.0, 6.0)},
        "crank": {"O": (0.0, 0.0), "A": (4.0, 0.0)},
        # C lies 3.0 from A and 7.55 from B.
        "rider": {"A": (0.0, 0.0), "B": (6.0, 0.0), "C": (-1.0002083333333331, 2.828353459157917)},
        "rocker": {"P": (0.0, 0.0), "B": (8.0, 0.0), "D": (-2.0, 0.0)},
        "hanger": {"D": (0.0, 0.0), "E": (6.0, 0.0), "F": (8.0, 0.0)},
        "rod": {"A": (0.0, 0.0), "E": (11.0, 0.0)},
        "shin": {"F": (0.0, 0.0), "T": (8.0, 0.0)},
        "foot": {"C": (0.0, 0.0), "T": (9.0, 0.0)},
    }
    dyads = [Dyad("B", "A", "P", -1), Dyad("E", "D", "A", -1), Dyad("T", "F", "C", -1)]
    return _as_the_paper(bodies, dyads, "T", phased_legs(phases))


def strider_robot(phases: int = 2) -> Robot:
    """Return a robot with Wade Vagle's Strider unit of ten bodies and two toes on each crank pin.

    The unit is its own mirror image. The rod of each side carries the foot of the other side.

    Source: the plans of Strider and the author's linkage simulator at diywalkers.com, in LEGO
    units, without toe extensions.
    """
    bodies = {
        "frame": {"O": (0.0, 0.0), "P": (-11.0, 8.0), "Q": (11.0, 8.0)},
        "crank": {"O": (0.0, 0.0), "A": (4.0, 0.0)},
        "left_rocker": {"P": (0.0, 0.0), "B": (5.0, 0.0)},
        "right_rocker": {"Q": (0.0, 0.0), "C": (5.0, 0.0)},
        "left_rod": {"A": (0.0, 0.0), "B": (-14.0, 0.0), "E": (6.0, 1.0)},
        "right_rod": {"A": (0.0, 0.0), "C": (14.0, 0.0), "D": (-6.0, 1.0)},
        "left_shin": {"B": (0.0, 0.0), "T": (13.0, 0.0)},
        "right_shin": {"C": (0.0, 0.0), "U": (13.0, 0.0)},
        "left_foot": {"D": (0.0, 0.0), "T": (10.0, 0.0)},
        "right_foot": {"E": (0.0, 0.0), "U": (10.0, 0.0)},
    }
    dyads = [
        Dyad("B", "P", "A", -1), Dyad("C", "Q", "A", 1), Dyad("T", "B", "D", -1),
        Dyad("U", "C", "E", 1),
    ]  # fmt: skip
    units = tuple(leg for leg in phased_legs(phases) if leg.side == "fore")
    return _as_the_paper(bodies, dyads, "TU", units)


ZOO = {
    "klann": klann_robot,
    "chebyshev": chebyshev_robot,
    "trotbot": trotbot_robot,
    "strider": strider_robot,
}
"""Functions that return robots with other linkages, by name.

The argument of each function is the number of crank pins. Each crank pin drives two toes.
"""
