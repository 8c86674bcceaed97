"""Setting a robot down: the chassis pose in which the ground carries it on both sides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import finite
from jansen_env.dynamics.pads import pad_layout
from jansen_env.engine.mathematics import directions
from jansen_env.engine.placement import clearance, level_pitch
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import positions_of, toe_positions
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]

DEEPEST = 0.02  # m, of static deflection


def static_deflection(robot: Robot, gravity: float) -> float:
    """:func:`resting_depth` of a robot."""
    return resting_depth(robot.mass, robot.pad_compliance.stiffness, gravity)


def resting_depth(mass: float, stiffness: float, gravity: float) -> float:
    """Static deflection of feet, m: the weight of a mass, kg, on two of a stiffness, N/m.

    ``gravity``: m/s^2, downwards.

    Raises:
        ValueError: deeper than :data:`DEEPEST`: the feet are too soft.
    """
    depth = 0.5 * mass * max(gravity, 0.0) / stiffness
    if depth > DEEPEST:
        raise ValueError(
            f"pad_compliance.stiffness is {stiffness} N/m, must be at least "
            f"{stiffness * depth / DEEPEST:.3g} N/m to carry a robot of {mass:.3g} kg"
        )
    return depth


def resting_pose(
    robot: Robot, centre: Array, terrain: Terrain, x: float, crank_angle: float, pitch: float | None
) -> tuple[float, float]:
    """Height and pitch (y, theta) of the chassis at which the lowest pad has no gap.

    Args:
        centre: (2,) centre of mass in the chassis frame, m. x: crank axis, m. crank_angle: rad.
        pitch: rad, or None for the pitch at which the lowest toe ahead of the centre of mass and
            the lowest one behind it touch together; level if all toes are on one side.

    Raises:
        ValueError: a number that is not finite.
    """
    x, crank_angle = finite("x", x), finite("crank_angle", crank_angle)
    pitch = None if pitch is None else finite("pitch", pitch)
    surface, radius = terrain.polyline, robot.pad_radius
    if pitch is None:
        toes = toe_positions(robot, crank_angle)
        pitch = level_pitch(toes, centre, surface, 0, len(surface), x, radius)
    layout = pad_layout(robot)
    known = [robot.linkage.all_pads[k][0] for k in layout.joint]
    pads = positions_of(robot, crank_angle, [*zip(layout.leg.tolist(), known, strict=True)])
    (c, s), places = directions([pitch])[0], pads.T
    centres = np.stack([x + c * places[0] - s * places[1], s * places[0] + c * places[1]], axis=1)
    return -clearance(centres, surface, 0, len(surface), radius), float(pitch)
