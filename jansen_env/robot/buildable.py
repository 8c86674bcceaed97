"""Parts of machines that could be built: flat bars, plates, pins, feet; their masses.

Constants are of the built robot; :data:`PLYWOOD` has those of the weekend robot. Bars and plates
are of aluminium EN AW-6060 T66. Every end of a link carries its share of a pin:
half of a shoulder screw with nut, washers and a spacer, and a plain bearing of iglidur J200. A foot
is a half-round tread of rubber on a shoe. ``docs/built_robot.md`` has the bill of materials and the
sources of all numbers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from jansen_env.arrays import Rows
from jansen_env.engine import link_shapes

DENSITY = 2700.0  # kg/m^3, EN AW-6060
STIFFNESS = 69e9  # Pa, its modulus of elasticity
BAR_THICKNESS, LOWER_ROD_THICKNESS, PLATE_THICKNESS = 5e-3, 6e-3, 4e-3  # m
WIDTH, FRAME_WIDTH = 15e-3, 30e-3  # m, of a link's flat bar and of the frame's
OUTLINE, WINDOW = 1.1, 0.9  # of a triangular plate and the hole in it, to the pins' triangle
PIN_SHARE = 8e-3  # kg, of a pin, its bearing and spacer, on every end of a link
PIN_RADIUS = 3e-3  # m
BEARING_FRICTION = 0.11  # coefficient, of iglidur J200

# At O and at P, as point masses; the battery is as heavy as makes both alike.
MOTOR_MASS = 0.485  # kg, of the T-Motor AK80-6
MOTOR_PLATE_MASS = 0.077  # kg, 100 x 100 x 4 mm with a hole of 60 mm
CRANKSHAFT_MASS = 0.183  # kg, 160 mm of steel, 12 mm, and four hubs, 25 x 10 mm
CROSS_MEMBER_MASS = 0.061  # kg, a tube of 20 x 2 mm, 200 mm, at either P
AXIS_MASS = MOTOR_MASS + MOTOR_PLATE_MASS + CRANKSHAFT_MASS
BATTERY_MASS = AXIS_MASS - 2.0 * CROSS_MEMBER_MASS  # with controller and cables

FOOT_RADIUS, FOOT_WIDTH = 20e-3, 30e-3  # m, of a half-round tread, its flat side bonded
RUBBER_DENSITY = 1000.0  # kg/m^3
RUBBER_HARDNESS = 60.0  # Shore A
FOOT_STIFFNESS = 1.28e5, 5.1e4  # N/m, normal and tangential: a secant at 530 N
FOOT_LOSS_FACTOR = 0.1  # tan delta of natural rubber
TREAD_MASS = 0.5 * math.pi * FOOT_RADIUS * FOOT_RADIUS * FOOT_WIDTH * RUBBER_DENSITY
SHOE_MASS = 13e-3  # kg, a plate of 40 x 30 x 3 mm and two screws, M4
FOOT_MASS = TREAD_MASS + SHOE_MASS


class Build(NamedTuple):
    """Sizes and materials of a machine's parts; SI units. Default: the built robot's.

    ``screw``: thread of the screws of feet, motor and brace. ``bush``: radius of a turning link's
    hole less the pin's. ``hub_screws``: from the axis to either screw. ``cross_member_mass``,
    ``battery_mass``: at the pivots P. ``tread_layers``: beside a link, covered by half of its
    tread's width. ``cells``: of the battery.
    """

    material: str = "EN AW-6060"
    density: float = DENSITY
    bar_thickness: float = BAR_THICKNESS
    lower_rod_thickness: float = LOWER_ROD_THICKNESS
    plate_thickness: float = PLATE_THICKNESS
    width: float = WIDTH
    frame_width: float = FRAME_WIDTH
    pin_share: float = PIN_SHARE
    pin_radius: float = PIN_RADIUS
    screw: str = "M4"
    bush: float = 1e-3
    bearing_friction: float = BEARING_FRICTION
    shaft_radius: float = 6e-3
    hub_radius: float = 12.5e-3
    hub_length: float = 10e-3
    hub_screws: float = 9.25e-3
    spacer_radius: float = 5e-3
    tube_radius: float = 10e-3
    axis_mass: float = AXIS_MASS
    cross_member_mass: float = CROSS_MEMBER_MASS
    battery_mass: float = BATTERY_MASS
    foot_radius: float = FOOT_RADIUS
    foot_width: float = FOOT_WIDTH
    tread_layers: int = 3
    foot_mass: float = FOOT_MASS
    foot_stiffness: tuple[float, float] = FOOT_STIFFNESS
    motor: str = "ak80_6"
    cells: int = 6


ALUMINIUM = Build()
PLYWOOD = Build(
    material="birch plywood", density=680.0, bar_thickness=3e-3, lower_rod_thickness=3e-3,
    plate_thickness=3e-3, width=10e-3, frame_width=12e-3, pin_share=1.2e-3, pin_radius=1.5e-3,
    screw="M3", bush=0.1e-3, bearing_friction=0.4, shaft_radius=2e-3, hub_radius=10e-3,
    hub_length=5e-3, hub_screws=6.35e-3, spacer_radius=3.5e-3, tube_radius=4e-3,
    axis_mass=0.147, cross_member_mass=0.0, battery_mass=0.114,
    foot_radius=7e-3, foot_width=9e-3, tread_layers=1, foot_mass=2.9e-3,
    foot_stiffness=(6e4, 1.5e4), motor="lp_25d_75", cells=3,
)  # fmt: skip
"""The weekend robot's: M3 screws turn in plain holes of plywood."""
BUILDS = {"aluminium": ALUMINIUM, "plywood": PLYWOOD}
"""By :attr:`jansen_env.Robot.material`."""


def build_row() -> Rows:
    """Return the constants of the built robot's parts, ``BUILD``, shape (1,)."""
    row = np.zeros(1, link_shapes.BUILD)
    for name in link_shapes.BUILD.names or ():
        row[name] = globals()[name.upper()]
    return row


class Inertial(NamedTuple):
    """Mass, kg, and inertia about the centre of mass, kg m^2."""

    mass: float
    inertia: float


def bar_thickness(name: str) -> float:
    """Return the thickness of a link's bar, m, by the link's name."""
    return LOWER_ROD_THICKNESS if name == "lower_rod" else BAR_THICKNESS


def flat_bar(
    length: float, width: float, end_mass: float = PIN_SHARE, thickness: float = BAR_THICKNESS
) -> Inertial:
    """A flat bar with round ends about two pins ``length`` m apart, and ``end_mass`` on each."""
    return Inertial(*link_shapes.flat_bar(length, width, end_mass, DENSITY * thickness))


def triangular_plate(
    sides: tuple[float, float, float], end_mass: float = PIN_SHARE, third_mass: float | None = None
) -> Inertial:
    """A plate about the triangle of its pins, a hole of the same shape, and masses on the pins.

    Outline, hole and pins are similar triangles about one centroid, which is the centre of mass.
    A heavier third corner draws the hole towards it, as far as leaves the centre of mass there.

    Args:
        sides: of the pins' triangle, first-second, second-third, third-first, m.
        end_mass: kg, on each pin. third_mass: kg, on the third corner instead, None for as much.
    """
    more = 0.0 if third_mass is None else third_mass - end_mass
    areal = DENSITY * PLATE_THICKNESS
    plate = link_shapes.triangular_plate(*sides, end_mass, more, areal, OUTLINE, WINDOW)
    return Inertial(*plate)


def dry_torque(load: float, build: Build = ALUMINIUM) -> float:
    """Coulomb friction torque of a pin's plain bearing under a load (N), N m."""
    return build.bearing_friction * build.pin_radius * load


def foot_damping(stiffness: float, mass: float, build: Build = ALUMINIUM) -> float:
    """N s/m of a foot whose rubber loses as much at the frequency of a robot (kg) on two feet."""
    return FOOT_LOSS_FACTOR * stiffness / math.sqrt(2.0 * build.foot_stiffness[0] / mass)


def buckling_load(length: float, thickness: float) -> float:
    """Euler's load of a flat bar between two pins (across its thickness, pinned ends), N."""
    stiffness = STIFFNESS * WIDTH * thickness * thickness * thickness / 12.0
    return math.pi * math.pi * stiffness / (length * length)
