"""Parts of a robot: links, legs, payload and contact pads.

The classes contain only data, which their constructors check. All values are in SI units. Angles
are in radians and positive counter-clockwise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, ClassVar, Literal, TypeAlias

import numpy as np
from typing_extensions import override

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

CRANK_RADIUS = 0.10834  # the paper's L2, in m
MOST_PHASES = 100  # largest number of crank pins
LONGEST = 1e3  # largest length, in m
LARGEST = 1e6  # limit of masses, inertias, frictions, gear ratios and angles, in SI units
STIFFEST = 1e20  # largest stiffness (N/m) and damping (N s/m) of a compliant pad

ANGLE = Limits(-2.0 * math.pi, 2.0 * math.pi, note="angles are in radians")
LESS_THAN_A_TURN = Limits(0.0, math.nextafter(ANGLE.most, 0.0), note=ANGLE.note)
LENGTH = Limits(0.0, LONGEST, above=True, note="lengths are in metres")
PLACE = Limits(-LONGEST, LONGEST, note=LENGTH.note)
COORDINATE = Limits(-LARGEST, LARGEST)
SIZE = Limits(0.0, LARGEST)
STIFFNESS = Limits(0.0, STIFFEST, above=True, infinite=True)
DAMPING = Limits(0.0, STIFFEST)

Positive: TypeAlias = Annotated[float, Limits(0.0, above=True)]
Mass: TypeAlias = Annotated[float, Limits(0.0, LARGEST, above=True)]
Size: TypeAlias = Annotated[float, SIZE]
Angle: TypeAlias = Annotated[float, ANGLE]
Length: TypeAlias = Annotated[float, LENGTH]
Place: TypeAlias = tuple[Annotated[float, PLACE], Annotated[float, PLACE]]
Point: TypeAlias = tuple[Annotated[float, COORDINATE], Annotated[float, COORDINATE]]


def point(name: str, value: object, limits: Limits = COORDINATE) -> tuple[float, float]:
    """Return a point as two floats.

    Args:
        name: Name of the point, for error messages.
        value: The point.
        limits: Limits of both coordinates, in m.

    Raises:
        ValueError: If the value is not a pair of numbers within the limits.
    """
    x, y = checks.entries(name, value, "two numbers (x, y)", 2)
    return limits.check(name, x), limits.check(name, y)


def within_a_turn(name: str, value: object) -> float:
    """Return an angle in rad as a float.

    Raises:
        ValueError: If the magnitude of the angle is more than a whole turn.
    """
    angle = checks.finite(name, value)
    if abs(angle) > ANGLE.most:
        raise ValueError(
            f"{name} must be between -2 pi and 2 pi rad, got {angle:g}; {ANGLE.note}: "
            f"{angle:g} degrees are {math.radians(angle):.4g} rad"
        )
    return angle


class RigidLink:
    """Base class of bars, triangles and plates, which knows the positions of their joints."""

    kind: ClassVar[int]
    """Index of the class in :data:`jansen_env.engine.link_shapes.KINDS`."""
    JOINTS: ClassVar[int]
    """Number of joints of a bar or a triangle."""

    @property
    def joints(self) -> int:
        """Number of joints."""
        return self.JOINTS

    @property
    def places(self) -> Array:
        """Positions of a plate's joints in the axes of the plate, in m, shape (joints, 2).

        The positions are 0 for other links.
        """
        return np.zeros((self.joints, 2))

    @property
    def corners(self) -> Corners:
        """Polar coordinates (c, o) of each joint, in m and rad.

        The joint is at the centre of mass + c (cos, sin)(theta + o), where theta is the angle of
        the link.
        """
        corners = np.zeros((self.joints, 2))
        put_link_corners(self, self.places, self.joints, corners)
        return tuple((reach, turn) for reach, turn in corners.tolist())

    def distance(self, i: int, k: int) -> float:
        """Return the distance between two different joints, in m.

        Args:
            i: Index of the first joint.
            k: Index of the second joint.
        """
        return float(distance(self, self.places, i, k))


@dataclass(frozen=True)
class Bar(RigidLink):
    """A straight link whose centre of mass is halfway between its two pins.

    The default mass and inertia are those of the paper's Table 1.

    Args:
        length: Distance between the two pins, in m.
        mass: Mass, in kg.
        inertia: Moment of inertia about the centre of mass, in kg m^2.

    Raises:
        ValueError: If a value is out of range.
    """

    length: Length
    mass: Mass = 0.1
    inertia: Size = 0.1

    kind: ClassVar[int] = BAR
    JOINTS: ClassVar[int] = 2

    def __post_init__(self) -> None:
        check_limits(self)

    def slender(self) -> Bar:
        """Return a copy of the bar with the inertia of a slender rod, m L^2 / 12."""
        return replace(self, inertia=self.mass * self.length * self.length / 12.0)


@dataclass(frozen=True)
class Triangle(RigidLink):
    """A rigid triangle, described as in the paper by its corners as seen from the centroid.

    Args:
        d: Distance from the centroid to the first corner, in m (the paper's d4 or d8).
        l: Distance from the centroid to the second corner, in m (the paper's l4 or l8).
        h: Distance from the centroid to the third corner, in m (the paper's h4 or h8).
        alpha: Angle at the centroid from the first corner to the second, in rad.
        gamma: Angle at the centroid from the first corner to the third, on the other side, in rad.
        mass: Mass, in kg.
        inertia: Moment of inertia about the centroid, in kg m^2.
        outward: Direction that defines the angle of the body. If True (as for the paper's triangle
            8), it is the direction from the centroid to the first corner. If False (as for triangle
            4), it is the direction from the first corner to the centroid.

    Raises:
        ValueError: If a value is out of range.
    """

    d: Length
    l: Length  # noqa: E741 - the paper's symbol
    h: Length
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
        cls,
        first_second: float,
        second_third: float,
        third_first: float,
        *,
        mass: float = 0.1,
        inertia: float = 0.1,
        outward: bool = False,
    ) -> Triangle:
        """Return the triangle with three side lengths.

        The distances and angles at the centroid follow from the law of cosines.

        Args:
            first_second: Distance between the first and the second corner, in m.
            second_third: Distance between the second and the third corner, in m.
            third_first: Distance between the third and the first corner, in m.
            mass: Mass, in kg.
            inertia: Moment of inertia about the centroid, in kg m^2.
            outward: See the class.

        Raises:
            ValueError: If the three lengths do not form a triangle, or a value is out of range.
        """
        a = checks.positive("Triangle.from_sides: first_second", first_second)
        b = checks.positive("Triangle.from_sides: second_third", second_third)
        c = checks.positive("Triangle.from_sides: third_first", third_first)
        if not is_triangle(a, b, c):
            raise ValueError(f"Triangle.from_sides: sides must form a triangle, got {a, b, c} m")
        d, l, h, alpha, gamma = triangle_of_sides(a, b, c)  # noqa: E741
        return cls(d, l, h, alpha, gamma, mass, inertia, outward)

    @property
    def sides(self) -> tuple[float, float, float]:
        """Side lengths first-second, second-third and third-first, in m."""
        return triangle_sides(self.d, self.l, self.h, self.alpha, self.gamma)

    def slender(self) -> Triangle:
        """Return a copy with the inertia of a uniform plate, m (a^2 + b^2 + c^2) / 36."""
        a, b, c = self.sides
        return replace(self, inertia=self.mass * (a * a + b * b + c * c) / 36.0)


@dataclass(frozen=True)
class Plate(RigidLink):
    """A rigid link of any shape with at least two joints.

    Args:
        points: Position (x, y) of each joint, in m, in axes that turn with the link and whose
            origin is the centre of mass. The angle of the body is the angle of these axes.
        mass: Mass, in kg.
        inertia: Moment of inertia about the centre of mass, in kg m^2.

    Raises:
        ValueError: If there are fewer than two points, two points coincide, or a value is out of
            range.
    """

    points: tuple[Place, ...]
    mass: Mass = 0.1
    inertia: Size = 0.1

    kind: ClassVar[int] = PLATE

    def __post_init__(self) -> None:
        check_limits(self)
        given = checks.entries("Plate.points", self.points, "a point (x, y) for each joint")
        points = [point("Plate.points", place, PLACE) for place in given]
        if len({*points}) != len(points) or len(points) < 2:
            raise ValueError(f"Plate.points must be at least two different points, got {points}")
        object.__setattr__(self, "points", tuple(points))

    @classmethod
    def uniform(cls, points: Sequence[tuple[float, float]], mass: float = 0.1) -> Plate:
        """Return a plate with a uniformly distributed mass.

        The mass is distributed over the largest triangle of the joints, or along a rod if all
        joints are on one line.

        Args:
            points: Position (x, y) of each joint in any axes, in m.
            mass: Mass, in kg.

        Raises:
            ValueError: If the class raises it for these points and this mass.
        """
        places = cls(tuple(points), mass).points
        x, y, inertia = uniform_plate(np.array(places), len(places), mass)
        return cls(tuple((float(a - x), float(b - y)) for a, b in places), mass, float(inertia))

    @property
    @override
    def joints(self) -> int:
        """Number of joints."""
        return len(self.points)

    @property
    @override
    def places(self) -> Array:
        """Positions of the joints in the axes of the plate, in m, shape (joints, 2)."""
        return np.array(self.points)

    def slender(self) -> Plate:
        """Return a copy of the plate whose mass is distributed as in :meth:`uniform`."""
        return Plate.uniform(self.points, self.mass)


Link = Bar | Triangle | Plate
Corners = tuple[tuple[float, float], ...]
"""Polar coordinates (c, o) of each joint of a link, in m and rad.

The joint is at the centre of mass + c (cos, sin)(theta + o), where theta is the angle of the link.
"""


@dataclass(frozen=True)
class Leg:
    """The direction in which a leg faces, and the phase of its crank.

    Args:
        side: ``"fore"`` for the leg as its linkage describes it (the paper's frame extends towards
            -x), or ``"back"`` for its mirror image.
        phase: Crank angle of this leg minus the robot's crank angle, in rad. Its magnitude is at
            most one turn.

    Raises:
        ValueError: If ``side`` is a different text, or ``phase`` is out of range.
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
        mass: Mass, in kg.
        inertia: Moment of inertia about the centre of mass of the load, in kg m^2.
        position: Position (x, y) of the centre of mass in the chassis frame, whose origin is the
            crank axis, in m.

    Raises:
        ValueError: If a value is out of range.
    """

    mass: Size = 0.0
    inertia: Size = 0.0
    position: Point = (0.0, 0.0)

    def __post_init__(self) -> None:
        check_limits(self)
        set_checked(self, point, "position")


@dataclass(frozen=True)
class Compliance:
    """The compliance of a contact pad.

    A compliant pad has a spring and a damper in the direction of the terrain's normal, and a
    bristle along the surface. An impact of a rigid pad ends at once and depends on the restitution
    of the terrain. For compliant pads, this restitution must be 0.

    Args:
        stiffness: Normal stiffness, in N/m. Infinity stands for a rigid pad.
        damping: Normal damping, in N s/m.
        tangential_stiffness: Stiffness of the bristle, which sticks before it slides, in N/m. None
            for the value of ``stiffness``.
        tangential_damping: Damping of the bristle, in N s/m. None for the value of ``damping``.

    Raises:
        ValueError: If a value is out of range, or only one of the stiffnesses is infinite.
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
        """Whether the pad is rigid."""
        return self.stiffness == math.inf


RIGID = Compliance()


def phased_legs(phases: int) -> tuple[Leg, ...]:
    """Return a fore leg and a back leg for each of several evenly spaced crank pins.

    Args:
        phases: Number of crank pins, from 1 to ``MOST_PHASES``.

    Returns:
        All fore legs, followed by all back legs.

    Raises:
        ValueError: If ``phases`` is out of range.
    """
    phases = checks.positive_integer("phases", phases, MOST_PHASES)
    angles = [2.0 * math.pi * k / phases for k in range(phases)]
    return tuple(Leg(side, angle) for side in ("fore", "back") for angle in angles)
