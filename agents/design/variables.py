"""Variables of a search: lengths, and the numbers of a crank-speed profile."""

import math
from typing import Any, NamedTuple

import numpy as np

from jansen_env.arrays import Array
from jansen_env.checks import shown
from jansen_env.plain_yaml import Rule, check_keys
from jansen_env.robot import Robot
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.tasks.walking.profile import DATA, load_profile
from jansen_env.tasks.walking.tuned import design_of
from jansen_env.world.settings import load_robot

KINDS: dict[str, Rule] = {
    "lengths": Rule((float, dict), 1e-4, 0.9), "harmonics": Rule((int,), 0, 8),
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
        wanted: "lengths": share by which each may change, or shares by name; "harmonics": K of the
            profile, without which it is no variable.

    Raises ValueError: an unknown name, or a value that is not allowed.
    """

    def __init__(
        self, robot: str, speed: float, wanted: dict[str, Any], profile: str | None = None
    ) -> None:
        check_keys("variables", wanted, KINDS)
        self.base = load_robot("robot", robot)
        design = design_of(self.base, TUNED) or "paper"
        source = (DATA, design) if profile is None else (profile, "found")
        numbers = load_profile(*source).at(np.array([speed]))[0]
        harmonics = int(wanted.get("harmonics", len(numbers) // 2 - 2))
        self._profile = _profile_variables(numbers, harmonics)
        self._lengths = _length_variables(self.base, wanted.get("lengths", {}))
        self.variables = [*self._lengths, *(self._profile if "harmonics" in wanted else [])]
        if not self.variables:
            raise ValueError(f"variables is {shown(wanted)}, must have some of {[*KINDS]}")
        self._low, self._high, start = np.array([each[1:] for each in self.variables]).T
        self.start: Array = (start - self._low) / (self._high - self._low)

    def candidate(self, unit: Array) -> Candidate:
        """Return what numbers (d,) from 0 to 1 stand for. Raises ValueError: lengths that form no
        triangle."""
        numbers = self._low + np.clip(unit, 0.0, 1.0) * (self._high - self._low)
        values = dict(zip((v.name for v in self.variables), numbers.tolist(), strict=True))
        robot = with_lengths(self.base, {v.name: values[v.name] for v in self._lengths})
        numbers = np.array([values.get(v.name, v.start) for v in self._profile])
        numbers[:2] = np.exp(numbers[:2])
        return Candidate(robot, numbers)


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
