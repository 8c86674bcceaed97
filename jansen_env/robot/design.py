"""What the machine is: links, joints, legs, masses. Data only, checked when it is made.

Body numbers are the paper's (*Dynamic Analysis and Modeling of Jansen Mechanism*, section 2.1):

==== =================================== ==============================
body what it joins                       field of :class:`Robot`
==== =================================== ==============================
1    fixed pivot P -> crank axis O       ``frame``, at ``frame_angle``
2    crank O -> crank pin A              ``crank``
3    A -> B                              ``upper_rod``
4    triangle P, B, D                    ``upper_triangle``
5    knee C -> P                         ``rocker``
6    C -> A                              ``lower_rod``
7    D -> E                              ``coupler``
8    triangle C, E, toe T                ``foot``
==== =================================== ==============================

Numbers are SI: metres, kilograms, radians, counter-clockwise positive.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from jansen_env.checks import (
    entries,
    finite,
    instance,
    non_negative,
    positive,
    positive_integer,
    shown,
    within,
)
from jansen_env.robot import buildable as built
from jansen_env.robot.motor import IDEAL, MOTORS, Motor

Side = Literal["fore", "back"]

BODIES = ("frame", "crank", "upper_rod", "upper_triangle", "rocker", "lower_rod", "coupler", "foot")
"""Bodies 1 to 8, by the names of :class:`Robot`'s fields."""
BODIES_PER_LEG = len(BODIES)
CRANK_RADIUS = 0.10834  # m, the paper's L2; every built-in design turns this crank
MOST_PHASES = 100  # of crank pins
STIFFEST = 1e20  # N/m and N s/m, of a pad that gives: beyond, it is rigid
JOINT_PAIRS = (
    (1, 2), (2, 3), (3, 4), (3, 6), (4, 5), (5, 6), (5, 8), (4, 7), (6, 8), (7, 8),
)  # fmt: skip
"""Pairs of bodies with viscous friction between them, as in the paper's h_f."""
BEARINGS = (
    (1, 2), (2, 3), (2, 6), (3, 4), (1, 4), (1, 5), (5, 6), (5, 8), (4, 7), (7, 8),
)  # fmt: skip
"""Pairs of bodies that turn on one another where the pins O, A, B, P, C, D and E are: the first one
holds the pin. The frame's at P are among them, which the paper's list leaves out."""


def _set(part: Any, check: Callable[[str, Any], float], *names: str) -> None:
    """Replace fields of a frozen dataclass by what ``check`` makes of them: floats."""
    for name in names:
        value = check(f"{type(part).__name__}.{name}", getattr(part, name))
        object.__setattr__(part, name, value)


@dataclass(frozen=True)
class Bar:
    """A straight link with its centre of mass half way.

    Args:
        length: distance between its two pins, m.
        mass: kg (paper, Table 1: 0.1).
        inertia: about the centre of mass, kg m^2 (paper, Table 1: 0.1).
    """

    length: float
    mass: float = 0.1
    inertia: float = 0.1

    def __post_init__(self) -> None:
        _set(self, positive, "length", "mass")
        _set(self, non_negative, "inertia")

    @property
    def half(self) -> float:
        """From either pin to the centre of mass, m (the paper's d_i and l_i)."""
        return 0.5 * self.length

    def slender(self) -> Bar:
        """The same bar with the inertia of a slender rod, m L^2 / 12."""
        return replace(self, inertia=self.mass * self.length**2 / 12.0)


@dataclass(frozen=True)
class Triangle:
    """A rigid triangle, given as the paper gives it: its corners seen from the centroid.

    The body's angle is the direction from its first corner to the centroid (triangle 4) or from
    the centroid to its first corner (triangle 8); ``alpha`` and ``gamma`` are the angles at the
    centroid between the first corner and the two others, on either side.

    Args:
        d, l, h: centroid to the first, second and third corner, m (d4, l4, h4 or d8, l8, h8).
        alpha: angle between the first and second corner, rad.
        gamma: angle between the first and third corner, rad.
        mass: kg.
        inertia: about the centroid, kg m^2.
    """

    d: float
    l: float  # noqa: E741 - the paper's symbol
    h: float
    alpha: float
    gamma: float
    mass: float = 0.1
    inertia: float = 0.1

    def __post_init__(self) -> None:
        _set(self, positive, "d", "l", "h", "alpha", "gamma", "mass")
        _set(self, non_negative, "inertia")
        if self.alpha + self.gamma >= 2.0 * math.pi:
            raise ValueError(
                f"Triangle: alpha + gamma is {self.alpha + self.gamma}, must be below 2 pi"
            )

    @classmethod
    def from_sides(
        cls, first_second: float, second_third: float, third_first: float, **inertial: float
    ) -> Triangle:
        """Build a triangle from its three side lengths (m), with the centroid's law of cosines.

        Raises:
            ValueError: the three lengths form no triangle.
        """
        a = positive("Triangle.from_sides: first_second", first_second)
        b = positive("Triangle.from_sides: second_third", second_third)
        c = positive("Triangle.from_sides: third_first", third_first)
        if 2.0 * max(a, b, c) >= a + b + c:
            raise ValueError(f"Triangle.from_sides: sides {a}, {b}, {c} m form no triangle")
        # Two thirds of each median: 9 d^2 = 2 a^2 + 2 c^2 - b^2, and so on around.
        d = math.sqrt(2 * a * a + 2 * c * c - b * b) / 3.0
        l = math.sqrt(2 * a * a + 2 * b * b - c * c) / 3.0  # noqa: E741
        h = math.sqrt(2 * b * b + 2 * c * c - a * a) / 3.0
        alpha = math.acos((d * d + l * l - a * a) / (2 * d * l))
        gamma = math.acos((d * d + h * h - c * c) / (2 * d * h))
        return cls(d, l, h, alpha, gamma, **inertial)

    @property
    def sides(self) -> tuple[float, float, float]:
        """Lengths first-second, second-third, third-first, m."""
        beta = 2.0 * math.pi - self.alpha - self.gamma

        def opposite(u: float, v: float, angle: float) -> float:
            return math.sqrt(u * u + v * v - 2.0 * u * v * math.cos(angle))

        return (
            opposite(self.d, self.l, self.alpha),
            opposite(self.l, self.h, beta),
            opposite(self.h, self.d, self.gamma),
        )

    def slender(self) -> Triangle:
        """The same triangle with a uniform plate's inertia, m (a^2 + b^2 + c^2) / 36."""
        return replace(self, inertia=self.mass * sum(s * s for s in self.sides) / 36.0)


@dataclass(frozen=True)
class Leg:
    """One leg: which way it faces, and the angle of its crank ahead of the first crank.

    Args:
        side: ``"fore"`` is the paper's forepaw (its frame reaches to -x), ``"back"`` its mirror.
        phase: crank angle of this leg minus the robot's crank angle, rad.
    """

    side: Side
    phase: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.side, str) or self.side not in ("fore", "back"):
            raise ValueError(f"Leg.side is {shown(self.side)}, must be 'fore' or 'back'")
        _set(self, finite, "phase")


@dataclass(frozen=True)
class Payload:
    """A rigid load on the chassis.

    Args:
        mass: kg. inertia: about its own centre, kg m^2.
        position: of its centre in the chassis frame (crank axis at the origin), m.
    """

    mass: float = 0.0
    inertia: float = 0.0
    position: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        _set(self, non_negative, "mass", "inertia")
        position = entries("Payload.position", self.position, "two numbers (x, y)")
        if len(position) != 2:
            raise ValueError(
                f"Payload.position is {shown(self.position)}, must be two numbers (x, y)"
            )
        position = tuple(finite("Payload.position", value) for value in position)
        object.__setattr__(self, "position", position)


@dataclass(frozen=True)
class Compliance:
    """How a pad gives: spring and damper along the ground's normal, and a bristle along the ground.

    Infinite stiffness is a rigid pad: then an impact ends at once, by the ground's restitution. A
    compliant one bounces by itself, and restitution must be 0.

    Args:
        stiffness: N/m, inf for a rigid pad. damping: N s/m.
        tangential_stiffness: N/m, of the bristle that sticks before it slides; None for as much as
            ``stiffness``. tangential_damping: N s/m, None for as much as ``damping``.

    Raises:
        ValueError: an argument out of range, or only one of the stiffnesses infinite.
    """

    stiffness: float = math.inf
    damping: float = 0.0
    tangential_stiffness: float | None = None
    tangential_damping: float | None = None

    def __post_init__(self) -> None:
        for name, normal in (("stiffness", positive), ("damping", non_negative)):
            tangential = f"tangential_{name}"
            if getattr(self, tangential) is None:
                object.__setattr__(self, tangential, getattr(self, name))
            for field_name in (name, tangential):
                if getattr(self, field_name) != math.inf:
                    _set(self, normal, field_name)
                    within(f"Compliance.{field_name}", getattr(self, field_name), 0.0, STIFFEST)
        if (self.stiffness == math.inf) != (self.tangential_stiffness == math.inf):
            raise ValueError(
                f"Compliance.tangential_stiffness is {self.tangential_stiffness}, must be infinite "
                f"where stiffness is, and nowhere else: that is {self.stiffness}"
            )
        if math.inf in (self.damping, self.tangential_damping):
            raise ValueError(f"Compliance.damping is {self.damping}, must be finite")
        if self.rigid and (self.damping, self.tangential_damping) != (0.0, 0.0):
            raise ValueError(
                f"Compliance.damping is {self.damping}, must be 0 where the stiffness is infinite"
            )

    @property
    def rigid(self) -> bool:
        """Whether the pad does not give."""
        return self.stiffness == math.inf


RIGID = Compliance()


def phased_legs(phases: int) -> tuple[Leg, ...]:
    """A fore and a back leg for each of ``phases`` evenly spaced crank pins: fore legs first.

    Raises:
        ValueError: ``phases`` is not a whole number from 1 to ``MOST_PHASES``.
    """
    phases = positive_integer("phases", phases, MOST_PHASES)
    angles = [2.0 * math.pi * k / phases for k in range(phases)]
    return tuple(Leg(side, angle) for side in ("fore", "back") for angle in angles)


# Triangle 4's constraint equations use the printed centroid data, 1.0101 times (L4, L10, L5).
_PAPER_TRIANGLE_4 = Triangle(d=0.122562, l=0.170599, h=0.178215, alpha=1.87097, gamma=1.98742)
_PAPER_TRIANGLE_8 = Triangle(d=0.147877, l=0.205316, h=0.252632, alpha=1.57408, gamma=2.19281)


@dataclass(frozen=True)
class Robot:
    """A Jansen walker: every leg the same linkage, all cranks on one shaft. Default: the paper's.

    Args:
        frame, frame_angle: P to O, its length and its angle in the chassis frame (fore legs).
        crank, upper_rod, upper_triangle, rocker, lower_rod, coupler, foot: the other bodies.
        damping: viscous coefficient of each pair in :data:`JOINT_PAIRS`, N m s / rad.
        legs: at least one; the first one's crank defines the crank angle, so its phase is 0.
        pad_radius: radius of the round pads at toes and outer joints, m.
        payload: extra rigid load on the chassis.
        motor: what turns the crank; pad_compliance: how the pads give.
        bearing_friction: Coulomb friction torque of each pair in :data:`BEARINGS`, N m.

    Raises:
        ValueError: an argument of another kind or out of range.
            :func:`jansen_env.robot.kinematics.check_closure` refuses a design that cannot turn (run
            when a robot is compiled).
    """

    frame: Bar = Bar(0.32436)
    frame_angle: float = math.atan2(0.04632, 0.32436)
    crank: Bar = Bar(CRANK_RADIUS)
    upper_rod: Bar = Bar(0.34885)
    upper_triangle: Triangle = _PAPER_TRIANGLE_4
    rocker: Bar = Bar(0.23508)
    lower_rod: Bar = Bar(0.38322)
    coupler: Bar = Bar(0.23934)
    foot: Triangle = _PAPER_TRIANGLE_8
    damping: tuple[float, ...] = (0.1,) * len(JOINT_PAIRS)
    legs: tuple[Leg, ...] = field(default_factory=lambda: phased_legs(2))
    pad_radius: float = 0.01
    payload: Payload = Payload()
    motor: Motor = IDEAL
    pad_compliance: Compliance = RIGID
    bearing_friction: tuple[float, ...] = (0.0,) * len(BEARINGS)

    def __post_init__(self) -> None:
        for name in BODIES:
            kind = Triangle if name in ("upper_triangle", "foot") else Bar
            instance(f"Robot.{name}", getattr(self, name), kind)
        instance("Robot.payload", self.payload, Payload)
        instance("Robot.motor", self.motor, Motor)
        instance("Robot.pad_compliance", self.pad_compliance, Compliance)
        _set(self, finite, "frame_angle")
        _set(self, positive, "pad_radius")
        self._set_pairs("damping", "joint pairs", JOINT_PAIRS)
        self._set_pairs("bearing_friction", "bearings", BEARINGS)
        object.__setattr__(self, "legs", entries("Robot.legs", self.legs, "at least one Leg"))
        if not self.legs:
            raise ValueError("Robot.legs is empty, must have at least one Leg")
        if not all(isinstance(leg, Leg) for leg in self.legs):
            raise ValueError(
                f"Robot.legs is {shown(self.legs)}, must be at least one Leg and nothing else"
            )
        if self.legs[0].phase != 0.0:
            raise ValueError(
                f"Robot.legs[0].phase is {self.legs[0].phase}, must be 0: the first leg's crank "
                "defines the crank angle"
            )

    def _set_pairs(self, name: str, label: str, pairs: tuple[tuple[int, int], ...]) -> None:
        """Check a field with one number for each of some pairs of bodies."""
        each = f"one number for each of the {len(pairs)} {label} {pairs}"
        values = entries(f"Robot.{name}", getattr(self, name), each)
        if len(values) != len(pairs):
            raise ValueError(f"Robot.{name} has {len(values)} values, must be {each}")
        checked = tuple(non_negative(f"Robot.{name}", value) for value in values)
        object.__setattr__(self, name, checked)

    @property
    def bodies(self) -> tuple[Bar | Triangle, ...]:
        """Bodies 1 to 8 of a leg."""
        return tuple(getattr(self, name) for name in BODIES)

    @property
    def links_mass(self) -> float:
        """Mass of every body of every leg, kg."""
        return len(self.legs) * sum(body.mass for body in self.bodies)

    @property
    def mass(self) -> float:
        """Total mass, kg: that of the links and the payload."""
        return self.links_mass + self.payload.mass

    @property
    def leg_names(self) -> tuple[str, ...]:
        """``rf``, ``lf``, ``rb``, ``lb`` for the paper's four, else ``f1``.. and ``b1``.."""
        if self.legs == phased_legs(2):
            return ("rf", "lf", "rb", "lb")
        count = {"fore": 0, "back": 0}
        names = []
        for leg in self.legs:
            count[leg.side] += 1
            names.append(f"{leg.side[0]}{count[leg.side]}")
        return tuple(names)

    def with_slender_inertias(self) -> Robot:
        """The same robot with rods of inertia m L^2 / 12 and triangles as uniform plates."""
        return replace(self, **{name: getattr(self, name).slender() for name in BODIES})


def paper_robot(phases: int = 2) -> Robot:
    """The paper's machine with ``phases`` crank pins, two legs on each (2 gives its four legs)."""
    return Robot(legs=phased_legs(phases))


def holy_numbers_robot(phases: int = 2) -> Robot:
    """Theo Jansen's eleven "holy numbers", scaled so that the crank is as long as the paper's.

    Source: T. Jansen, *The Great Pretender* (2007): a 38, b 41.5, c 39.3, d 40.1, e 55.8, f 39.4,
    g 36.7, h 65.7, i 49, j 50, k 61.9, l 7.8, m 15.
    """
    s = CRANK_RADIUS / 15.0
    return Robot(
        frame=Bar(s * math.hypot(38.0, 7.8)),
        frame_angle=math.atan2(7.8, 38.0),
        upper_rod=Bar(s * 50.0),
        upper_triangle=Triangle.from_sides(s * 41.5, s * 55.8, s * 40.1),
        rocker=Bar(s * 39.3),
        lower_rod=Bar(s * 61.9),
        coupler=Bar(s * 39.4),
        foot=Triangle.from_sides(s * 36.7, s * 65.7, s * 49.0),
        legs=phased_legs(phases),
    )


BEARING_LOADS = (17.0, 13.0, 11.0, 14.0, 23.0, 14.0, 11.0, 20.0, 11.0, 10.0)
"""N, mean load of each of :data:`BEARINGS` of the built robot in walks at 2 rad/s."""


def built_robot(phases: int = 2) -> Robot:
    """A machine that could be built: the paper's linkage of aluminium, with a gearmotor.

    Flat bars and windowed plates with pins in dry plain bearings, see
    :mod:`jansen_env.robot.buildable`; the frame's bars carry motor and crankshaft at O, battery
    and cross-members at P, as heavy. Bearings have Coulomb friction alone, by their mean load. Feet
    are half-round treads of rubber with a radius of 20 mm. ``docs/built_robot.md`` has the bill of
    materials and all sources.
    """
    robot, parts = paper_robot(phases), {}
    for name in BODIES:
        link = getattr(robot, name)
        if isinstance(link, Triangle):
            third = built.FOOT_MASS if name == "foot" else None
            mass, inertia = built.triangular_plate(link.sides, third_mass=third)
        elif name == "frame":
            each = built.PIN_SHARE + built.AXIS_MASS / len(robot.legs)
            mass, inertia = built.flat_bar(link.length, built.FRAME_WIDTH, each)
        else:
            thickness = built.bar_thickness(name)
            mass, inertia = built.flat_bar(link.length, built.WIDTH, thickness=thickness)
        parts[name] = replace(link, mass=mass, inertia=inertia)
    robot = replace(robot, **parts)
    normal, tangential = built.FOOT_STIFFNESS
    return replace(
        robot,
        damping=(0.0,) * len(JOINT_PAIRS),
        pad_radius=built.FOOT_RADIUS,
        motor=MOTORS["ak80_6"],
        bearing_friction=tuple(round(built.dry_torque(load), 4) for load in BEARING_LOADS),
        pad_compliance=Compliance(
            normal, round(built.foot_damping(normal, robot.mass), 1),
            tangential, round(built.foot_damping(tangential, robot.mass), 1),
        ),
    )  # fmt: skip


ROBOTS: dict[str, Callable[..., Robot]] = {
    "paper": paper_robot,
    "paper_slender": lambda phases=2: paper_robot(phases).with_slender_inertias(),
    "holy": holy_numbers_robot,
    "holy_slender": lambda phases=2: holy_numbers_robot(phases).with_slender_inertias(),
    "built": built_robot,
}
"""Built-in designs by name; each takes the number of crank phases (legs = 2 x phases)."""
