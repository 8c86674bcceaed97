"""The score of a walk as it goes: what ``agents.tasks`` has of a whole episode.

Distance, slip per metre and mechanical cost of transport are those of ``python -m
agents.evaluate``; ``tests/test_play_session.py`` holds one to the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

MIN_DISTANCE = 1e-3  # m, below which a ratio per metre is not formed


@dataclass(frozen=True)
class Score:
    """What a walk has come to.

    Attributes:
        time: s. distance: m, walked in the commanded direction, or without a command in the
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
    """Adds up the steps of one walk.

    Args:
        dt: s of a step.
    """

    def __init__(self, dt: float) -> None:
        self._dt, self._steps = dt, 0
        self._x = self._slip = self._lift = self._speed = 0.0

    def add(self, info: Mapping[str, Any], weight: float) -> None:
        """Add a step by its ``info``; ``weight`` of the robot in it, N."""
        self._steps += 1
        self._x = float(info["x_position"])
        self._speed = float(info["mean_speed"])
        self._slip += float(np.sum(info["slip"]))
        self._lift += abs(float(info["energy"]["motor_work"])) / weight

    def score(self, command: float | None) -> Score:
        """The score so far; ``command``: m/s, or None where there is none."""
        direction = np.sign(command or self._x)
        distance = max(float(direction) * self._x, 0.0)
        far = distance > MIN_DISTANCE
        return Score(
            self._steps * self._dt,
            distance,
            self._slip / distance if far else None,
            self._lift / distance if far else None,
            self._speed,
        )
