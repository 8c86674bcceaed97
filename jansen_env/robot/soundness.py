"""Checks that a robot can turn its crank and stand, and that its values are in SI units.

:func:`jansen_env.world.settings.load_robot` applies these checks to every robot, whatever the robot
is used for.
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

SAMPLES = 180  # number of crank angles per turn
CHECKED = 1024  # number of robots whose results are cached
HEIGHTS = 0.05, 5.0  # plausible heights of a crank axis: from a tenth to ten times 0.5 m
DENSITIES = 0.2, 2000.0  # plausible mass of a leg divided by the cube of that height, in kg/m^3
FARTHEST_PAYLOAD = 10.0  # plausible distance of a payload from the crank axis, divided by height
LARGEST_PAD = 0.5  # plausible radius of a pad, divided by height
UNITS = {"millimetres": 1e-3, "centimetres": 1e-2, "inches": 0.0254}  # m
"""Units in which tables of lengths are often written, and their sizes in m."""


def check_standing(robot: Robot) -> float:
    """Check that the lowest toe is below the crank axis at every crank angle.

    Returns:
        Mean height of the crank axis above the lowest toe over a turn, in m.

    Raises:
        LinkageError: If the robot cannot stand, or its linkage does not close. The message contains
            a crank angle at which the robot cannot stand, and the dyads that should be assembled on
            their other side.
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
    """Return the height of the lowest toe above the crank axis over a turn.

    The chassis is kept level during the turn.

    Returns:
        Heights in m, shape (SAMPLES,). They are negative where the toe is below the axis.

    Raises:
        LinkageError: If the linkage does not close.
    """
    heights: Array = toe_positions(robot, _turn())[..., 1].min(axis=-1)
    return heights


def check_loaded(name: str, robot: Robot, standing: bool = True) -> Robot:
    """Return a robot after checking that it can turn its crank and stand.

    The function issues a warning if the height, a length or a mass differs so much from that of a
    robot of human scale (for the height, by more than a factor of ten) that it may be in a wrong
    unit. The warning names the unit of the quantity and, for heights and masses, the unit
    that is likely to be meant.

    Args:
        name: Name of the argument that contains the robot, for messages.
        robot: The robot.
        standing: Whether the robot must be able to stand. If False, because its chassis is held in
            the air, a robot that cannot stand causes a warning instead of an error.

    Returns:
        The same robot.

    Raises:
        LinkageError: If the robot cannot turn its crank through a full turn, or cannot stand.
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
    """Return the warnings about a robot.

    Raises:
        LinkageError: If :func:`check_loaded` has to raise it.
    """
    try:
        height = check_standing(robot)
    except LinkageError as error:
        joint_positions(robot, "fore", _turn())  # raises if the linkage does not close
        if standing:
            raise
        return (f"{error}. This is allowed here, as the chassis is held in the air",)
    return tuple(_unit_warnings(robot, height))


def _unit_warnings(robot: Robot, height: float) -> Iterator[str]:
    """Yield a warning for each length or mass that is far from that of a robot of human scale."""
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
    """Return the warning about a height of the crank axis (in m), with the likely unit."""
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
    """Return a text that names the dyads whose branch must be reversed for the robot to stand."""
    dyads = robot.linkage.dyads
    standing = []
    for place, dyad in enumerate(dyads):
        other = dyad._replace(branch=-dyad.branch)
        linkage = replace(robot.linkage, dyads=(*dyads[:place], other, *dyads[place + 1 :]))
        try:
            heights = lowest_toes(replace(robot, linkage=linkage))
        except LinkageError:  # the linkage does not close with this dyad on its other side
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
    """Return the crank angles of a turn, in rad, shape (SAMPLES,)."""
    return 2.0 * math.pi / SAMPLES * np.arange(SAMPLES, dtype=float)
