"""Parameters of robots and terrains applied: to machines, and to the kernels' rows.

A row of :data:`jansen_env.parameters.ROBOT_PARAMETERS` has friction, restitution and payload
as they are, the others as scales of the robot's own numbers (1: as it is), so that a row never
builds on the one before. Coulomb friction of bearings stays: it is data of the machine, by loads
measured.

A parameter in neither table of effects below is honoured by no plant, and refused.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine import mathematics
from jansen_env.parameters import OF_ROBOTS, PARAMETERS, plain
from jansen_env.plants.robot_data import set_arms
from jansen_env.robot import Compliance, Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]
Rows = NDArray[np.void]

LIMITS = np.array([(PARAMETERS[name].least, PARAMETERS[name].most) for name in OF_ROBOTS]).T
"""The least and the most of each parameter."""


def _scaled_links(robot: Robot, mass: float, inertia: float) -> Robot:
    links = (
        replace(link, mass=mass * link.mass, inertia=inertia * link.inertia)
        for link in robot.bodies
    )
    return replace(robot, bodies=tuple(links))


def _scaled_pads(robot: Robot, stiffness: float, damping: float) -> Robot:
    pads = robot.pad_compliance
    if pads.rigid:
        return robot
    normal, tangential = pads.tangential_stiffness or 0.0, pads.tangential_damping or 0.0
    scaled = Compliance(
        stiffness * pads.stiffness, damping * pads.damping, stiffness * normal, damping * tangential
    )
    return replace(robot, pad_compliance=scaled)


def _with_motor(robot: Robot, **numbers: float) -> Robot:
    return replace(robot, motor=replace(robot.motor, **numbers))


def _loaded(robot: Robot, x: float | None = None, y: float | None = None) -> Robot:
    own_x, own_y = robot.payload.position
    place = own_x if x is None else x, own_y if y is None else y
    return replace(robot, payload=replace(robot.payload, position=place))


ON_ROBOTS: dict[str, Callable[[Robot, float], Robot]] = {
    "payload": lambda robot, value: replace(robot, payload=replace(robot.payload, mass=value)),
    "payload_x": lambda robot, value: _loaded(robot, x=value),
    "payload_y": lambda robot, value: _loaded(robot, y=value),
    "inertia_scale": lambda robot, value: _scaled_links(robot, 1.0, value),
    "mass_scale": lambda robot, value: _scaled_links(robot, value, value),
    "damping_scale": lambda robot, value: replace(
        robot, damping=tuple(value * one for one in robot.damping)
    ),
    "foot_stiffness_scale": lambda robot, value: _scaled_pads(robot, value, 1.0),
    "foot_damping_scale": lambda robot, value: _scaled_pads(robot, 1.0, value),
    "motor_strength": lambda robot, value: _with_motor(
        robot,
        stall_torque=value * robot.motor.stall_torque,
        torque_limit=value * robot.motor.torque_limit,
    ),
    "rotor_inertia_scale": lambda robot, value: _with_motor(
        robot, rotor_inertia=value * robot.motor.rotor_inertia
    ),
}
"""The machine that a robot is under a value of each parameter."""
ON_TERRAINS = ("friction", "restitution")
"""Fields of a terrain."""
ON_GRAVITY = "tilt"
HONOURED_BY_MACHINES = frozenset({*ON_ROBOTS, *ON_TERRAINS, ON_GRAVITY})
"""Parameters of a plant that is built of :func:`machine_of` and :func:`terrain_of`."""

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
HONOURED_BY_KERNELS = frozenset({*COPIED, *SCALED, ON_GRAVITY})
"""Parameters of a plant that goes by :func:`apply_to_kernels`."""


def machine_of(robot: Robot, row: np.void) -> Robot:
    """Return the machine that a robot is under a row of parameters."""
    for name, effect in ON_ROBOTS.items():
        robot = effect(robot, float(row[name]))
    return robot


def terrain_of(terrain: Terrain, row: np.void) -> Terrain:
    """Return the ground that a terrain is under a row of parameters."""
    numbers = {name: float(row[name]) for name in ON_TERRAINS}
    return replace(terrain, **numbers)  # type: ignore[arg-type]


def tilted(gravity: tuple[float, float], tilt: float) -> tuple[float, float]:
    """Return a gravity (x, y), m/s^2, under a tilt, rad."""
    (x, y), cos, sin = gravity, mathematics.cos(tilt), mathematics.sin(tilt)
    return cos * x + sin * y, cos * y - sin * x


def apply_to_kernels(
    params: Rows, values: Rows, links_mass: Array, centre: Array, pad: Array
) -> None:
    """Make the kernels' rows of robots as they are those under parameters.

    Args:
        params: (k,) of ``PARAMS``. values: (k,) of ``ROBOT_PARAMETERS``. links_mass: kg, of the
            design. centre, pad: of :func:`jansen_env.plants.robot_data.farthest`.
    """
    for name, field in COPIED.items():
        params[field] = values[name]
    for name, fields in SCALED.items():
        for field in fields:
            scale = values[name]
            params[field] *= scale if params[field].ndim == 1 else scale[:, None]
    params["mass"] = values["mass_scale"] * links_mass + values["payload"]
    set_arms(params, centre, pad)
    params["winding"] /= values["motor_strength"]  # the no-load speed stays
    x, y = params["gravity_x"].copy(), params["gravity_y"].copy()
    cos, sin = mathematics.directions(values[ON_GRAVITY]).T
    params["gravity_x"], params["gravity_y"] = cos * x + sin * y, cos * y - sin * x


def check_values(
    values: Rows, nominal: Rows, compliant: NDArray[np.bool_], honours: Collection[str]
) -> None:
    """Check parameters (k,) of robots whose pads give or not (k,).

    Args:
        values: that are to be put in force. nominal: those that change nothing.
        honours: names of the parameters that the plant knows.

    Raises:
        ValueError: a number out of its limits, another than the nominal one of a parameter that
            the plant does not honour, or restitution where pads give.
    """
    numbers, own = plain(values), plain(nominal)
    wrong = ~((numbers >= LIMITS[0]) & (numbers <= LIMITS[1]))
    if wrong.any():
        k, i = np.argwhere(wrong)[0]
        row = PARAMETERS[OF_ROBOTS[i]]
        raise ValueError(
            f"{row.name} is {numbers[k, i]}, must be between {row.least:g} and {row.most:g}"
        )
    fixed = [name not in honours for name in OF_ROBOTS]
    other = (numbers != own) & fixed
    if other.any():
        k, i = np.argwhere(other)[0]
        raise ValueError(
            f"{OF_ROBOTS[i]} is {numbers[k, i]}, must be {own[k, i]:g}: this plant honours "
            f"{sorted(honours)} only"
        )
    check_restitution(compliant, values["restitution"])


def check_restitution(compliant: NDArray[np.bool_], restitution: Array) -> None:
    """Raise ValueError where compliant pads (k,) are on ground with restitution (k,)."""
    bounces = compliant & (restitution > 0.0)
    if bounces.any():
        raise ValueError(
            f"restitution is {restitution[bounces][0]}, must be 0 with compliant pads: their "
            "springs and dampers say how they bounce"
        )
