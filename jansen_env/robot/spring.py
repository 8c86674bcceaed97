"""Springs of a leg: linear springs between two points, and torsion springs between two links.

Springs have no mass and no damping. All legs of a robot have the same springs. Those of a back leg
are the mirror images of those of a fore leg.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from jansen_env.checks import check_limits, instance, invalid, listed, set_checked
from jansen_env.engine.topology import (
    CHASSIS,
    SPRING_FAULTS,
    find_spring_fault,
    find_torsion_fault,
)
from jansen_env.robot.linkage import FRAME, Linkage
from jansen_env.robot.links import Angle, Point, Size, point, within_a_turn


@dataclass(frozen=True)
class Spring:
    """A linear spring between two points of a leg.

    The spring pulls its ends together with the force ``stiffness * (length - rest_length)``. It
    pushes if this force is negative. Its first end is a joint. Its second end is another joint, or
    a point of the chassis. A joint need not have a pin: any point of a link can be a joint of its
    :class:`jansen_env.robot.Plate`.

    Args:
        start: Joint at the first end.
        end: Joint at the second end. If empty, the second end is at ``anchor``.
        anchor: Second end in the chassis frame of a fore leg, whose origin is the crank axis, in m.
            For a back leg, x is mirrored. It is not used if ``end`` is a joint.
        stiffness: Stiffness, in N/m.
        rest_length: Length at which the spring exerts no force, in m.

    Raises:
        ValueError: If a value has the wrong type or is out of range.
    """

    start: str
    end: str = ""
    anchor: Point = (0.0, 0.0)
    stiffness: Size = 0.0
    rest_length: Size = 0.0

    def __post_init__(self) -> None:
        instance("Spring.start", self.start, str)
        instance("Spring.end", self.end, str)
        check_limits(self)
        set_checked(self, point, "anchor")


@dataclass(frozen=True)
class TorsionSpring:
    """A torsion spring at the pin of two links.

    The spring exerts the torque ``stiffness * (angle - rest_angle)`` on the first link, and the
    opposite torque on the second link, where ``angle`` is the angle of the second link minus that
    of the first link. The angle of a bar is that of the line from its first joint to its second
    joint; :class:`jansen_env.robot.Triangle` and :class:`jansen_env.robot.Plate` explain the angles
    of other links. The two links must not make whole turns relative to each other.

    Args:
        first: Name of the first link.
        second: Name of the second link.
        stiffness: Stiffness, in N m/rad.
        rest_angle: Angle at which the spring exerts no torque, for a fore leg, in rad. Whole turns
            are added to it such that the mean deflection over a turn of the crank is at most half a
            turn.

    Raises:
        ValueError: If a value has the wrong type or is out of range.
    """

    first: str
    second: str
    stiffness: Size = 0.0
    rest_angle: Angle = 0.0

    def __post_init__(self) -> None:
        instance("TorsionSpring.first", self.first, str)
        instance("TorsionSpring.second", self.second, str)
        check_limits(self)
        set_checked(self, within_a_turn, "rest_angle")


AnySpring: TypeAlias = Spring | TorsionSpring


def carrier(linkage: Linkage, joint: str) -> int:
    """Return the index of the body that carries the end of a spring at a joint.

    If several bodies share the joint, it is the frame, or else the last of these bodies. The choice
    affects the forces in the pins of the joint, but not the motion.
    """
    bodies = [k for k, (_, joints) in enumerate(linkage.bodies) if joint in joints]
    return bodies[0] if bodies[0] == FRAME - 1 else bodies[-1]


def check_spring(name: str, spring: AnySpring, linkage: Linkage) -> None:
    """Check that a spring connects two points, or two links, that can move relative to each other.

    Args:
        name: Name of the spring, for error messages.
        spring: The spring.
        linkage: Linkage of the leg.

    Raises:
        ValueError: If a joint or a link does not exist, or the spring has no effect.
    """
    members = {each: joints for each, joints in linkage.bodies}
    if isinstance(spring, TorsionSpring):
        for field in ("first", "second"):
            link = getattr(spring, field)
            if link not in members:
                raise invalid(f"{name}.{field}", link, f"one of {listed(members, link)}")
        links = map(linkage.names.index, (spring.first, spring.second))
        fault = find_torsion_fault(linkage.padded_members, *links)
        if fault >= 0:
            raise invalid(name, spring, SPRING_FAULTS[fault])
        return
    for field in ("start", "end"):
        joint = getattr(spring, field)
        if joint not in [*linkage.joints] and (field == "start" or joint):
            raise invalid(f"{name}.{field}", joint, f"one of {[*linkage.joints]}")
    start = linkage.joints.index(spring.start)
    end = linkage.joints.index(spring.end) if spring.end else CHASSIS
    fault = find_spring_fault(linkage.padded_members, start, end)
    if fault >= 0:
        raise invalid(name, spring, SPRING_FAULTS[fault])
