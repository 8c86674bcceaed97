"""Variables of a search: link lengths and the parameters of a crank-speed profile."""

import math
from typing import Any, NamedTuple

import numpy as np

from jansen_env.arrays import Array
from jansen_env.checks import shown
from jansen_env.files.plain_yaml import Rule, check_keys
from jansen_env.robot import Robot
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.tasks.walking.profile import DATA, load_profile
from jansen_env.tasks.walking.tuned import design_of
from jansen_env.world.settings import load_robot

KINDS: dict[str, Rule] = {
    "lengths": Rule((float, dict), 1e-4, 0.9),
    "harmonics": Rule((int,), 0, 8),
}
TUNED = "built", "paper"
"""Designs whose tuned profiles a search may start from; the more similar kind of robot is first."""
# Ranges of the profile parameters.
SPEED_RANGE = 2.5  # factor on the initial crank speed n0
GAIN_RANGE = (1.0, 30.0)  # gain kp, in N m s/rad
BIAS_RANGE = 4.0  # distance from the initial bias torque tau0, in N m
FEEDBACKS = (0.0, 4.0)  # feedback g, in 1/m
SHAPE_RANGE = 0.8  # distance of the first harmonics from their initial values


class Variable(NamedTuple):
    """A number that a search varies.

    Attributes:
        name: Name of the variable.
        low: Lowest value.
        high: Highest value.
        start: Value at which the search begins.
    """

    name: str
    low: float
    high: float
    start: float


class Candidate(NamedTuple):
    """A robot and the crank-speed profile with which it walks.

    Attributes:
        robot: The robot.
        numbers: Parameters of the profile with K harmonics, shape (4 + 2 K,).
    """

    robot: Robot
    numbers: Array


class Space:
    """Search space: variables, each scaled to [0, 1], and the candidates that they stand for.

    Args:
        robot: Name or file of the design that the search starts from.
        speed: Commanded speed of the profile, in m/s.
        wanted: What the search varies. ``"lengths"`` is the fraction by which every link length may
            change, or such fractions by name. ``"harmonics"`` is the number K of harmonics of the
            profile; without this entry, the search does not vary the profile.
        profile: File of a profile that an earlier search wrote, to start from. None selects the
            tuned profile of the robot's design.

    Attributes:
        base: Robot that the search starts from.
        variables: Variables in the order of the search.
        start: Scaled variables at which the search begins, shape (d,).

    Raises:
        ValueError: If a name is unknown or a value is not allowed.
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
            raise ValueError(f"variables must have some of {[*KINDS]}, got {shown(wanted)}")
        self._low, self._high, start = np.array([each[1:] for each in self.variables]).T
        self.start: Array = (start - self._low) / (self._high - self._low)

    def candidate(self, unit: Array) -> Candidate:
        """Return the candidate that scaled variables stand for.

        Args:
            unit: Variables, shape (d,). Values beyond [0, 1] are clipped.

        Raises:
            ValueError: If the link lengths form no triangle.
        """
        numbers = self._low + np.clip(unit, 0.0, 1.0) * (self._high - self._low)
        values = dict(zip((v.name for v in self.variables), numbers.tolist(), strict=True))
        robot = with_lengths(self.base, {v.name: values[v.name] for v in self._lengths})
        numbers = np.array([values.get(v.name, v.start) for v in self._profile])
        numbers[:2] = np.exp(numbers[:2])
        return Candidate(robot, numbers)


def _length_variables(robot: Robot, changes: float | dict[str, float]) -> list[Variable]:
    """Return the link lengths as variables, each within a fraction of the robot's own length."""
    known = lengths(robot)
    if not isinstance(changes, dict):
        changes = {name: changes for name, length in known.items() if abs(length) > 1e-9}
    check_keys("variables.lengths", {**changes}, dict.fromkeys(known, Rule((float,), 1e-4, 0.9)))
    variables = []
    for name, change in changes.items():
        ends = sorted(known[name] * (1.0 + way * change) for way in (-1.0, 1.0))
        if ends[0] == ends[1]:
            raise ValueError(
                f"variables.lengths.{name} must be a fraction of a length above 0 m, got 0 m"
            )
        variables.append(Variable(name, ends[0], ends[1], known[name]))
    return variables


def _profile_variables(numbers: Array, harmonics: int) -> list[Variable]:
    """Return the profile parameters as variables, the first two of them as logarithms."""
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
