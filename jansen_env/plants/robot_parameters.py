"""Parameters of robots and terrains applied: to machines, and to the kernels' rows.

A row of :data:`jansen_env.parameters.ROBOT_PARAMETERS` has friction, restitution and payload
as they are, the others as scales of the robot's own numbers (1: as it is), so that a row never
builds on the one before. Coulomb friction of bearings stays: it is data of the machine, by loads
measured.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from jansen_env.arrays import Array, Bools, Rows
from jansen_env.checks import invalid
from jansen_env.engine import mathematics
from jansen_env.engine.records import PARAMS
from jansen_env.parameters import OF_ROBOTS, PARAMETERS, plain
from jansen_env.robot import Compliance, Robot
from jansen_env.terrain import Terrain

BOUND = 1.1  # what lies between the angles of the tables is less than so much larger
LIMITS = np.array([(PARAMETERS[name].least, PARAMETERS[name].most) for name in OF_ROBOTS]).T
"""The least and the most of each parameter."""
COPIED = {
    "friction": "friction", "restitution": "restitution", "payload": "load_mass",
    "payload_x": "load_x", "payload_y": "load_y", "mass_scale": "mass_scale",
    "inertia_scale": "inertia_scale", "damping_scale": "damping_scale",
}  # fmt: skip
"""The number of :data:`jansen_env.engine.records.PARAMS` that is a parameter."""
SCALED = {
    "foot_stiffness_scale": ("stiffness",),
    "foot_damping_scale": ("pad_damping",),
    "motor_strength": ("stall_torque", "torque_slope", "most_torque"),
    "rotor_inertia_scale": ("rotor_pitch", "rotor_coupling", "rotor_crank"),
}
"""The numbers that it scales."""
ON_TERRAINS = ("friction", "restitution")
"""Fields of a terrain."""


def machine_of(robot: Robot, row: np.void) -> Robot:
    """The robot with these parameters applied."""
    values = dict(zip(OF_ROBOTS, row.item(), strict=True))
    mass, inertia = values["mass_scale"], values["inertia_scale"]
    strength, motor, pads = values["motor_strength"], robot.motor, robot.pad_compliance
    if not pads.rigid:
        k, d = values["foot_stiffness_scale"], values["foot_damping_scale"]
        normal = k * pads.stiffness, d * pads.damping
        tangential = pads.tangential_stiffness or 0.0, pads.tangential_damping or 0.0
        pads = Compliance(*normal, k * tangential[0], d * tangential[1])
    place = values["payload_x"], values["payload_y"]
    return replace(
        robot,
        bodies=tuple(
            replace(link, mass=mass * link.mass, inertia=mass * (inertia * link.inertia))
            for link in robot.bodies
        ),
        damping=tuple(values["damping_scale"] * each for each in robot.damping),
        payload=replace(robot.payload, mass=values["payload"], position=place),
        motor=replace(
            motor,
            stall_torque=strength * motor.stall_torque,
            torque_limit=strength * motor.torque_limit,
            rotor_inertia=values["rotor_inertia_scale"] * motor.rotor_inertia,
        ),
        pad_compliance=pads,
    )


def terrain_of(terrain: Terrain, row: np.void) -> Terrain:
    """The terrain with these parameters applied."""
    friction, restitution = (float(row[name]) for name in ON_TERRAINS)
    return replace(terrain, friction=friction, restitution=restitution)


def gravity_of(gravity: tuple[float, float], row: np.void) -> tuple[float, float]:
    """The gravity (x, y), m/s^2, with these parameters applied."""
    x, y = (float(row["gravity_scale"]) * each for each in gravity)
    cos, sin = mathematics.cos(float(row["tilt"])), mathematics.sin(float(row["tilt"]))
    return cos * x + sin * y, cos * y - sin * x


def kernel_row(robot: Robot) -> Rows:
    """(1,) PARAMS of a robot, its crank free, weightless on level slippery ground.

    How far its pads get is not known yet, see :func:`apply_to_kernels`.
    """
    load, motor, pads = robot.payload, robot.motor, robot.pad_compliance
    row = np.zeros(1, PARAMS)
    row["mass"], row["load_mass"], row["load_inertia"] = robot.mass, load.mass, load.inertia
    row["own_inertia"] = len(robot.legs) * math.fsum(body.inertia for body in robot.bodies)
    row["mass_scale"] = row["inertia_scale"] = row["damping_scale"] = 1.0
    row["load_x"], row["load_y"] = load.position
    row["pad_radius"] = robot.pad_radius
    J, G = motor.rotor_inertia, motor.gear_ratio
    row["rotor_pitch"], row["rotor_coupling"], row["rotor_crank"] = J, G * J, G * G * J
    row["stall_torque"], row["torque_slope"] = motor.stall_torque, motor.slope
    row["most_torque"] = motor.most_torque
    row["winding"], row["limited"] = motor.winding, motor.stall_torque < np.inf
    row["driving"], row["driven"] = 1.0 / motor.efficiency, motor.efficiency
    row["viscous_friction"], row["gear_friction"] = motor.viscous_friction, motor.friction
    row["dry"] = motor.friction > 0.0 or any(robot.bearing_friction)
    row["compliant"] = not pads.rigid
    row["stiffness"] = pads.stiffness, pads.tangential_stiffness
    row["pad_damping"] = pads.damping, pads.tangential_damping
    return row


def apply_to_kernels(
    params: Rows, values: Rows, links_mass: Array, centre: Array, pad: Array
) -> None:
    """Make the kernels' rows of robots as they are those under parameters.

    Args:
        params: (k,) of ``PARAMS``. values: (k,) of ``ROBOT_PARAMETERS``. links_mass: kg, of the
            design. centre: (k, 2) largest |c| and |c'| of the design without its load, kg m.
            pad: (k, 2) largest |p| and |p'| of its pads, m.
    """
    for name, copied in COPIED.items():
        params[copied] = values[name]
    for name, fields in SCALED.items():
        for field in fields:
            scale = values[name]
            params[field] *= scale if params[field].ndim == 1 else scale[:, None]
    params["mass"] = values["mass_scale"] * links_mass + values["payload"]
    scale, mass = params["mass_scale"], params["mass"]
    for k, name in enumerate(("pitch_arm", "crank_arm")):
        params[name] = BOUND * (scale * centre[:, k] / mass + pad[:, k])
    load = np.sqrt(params["load_x"] ** 2 + params["load_y"] ** 2)
    params["pitch_arm"] += params["load_mass"] * load / mass
    params["winding"] /= values["motor_strength"]  # the no-load speed stays
    x, y = (values["gravity_scale"] * params[name] for name in ("gravity_x", "gravity_y"))
    cos, sin = mathematics.directions(values["tilt"]).T
    params["gravity_x"], params["gravity_y"] = cos * x + sin * y, cos * y - sin * x


def check_values(values: Rows, compliant: Bools) -> None:
    """Check parameters (k,) that are to be put in force, of robots whose pads give or not (k,).

    Raises:
        ValueError: a number out of its limits, or restitution where pads give.
    """
    numbers = plain(values)
    wrong = ~((numbers >= LIMITS[0]) & (numbers <= LIMITS[1]))
    if wrong.any():
        k, i = np.argwhere(wrong)[0]
        row = PARAMETERS[OF_ROBOTS[i]]
        raise invalid(row.name, float(numbers[k, i]), f"between {row.least:g} and {row.most:g}")
    check_restitution(compliant, values["restitution"])


def check_restitution(compliant: Bools, restitution: Array) -> None:
    """Raise ValueError where compliant pads (k,) are on ground with restitution (k,)."""
    bounces = compliant & (restitution > 0.0)
    if bounces.any():
        allowed = "0 with compliant pads: their springs and dampers say how they bounce"
        raise invalid("restitution", float(restitution[bounces][0]), allowed)
