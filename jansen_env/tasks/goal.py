"""The goal task: walk to a place and stand there. Plain NumPy over n robots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, TypedDict

import numpy as np

from jansen_env.checks import non_negative, positive
from jansen_env.tasks.task import Task
from jansen_env.uniform import uniform
from jansen_env.world.argument_checks import Filled, Ints, option, single
from jansen_env.world.entries import EXACT, Observed

FARTHEST = 3.0  # m, a goal on either side
NEAR, HOLD = 0.02, 1.0  # m from the goal, and s there, that are a success
HALF_DISTANCE = 0.3  # m, at which closeness has fallen to a half
HALF_POWER = 0.5  # m/s: motor power / weight at which energy has fallen to a half
FALLEN_PITCH = 1.2  # rad
UP_TO = 1e-9  # of HOLD: periods do not add up to it exactly


class GoalReward(TypedDict, total=False):
    """Exponent of the energy's factor, and the worth of standing at the goal."""

    energy_weight: Annotated[float, single(1.0, non_negative)]
    arrival_weight: Annotated[float, single(1.0, positive)]


class GoalTask(Task):
    """Walk to a goal and stand there; see :class:`jansen_env.envs.goal_env.JansenGoalEnv`."""

    RECORDS = {"rewards": GoalReward}
    DEFAULTS = {"robot": "built"}
    OPTIONS = ("goal",)
    ROW = np.dtype([
        ("info", [("goal", "f8"), ("distance", "f8"), ("held", "f8"), ("fallen", "?"),
                  ("is_success", "?")]),
        ("reward", [("closeness", "f8"), ("arrival", "f8"), ("energy", "f8")]),
    ])  # fmt: skip
    STATE = ("info.goal", "info.held", "info.fallen", "info.is_success")

    def take(self, records: dict[str, Any]) -> None:
        """Keep the weights."""
        self._weights: Filled = records["rewards"]

    @property
    def own_entries(self) -> Sequence[Observed]:
        """Distance to the goal along x."""
        return [Observed("goal_distance", "m", -np.inf, np.inf, EXACT)]

    def draw(self, row: int, rng: np.random.Generator, options: dict[str, Any]) -> float:
        """Draw a goal, m."""
        return option(options, "goal", uniform(rng, -FARTHEST, FARTHEST), -FARTHEST, FARTHEST)

    def begin(self, rows: Ints, drawn: Sequence[Any]) -> None:
        """Start with goals, m."""
        self.rows["info"]["goal"][rows] = drawn

    def observe(self, rows: Ints) -> None:
        """Show how far ahead the goal is."""
        info = self.rows["info"]
        info["distance"][rows] = info["goal"][rows] - self.world.rows["info"]["x_position"][rows]
        self.observation[rows, self.columns["goal_distance"]] = info["distance"][rows]

    def score(self, rows: Ints) -> None:
        """Reward being near at little power; a fall ends the episode."""
        self.observe(rows)
        world, info, term = self.world.rows[rows], self.rows["info"], self.rows["reward"]
        distance = np.abs(info["distance"][rows])
        near = distance <= NEAR
        info["held"][rows] = np.where(near, info["held"][rows] + self.control_dt, 0.0)
        info["is_success"][rows] = info["held"][rows] >= HOLD - UP_TO
        tipped = np.abs(world["info"]["pitch"]) > FALLEN_PITCH
        info["fallen"][rows] |= tipped | self.world.non_toe_contact[rows]
        power = np.abs(world["energy"]["motor_work"]) / self.control_dt / world["weight"]
        term["closeness"][rows] = 1.0 / (1.0 + distance / HALF_DISTANCE)
        term["arrival"][rows] = self._weights.arrival_weight * near
        term["energy"][rows] = (1.0 + power / HALF_POWER) ** -self._weights.energy_weight
        paid = (term["closeness"] + term["arrival"])[rows] * term["energy"][rows]
        self.reward[rows], self.terminated[rows] = paid, info["fallen"][rows]
