"""The next episode's terrain level by how far the last one went."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jansen_env.checks import finite, non_negative, positive, whole_number, within
from jansen_env.terrain.generators import HIGHEST


@dataclass(frozen=True)
class Curriculum:
    """Up after a long walk, down after a short one, and past the top to any level.

    Rudin, Hoeller, Reist and Hutter, "Learning to Walk in Minutes Using Massively Parallel Deep
    Reinforcement Learning", CoRL 2021 (2022), section 2.2; ``_update_terrain_curriculum`` of
    legged_gym. Levels drawn at the top keep the easy ones from being forgotten.

    Args:
        up: goes up beyond this share of the commanded distance. down: goes down below this one.
        highest: level; beyond it, any from 0 to it.
        horizon: s, that an episode is planned to last: the commanded distance is the mean size of
            its commands times this, so that falling early is no success.

    Raises:
        ValueError: an argument out of range, or ``down`` above ``up``.
    """

    up: float = 0.5
    down: float = 0.25
    highest: int = HIGHEST
    horizon: float = 10.0

    def __post_init__(self) -> None:
        set_value = object.__setattr__
        set_value(self, "up", within("up", self.up, 0.0, 1.0))
        set_value(self, "down", within("down", self.down, 0.0, 1.0))
        set_value(self, "highest", whole_number("highest", self.highest, HIGHEST))
        set_value(self, "horizon", positive("horizon", self.horizon))
        if self.down > self.up:
            raise ValueError(f"down is {self.down}, must be at most up, {self.up}")

    def next_level(
        self, level: int, walked: float, commanded: float, rng: np.random.Generator
    ) -> int:
        """The level of the next episode. Raises ValueError: an argument out of range.

        Args:
            level: of this one. walked: m, towards the command. commanded: m, see ``horizon``; after
                0 m the level stays. rng: draws the level beyond the highest.
        """
        level = whole_number("level", level, HIGHEST)
        walked, commanded = finite("walked", walked), non_negative("commanded", commanded)
        if commanded > 0.0:
            level += (walked > self.up * commanded) - (walked < self.down * commanded)
        if level > self.highest:
            return int(rng.integers(self.highest + 1))
        return max(level, 0)
