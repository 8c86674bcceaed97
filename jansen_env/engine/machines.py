"""What a robot is before the parameters of an episode change it: numbers of a robot file."""

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
        "stall_torque", "no_load_speed", "torque_limit", "gear_ratio", "rotor_inertia", "friction",
        "viscous_friction", "efficiency",
    )
)  # fmt: skip
"""A :class:`jansen_env.robot.motor.Motor`."""
COMPLIANCE = row_dtype(floats("stiffness", "damping", "tangential_stiffness", "tangential_damping"))
"""A :class:`jansen_env.robot.Compliance`."""
PAYLOAD = row_dtype([*floats("mass", "inertia"), ("position", "f8", 2)])
"""A :class:`jansen_env.robot.Payload`."""
CHASSIS = row_dtype(
    [
        *floats("frame_angle", "pad_radius"),
        ("payload", PAYLOAD),
        ("motor", MOTOR),
        ("pad_compliance", COMPLIANCE),
    ]
)
"""What a :class:`jansen_env.robot.Robot` has beside links and legs, under its names; SI units."""

Chassis = Annotated[NDArray[np.void], CHASSIS, 1]


@kernel
def put_machine(
    links: Links, legs: int, chassis: Chassis, friction: Floats1, work: Floats2, machines: Machines
) -> None:
    """Put the numbers of a robot, its crank free, weightless on level slippery ground.

    How far its pads get, and how it advances, is not known yet.

    Args:
        links: (bodies,) links of a leg. legs: Number of legs. chassis: (1,).
        friction: Coulomb friction of each bearing, N m.
        work: (2, bodies + 1) work space.
        machines: (1,) out.
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
    pads = whole.pad_compliance
    params.compliant = pads.stiffness < math.inf
    params.stiffness[0], params.stiffness[1] = pads.stiffness, pads.tangential_stiffness
    params.pad_damping[0], params.pad_damping[1] = pads.damping, pads.tangential_damping


@stage
def _put_motor(motor, params):
    """Put the numbers of a motor, see :class:`jansen_env.robot.motor.Motor`."""
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
