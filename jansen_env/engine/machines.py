"""Parameters of a robot as its robot file defines them, before an episode changes them."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine.kernel import Floats1, Floats2, kernel, stage
from jansen_env.engine.link_shapes import Links
from jansen_env.engine.records import Machines, floats, row_dtype
from jansen_env.engine.sums import exact_sum

MOTOR = row_dtype(
    floats(
        "stall_torque",
        "no_load_speed",
        "torque_limit",
        "gear_ratio",
        "rotor_inertia",
        "friction",
        "viscous_friction",
        "efficiency",
    )
)
"""Record of a :class:`jansen_env.robot.motor.Motor`."""
COMPLIANCE = row_dtype(floats("stiffness", "damping", "tangential_stiffness", "tangential_damping"))
"""Record of a :class:`jansen_env.robot.Compliance`."""
PAYLOAD = row_dtype([*floats("mass", "inertia"), ("position", "f8", 2)])
"""Record of a :class:`jansen_env.robot.Payload`."""
CHASSIS = row_dtype(
    [
        *floats("frame_angle", "pad_radius"),
        ("payload", PAYLOAD),
        ("motor", MOTOR),
        ("pad_compliance", COMPLIANCE),
    ]
)
"""Values of a :class:`jansen_env.robot.Robot` other than those of links and legs, in SI units."""

Chassis = Annotated[NDArray[np.void], CHASSIS, 1]


@kernel
def put_machine(
    links: Links,
    legs: int,
    chassis: Chassis,
    friction: Floats1,
    stiffness: Floats1,
    work: Floats2,
    machines: Machines,
) -> None:
    """Store the parameters of a weightless robot on level ground without friction.

    The crank of the robot is free. This function does not set the reach of the pads or the advance
    per turn of the crank.

    Args:
        links: Links of a leg, shape (bodies,).
        legs: Number of legs.
        chassis: Record of the other values of the robot, shape (1,).
        friction: Coulomb friction of each bearing, in N m, shape (bearings,).
        stiffness: Stiffness of each spring of a leg, in N/m or N m/rad, shape (springs,).
        work: Work space, shape (2, bodies + 1).
        machines: Output, shape (1,).
    """
    machine, whole = machines[0], chassis[0]
    properties, load = machine.nominal, whole.payload
    for k in range(len(links)):
        work[0, k] = links[k].mass
    machine.links_mass = legs * exact_sum(work[0, : len(links)], work[1])
    for k in range(len(links)):
        work[0, k] = links[k].inertia
    properties.own_inertia = legs * exact_sum(work[0, : len(links)], work[1])
    properties.mass = machine.links_mass + load.mass
    properties.load_mass, properties.load_inertia = load.mass, load.inertia
    properties.load_x, properties.load_y = load.position[0], load.position[1]
    properties.mass_scale = properties.inertia_scale = properties.damping_scale = 1.0
    properties.pad_radius = whole.pad_radius
    machine.torque_limit = whole.motor.torque_limit
    _put_motor(whole.motor, properties)
    properties.dry = whole.motor.friction > 0.0
    for k in range(len(friction)):
        properties.dry = properties.dry or friction[k] > 0.0
    properties.sprung = False
    for k in range(len(stiffness)):
        properties.sprung = properties.sprung or stiffness[k] > 0.0
    pads = whole.pad_compliance
    properties.compliant = pads.stiffness < math.inf
    properties.stiffness[0], properties.stiffness[1] = pads.stiffness, pads.tangential_stiffness
    properties.pad_damping[0], properties.pad_damping[1] = pads.damping, pads.tangential_damping


@stage
def _put_motor(motor, properties):
    """Store the parameters of a motor, see :class:`jansen_env.robot.motor.Motor`."""
    inertia, gear, stall = motor.rotor_inertia, motor.gear_ratio, motor.stall_torque
    properties.rotor_pitch, properties.rotor_coupling = inertia, gear * inertia
    properties.rotor_crank = gear * gear * inertia
    slope = stall / motor.no_load_speed if motor.no_load_speed < math.inf else 0.0
    properties.stall_torque, properties.torque_slope = stall, slope
    properties.limited = stall < math.inf
    properties.most_torque = motor.torque_limit if stall < math.inf else math.inf
    properties.winding = motor.efficiency / slope if slope > 0.0 else 0.0
    properties.driving, properties.driven = 1.0 / motor.efficiency, motor.efficiency
    properties.viscous_friction, properties.gear_friction = motor.viscous_friction, motor.friction
