"""Variables of a search: lengths, crank phases, legs, motor, a crank-speed profile's numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from jansen_env.baselines.policy import Array
from jansen_env.checks import shown
from jansen_env.drawings.shaft_order import units
from jansen_env.plain_yaml import Rule, check_keys
from jansen_env.robot import ROBOTS, Robot
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.robot.motor import MOTORS
from jansen_env.tasks.walking.profile import DATA, load_profile
from jansen_env.tasks.walking.walker_benchmark import tuned_for
from jansen_env.world.settings import load_robot

T = TypeVar("T")

KINDS: dict[str, Rule] = {
    "lengths": Rule((float, dict), 1e-4, 0.9), "phases": Rule((float,), 1e-4, math.pi),
    "pins": Rule((list,)), "motors": Rule((list,)), "harmonics": Rule((int,), 0, 8),
}  # fmt: skip
TUNED = "built", "paper"
"""Designs whose profiles a search may begin with, the nearer kind of machine first."""
# Ranges of a profile's numbers about where it begins: factors, N m, and of the harmonics.
SPEED_RANGE, GAIN_RANGE, BIAS_RANGE, FEEDBACKS, SHAPE_RANGE = 2.5, (1.0, 30.0), 4.0, (0.0, 4.0), 0.8


class Variable(NamedTuple):
    """A number from ``low`` to ``high``; the search begins at ``start``."""

    name: str
    low: float
    high: float
    start: float


class Candidate(NamedTuple):
    """A robot, and numbers (4 + 2 K,) of the profile that turns its crank."""

    robot: Robot
    numbers: Array


class Space:
    """The variables of a search, each from 0 to 1, and the candidates they stand for.

    Args:
        robot: name or file of the design to begin with. speed: m/s, of the profile.
        profile: file of a search's to begin with; None for that of the robot's design.
        wanted: by the names of :data:`KINDS`: "lengths": share by which each may change, or shares
            by name; "phases": rad by which each crank pin but the first may; "pins": numbers of
            crank pins; "motors": names; "harmonics": K of the profile, without which it is no
            variable.

    Raises:
        ValueError: an unknown name, or a value that is not allowed.
    """

    def __init__(
        self, robot: str, speed: float, wanted: dict[str, Any], profile: str | None = None
    ) -> None:
        check_keys("variables", wanted, KINDS)
        self._name, self.base = robot, load_robot("robot", robot)
        self._choices = {name: _choices(name, wanted[name], robot)
                         for name in ("pins", "motors") if name in wanted}  # fmt: skip
        shipped = DATA, tuned_for(self.base, TUNED)
        source = shipped if profile is None else (profile, "found")
        numbers = load_profile(*source).at(np.array([speed]))[0]
        self._profile = _profile_variables(
            numbers, int(wanted.get("harmonics", len(numbers) // 2 - 2))
        )
        self._lengths = _length_variables(self.base, wanted.get("lengths", {}))
        if "pins" in wanted and "phases" in wanted:
            raise ValueError("variables has pins and phases, must have one of them")
        reach = float(wanted.get("phases", 0.0))
        self._units = units(self.base)[1:] if reach else []
        self._phases = [Variable(f"phase_{k}", -reach, reach, 0.0)
                        for k, _ in enumerate(self._units, start=1)]  # fmt: skip
        picks = [Variable(name, 0.0, 1.0, 0.5) for name in self._choices]
        tuned = self._profile if "harmonics" in wanted else []
        self.variables = [*self._lengths, *self._phases, *picks, *tuned]
        if not self.variables:
            raise ValueError(f"variables is {shown(wanted)}, must have some of {[*KINDS]}")
        self._low, self._high, start = np.array([each[1:] for each in self.variables]).T
        self.start: Array = (start - self._low) / (self._high - self._low)

    def candidate(self, unit: Array) -> Candidate:
        """Return what numbers (d,) from 0 to 1 stand for.

        Raises:
            ValueError: lengths that form no triangle.
        """
        numbers = self._low + np.clip(unit, 0.0, 1.0) * (self._high - self._low)
        values = dict(zip((v.name for v in self.variables), numbers.tolist(), strict=True))
        robot = self.base
        if "pins" in values:
            robot = ROBOTS[self._name](_pick(self._choices["pins"], values["pins"]))
        robot = with_lengths(robot, {v.name: values[v.name] for v in self._lengths})
        if self._phases:
            legs = [*robot.legs]
            for phase, unit_legs in zip(self._phases, self._units, strict=True):
                for k in unit_legs:
                    legs[k] = replace(legs[k], phase=legs[k].phase + values[phase.name])
            robot = replace(robot, legs=tuple(legs))
        if "motors" in values:
            robot = replace(robot, motor=MOTORS[_pick(self._choices["motors"], values["motors"])])
        numbers = np.array([values.get(v.name, v.start) for v in self._profile])
        numbers[:2] = np.exp(numbers[:2])
        return Candidate(robot, numbers)


def _pick(choices: Sequence[T], value: float) -> T:
    return choices[min(int(value * len(choices)), len(choices) - 1)]


def _choices(name: str, given: list[Any], robot: str) -> list[Any]:
    """Check a list of crank pins or motors."""
    if name == "pins":
        if robot not in ROBOTS:
            raise ValueError(f"variables.pins needs a built-in robot, not {shown(robot)}")
        allowed = all(type(count) is int and 1 <= count <= 12 for count in given)
    else:
        allowed = all(isinstance(motor, str) and motor in MOTORS for motor in given)
    if not given or not allowed:
        what = "whole, from 1 to 12" if name == "pins" else f"of {[*MOTORS]}"
        raise ValueError(f"variables.{name} is {shown(given)}, must be a list of some {what}")
    return given


def _length_variables(robot: Robot, shares: float | dict[str, float]) -> list[Variable]:
    """Lengths within a share of those that a robot has."""
    known = lengths(robot)
    if not isinstance(shares, dict):
        shares = {name: shares for name, length in known.items() if abs(length) > 1e-9}
    check_keys("variables.lengths", {**shares}, dict.fromkeys(known, Rule((float,), 1e-4, 0.9)))
    variables = []
    for name, share in shares.items():
        ends = sorted(known[name] * (1.0 + way * share) for way in (-1.0, 1.0))
        if ends[0] == ends[1]:
            raise ValueError(f"variables.lengths.{name} would be a share of 0 m, must be of more")
        variables.append(Variable(name, ends[0], ends[1], known[name]))
    return variables


def _profile_variables(numbers: Array, harmonics: int) -> list[Variable]:
    """A profile's numbers, the first two as logarithms."""
    speed, gain = np.log(numbers[:2]).tolist()
    bias, feedback = numbers[2:4].tolist()
    least, most = np.log(GAIN_RANGE).tolist()
    around = math.log(SPEED_RANGE)
    variables = [
        Variable("log_n0", speed - around, speed + around, speed),
        Variable("log_kp", least, most, min(max(gain, least), most)),
        Variable("tau0", bias - BIAS_RANGE, bias + BIAS_RANGE, bias),
        Variable("g", FEEDBACKS[0], FEEDBACKS[1], min(max(feedback, FEEDBACKS[0]), FEEDBACKS[1])),
    ]
    for letter, shape in zip("ab", np.split(numbers[4:], 2), strict=True):
        for k in range(harmonics):
            middle = float(shape[k]) if k < len(shape) else 0.0
            reach = SHAPE_RANGE / math.sqrt(k + 1)
            variables.append(Variable(f"{letter}{k + 1}", middle - reach, middle + reach, middle))
    return variables
