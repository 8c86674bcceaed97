"""The crank task: follow a turning reference; numbers: :mod:`jansen_env.engine.crank_tracking`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, TypedDict

import numpy as np

from jansen_env.checks import non_negative
from jansen_env.engine import crank_tracking
from jansen_env.tasks.task import CompiledTask
from jansen_env.world.argument_checks import PerRobot, Range, range_per_robot, single
from jansen_env.world.entries import Observed
from jansen_env.world.held import START_ANGLE, HeldRobots

FASTEST_COMMAND = 10.0  # rad/s
LOST = crank_tracking.LOST


class Tracking(TypedDict, total=False):
    """Crank speeds that are asked for, rad/s (by default the paper's), and the terms' weights."""

    speed_command: Annotated[
        PerRobot[Range], range_per_robot(1.0, -FASTEST_COMMAND, FASTEST_COMMAND)
    ]
    tracking_weight: Annotated[float, single(1.0, non_negative)]
    torque_weight: Annotated[float, single(1.0, non_negative)]


class CrankTask(CompiledTask):
    """Turn the crank along a reference; see :class:`jansen_env.envs.crank_env.JansenCrankEnv`."""

    WORLD = HeldRobots
    RECORDS = {"tracking": Tracking}
    ROW = crank_tracking.ROW
    ENGINE: ClassVar[Any] = crank_tracking
    FASTEST = FASTEST_COMMAND

    def take(self, records: dict[str, Any]) -> None:
        """Keep command and weights."""
        chosen = records["tracking"]
        self.speed_command = chosen.speed_command
        self._weights = np.zeros(1, crank_tracking.REWARD)
        self._weights[0] = chosen.tracking_weight, chosen.torque_weight

    @property
    def own_entries(self) -> Sequence[Observed]:
        """The tracking error and the command."""
        return [
            Observed("tracking_error", "rad", -np.inf, np.inf),
            Observed("speed_command", "rad/s", -FASTEST_COMMAND, FASTEST_COMMAND),
        ]

    def reference(self, row: int) -> float:
        """r(t) = w t + pi, rad: where a robot's crank should be now."""
        passed = self.world.rows[row]["steps"] * self.control_dt
        return float(self.command(row) * passed + START_ANGLE)

    def step_arguments(self) -> tuple[Any, ...]:
        world = self.world
        return (
            world.plant.states, world.plant.rows, world.torque, self.control_dt, self._weights,
            world.rows, self.rows, self.reward, self.terminated, self.observation,
        )  # fmt: skip

    def describe_arguments(self) -> tuple[Any, ...]:
        world = self.world
        return world.plant.states, self.control_dt, world.rows, self.rows, self.observation

    def scene(self, row: int) -> dict[str, Any]:
        """Return the arguments of the renderer."""
        speed_range = 2.0 * max(1e-3, *map(abs, self.speed_command[row].tolist()))
        return {**super().scene(row), "speed_range": speed_range}
