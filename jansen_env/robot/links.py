"""Parts of a machine: links, legs, payload, pads. Data only, checked when it is made.

Numbers are SI: metres, kilograms, radians, counter-clockwise positive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, ClassVar, Literal, TypeAlias

import numpy as np

from jansen_env import checks
from jansen_env.arrays import Array
from jansen_env.checks import Combination, FiniteWith, Limits, Rule, check_limits, set_checked
from jansen_env.engine.link_shapes import (
    BAR,
    PLATE,
    TRIANGLE,
    distance,
    is_triangle,
    put_link_corners,
    triangle_of_sides,
    triangle_sides,
    uniform_plate,
)

Side = Literal["fore", "back"]

CRANK_RADIUS = 0.10834  # m, the paper's L2; every built-in design turns this crank
MOST_PHASES = 100  # of crank pins
LARGEST = 1e6  # of a mass, an inertia, a friction, a gear, an angle, SI: beyond any machine
STIFFEST = 1e20  # N/m and N s/m, of a compliant pad: beyond, it is rigid


ANGLE = Limits(-2.0 * math.pi, 2.0 * math.pi, note="angles are in radians")
LESS_THAN_A_TURN = Limits(0.0, math.nextafter(ANGLE.most, 0.0), note=ANGLE.note)
COORDINATE = Limits(-LARGEST, LARGEST)
SIZE = Limits(0.0, LARGEST)
STIFFNESS = Limits(0.0, STIFFEST, above=True, infinite=True)
DAMPING = Limits(0.0, STIFFEST)

Positive: TypeAlias = Annotated[float, Limits(0.0, above=True)]
Mass: TypeAlias = Annotated[float, Limits(0.0, LARGEST, above=True)]
Size: TypeAlias = Annotated[float, SIZE]
Angle: TypeAlias = Annotated[float, ANGLE]
Point: TypeAlias = tuple[Annotated[float, COORDINATE], Annotated[float, COORDINATE]]


def point(name: str, value: object) -> tuple[float, float]:
    """Return a point as floats. Raises ValueError unless it is two numbers up to LARGEST."""
    x, y = checks.entries(name, value, "two numbers (x, y)", 2)
    return COORDINATE.check(name, x), COORDINATE.check(name, y)


def within_a_turn(name: str, value: object) -> float:
    """Return an angle in rad as a float. Raises ValueError if it is more than a whole turn."""
    angle = checks.finite(name, value)
    if abs(angle) > ANGLE.most:
        raise ValueError(
            f"{name} must be between -2 pi and 2 pi rad, got {angle:g}; {ANGLE.note}: "
            f"{angle:g} degrees are {math.radians(angle):.4g} rad"
        )
    return angle


class RigidLink:
    """What bars, triangles and plates have in common: where their joints are."""

    kind: ClassVar[int]
    """Number of the kind in :data:`jansen_env.engine.link_shapes.KINDS`."""
    JOINTS: ClassVar[int]
    """Number of joints of a bar or a triangle."""

    @property
    def joints(self) -> int:
        """Number of joints."""
        return self.JOINTS

    @property
    def places(self) -> Array:
        """(joints, 2) of a plate: its joints in its own axes, m; 0 of other links."""
        return np.zeros((self.joints, 2))

    @property
    def corners(self) -> Corners:
        """(c, o) of each joint, m and rad: it is at the centre + c (cos, sin)(theta + o)."""
        corners = np.zeros((self.joints, 2))
        put_link_corners(self, self.places, self.joints, corners)
        return tuple((reach, turn) for reach, turn in corners.tolist())

    def distance(self, i: int, k: int) -> float:
        """Distance between two different joints, m."""
        return float(distance(self, self.places, i, k))


@dataclass(frozen=True)
class Bar(RigidLink):
    """A straight link with its centre of mass half way.

    Args:
        length: distance between its two pins, m.
        mass, inertia: kg, and about the centre of mass, kg m^2 (paper, Table 1: 0.1 both).
    """

    length: Positive
    mass: Mass = 0.1
    inertia: Size = 0.1

    kind: ClassVar[int] = BAR
    JOINTS: ClassVar[int] = 2

    def __post_init__(self) -> None:
        check_limits(self)

    def slender(self) -> Bar:
        """Return the bar with the inertia of a slender rod, m L^2 / 12."""
        return replace(self, inertia=self.mass * self.length * self.length / 12.0)


@dataclass(frozen=True)
class Triangle(RigidLink):
    """A rigid triangle, given as the paper gives it: its corners seen from the centroid.

    Args:
        d, l, h: centroid to the first, second and third corner, m (d4, l4, h4 or d8, l8, h8).
        alpha, gamma: angles at the centroid from the first corner to the second, and to the third
            on the other side, rad.
        mass: kg. inertia: about the centroid, kg m^2.
        outward: the body's angle is the direction from the centroid to the first corner (triangle
            8), not from the first corner to the centroid (triangle 4).
    """

    d: Positive
    l: Positive  # noqa: E741 - the paper's symbol
    h: Positive
    alpha: Positive
    gamma: Positive
    mass: Mass = 0.1
    inertia: Size = 0.1
    outward: bool = False

    RULES: ClassVar[tuple[Rule, ...]] = (Combination(("alpha", "gamma"), "sum", LESS_THAN_A_TURN),)
    kind: ClassVar[int] = TRIANGLE
    JOINTS: ClassVar[int] = 3

    def __post_init__(self) -> None:
        check_limits(self)
        checks.instance("Triangle.outward", self.outward, bool)

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

    def slender(self) -> Triangle:
        """Return the triangle with a uniform plate's inertia, m (a^2 + b^2 + c^2) / 36."""
        a, b, c = self.sides
        return replace(self, inertia=self.mass * (a * a + b * b + c * c) / 36.0)


@dataclass(frozen=True)
class Plate(RigidLink):
    """A rigid link of any shape with two joints or more.

    Args:
        points: (x, y) of each joint in axes that turn with the link, its centre of mass at the
            origin, m. The body's angle is that of these axes.
        mass, inertia: kg, and about the centre of mass, kg m^2.

    Raises:
        ValueError: fewer than two points, two in one place, or a number out of range.
    """

    points: tuple[Point, ...]
    mass: Mass = 0.1
    inertia: Size = 0.1

    kind: ClassVar[int] = PLATE

    def __post_init__(self) -> None:
        check_limits(self)
        given = checks.entries("Plate.points", self.points, "a point (x, y) for each joint")
        points = [point("Plate.points", place) for place in given]
        if len({*points}) != len(points) or len(points) < 2:
            raise ValueError(f"Plate.points must be at least two different points, got {points}")
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
    def joints(self) -> int:
        return len(self.points)

    @property
    def places(self) -> Array:
        return np.array(self.points)

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
    phase: Angle = 0.0

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

    mass: Size = 0.0
    inertia: Size = 0.0
    position: Point = (0.0, 0.0)

    def __post_init__(self) -> None:
        check_limits(self)
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

    stiffness: Annotated[float, STIFFNESS] = math.inf
    damping: Annotated[float, DAMPING] = 0.0
    tangential_stiffness: Annotated[float | None, STIFFNESS] = field(
        default=None, metadata={"as": "stiffness"}
    )
    tangential_damping: Annotated[float | None, DAMPING] = field(
        default=None, metadata={"as": "damping"}
    )

    RULES: ClassVar[tuple[Rule, ...]] = (
        FiniteWith("stiffness", "tangential_stiffness"),
        FiniteWith("tangential_stiffness", "stiffness"),
        FiniteWith("damping", "stiffness"),
        FiniteWith("tangential_damping", "stiffness"),
    )

    def __post_init__(self) -> None:
        for entry in fields(self):
            if getattr(self, entry.name) is None and "as" in entry.metadata:
                object.__setattr__(self, entry.name, getattr(self, entry.metadata["as"]))
        check_limits(self)

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
