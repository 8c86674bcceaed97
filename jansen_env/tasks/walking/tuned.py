"""Parameters of the baselines for each robot: measured for designs, and scaled for other robots.

For each built-in design, ``data/baselines.json`` contains two sets of PID gains, the crank speed
and the constant torque for commanded speeds, and the command line that found each of them.
``data/profile.json`` contains the crank-speed profile of each design. The gains "pid" achieve the
highest return when walking at a commanded speed. The gains "steady" hold the crank at a constant
speed, for predictions and measurements.

A robot belongs to a design if it has the same links. A robot with other links gets the parameters
of the paper's robot, scaled to its size, weight and motor (:func:`scale_of`).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from jansen_env.arrays import Array
from jansen_env.engine.crank_control import (
    put_nearest_settings,
    put_rolling_speeds,
    put_scale,
    put_scaled_gains,
)
from jansen_env.policies.pid import PID
from jansen_env.policies.policy import PAPER_PID
from jansen_env.robot import ROBOTS, Robot, named_robot
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.zoo import standing_height
from jansen_env.tasks.walking import profile
from jansen_env.tasks.walking.profile import Profile
from jansen_env.world.settings import Values

DATA = Path(__file__).parent / "data" / "baselines.json"
# Lag of the crank at which a scaled proportional gain commands the torque limit, in rad.
MOST_LAG = 2.0

Setting: TypeAlias = Callable[[Array], Array]
"""Function that returns crank speeds in rad/s, or torques in N m, for walking at commanded speeds.

Its argument is commanded speeds in m/s. The argument and the result have shape (n,).
"""


class Scale(NamedTuple):
    """Torques, times and lengths of a robot as multiples of those of the paper's robot.

    Attributes:
        torque: Ratio of the torques.
        time: Ratio of the times.
        length: Ratio of the lengths.
    """

    torque: float
    time: float
    length: float

    @property
    def speed(self) -> float:
        """Ratio of the walking speeds at the same Froude number."""
        return self.length / self.time


def scale_of(robot: Robot, most_lag: float = MOST_LAG) -> Scale:
    """Return the scale of a robot relative to the paper's robot.

    Lengths scale with the standing height h, times with the square root of h, and torques with the
    weight times h. Two robots of the same shape then walk in the same way (at the same Froude
    number). The torque scale is smaller if the motor is too weak for it: a crank that lags by
    ``most_lag`` then commands the torque limit of the motor, as on the paper's robot. Without this
    limit, a weak motor would switch between its two torque limits.

    Args:
        robot: The robot.
        most_lag: Lag of the crank at which the proportional gain commands the torque limit, in rad.
    """
    paper = named_robot("paper")
    ratios = np.empty(3)
    put_scale(
        standing_height(robot),
        robot.links_mass,
        robot.motor.torque_limit,
        standing_height(paper),
        paper.links_mass,
        PAPER_PID.kp,
        most_lag,
        ratios,
    )
    return Scale(*ratios.tolist())


def scaled_gains(scale: Scale) -> PID:
    """Return the gains of the paper, scaled to a robot.

    Args:
        scale: Scale of the robot.
    """
    gains = np.empty(3)
    paper = np.array([PAPER_PID.kp, PAPER_PID.ki, PAPER_PID.kd], float)
    put_scaled_gains(paper, np.array(scale), gains)
    return PID(*gains.tolist())


def design_of(robot: Robot, known: Iterable[str] = tuple(ROBOTS)) -> str | None:
    """Return the name of the design that has the same links as a robot.

    Args:
        robot: The robot.
        known: Names of the designs to compare with.

    Returns:
        The name, or None if no design has the same links.
    """
    for name in known:
        design = named_robot(name)
        if (design.linkage, design.bodies) == (robot.linkage, robot.bodies):
            return name
    return None


@cache
def _read() -> dict[str, Values]:
    """Return the content of ``data/baselines.json``."""
    return json.loads(DATA.read_text(encoding="utf-8"))


def measured(name: str, robot: Robot) -> Values | None:
    """Return measured parameters of a robot's design, or None if it belongs to no design.

    Args:
        name: Name of the entry: "pid", "steady" or "constant".
        robot: The robot.
    """
    numbers = _read()
    design = design_of(robot, numbers)
    return None if design is None else numbers[design][name]


def gains_of(robot: Robot, kind: str = "pid") -> PID:
    """Return the PID gains of a robot, measured for its design or scaled from those of the paper.

    Args:
        robot: The robot.
        kind: "pid" for the gains with the highest return, "steady" for the gains that hold the
            crank speed.
    """
    entry = measured(kind, robot)
    return scaled_gains(scale_of(robot)) if entry is None else PID(*entry["gains"])


def nearest_setting(settings: Array, speeds: Array) -> Setting:
    """Return a function that selects the measured setting with the speed nearest to a command.

    A negative command turns the crank backwards, because the robot is its own mirror image.

    Args:
        settings: Measured settings, shape (m,).
        speeds: Speeds of the episodes with each setting, in m/s, shape (m, episodes).
    """

    def setting(command: Array) -> Array:
        selected = np.empty(len(command))
        work = np.empty(speeds.shape[1])
        put_nearest_settings(settings, speeds, np.ascontiguousarray(command), work, selected)
        return selected

    return setting


def rolling(robot: Robot) -> Setting:
    """Return the function from commands to the crank speeds that follow them without slip.

    Args:
        robot: The robot.
    """
    advance = advance_per_turn(robot)

    def setting(command: Array) -> Array:
        speeds = np.empty(len(command))
        put_rolling_speeds(advance, np.ascontiguousarray(command), speeds)
        return speeds

    return setting


def setting_of(name: str, robot: Robot) -> Setting:
    """Return the function from commands to the settings of a baseline for a robot.

    For a robot of a known design, the settings are those that were measured. For another robot, the
    crank speed is that of :func:`rolling`, and the torque is that of the paper's robot at the same
    Froude number, scaled to the robot.

    Args:
        name: "pid" for crank speeds, "constant" for torques.
        robot: The robot.
    """
    entry = measured(name, robot)
    if entry is not None:
        return nearest_setting(np.array(entry["settings"]), np.array(entry["speeds"]))
    if name == "pid":
        return rolling(robot)
    scale = scale_of(robot)
    paper = setting_of(name, named_robot("paper"))
    return lambda command: scale.torque * paper(command / scale.speed)


def profile_of(robot: Robot) -> Profile:
    """Return the crank-speed profile of a robot: that of its design, or else the paper's, scaled.

    Args:
        robot: The robot.
    """
    profiles = json.loads(profile.DATA.read_text(encoding="utf-8"))
    design = design_of(robot, profiles)
    if design is not None:
        return profile.load_profile(robot=design)
    return scaled_profile(profile.load_profile(), scale_of(robot))


def scaled_profile(paper: Profile, scale: Scale) -> Profile:
    """Return the profile of the paper's robot, scaled to another robot.

    The harmonics do not change.

    Args:
        paper: Profile of the paper's robot.
        scale: Scale of the other robot.
    """
    units = np.ones(paper.numbers.shape[1])
    units[:4] = 1.0 / scale.time, scale.torque * scale.time, scale.torque, 1.0 / scale.length
    return Profile(scale.speed * paper.commands, units * paper.numbers)
