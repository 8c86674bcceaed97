"""The score of a walk as it goes, by the definitions of :mod:`jansen_env.scoring.benchmarks`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

MIN_DISTANCE = 1e-3  # m, below which a ratio per metre is not formed


@dataclass(frozen=True)
class Score:
    """Score of a walk so far.

    Attributes:
        time: s. distance: m, walked in the directions commanded, and without a command in the
            direction walked. slip_per_metre: m slid by all toes while loaded / distance.
        cost_of_transport: sum of \\|motor work\\| of each step / (weight * distance). Both ratios
            are None where there is no distance. speed: m/s, mean of the last strides, in +x.
    """

    time: float = 0.0
    distance: float = 0.0
    slip_per_metre: float | None = None
    cost_of_transport: float | None = None
    speed: float = 0.0


class Tally:
    """Adds up the steps, of ``dt`` s each, of one walk."""

    def __init__(self, dt: float) -> None:
        self._dt, self._steps = dt, 0
        self._x = self._free = self._commanded = 0.0  # m: place, and ways to it
        self._slip = self._lift = self._speed = 0.0

    def add(self, info: Mapping[str, Any], weight: float, command: float | None) -> None:
        """Add a step by its ``info``, the robot's weight (N) and command (m/s, or None) in it."""
        self._steps += 1
        way, self._x = float(info["x_position"]) - self._x, float(info["x_position"])
        if command:
            self._commanded += way if command > 0.0 else -way
        else:
            self._free += way
        self._speed = float(info["mean_speed"])
        self._slip += float(np.sum(info["slip"]))
        self._lift += abs(float(info["energy"]["motor_work"])) / weight

    def score(self) -> Score:
        """The score so far."""
        distance = max(self._commanded, 0.0) + abs(self._free)
        slip, cost = (
            v / distance if distance > MIN_DISTANCE else None for v in (self._slip, self._lift)
        )
        return Score(self._steps * self._dt, distance, slip, cost, self._speed)
