"""A compiled robot as the engine sees it: a :class:`Model` of its tables, and its PARAMS."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.reduced import Tables
from jansen_env.engine import mathematics
from jansen_env.engine.records import PAD, PARAMS, Model
from jansen_env.robot import Compliance, Robot

BOUND = 1.1  # what lies between the angles of the tables is less than so much larger


def kernel_model(tables: Tables) -> Model:
    """The kernels' view of one design, along a first axis of length 1."""
    layout = np.zeros(len(tables.layout.joint), PAD)
    legs = [tables.robot.legs[i] for i in tables.layout.leg]
    layout["table"] = tables.layout.joint
    layout["phase"] = [one.phase if one.side == "fore" else math.pi - one.phase for one in legs]
    layout["mirror"] = [1.0 if one.side == "fore" else -1.0 for one in legs]
    views = tables.body, tables.pads, layout, tables.bearings
    return Model(*(np.array([table]) for table in views))


def parameters(robot: Robot, gravity: tuple[float, float]) -> NDArray[np.void]:
    """(1,) PARAMS of a robot, its crank free, on level slippery ground.

    How far its pads get is not known yet, see :func:`set_arms`.
    """
    load = robot.payload
    row = np.zeros(1, PARAMS)
    row["mass"], row["load_mass"], row["load_inertia"] = robot.mass, load.mass, load.inertia
    row["own_inertia"] = len(robot.legs) * math.fsum(body.inertia for body in robot.bodies)
    row["mass_scale"] = row["inertia_scale"] = row["damping_scale"] = 1.0
    row["load_x"], row["load_y"] = load.position
    row["gravity_x"], row["gravity_y"] = gravity
    row["pad_radius"] = robot.pad_radius
    set_motor(row, robot)
    set_compliance(row, robot.pad_compliance)
    return row


def farthest(tables: Tables) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(2,) largest |c| and |c'|, kg m, of a robot without its load; (2,) of its pads' p, m."""
    centre, pads = tables.body[:, :2], tables.pads[:, :, :2]
    return (
        mathematics.lengths_of(centre[..., :2]).max(axis=0),
        mathematics.lengths_of(pads[..., :2]).max(axis=(0, 1)),
    )


def set_arms(rows: NDArray[np.void], centre: NDArray[np.float64], pad: NDArray[np.float64]) -> None:
    """Put how far pads get into PARAMS (k,) whose masses are known; (..., 2) :func:`farthest`."""
    scale, mass = rows["mass_scale"], rows["mass"]
    for k, name in enumerate(("pitch_arm", "crank_arm")):
        rows[name] = BOUND * (scale * centre[..., k] / mass + pad[..., k])
    load = np.sqrt(rows["load_x"] ** 2 + rows["load_y"] ** 2)
    rows["pitch_arm"] += rows["load_mass"] * load / mass


def set_motor(row: NDArray[np.void], robot: Robot) -> None:
    """Put a robot's motor, and whether there is dry friction, into its PARAMS (1,)."""
    motor = robot.motor
    J, G = motor.rotor_inertia, motor.gear_ratio
    row["rotor_pitch"], row["rotor_coupling"], row["rotor_crank"] = J, G * J, G * G * J
    row["stall_torque"], row["torque_slope"] = motor.stall_torque, motor.slope
    row["most_torque"] = motor.most_torque
    row["winding"], row["limited"] = motor.winding, motor.stall_torque < np.inf
    row["driving"], row["driven"] = 1.0 / motor.efficiency, motor.efficiency
    row["viscous_friction"], row["gear_friction"] = motor.viscous_friction, motor.friction
    row["dry"] = motor.friction > 0.0 or any(robot.bearing_friction)


def set_compliance(row: NDArray[np.void], pads: Compliance) -> None:
    """Put how the pads give into a robot's PARAMS (1,)."""
    row["compliant"] = not pads.rigid
    row["stiffness"] = pads.stiffness, pads.tangential_stiffness
    row["pad_damping"] = pads.damping, pads.tangential_damping
