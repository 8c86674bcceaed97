"""What may change of a robot and its ground from one episode to the next, as rows of numbers.

A row says what is in force: friction, restitution and payload as they are, the others as scales of
the robot's own numbers (1: as it is), so that a row never builds on the one before.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.reduced import Tables
from jansen_env.engine.tables import set_arms
from jansen_env.robot import BODIES, Compliance, Payload, Robot
from jansen_env.terrain import MAX_SLOPE, Terrain

Array = NDArray[np.float64]
Rows = NDArray[np.void]

LARGEST = 1e6  # of a coefficient of friction, a mass in kg, a place in m
SCALES = 0.01, 100.0

RANGES = {
    "friction": (0.0, LARGEST),
    "restitution": (0.0, 1.0),
    "payload": (0.0, LARGEST),
    "payload_x": (-LARGEST, LARGEST),
    "payload_y": (-LARGEST, LARGEST),
    "mass_scale": SCALES,
    "inertia_scale": (0.0, SCALES[1]),
    "damping_scale": (0.0, SCALES[1]),
    "foot_stiffness_scale": SCALES,
    "foot_damping_scale": (0.0, SCALES[1]),
    "motor_strength": SCALES,
    "rotor_inertia_scale": (0.0, SCALES[1]),
    "tilt": (-MAX_SLOPE, MAX_SLOPE),
}
"""What may vary, and how far.

- ``friction``, ``restitution``: between toes and ground. ``payload``: kg on the chassis, at
  ``payload_x``, ``payload_y``, m, in its frame; its own inertia stays the robot's.
- ``mass_scale``: of the masses and inertias of all links; ``inertia_scale``: on top, of their
  inertias about their own centres of mass. ``damping_scale``: of the joints' viscous friction.
- ``foot_stiffness_scale``, ``foot_damping_scale``: of feet that give, normal and tangential.
- ``motor_strength``: of all torques of the motor; the no-load speed stays.
  ``rotor_inertia_scale``: of its rotor's inertia.
- ``tilt``: rad, by which gravity is turned, so that the floor rises towards +x above 0.

Bearings keep their Coulomb friction torques: these are data of the machine, by loads measured.
"""
VARIATION = np.dtype([(name, "f8") for name in RANGES])
_LOW, _HIGH = np.array(list(RANGES.values())).T


def nominal(robot: Robot, terrain: Terrain) -> np.void:
    """The row of :data:`VARIATION` that changes nothing."""
    row = np.ones(1, VARIATION)[0]
    row["friction"], row["restitution"], row["tilt"] = terrain.friction, terrain.restitution, 0.0
    row["payload"] = robot.payload.mass
    row["payload_x"], row["payload_y"] = robot.payload.position
    return row


def effective(robot: Robot) -> tuple[str, ...]:
    """The names of :data:`RANGES` that change how a robot moves, whatever its load and ground."""
    pads = robot.pad_compliance
    rigid, undamped = pads.rigid, (pads.damping, pads.tangential_damping) == (0.0, 0.0)
    absent = {
        "restitution": not rigid,
        "inertia_scale": not any(link.inertia for link in robot.bodies),
        "damping_scale": not any(robot.damping),
        "foot_stiffness_scale": rigid,
        "foot_damping_scale": rigid or undamped,
        "rotor_inertia_scale": robot.motor.rotor_inertia == 0.0,
    }
    return tuple(name for name in RANGES if not absent.get(name, False))


def check_variations(values: Rows, compliant: NDArray[np.bool_]) -> None:
    """Check rows (k,) of :data:`VARIATION` for robots whose pads give or not (k,).

    Raises:
        ValueError: a number out of :data:`RANGES`, or restitution where pads give.
    """
    numbers = values.view(np.float64).reshape(len(values), len(RANGES))
    allowed = (numbers >= _LOW) & (numbers <= _HIGH)
    if not allowed.all():
        row, column = np.argwhere(~allowed)[0].tolist()
        name = list(RANGES)[column]
        low, high = RANGES[name]
        raise ValueError(f"{name} is {numbers[row, column]}, must be between {low:g} and {high:g}")
    bounces = compliant & (values["restitution"] > 0.0)
    if bounces.any():
        raise ValueError(
            f"restitution is {values['restitution'][bounces][0]}, must be 0 with compliant pads"
        )


def vary_params(rows: Rows, values: Rows, links_mass: float, centre: Array, pad: Array) -> None:
    """Make PARAMS (k,) of robots as they are those of ``values`` (k,), :data:`VARIATION`.

    Args:
        links_mass: kg, of the design. centre, pad: of :func:`jansen_env.engine.tables.farthest`.
    """
    rows["friction"], rows["restitution"] = values["friction"], values["restitution"]
    rows["load_mass"] = values["payload"]
    rows["load_x"], rows["load_y"] = values["payload_x"], values["payload_y"]
    for name in ("mass_scale", "inertia_scale", "damping_scale"):
        rows[name] = values[name]
    rows["mass"] = values["mass_scale"] * links_mass + values["payload"]
    set_arms(rows, centre, pad)
    rows["stiffness"] *= values["foot_stiffness_scale"][:, None]
    rows["pad_damping"] *= values["foot_damping_scale"][:, None]
    for name in ("stall_torque", "torque_slope", "most_torque"):
        rows[name] *= values["motor_strength"]
    rows["winding"] /= values["motor_strength"]
    for name in ("rotor_pitch", "rotor_coupling", "rotor_crank"):
        rows[name] *= values["rotor_inertia_scale"]
    x, y = rows["gravity_x"].copy(), rows["gravity_y"].copy()
    cos, sin = np.cos(values["tilt"]), np.sin(values["tilt"])
    rows["gravity_x"], rows["gravity_y"] = cos * x + sin * y, cos * y - sin * x


def tilted(gravity: tuple[float, float], tilt: float) -> tuple[float, float]:
    """A gravity (x, y), m/s^2, under a tilt, rad."""
    (x, y), cos, sin = gravity, math.cos(tilt), math.sin(tilt)
    return cos * x + sin * y, cos * y - sin * x


def varied_robot(robot: Robot, row: np.void) -> Robot:
    """The machine that a robot is under a row of :data:`VARIATION`."""
    of = dict(zip(RANGES, map(float, row.tolist()), strict=True))
    scale, own, strength = of["mass_scale"], of["inertia_scale"], of["motor_strength"]
    links: dict[str, Any] = {}
    pads, motor = robot.pad_compliance, robot.motor
    for name, link in zip(BODIES, robot.bodies, strict=True):
        links[name] = replace(link, mass=scale * link.mass, inertia=scale * (own * link.inertia))
    if not pads.rigid:
        k, d = of["foot_stiffness_scale"], of["foot_damping_scale"]
        pads = Compliance(
            k * pads.stiffness, d * pads.damping,
            k * float(pads.tangential_stiffness or 0.0), d * float(pads.tangential_damping or 0.0),
        )  # fmt: skip
    return replace(
        robot,
        **links,
        damping=tuple(of["damping_scale"] * value for value in robot.damping),
        payload=Payload(of["payload"], robot.payload.inertia, (of["payload_x"], of["payload_y"])),
        motor=replace(
            motor,
            stall_torque=strength * motor.stall_torque,
            torque_limit=strength * motor.torque_limit,
            rotor_inertia=of["rotor_inertia_scale"] * motor.rotor_inertia,
        ),
        pad_compliance=pads,
    )


def varied_terrain(terrain: Terrain, row: np.void) -> Terrain:
    """The ground that a terrain is under a row of :data:`VARIATION`."""
    return replace(terrain, friction=float(row["friction"]), restitution=float(row["restitution"]))


def varied_tables(tables: Tables, row: np.void) -> Tables:
    """The tables of :func:`varied_robot`, from those of the robot as it is."""
    body = tables.body + (row["inertia_scale"] - 1.0) * tables.own
    body[:, :5] *= row["mass_scale"]
    body[:, 5] *= row["damping_scale"]
    own = row["mass_scale"] * row["inertia_scale"] * tables.own
    return replace(tables, robot=varied_robot(tables.robot, row), body=body, own=own)
