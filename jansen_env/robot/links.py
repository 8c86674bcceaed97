"""Parts of a machine: links, legs, payload, pads. Data only, checked when it is made.

Numbers are SI: metres, kilograms, radians, counter-clockwise positive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from jansen_env import checks
from jansen_env.checks import set_checked
from jansen_env.engine.link_shapes import (
    is_triangle,
    triangle_of_sides,
    triangle_sides,
    uniform_plate,
)
from jansen_env.engine.mathematics import atan2, hypot

Side = Literal["fore", "back"]

CRANK_RADIUS = 0.10834  # m, the paper's L2; every built-in design turns this crank
MOST_PHASES = 100  # of crank pins
LARGEST = 1e6  # of a mass, an inertia, a friction, a gear, an angle, SI: beyond any machine
STIFFEST = 1e20  # N/m and N s/m, of a compliant pad: beyond, it is rigid


def point(name: str, value: object) -> tuple[float, float]:
    """Return a point as floats. Raises ValueError unless it is two numbers up to LARGEST."""
    x, y = checks.entries(name, value, "two numbers (x, y)", 2)
    return within_largest(name, x), within_largest(name, y)


def within_largest(name: str, value: object) -> float:
    """Return a float. Raises ValueError unless it is a number from -LARGEST to LARGEST."""
    return checks.within(name, value, -LARGEST, LARGEST)


def within_a_turn(name: str, value: object) -> float:
    """Return an angle in rad as a float. Raises ValueError if it is more than a whole turn."""
    angle = checks.finite(name, value)
    if abs(angle) > 2.0 * math.pi:
        raise ValueError(
            f"{name} must be between -2 pi and 2 pi rad, got {angle:g}; angles are in radians: "
            f"{angle:g} degrees are {math.radians(angle):.4g} rad"
        )
    return angle


def up_to_largest(name: str, value: object) -> float:
    """Return a float. Raises ValueError unless it is a number from 0 to LARGEST."""
    return checks.within(name, value, 0.0, LARGEST)


@dataclass(frozen=True)
class Bar:
    """A straight link with its centre of mass half way.

    Args:
        length: distance between its two pins, m.
        mass, inertia: kg, and about the centre of mass, kg m^2 (paper, Table 1: 0.1 both).
    """

    length: float
    mass: float = 0.1
    inertia: float = 0.1

    def __post_init__(self) -> None:
        set_checked(self, checks.positive, "length", "mass")
        set_checked(self, up_to_largest, "mass", "inertia")

    @property
    def corners(self) -> Corners:
        """(c, o) of both ends, m and rad: the end is at the centre + c (cos, sin)(theta + o)."""
        return (-0.5 * self.length, 0.0), (0.5 * self.length, 0.0)

    def distance(self, i: int, k: int) -> float:
        """Distance between two different joints, m."""
        return self.length

    def slender(self) -> Bar:
        """Return the bar with the inertia of a slender rod, m L^2 / 12."""
        return replace(self, inertia=self.mass * self.length * self.length / 12.0)


@dataclass(frozen=True)
class Triangle:
    """A rigid triangle, given as the paper gives it: its corners seen from the centroid.

    Args:
        d, l, h: centroid to the first, second and third corner, m (d4, l4, h4 or d8, l8, h8).
        alpha, gamma: angles at the centroid from the first corner to the second, and to the third
            on the other side, rad.
        mass: kg. inertia: about the centroid, kg m^2.
        outward: the body's angle is the direction from the centroid to the first corner (triangle
            8), not from the first corner to the centroid (triangle 4).
    """

    d: float
    l: float  # noqa: E741 - the paper's symbol
    h: float
    alpha: float
    gamma: float
    mass: float = 0.1
    inertia: float = 0.1
    outward: bool = False

    def __post_init__(self) -> None:
        set_checked(self, checks.positive, "d", "l", "h", "alpha", "gamma", "mass")
        checks.instance("Triangle.outward", self.outward, bool)
        set_checked(self, up_to_largest, "mass", "inertia")
        if self.alpha + self.gamma >= 2.0 * math.pi:
            raise ValueError(
                "Triangle.alpha and Triangle.gamma must add up to less than 2 pi rad, got "
                f"{self.alpha:g} and {self.gamma:g}; angles are in radians"
            )

    @classmethod
    def from_sides(
        cls, first_second: float, second_third: float, third_first: float, *, mass: float = 0.1,
        inertia: float = 0.1, outward: bool = False,
    ) -> Triangle:  # fmt: skip
        """Build a triangle from its three side lengths (m), with the centroid's law of cosines.

        Raises:
            ValueError: the three lengths form no triangle.
        """
        a = checks.positive("Triangle.from_sides: first_second", first_second)
        b = checks.positive("Triangle.from_sides: second_third", second_third)
        c = checks.positive("Triangle.from_sides: third_first", third_first)
        if not is_triangle(a, b, c):
            raise ValueError(f"Triangle.from_sides: sides {a}, {b}, {c} m form no triangle")
        d, l, h, alpha, gamma = triangle_of_sides(a, b, c)  # noqa: E741
        return cls(d, l, h, alpha, gamma, mass, inertia, outward)

    @property
    def sides(self) -> tuple[float, float, float]:
        """Lengths first-second, second-third, third-first, m."""
        return triangle_sides(self.d, self.l, self.h, self.alpha, self.gamma)

    @property
    def corners(self) -> Corners:
        """(c, o) of each joint, m and rad: it is at the centre + c (cos, sin)(theta + o)."""
        s = 1.0 if self.outward else -1.0
        return (s * self.d, 0.0), (s * self.l, self.alpha), (s * self.h, -self.gamma)

    def distance(self, i: int, k: int) -> float:
        """Distance between two different corners, m."""
        return self.sides[(0, 2, 1)[i + k - 1]]

    def slender(self) -> Triangle:
        """Return the triangle with a uniform plate's inertia, m (a^2 + b^2 + c^2) / 36."""
        a, b, c = self.sides
        return replace(self, inertia=self.mass * (a * a + b * b + c * c) / 36.0)


@dataclass(frozen=True)
class Plate:
    """A rigid link of any shape with two joints or more.

    Args:
        points: (x, y) of each joint in axes that turn with the link, its centre of mass at the
            origin, m. The body's angle is that of these axes.
        mass, inertia: kg, and about the centre of mass, kg m^2.

    Raises:
        ValueError: fewer than two points, two in one place, or a number out of range.
    """

    points: tuple[tuple[float, float], ...]
    mass: float = 0.1
    inertia: float = 0.1

    def __post_init__(self) -> None:
        set_checked(self, checks.positive, "mass")
        set_checked(self, up_to_largest, "mass", "inertia")
        given = checks.entries("Plate.points", self.points, "a point (x, y) for each joint")
        points = [point("Plate.points", place) for place in given]
        if len({*points}) != len(points) or len(points) < 2:
            raise ValueError(f"Plate.points is {points}, must be two different points or more")
        object.__setattr__(self, "points", tuple(points))

    @classmethod
    def uniform(cls, points: Sequence[tuple[float, float]], mass: float = 0.1) -> Plate:
        """A uniform plate over the largest triangle of its joints, or a rod if they are in line.

        Args:
            points: (x, y) of each joint in any axes, m. mass: kg.

        Raises:
            ValueError: as for the class.
        """
        places = cls(tuple(points), mass).points
        x, y, inertia = uniform_plate(np.array(places), len(places), mass)
        return cls(tuple((float(a - x), float(b - y)) for a, b in places), mass, float(inertia))

    @property
    def corners(self) -> Corners:
        """(c, o) of each joint, m and rad: it is at the centre + c (cos, sin)(theta + o)."""
        return tuple((hypot(x, y), atan2(y, x)) for x, y in self.points)

    def distance(self, i: int, k: int) -> float:
        """Distance between two different joints, m."""
        (x, y), (u, v) = self.points[i], self.points[k]
        return hypot(u - x, v - y)

    def slender(self) -> Plate:
        """Return the plate with its mass spread as :meth:`uniform` spreads it."""
        return Plate.uniform(self.points, self.mass)


Link = Bar | Triangle | Plate
Corners = tuple[tuple[float, float], ...]
"""(c, o) of each joint of a link: it is at the centre of mass + c (cos, sin)(theta + o), m, rad."""


@dataclass(frozen=True)
class Leg:
    """One leg: which way it faces, and the angle of its crank ahead of the first crank.

    Args:
        side: ``"fore"`` is the leg as its linkage has it (the paper's frame reaches to -x),
            ``"back"`` its mirror image.
        phase: crank angle of this leg minus the robot's crank angle, rad, at most one turn.
    """

    side: Side
    phase: float = 0.0

    def __post_init__(self) -> None:
        checks.one_of("Leg.side", self.side, ("fore", "back"))
        set_checked(self, within_a_turn, "phase")


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
        set_checked(self, up_to_largest, "mass", "inertia")
        set_checked(self, point, "position")


@dataclass(frozen=True)
class Compliance:
    """Compliance of a pad: spring and damper along the ground's normal, a bristle along the ground.

    A rigid pad's impact ends at once, by the ground's restitution; for a compliant one that must
    be 0.

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
        for name, check in (("stiffness", checks.positive), ("damping", checks.non_negative)):
            if getattr(self, f"tangential_{name}") is None:
                object.__setattr__(self, f"tangential_{name}", getattr(self, name))
            for field in (name, f"tangential_{name}"):
                if name == "damping" or not checks.infinite(getattr(self, field)):
                    set_checked(self, check, field)
                    checks.within(f"Compliance.{field}", getattr(self, field), 0.0, STIFFEST)
        if (self.stiffness == math.inf) != (self.tangential_stiffness == math.inf):
            allowed = f"infinite where stiffness is, and nowhere else: that is {self.stiffness}"
            name = "Compliance.tangential_stiffness"
            raise checks.invalid(name, self.tangential_stiffness, allowed)
        if self.rigid and (self.damping, self.tangential_damping) != (0.0, 0.0):
            allowed = "0 where the stiffness is infinite"
            raise checks.invalid("Compliance.damping", self.damping, allowed)

    @property
    def rigid(self) -> bool:
        """Return whether the pad is rigid."""
        return self.stiffness == math.inf


RIGID = Compliance()


def phased_legs(phases: int) -> tuple[Leg, ...]:
    """A fore and a back leg for each of 1 to ``MOST_PHASES`` evenly spaced crank pins: fore first.

    Raises ValueError: another number of pins.
    """
    phases = checks.positive_integer("phases", phases, MOST_PHASES)
    angles = [2.0 * math.pi * k / phases for k in range(phases)]
    return tuple(Leg(side, angle) for side in ("fore", "back") for angle in angles)
