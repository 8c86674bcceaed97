"""Numbers of the baselines that belong to a robot: found for designs, by a rule for others.

``data/baselines.json`` has, for each built-in design, two sets of gains, the crank speed and the
constant torque for a commanded speed, and the command that found each; ``data/profile.json`` has
its crank-speed profile. The gains of "pid" return most in walks at a commanded speed. Those of
"steady" hold the crank at a constant speed, for predictions and measurements.

Links decide which design a robot is. A robot with other links gets the paper's numbers, scaled to
its size, weight and motor (:func:`scale_of`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from jansen_env.arrays import Array
from jansen_env.baselines.pid import PID
from jansen_env.baselines.policy import PAPER_PID
from jansen_env.robot import ROBOTS, Robot, named_robot
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.zoo import standing_height
from jansen_env.tasks.walking import profile
from jansen_env.tasks.walking.profile import Profile
from jansen_env.world.settings import Values

DATA = Path(__file__).parent / "data" / "baselines.json"
MOST_LAG = 2.0  # rad, at which the proportional gain of the rule asks for the torque limit
SHORTEST_TURN = 0.05  # m, of advance in a turn of the crank, by which crank speeds are found

Setting: TypeAlias = Callable[[Array], Array]
"""Commands (n,), m/s, to crank speeds (n,), rad/s, or torques (n,), N m, that walk at them."""


class Scale(NamedTuple):
    """A robot's torques, times and lengths as multiples of those of the paper's robot."""

    torque: float
    time: float
    length: float

    @property
    def speed(self) -> float:
        """Walking speed at the same Froude number."""
        return self.length / self.time


def scale_of(robot: Robot, most_lag: float = MOST_LAG) -> Scale:
    """Return the scale by which a robot's numbers differ from those of the paper's robot.

    Lengths scale with the standing height h, times with the root of h, torques with the weight
    times h: two machines of the same shape then walk alike (the same Froude number). The torque
    is less where the motor is too weak for it: a crank that lags by ``most_lag`` (rad) asks for the
    motor's torque limit, as on the paper's robot, so that a weak motor does not switch between its
    limits.
    """
    paper = named_robot("paper")
    length = max(standing_height(robot) / standing_height(paper), 1e-3)
    torque = min(robot.links_mass / paper.links_mass * length,
                 robot.motor.torque_limit / (PAPER_PID.kp * most_lag))  # fmt: skip
    return Scale(torque, math.sqrt(length), length)


def scaled_gains(scale: Scale) -> PID:
    """Return the paper's gains for a robot of a scale."""
    return PID(
        PAPER_PID.kp * scale.torque,
        PAPER_PID.ki * scale.torque / scale.time,
        PAPER_PID.kd * scale.torque * scale.time,
    )


def design_of(robot: Robot, known: Iterable[str] = tuple(ROBOTS)) -> str | None:
    """Return the name of the design that has a robot's links, of those in ``known``."""
    for name in known:
        design = named_robot(name)
        if (design.linkage, design.bodies) == (robot.linkage, robot.bodies):
            return name
    return None


@cache
def _read() -> dict[str, Values]:
    return json.loads(DATA.read_text(encoding="utf-8"))


def measured(name: str, robot: Robot) -> Values | None:
    """Return the entry "pid", "steady" or "constant" of a robot's design; None for no design."""
    numbers = _read()
    design = design_of(robot, numbers)
    return None if design is None else numbers[design][name]


def gains_of(robot: Robot, kind: str = "pid") -> PID:
    """Return the gains of a robot's own PID: found for its design, or scaled from the paper's.

    ``kind``: "pid" for those that return most, "steady" for those that hold the crank's speed.
    """
    entry = measured(kind, robot)
    return scaled_gains(scale_of(robot)) if entry is None else PID(*entry["gains"])


def nearest_setting(settings: Array, speeds: Array) -> Setting:
    """The measured setting (m,) whose episodes' speeds (m, episodes) came closest to a command.

    A negative command turns the crank backwards: the machine is its own mirror image.
    """

    def setting(command: Array) -> Array:
        error = np.abs(speeds - np.abs(command)[:, None, None]).mean(axis=2)
        return np.sign(command) * settings[np.argmin(error, axis=1)]

    return setting


def rolling(robot: Robot) -> Setting:
    """Return the crank speed at which a robot that does not slip walks at a command."""
    turn = max(abs(advance_per_turn(robot)), SHORTEST_TURN)
    return lambda command: 2.0 * math.pi / turn * command


def setting_of(name: str, robot: Robot) -> Setting:
    """Return the settings of "pid" (crank speeds) or "constant" (torques) for a robot.

    Those that were measured on its design; of another robot the crank speed of :func:`rolling`, or
    the paper's torque at the same Froude number, scaled.
    """
    entry = measured(name, robot)
    if entry is not None:
        return nearest_setting(np.array(entry["settings"]), np.array(entry["speeds"]))
    if name == "pid":
        return rolling(robot)
    scale, paper = scale_of(robot), setting_of(name, named_robot("paper"))
    return lambda command: scale.torque * paper(command / scale.speed)


def profile_of(robot: Robot) -> Profile:
    """Return the crank-speed profile of a robot: its design's, or the paper's, scaled."""
    profiles = json.loads(profile.DATA.read_text(encoding="utf-8"))
    design = design_of(robot, profiles)
    if design is not None:
        return profile.load_profile(robot=design)
    return scaled_profile(profile.load_profile(), scale_of(robot))


def scaled_profile(paper: Profile, scale: Scale) -> Profile:
    """Return the paper's profile for a robot of a scale; the harmonics are the same."""
    units = np.ones(paper.numbers.shape[1])
    units[:4] = 1.0 / scale.time, scale.torque * scale.time, scale.torque, 1.0 / scale.length
    return Profile(scale.speed * paper.commands, units * paper.numbers)
