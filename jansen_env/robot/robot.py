"""A robot whose legs are all the same linkage and whose cranks are all on one shaft."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

from jansen_env.checks import (
    AsManyAs,
    AtLeast,
    Rule,
    check_limits,
    entries,
    instance,
    invalid,
    one_of,
    set_checked,
)
from jansen_env.engine.mathematics import atan2
from jansen_env.robot.buildable import BUILDS, Build
from jansen_env.robot.linkage import JANSEN, Linkage
from jansen_env.robot.links import (
    CRANK_RADIUS,
    RIGID,
    SIZE,
    Angle,
    Bar,
    Compliance,
    Leg,
    Length,
    Link,
    Payload,
    Size,
    Triangle,
    phased_legs,
    within_a_turn,
)
from jansen_env.robot.motor import IDEAL, Motor
from jansen_env.robot.spring import AnySpring, Spring, TorsionSpring, check_spring

MOST_PADS = 1200  # largest number of pads of all legs; their contact problem reserves 1.5 GB

PAPER_BODIES = (
    Bar(0.32436),
    Bar(CRANK_RADIUS),
    Bar(0.34885),
    # The constraint equations use the printed centroid data, 1.0101 times (L4, L10, L5).
    Triangle(d=0.122562, l=0.170599, h=0.178215, alpha=1.87097, gamma=1.98742),
    Bar(0.23508),
    Bar(0.38322),
    Bar(0.23934),
    Triangle(d=0.147877, l=0.205316, h=0.252632, alpha=1.57408, gamma=2.19281, outward=True),
)
"""Bodies 1 to 8 of the paper, with the masses and inertias of its Table 1."""


@dataclass(frozen=True)
class Robot:
    """A walking robot whose legs are all the same linkage and whose cranks are all on one shaft.

    The defaults are those of the paper's robot. The constructor does not check whether the robot
    can turn its crank and stand. That is checked when the robot is loaded; see
    :mod:`jansen_env.robot.soundness`.

    Args:
        linkage: Topology of a leg.
        bodies: Links of a leg, in the order of ``linkage.bodies``.
        frame_angle: Angle of the frame in the chassis frame, for a fore leg, in rad. Its magnitude
            is at most one turn.
        damping: Viscous coefficient of each pair in ``linkage.damped``, in N m s/rad.
        legs: The legs, at least one. The crank of the first leg defines the crank angle, so its
            phase must be 0.
        pad_radius: Radius of the round contact pads at toes and outer joints, in m.
        payload: Additional rigid load on the chassis.
        motor: Motor that turns the crank.
        pad_compliance: Compliance of the contact pads.
        bearing_friction: Coulomb friction torque of each pair in ``linkage.bearings``, in N m.
        material: Material of the parts that are drawn and cut, a key of :data:`.buildable.BUILDS`.
            It does not affect the masses, which are those of ``bodies``.
        springs: Springs of each leg. The contact pads have their own springs, see
            ``pad_compliance``.

    Raises:
        ValueError: If an argument has the wrong type or is out of range.
    """

    linkage: Linkage = JANSEN
    bodies: tuple[Link, ...] = PAPER_BODIES
    frame_angle: Angle = atan2(0.04632, 0.32436)
    damping: tuple[Size, ...] = (0.1,) * len(JANSEN.damped)
    legs: tuple[Leg, ...] = field(default_factory=lambda: phased_legs(2))
    pad_radius: Length = 0.01
    payload: Payload = Payload()
    motor: Motor = IDEAL
    pad_compliance: Compliance = RIGID
    bearing_friction: tuple[Size, ...] = (0.0,) * len(JANSEN.bearings)
    material: str = "aluminium"
    springs: tuple[AnySpring, ...] = ()
    RULES: ClassVar[tuple[Rule, ...]] = (
        AsManyAs("bodies", "linkage.bodies"),
        AsManyAs("damping", "linkage.damped"),
        AsManyAs("bearing_friction", "linkage.bearings"),
        AtLeast("legs", 1),
    )

    def __post_init__(self) -> None:
        instance("Robot.linkage", self.linkage, Linkage)
        for name in ("bodies", "damping", "bearing_friction", "legs", "springs"):
            values = entries(f"Robot.{name}", getattr(self, name), "a list")
            object.__setattr__(self, name, values)
        instance("Robot.payload", self.payload, Payload)
        instance("Robot.motor", self.motor, Motor)
        instance("Robot.pad_compliance", self.pad_compliance, Compliance)
        one_of("Robot.material", self.material, BUILDS)
        set_checked(self, within_a_turn, "frame_angle")
        check_limits(self)
        self._check_bodies()
        for name in ("damping", "bearing_friction"):
            numbers = tuple(SIZE.check(f"Robot.{name}", value) for value in getattr(self, name))
            object.__setattr__(self, name, numbers)
        self._check_springs()
        if not all(isinstance(leg, Leg) for leg in self.legs):
            raise invalid("Robot.legs", self.legs, "a sequence of Leg objects")
        pads = len(self.linkage.all_pads)
        if len(self.legs) * pads > MOST_PADS:
            given = f"{len(self.legs)} legs of {pads} pads each"
            raise ValueError(f"Robot.legs must have at most {MOST_PADS} pads in all, got {given}")
        if self.legs[0].phase != 0.0:
            allowed = "0, because the crank of the first leg defines the crank angle"
            raise invalid("Robot.legs[0].phase", self.legs[0].phase, allowed)

    def _check_bodies(self) -> None:
        """Check that each body is a link with the number of joints that the linkage requires."""
        for (name, joints), body in zip(self.linkage.bodies, self.bodies, strict=True):
            if not isinstance(body, Link) or len(body.corners) != len(joints):
                kinds = {2: "a Bar", 3: "a Triangle"}.get(len(joints), "a Plate")
                allowed = f"{kinds} or a Plate with joints {joints}"
                raise invalid(f"Robot.bodies: {name}", body, allowed)

    def _check_springs(self) -> None:
        """Check that the springs fit the linkage."""
        for k, spring in enumerate(self.springs):
            if not isinstance(spring, Spring | TorsionSpring):
                raise invalid(f"Robot.springs[{k}]", spring, "a Spring or a TorsionSpring")
            check_spring(f"Robot.springs[{k}]", spring, self.linkage)

    def body(self, name: str) -> Any:
        """Return the link with a name of ``linkage.names``.

        Raises:
            ValueError: If there is no link with this name.
        """
        one_of("body", name, self.linkage.names)
        return self.bodies[self.linkage.names.index(name)]

    def with_bodies(self, **links: Link) -> Robot:
        """Return a copy of the robot in which some links are replaced.

        Args:
            links: The new links, by their names in ``linkage.names``.

        Raises:
            ValueError: If there is no link with one of these names.
        """
        for name in links:
            one_of("body", name, self.linkage.names)
        pairs = zip(self.linkage.names, self.bodies, strict=True)
        return replace(self, bodies=tuple(links.get(name, body) for name, body in pairs))

    @property
    def build(self) -> Build:
        """Sizes and materials of the parts that have to be cut or ordered."""
        return BUILDS[self.material]

    @property
    def toes(self) -> tuple[tuple[int, int], ...]:
        """Pair of indices (leg, joint) of each toe, leg by leg."""
        count = len(self.linkage.toes)
        joints = [joint for joint, _ in self.linkage.all_pads[:count]]
        return tuple((leg, joint) for leg in range(len(self.legs)) for joint in joints)

    @property
    def links_mass(self) -> float:
        """Total mass of all bodies of all legs, in kg."""
        return len(self.legs) * math.fsum(body.mass for body in self.bodies)

    @property
    def mass(self) -> float:
        """Total mass of the links and the payload, in kg."""
        return self.links_mass + self.payload.mass

    @property
    def leg_names(self) -> tuple[str, ...]:
        """Names of the legs.

        The names are ``rf``, ``lf``, ``rb`` and ``lb`` for the paper's four legs. For all other
        robots they are ``f1``, ``f2``, ... for fore legs and ``b1``, ``b2``, ... for back legs.
        """
        if self.legs == phased_legs(2):
            return ("rf", "lf", "rb", "lb")
        count = {"fore": 0, "back": 0}
        names = []
        for leg in self.legs:
            count[leg.side] += 1
            names.append(f"{leg.side[0]}{count[leg.side]}")
        return tuple(names)

    def with_slender_inertias(self) -> Robot:
        """Return a copy of the robot whose links have the inertias of slender links.

        Bars become slender rods with an inertia of m L^2 / 12, and triangles become uniform plates.
        """
        return replace(self, bodies=tuple(body.slender() for body in self.bodies))
