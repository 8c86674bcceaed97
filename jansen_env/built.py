"""What a machine is made of that could be built: flat bars, plates, pins, feet; masses from these.

Bars are flat stock of aluminium EN AW-6060 T66, 5 mm thick, plates are cut from 4 mm of it: density
2700 kg/m^3, modulus of elasticity 69 GPa, proof strength 160 MPa (EN 755-2 for solid bars). Every
end of a link carries its share of a pin: half of an M6 shoulder screw with nut and washers, and a
flanged plain bearing of iglidur J200, whose coefficient of friction igus gives as 0.11 in the mean
of all its measurements. ``docs/built_robot.md`` has the bill of materials and the sources.
"""

from __future__ import annotations

import math
from typing import NamedTuple

DENSITY = 2700.0  # kg/m^3, EN AW-6060
STIFFNESS = 69e9  # Pa, its modulus of elasticity
STRENGTH = 160e6  # Pa, its proof strength in temper T66
BAR_THICKNESS, PLATE_THICKNESS = 5e-3, 4e-3  # m
WIDTH, FRAME_WIDTH = 15e-3, 30e-3  # m, of a link's flat bar and of the frame's
OUTLINE, WINDOW = 1.1, 0.9  # of a triangular plate and the hole in it, to the pins' triangle
PIN_SHARE = 8e-3  # kg, of a pin and its bearing, or of a foot, on every end of a link
PIN_RADIUS = 3e-3  # m
BEARING_FRICTION = 0.11  # coefficient, of iglidur J200
MOTOR_MASS = 0.485  # kg, of the T-Motor AK80-6; and of battery, controller and cables at P
FOOT_STIFFNESS = 1.2e5, 3.0e4  # N/m, normal and tangential
FOOT_LOSS_FACTOR = 0.1  # tan delta of natural rubber


class Inertial(NamedTuple):
    """Mass, kg, and inertia about the centre of mass, kg m^2."""

    mass: float
    inertia: float


def flat_bar(length: float, width: float, end_mass: float = PIN_SHARE) -> Inertial:
    """A flat bar with round ends about its two pins, and a point mass on each pin.

    Args:
        length: between the pins, m. width: m. end_mass: kg, on each pin.
    """
    radius, areal = 0.5 * width, DENSITY * BAR_THICKNESS
    middle, rounds = areal * length * width, areal * math.pi * radius**2
    inertia = middle * (length**2 + width**2) / 12.0
    # Two half discs, with their centroids 4 r / 3 pi beyond the pins.
    inertia += rounds * (0.5 * radius**2 + 0.25 * length**2 + length * 4.0 * radius / (3 * math.pi))
    return Inertial(middle + rounds + 2.0 * end_mass, inertia + 0.5 * end_mass * length**2)


def triangular_plate(sides: tuple[float, float, float], end_mass: float = PIN_SHARE) -> Inertial:
    """A plate about the triangle of its pins, a hole of the same shape, and masses on the pins.

    Outline, hole and pins are similar triangles about one centroid, which is the centre of mass.
    The corners' rounding is left out.

    Args:
        sides: of the pins' triangle, m. end_mass: kg, on each pin.
    """
    a, b, c = sides
    half = 0.5 * (a + b + c)
    area = math.sqrt(half * (half - a) * (half - b) * (half - c))
    spread = (a * a + b * b + c * c) / 36.0  # inertia / mass of a uniform triangle
    areal = DENSITY * PLATE_THICKNESS
    inertia = areal * area * spread * (OUTLINE**4 - WINDOW**4)
    # The pins: sum of |corner - centroid|^2 is (a^2 + b^2 + c^2) / 3.
    mass = areal * area * (OUTLINE**2 - WINDOW**2)
    return Inertial(mass + 3.0 * end_mass, inertia + end_mass * 12.0 * spread)


def dry_torque(load: float) -> float:
    """Coulomb friction torque of a pin's plain bearing under a load (N), N m."""
    return BEARING_FRICTION * PIN_RADIUS * load


def foot_damping(stiffness: float, mass: float) -> float:
    """N s/m of a foot whose rubber loses as much at the frequency of a robot (kg) on two feet."""
    return FOOT_LOSS_FACTOR * stiffness / math.sqrt(2.0 * FOOT_STIFFNESS[0] / mass)


def buckling_load(length: float, width: float = WIDTH) -> float:
    """Euler's load of a flat bar between two pins (across its thickness, pinned ends), N."""
    return math.pi**2 * STIFFNESS * width * BAR_THICKNESS**3 / 12.0 / length**2


def yield_load(width: float = WIDTH) -> float:
    """The pull at which a bar yields beside a pin's hole, N."""
    return STRENGTH * BAR_THICKNESS * (width - 2.0 * (PIN_RADIUS + 1e-3))
