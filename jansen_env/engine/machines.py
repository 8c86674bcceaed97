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
    params, load = machine.nominal, whole.payload
    for k in range(len(links)):
        work[0, k] = links[k].mass
    machine.links_mass = legs * exact_sum(work[0, : len(links)], work[1])
    for k in range(len(links)):
        work[0, k] = links[k].inertia
    params.own_inertia = legs * exact_sum(work[0, : len(links)], work[1])
    params.mass = machine.links_mass + load.mass
    params.load_mass, params.load_inertia = load.mass, load.inertia
    params.load_x, params.load_y = load.position[0], load.position[1]
    params.mass_scale = params.inertia_scale = params.damping_scale = 1.0
    params.pad_radius = whole.pad_radius
    machine.torque_limit = whole.motor.torque_limit
    _put_motor(whole.motor, params)
    params.dry = whole.motor.friction > 0.0
    for k in range(len(friction)):
        params.dry = params.dry or friction[k] > 0.0
    params.sprung = False
    for k in range(len(stiffness)):
        params.sprung = params.sprung or stiffness[k] > 0.0
    pads = whole.pad_compliance
    params.compliant = pads.stiffness < math.inf
    params.stiffness[0], params.stiffness[1] = pads.stiffness, pads.tangential_stiffness
    params.pad_damping[0], params.pad_damping[1] = pads.damping, pads.tangential_damping


@stage
def _put_motor(motor, params):
    """Store the parameters of a motor, see :class:`jansen_env.robot.motor.Motor`."""
    inertia, gear, stall = motor.rotor_inertia, motor.gear_ratio, motor.stall_torque
    params.rotor_pitch, params.rotor_coupling = inertia, gear * inertia
    params.rotor_crank = gear * gear * inertia
    slope = stall / motor.no_load_speed if motor.no_load_speed < math.inf else 0.0
    params.stall_torque, params.torque_slope = stall, slope
    params.limited = stall < math.inf
    params.most_torque = motor.torque_limit if stall < math.inf else math.inf
    params.winding = motor.efficiency / slope if slope > 0.0 else 0.0
    params.driving, params.driven = 1.0 / motor.efficiency, motor.efficiency
    params.viscous_friction, params.gear_friction = motor.viscous_friction, motor.friction
