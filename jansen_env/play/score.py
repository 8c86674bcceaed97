"""The score of a walk as it goes: what ``jansen_env.scoring.benchmarks`` has of a whole episode.

Distance, slip per metre and mechanical cost of transport are those of ``python -m
agents.evaluate``; ``tests/play/test_play_session.py`` holds one to the other.
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
    """Adds up the steps of one walk.

    Args:
        dt: s of a step.
    """

    def __init__(self, dt: float) -> None:
        self._dt, self._steps = dt, 0
        self._x = self._free = self._commanded = 0.0  # m: place, and ways to it
        self._slip = self._lift = self._speed = 0.0

    def add(self, info: Mapping[str, Any], weight: float, command: float | None) -> None:
        """Add a step by its ``info``.

        ``weight``: of the robot in it, N; ``command``: in it, m/s, or None where there is none.
        """
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
        far = distance > MIN_DISTANCE
        return Score(
            self._steps * self._dt,
            distance,
            self._slip / distance if far else None,
            self._lift / distance if far else None,
            self._speed,
        )
