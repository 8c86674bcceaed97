"""Application of episode parameters to robots, terrains and gravity, and their checks.

A record of :data:`jansen_env.plants.parameters.EPISODE` contains the friction, the restitution and
the payload themselves. Most of its other values are factors on the robot's own values, where 1
changes nothing. A record is therefore independent of the records that were applied before it. The
kernel :func:`jansen_env.engine.episode.apply_parameters` computes from a record the values that the
dynamics read. No parameter changes the Coulomb friction of bearings, because it is a property of
the robot that follows from measured loads.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from jansen_env.arrays import Array, Bools, Rows
from jansen_env.checks import invalid
from jansen_env.dynamics.reduced import lightest_mass
from jansen_env.engine import mathematics
from jansen_env.engine.compliance import RESOLVED
from jansen_env.plants.parameters import TABLE, plain
from jansen_env.robot import Compliance, Robot
from jansen_env.terrain import Ground

LONGEST_PHASE = 2.0 * RESOLVED
"""Largest phase h sqrt(k / m) and decay h d / m of a foot in a time step h.

Beyond this value, :mod:`jansen_env.engine.compliance` treats a foot as a rigid pad, not as a
spring.
"""
LIMITS = np.array([(row.least, row.most) for row in TABLE]).T
"""Smallest and largest value of each parameter, shape (2, parameters)."""
ON_TERRAINS = ("friction", "restitution")
"""Parameters that are fields of a terrain."""
ONLY_ZERO = {
    "compliant": "0 with compliant pads, whose springs and dampers determine how they bounce"
}
"""Description of the only allowed value of a parameter, by the flag ``Parameter.zero_where``."""


def machine_of(robot: Robot, row: np.void) -> Robot:
    """Return a robot with the parameters of an episode applied.

    Args:
        robot: The robot.
        row: Parameters, a record of :data:`jansen_env.plants.parameters.EPISODE`.
    """
    values = dict(zip(row.dtype.names or (), row.item(), strict=True))
    mass = values["mass_scale"]
    inertia = values["inertia_scale"]
    strength = values["motor_strength"]
    motor = robot.motor
    pads = robot.pad_compliance
    if not pads.rigid:
        k = values["foot_stiffness_scale"]
        d = values["foot_damping_scale"]
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


def terrain_of(terrain: Ground, row: np.void) -> Ground:
    """Return a terrain with the parameters of an episode applied.

    Args:
        terrain: The terrain.
        row: Parameters, a record of :data:`jansen_env.plants.parameters.EPISODE`.
    """
    return replace(terrain, friction=float(row["friction"]), restitution=float(row["restitution"]))


def gravity_of(gravity: tuple[float, float], row: np.void) -> tuple[float, float]:
    """Return the gravitational acceleration with the parameters of an episode applied.

    Args:
        gravity: Gravitational acceleration (x, y), in m/s^2.
        row: Parameters, a record of :data:`jansen_env.plants.parameters.EPISODE`.

    Returns:
        Scaled and tilted gravitational acceleration (x, y), in m/s^2.
    """
    scale = float(row["gravity_scale"])
    x = scale * gravity[0]
    y = scale * gravity[1]
    cos, sin = mathematics.cos(float(row["tilt"])), mathematics.sin(float(row["tilt"]))
    return cos * x + sin * y, cos * y - sin * x


def check_values(values: Rows, compliant: Bools) -> None:
    """Check the parameters of episodes before they are applied to robots.

    Args:
        values: Parameters, records of :data:`jansen_env.plants.parameters.EPISODE`, shape (k,).
        compliant: Whether the pads of each robot are compliant, shape (k,).

    Raises:
        ValueError: If a value is outside its limits, or a robot with compliant pads gets a
            restitution above 0.
    """
    numbers = plain(values)
    wrong = ~((numbers >= LIMITS[0]) & (numbers <= LIMITS[1]))
    if wrong.any():
        k, i = np.argwhere(wrong)[0]
        row = TABLE[i]
        raise invalid(row.name, float(numbers[k, i]), f"between {row.least:g} and {row.most:g}")
    check_restitution(compliant, values["restitution"])


def check_resolved(robot: Robot, values: np.void, time_step: float) -> None:
    """Check that the time step is short enough for a robot's compliant feet.

    Args:
        robot: Robot with compliant pads.
        values: Parameters of its episode, a record of :data:`jansen_env.plants.parameters.EPISODE`.
        time_step: Time step of the integration, in s.

    Raises:
        ValueError: If the feet are so stiff or so damped that they would be treated as rigid.
    """
    pads = robot.pad_compliance
    k = max(pads.stiffness, pads.tangential_stiffness or 0.0) * values["foot_stiffness_scale"]
    d = max(pads.damping, pads.tangential_damping or 0.0) * values["foot_damping_scale"]
    # The smallest effective mass of a foot, for any payload, direction and crank angle.
    scale = values["mass_scale"] * min(1.0, values["inertia_scale"])
    mass = float(scale) * lightest_mass(robot)
    longest = LONGEST_PHASE * math.sqrt(mass / k)
    if d > 0.0:
        longest = min(longest, LONGEST_PHASE * mass / d)
    if time_step > longest:
        raise ValueError(
            f"time_step must be at most {longest:.3g} s for feet of {k:.6g} N/m and {d:.6g} N s/m, "
            f"which move an effective mass of {mass:.3g} kg, got {time_step:g}"
        )


def check_restitution(compliant: Bools, restitution: Array) -> None:
    """Check that no compliant pads are on ground with a restitution above 0.

    Args:
        compliant: Whether the pads of each robot are compliant, shape (k,).
        restitution: Restitution of each robot's ground, shape (k,).

    Raises:
        ValueError: If compliant pads are on ground with a restitution above 0.
    """
    bounces = compliant & (restitution > 0.0)
    if bounces.any():
        raise invalid("restitution", float(restitution[bounces][0]), ONLY_ZERO["compliant"])
