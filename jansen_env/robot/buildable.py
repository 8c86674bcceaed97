"""Parts of robots that can be built (flat bars, plates, pins and feet), and their masses.

The constants of this module describe the robot ``built``; :data:`PLYWOOD` contains those of the
robot ``weekend``. Bars and plates are made of aluminium EN AW-6060 T66. Each end of a link carries
its share of a pin: half of a shoulder screw with nut, washers and a spacer, and a plain bearing of
iglidur J200. A foot is a half-round rubber tread on a shoe. ``docs/built_robot.md`` contains the
bill of materials and the sources of all numbers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from jansen_env.arrays import Rows
from jansen_env.engine import link_shapes

DENSITY = 2700.0  # density of EN AW-6060, in kg/m^3
STIFFNESS = 69e9  # modulus of elasticity of EN AW-6060, in Pa
BAR_THICKNESS = 5e-3  # m
LOWER_ROD_THICKNESS = 6e-3  # m
PLATE_THICKNESS = 4e-3  # m
WIDTH = 15e-3  # width of the flat bars of a link, in m
FRAME_WIDTH = 30e-3  # width of the flat bars of the frame, in m
OUTLINE = 1.1  # size of a plate's outline, relative to its pins
WINDOW = 0.9  # size of a plate's hole, relative to its pins
PIN_SHARE = 8e-3  # mass at each end of a link: its share of a pin, bearing and spacer, in kg
PIN_RADIUS = 3e-3  # m
BEARING_FRICTION = 0.11  # friction coefficient of iglidur J200

# Point masses at the joints O and P. The mass of the battery is such that both joints carry the
# same mass.
MOTOR_MASS = 0.485  # mass of a T-Motor AK80-6, in kg
MOTOR_PLATE_MASS = 0.077  # plate of 100 x 100 x 4 mm with a hole of 60 mm, in kg
CRANKSHAFT_MASS = 0.183  # 160 mm of 12 mm steel and four hubs of 25 x 10 mm, in kg
CROSS_MEMBER_MASS = 0.061  # tube of 20 x 2 mm, 200 mm long, at each of the two joints P, in kg
AXIS_MASS = MOTOR_MASS + MOTOR_PLATE_MASS + CRANKSHAFT_MASS
BATTERY_MASS = AXIS_MASS - 2.0 * CROSS_MEMBER_MASS  # includes the controller and the cables

FOOT_RADIUS = 20e-3  # radius of the half-round tread, which is bonded at its flat side, in m
FOOT_WIDTH = 30e-3  # m
RUBBER_DENSITY = 1000.0  # kg/m^3
RUBBER_HARDNESS = 60.0  # Shore A
FOOT_STIFFNESS = 1.28e5, 5.1e4  # normal and tangential secant stiffness at 530 N, in N/m
FOOT_LOSS_FACTOR = 0.1  # tan delta of natural rubber
TREAD_MASS = 0.5 * math.pi * FOOT_RADIUS * FOOT_RADIUS * FOOT_WIDTH * RUBBER_DENSITY
SHOE_MASS = 13e-3  # plate of 40 x 30 x 3 mm and two M4 screws, in kg
FOOT_MASS = TREAD_MASS + SHOE_MASS


class Build(NamedTuple):
    """Sizes and materials of a robot's parts, in SI units.

    The defaults are those of the robot ``built``.

    Attributes:
        material: Name of the material of bars and plates.
        density: Density of the material, in kg/m^3.
        bar_thickness: Thickness of a bar, in m.
        lower_rod_thickness: Thickness of the bar ``lower_rod``, in m.
        plate_thickness: Thickness of a triangular plate, in m.
        width: Width of a link's bar, in m.
        frame_width: Width of the frame's bar, in m.
        pin_share: Mass of the share of a pin at each end of a link, in kg.
        pin_radius: Radius of a pin, in m.
        screw: Thread of the screws of the feet, the motor and the brace.
        bush: Radius of the hole in a turning link minus the radius of the pin, in m.
        bearing_friction: Friction coefficient of the plain bearings.
        shaft_radius: Radius of the crankshaft, in m.
        hub_radius: Radius of a hub on the crankshaft, in m.
        hub_length: Length of a hub, in m.
        hub_screws: Distance from the axis of a hub to each of its screws, in m.
        spacer_radius: Radius of a spacer, in m.
        tube_radius: Radius of the tube of a cross-member, in m.
        axis_mass: Mass of the motor, its plate and the crankshaft at the crank axis O, in kg.
        cross_member_mass: Mass of a cross-member at a pivot P, in kg.
        battery_mass: Mass of the battery at the pivots P, in kg.
        foot_radius: Radius of a half-round tread, in m.
        foot_width: Width of a tread, in m.
        tread_layers: Number of layers next to a link that half the width of its tread covers.
        foot_mass: Mass of a foot, in kg.
        foot_stiffness: Normal and tangential stiffness of a foot, in N/m.
        motor: Name of the motor, a key of :data:`jansen_env.robot.motor.MOTORS`.
        cells: Number of cells of the battery.
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
"""Parts of the robot ``weekend``, whose pins are M3 screws that turn in plain holes in plywood."""
BUILDS = {"aluminium": ALUMINIUM, "plywood": PLYWOOD}
"""Sizes and materials of parts by the value of :attr:`jansen_env.Robot.material`."""


def build_row() -> Rows:
    """Return the constants of the parts of the robot ``built``.

    Returns:
        Record of type ``BUILD``, shape (1,).
    """
    row = np.zeros(1, link_shapes.BUILD)
    for name in link_shapes.BUILD.names or ():
        row[name] = globals()[name.upper()]
    return row


class Inertial(NamedTuple):
    """Mass and inertia of a part.

    Attributes:
        mass: Mass, in kg.
        inertia: Moment of inertia about the centre of mass, in kg m^2.
    """

    mass: float
    inertia: float


def bar_thickness(name: str) -> float:
    """Return the thickness of the bar of the link with this name, in m."""
    return LOWER_ROD_THICKNESS if name == "lower_rod" else BAR_THICKNESS


def flat_bar(
    length: float, width: float, end_mass: float = PIN_SHARE, thickness: float = BAR_THICKNESS
) -> Inertial:
    """Return the mass and inertia of a flat bar whose round ends are centred on its two pins.

    Args:
        length: Distance between the pins, in m.
        width: Width of the bar, in m.
        end_mass: Point mass on each pin, in kg.
        thickness: Thickness of the bar, in m.
    """
    return Inertial(*link_shapes.flat_bar(length, width, end_mass, DENSITY * thickness))


def triangular_plate(
    sides: tuple[float, float, float], end_mass: float = PIN_SHARE, third_mass: float | None = None
) -> Inertial:
    """Return the mass and inertia of a triangular plate with a triangular hole.

    The outline, the hole and the pins form similar triangles about the same centroid, which is the
    centre of mass. If the third corner is heavier, the hole is shifted towards it just so far that
    the centre of mass stays at the centroid.

    Args:
        sides: Distances between the first and second, the second and third, and the third and first
            pin, in m.
        end_mass: Point mass on each pin, in kg.
        third_mass: Point mass on the third pin, in kg. None for ``end_mass``.
    """
    more = 0.0 if third_mass is None else third_mass - end_mass
    areal = DENSITY * PLATE_THICKNESS
    plate = link_shapes.triangular_plate(*sides, end_mass, more, areal, OUTLINE, WINDOW)
    return Inertial(*plate)


def dry_torque(load: float, build: Build = ALUMINIUM) -> float:
    """Return the Coulomb friction torque of a plain bearing, in N m.

    Args:
        load: Force on the bearing, in N.
        build: Sizes and materials of the parts.
    """
    return build.bearing_friction * build.pin_radius * load


def foot_damping(stiffness: float, mass: float, build: Build = ALUMINIUM) -> float:
    """Return the damping coefficient of a foot, in N s/m.

    With this coefficient, a damper loses as much energy as the rubber does at the frequency at
    which a robot bounces on two feet.

    Args:
        stiffness: Stiffness of the foot in the direction of the damping, in N/m.
        mass: Mass of the robot, in kg.
        build: Sizes and materials of the parts.
    """
    return FOOT_LOSS_FACTOR * stiffness / math.sqrt(2.0 * build.foot_stiffness[0] / mass)


def buckling_load(length: float, thickness: float) -> float:
    """Return Euler's buckling load of a flat bar with pinned ends, in N.

    The bar buckles in the direction of its thickness.

    Args:
        length: Distance between the pins, in m.
        thickness: Thickness of the bar, in m.
    """
    stiffness = STIFFNESS * WIDTH * thickness * thickness * thickness / 12.0
    return math.pi * math.pi * stiffness / (length * length)
