"""The crank task: follow a turning reference; numbers: :mod:`jansen_env.engine.crank_tracking`."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import ClassVar

import numpy as np

from jansen_env.checks import non_negative
from jansen_env.engine import crank_tracking
from jansen_env.tasks.task import CompiledTask
from jansen_env.world.argument_checks import Arguments, PerRobot, Range, Values
from jansen_env.world.observations import EXACT, Observed
from jansen_env.world.settings import HeldSettings, RobotArguments, range_each, shared
from jansen_env.world.world import START_ANGLE

FASTEST_COMMAND = 10.0  # rad/s
LOST = crank_tracking.LOST


class CrankArguments(RobotArguments, total=False):
    """Arguments of ``JansenCrank-v0``; :class:`CrankSettings` has their defaults and checks."""

    time_step: float
    speed_command: PerRobot[Range]
    tracking_weight: float
    torque_weight: float


@dataclass(frozen=True, kw_only=True)
class CrankSettings(HeldSettings):
    """Arguments of ``JansenCrank-v0``; commands in rad/s, by default the paper's."""

    speed_command: PerRobot[Range] = range_each(1.0, -FASTEST_COMMAND, FASTEST_COMMAND)
    tracking_weight: float = shared(1.0, non_negative)
    torque_weight: float = shared(1.0, non_negative)


class CrankTask(CompiledTask):
    """Turn the crank along a reference.

    See :class:`jansen_env.tasks.crank.crank_env.JansenCrankEnv`. One kernel does all.
    """

    SETTINGS = CrankSettings
    OBSERVED = (
        Observed("tracking_error", "rad", -np.inf, np.inf, EXACT),
        Observed("speed_command", "rad/s", -FASTEST_COMMAND, FASTEST_COMMAND, EXACT),
    )
    COMPILED = ("tracking_error", "speed_command")
    ENGINE: ClassVar[ModuleType] = crank_tracking
    ROW = crank_tracking.ROW
    FASTEST = FASTEST_COMMAND

    def __init__(self, settings: CrankSettings, threads: int | None = None) -> None:
        self._weights = np.zeros(1, crank_tracking.REWARD)
        self._weights[0] = settings.tracking_weight, settings.torque_weight
        super().__init__(settings, threads)

    def reference(self, i: int) -> float:
        """r(t) = w t + pi, rad: where a robot's crank should be now."""
        passed = float(self.world.elapsed[i]) * self.control_dt
        return float(self.info["speed_command"][i] * passed + START_ANGLE)

    def _kernel_arguments(self) -> tuple[Arguments, Arguments]:
        """Return those of ``finish_step`` and ``describe`` of the engine's ``crank_tracking``."""
        world, plant = self.world, self.world.plant
        step = (
            plant.states, plant.rows, world.elapsed, self.control_dt, self._weights, world.data,
            self.data, self.rewards, self.ended, self.observation,
        )  # fmt: skip
        describe = (
            plant.states, world.elapsed, self.control_dt, world.data, self.data, self.observation
        )  # fmt: skip
        return step, describe

    def scene(self, i: int) -> Values:
        """Return the arguments of the renderer."""
        speed_range = 2.0 * max(1e-3, *map(abs, self.speed_command[i].tolist()))
        return {**super().scene(i), "speed_range": speed_range}
