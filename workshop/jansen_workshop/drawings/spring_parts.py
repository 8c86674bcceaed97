"""Springs of a machine in its bill of materials, and ends of springs that no part carries.

An end at a joint with a pin is an eye on this pin. An end at another point of a part has a hole of
its own (:func:`jansen_workshop.drawings.outlines.spring_holes`). An end on the chassis that the
part of the frame does not reach needs a bracket, which is not drawn.
"""

from __future__ import annotations

import math

import numpy as np

from jansen_env.dynamics.spring_forces import rest_angles, spring_lengths
from jansen_env.robot import Robot, Spring, TorsionSpring
from jansen_env.robot.kinematics import coordinates
from jansen_env.robot.part_sizes import radii
from jansen_env.robot.spring import AnySpring
from jansen_workshop.drawings.materials import Part
from jansen_workshop.drawings.outlines import SpringEnd, link_part, spring_ends

SAMPLES = 360  # number of crank angles at which the longest spring is sought
ALIGNED = 1e-3  # distance at which a hole is at the end of a spring, in mm


def spring_rows(robot: Robot) -> list[Part]:
    """Return the lines of the springs, one per spring of a leg.

    The springs have no mass, as in the model, and no price.

    Args:
        robot: Robot whose springs are listed.
    """
    return [_row(robot, spring) for spring in robot.springs]


def missing_brackets(robot: Robot) -> list[str]:
    """Return a warning for each spring with an end that no part carries."""
    linear = [spring for spring in robot.springs if isinstance(spring, Spring)]
    return [
        f"warning: no part has a hole for the end of {spring_name(spring)} at "
        f"{_place(spring, end)}; fix it to a bracket, which is not drawn"
        for spring in linear
        for end in spring_ends(robot, spring)
        if hole_at(robot, end) is None
    ]


def hole_at(robot: Robot, end: SpringEnd) -> float | None:
    """Return the diameter of the hole at the end of a spring, in mm. None if there is no hole."""
    for hole in link_part(robot, end.body).holes:
        if abs(hole.corners[0] - end.place) < ALIGNED:
            return 2.0 * hole.radius
    return None


def spring_name(spring: AnySpring) -> str:
    """Return the name of a spring in the bill of materials."""
    if isinstance(spring, TorsionSpring):
        return f"torsion spring {spring.first}-{spring.second}"
    return f"spring {spring.start}-{spring.end or 'chassis'}"


def _row(robot: Robot, spring: AnySpring) -> Part:
    """Return the line of a spring."""
    if isinstance(spring, TorsionSpring):
        torsion = [each for each in robot.springs if isinstance(each, TorsionSpring)]
        angle = math.degrees(rest_angles(robot)[torsion.index(spring)])
        size = f"{spring.stiffness:g} N m/rad, no torque at {angle:.1f} degrees"
        note = f"angle of {spring.second} minus that of {spring.first}; opposite on back legs"
    else:
        linear = [each for each in robot.springs if isinstance(each, Spring)]
        psi = 2.0 * math.pi / SAMPLES * np.arange(SAMPLES)
        lengths = spring_lengths(robot, "fore", coordinates(robot, "fore", psi))
        longest = 1e3 * float(lengths[:, linear.index(spring)].max())
        rest = 1e3 * spring.rest_length
        size = f"{spring.stiffness:g} N/m, rest {rest:.1f} mm, longest {longest:.1f} mm"
        note = "; ".join(_fixed(robot, spring, end) for end in spring_ends(robot, spring))
    return Part(spring_name(spring), "spring steel", size, len(robot.legs), 0.0, note=note)


def _fixed(robot: Robot, spring: Spring, end: SpringEnd) -> str:
    """Return how the end of a spring is fixed."""
    diameter = hole_at(robot, end)
    if diameter is None:
        return f"bracket at {_place(spring, end)}"
    pin, _, shaft, _ = radii(robot.build)
    if end.joint == robot.linkage.joints[robot.linkage.axis]:
        return f"eye on the shaft of {2.0 * shaft:g} mm"
    if end.joint in {each.joint for each in robot.linkage.pins}:
        return f"eye on the pin of {2.0 * pin:g} mm at {end.joint}"
    return (
        f"hole of {diameter:g} mm in {robot.linkage.names[end.body - 1]} at {_place(spring, end)}"
    )


def _place(spring: Spring, end: SpringEnd) -> str:
    """Return a text with the position of the end of a spring."""
    if end.joint:
        return end.joint
    x, y = (1e3 * value for value in spring.anchor)
    return f"({x:g}, {y:g}) mm from the crank axis of a fore leg"
