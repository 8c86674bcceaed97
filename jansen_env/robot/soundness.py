"""The check of every robot that is loaded: it turns its crank, it can stand, its units are SI.

:func:`jansen_env.world.settings.load_robot` runs it on every robot, whatever will be done with it.
"""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jansen_env.arrays import Array
from jansen_env.robot.kinematics import LinkageError, joint_positions, toe_positions
from jansen_env.robot.robot import Robot

SAMPLES = 180  # crank angles over a turn
CHECKED = 1024  # robots whose result is remembered
HEIGHTS = 0.05, 5.0  # m, of a crank axis above the ground: a tenth of 0.5 m and ten times as much
DENSITIES = 0.2, 2000.0  # kg/m^3: mass of one leg per cube of that height
FARTHEST_PAYLOAD = 10.0  # times that height, from the crank axis
LARGEST_PAD = 0.5  # of that height, a pad's radius
UNITS = {"millimetres": 1e-3, "centimetres": 1e-2, "inches": 0.0254}  # m
"""Units in which builders write tables of lengths."""


def check_standing(robot: Robot) -> float:
    """Raise LinkageError unless the lowest toe lies below the crank axis at every crank angle.

    The message says where it does not, and which dyads to assemble on their other side.

    Returns:
        Mean height of the crank axis above the lowest toe over a turn, m.

    Raises:
        LinkageError: the robot cannot stand, or its linkage does not close.
    """
    psi = _turn()
    heights = lowest_toes(robot)
    worst = int(heights.argmax())
    if heights[worst] < 0.0:
        return -float(heights.mean())
    raise LinkageError(
        "robot cannot stand: its lowest toe must lie below the crank axis over the whole turn, but "
        f"is {heights[worst]:.3g} m above the axis at crank angle {psi[worst]:.3f} rad; "
        + _usual_cause(robot)
    )


def lowest_toes(robot: Robot) -> Array:
    """Height of the lowest toe above the crank axis (SAMPLES,), m, over a turn, kept level.

    Raises:
        LinkageError: the linkage does not close.
    """
    heights: Array = toe_positions(robot, _turn())[..., 1].min(axis=-1)
    return heights


def check_loaded(name: str, robot: Robot, standing: bool = True) -> Robot:
    """Return a robot after checking that it turns its crank and can stand, and what its units are.

    Args:
        name: The argument that holds the robot, for messages.
        robot: The robot to check.
        standing: Whether it has to stand. Where it need not, because its chassis is held in the
            air, there is a warning instead of an error.

    Returns:
        The same robot. Lengths and masses that a factor of ten around human scale does not explain
        cause a warning that names the unit.

    Raises:
        LinkageError: the robot cannot turn its crank all the way round, or cannot stand.
    """
    try:
        found = _findings(robot, standing)
    except LinkageError as error:
        raise LinkageError(f"{name}: {error}") from None
    for text in found:
        warnings.warn(f"{name}: {text}", UserWarning, stacklevel=2)
    return robot


@functools.lru_cache(maxsize=CHECKED)
def _findings(robot: Robot, standing: bool) -> tuple[str, ...]:
    """Return the warnings about a robot. Raises LinkageError as :func:`check_loaded` does."""
    try:
        height = check_standing(robot)
    except LinkageError as error:
        joint_positions(robot, "fore", _turn())  # or its linkage does not close
        if standing:
            raise
        return (f"{error}. This is allowed here, as the chassis is held in the air",)
    return tuple(_unit_warnings(robot, height))


def _unit_warnings(robot: Robot, height: float) -> Iterator[str]:
    """Describe lengths and masses that a factor of ten around human scale does not explain."""
    if not HEIGHTS[0] <= height <= HEIGHTS[1]:
        yield _wrong_height(height)
        return
    density = robot.links_mass / len(robot.legs) / height**3
    if not DENSITIES[0] <= density <= DENSITIES[1]:
        each = robot.links_mass / len(robot.legs)
        factor = 1e-3 if density > DENSITIES[1] else 1e3
        yield (
            f"each leg has a mass of {each:.3g} kg, while the crank axis is {height:.3g} m above "
            f"the ground; masses are in kg: if these are in {'g' if factor < 1.0 else 'tonnes'}, "
            f"multiply them by {factor:g}"
        )
    if robot.pad_radius > LARGEST_PAD * height:
        yield (
            f"pad_radius is {robot.pad_radius:.3g} m, while the crank axis is {height:.3g} m above "
            "the ground; lengths are in metres"
        )
    if robot.payload.mass > 0.0 and math.hypot(*robot.payload.position) > FARTHEST_PAYLOAD * height:
        yield (
            f"payload.position is {robot.payload.position} m, while the crank axis is {height:.3g} "
            "m above the ground; lengths are in metres"
        )


def _wrong_height(height: float) -> str:
    low, high = HEIGHTS
    text = (
        f"its crank axis is {height:.3g} m above the ground, expected {low:g} to {high:g} m; "
        "lengths are in metres"
    )
    for unit, size in UNITS.items():
        if low <= height * size <= high:
            text += f"; multiply lengths in {unit} by {size:g}"
    return text


def _usual_cause(robot: Robot) -> str:
    """Say which dyads let the robot stand when they are assembled on their other side."""
    dyads = robot.linkage.dyads
    standing = []
    for place, dyad in enumerate(dyads):
        other = dyad._replace(branch=-dyad.branch)
        linkage = replace(robot.linkage, dyads=(*dyads[:place], other, *dyads[place + 1 :]))
        try:
            heights = lowest_toes(replace(robot, linkage=linkage))
        except LinkageError:  # with this dyad on its other side it does not even close
            continue
        if heights.max() < 0.0:
            height = -float(heights.mean())
            axis = f"the crank axis is then {height:.3g} m above the ground"
            standing.append(f"joint {dyad.joint} ({axis})")
    if not standing:
        return (
            "the usual causes are dyads assembled on their other side (Dyad.branch), and a frame "
            "that is upside down (frame_angle, in radians)"
        )
    return (
        "the usual cause is a dyad assembled on its other side: reverse the branch of "
        + " or ".join(standing)
    )


@functools.cache
def _turn() -> Array:
    return 2.0 * math.pi / SAMPLES * np.arange(SAMPLES, dtype=float)
