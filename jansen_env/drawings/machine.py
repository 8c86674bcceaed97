"""The machine that the drawings make, as a robot with the masses and inertias of its parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jansen_env.drawings.materials import bill_of_materials, counts
from jansen_env.drawings.outlines import CutPart, Round, feet_of, hull, link_part
from jansen_env.robot import Compliance, Plate, Robot
from jansen_env.robot import buildable as built
from jansen_env.robot.linkage import CRANK, FRAME
from jansen_env.robot.motor import MOTORS

CIRCLE = np.exp(2j * np.pi * np.arange(64) / 64)


def machine(robot: Robot) -> Robot:
    """Return a robot as it would be cut: its parts, with the built robot's feet and motor.

    Joints keep their places and their friction.

    Raises ValueError: a part cannot be made; names it.
    """
    made = replace(
        robot, bodies=tuple(_link(robot, body) for body in range(1, len(robot.bodies) + 1))
    )
    damping = [round(built.foot_damping(one, made.mass), 1) for one in built.FOOT_STIFFNESS]
    normal, tangential = zip(built.FOOT_STIFFNESS, damping, strict=True)
    return replace(
        made, pad_radius=built.FOOT_RADIUS, motor=MOTORS["ak80_6"],
        pad_compliance=Compliance(*normal, *tangential),
    )  # fmt: skip


def _link(robot: Robot, body: int) -> Plate:
    """Return a body of a leg: its flat parts, and pins, feet, motor and battery as point masses."""
    part, legs = link_part(robot, body), len(robot.legs)
    each = next(one.each for one in bill_of_materials(robot) if one.name == part.name)
    mass = each * counts(robot)[part.name] / legs
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
    masses, places = np.array([one for one, _ in points]), np.array([z for _, z in points])
    middle = masses @ places / masses.sum()
    turning = mass * inertia / area + float(masses @ abs(places - middle) ** 2)
    joints = [1e-3 * (z - middle) for z in part.joints.values()]
    corners = tuple((float(z.real), float(z.imag)) for z in joints)
    return Plate(corners, float(masses.sum()), 1e-6 * turning)


def _moments(part: CutPart) -> tuple[float, complex, float]:
    """Return area, mm^2, centroid, mm, and second moment about it, mm^4, of a part as drawn."""
    signed = [(1.0, part.outline), *((-1.0, one) for one in (*part.windows, *part.holes))]
    found = np.array([sign * _about_origin(shape) for sign, shape in signed]).sum(axis=0)
    area, centre = float(found[0].real), complex(found[1] / found[0])
    return area, centre, float(found[2].real) - area * abs(centre) ** 2


def _about_origin(shape: Round) -> NDArray[np.complex128]:
    """Return area, first and second moment about the origin of a polygon with round corners."""
    p = np.array(hull(z + shape.radius * turn for z in shape.corners for turn in CIRCLE))
    q = np.roll(p, -1)
    cross = (p.conj() * q).imag
    squares = abs(p) ** 2 + (p.conj() * q).real + abs(q) ** 2
    return np.array([cross.sum() / 2, (p + q) @ cross / 6, squares @ cross / 12])
