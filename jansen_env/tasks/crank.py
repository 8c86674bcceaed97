"""The crank task: follow a turning reference with the crank of a robot that is held.

The numbers of a step are worked out in :mod:`jansen_env.engine.crank_tracking`. What they mean is
documented in :class:`jansen_env.envs.crank_env.JansenCrankEnv`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jansen_env.checks import non_negative, within
from jansen_env.engine import crank_tracking
from jansen_env.engine.jit import Kernel
from jansen_env.tasks.task import Task
from jansen_env.world.actuated import Bools, Ints
from jansen_env.world.argument_checks import option
from jansen_env.world.broadcasting import broadcast_ranges, number_range
from jansen_env.world.entries import Observed
from jansen_env.world.held import START_ANGLE, HeldRobots
from jansen_env.world.settings import per_robot

FASTEST_COMMAND = 10.0  # rad/s
LOST = crank_tracking.LOST


@dataclass(frozen=True)
class Tracking:
    """Crank speeds that are asked for, rad/s, and weights of the reward's terms."""

    speed_command: float | tuple[float, float] | Any = per_robot(1.0)  # the paper's
    tracking_weight: float = 1.0
    torque_weight: float = 1.0


class CrankTask(Task):
    """Turn the crank of a Jansen linkage along a reference; the chassis is held in the air.

    Attributes:
        speed_command: (n, 2) rad/s, range of the next commands.
    """

    WORLD = HeldRobots
    RECORDS = {"tracking": Tracking}
    ROW = crank_tracking.ROW
    OPTIONS = ("speed_command",)
    SETTABLE = ("speed_command",)

    def take(self, records: dict[str, Any]) -> None:
        """Check and keep command and weights."""
        chosen, fastest = records["tracking"], FASTEST_COMMAND
        self.speed_command = broadcast_ranges(
            self.num_envs, "speed_command", chosen.speed_command, -fastest, fastest
        )
        self._weights = np.zeros(1, crank_tracking.REWARD)
        self._weights[0] = (
            non_negative("tracking_weight", chosen.tracking_weight),
            non_negative("torque_weight", chosen.torque_weight),
        )

    @property
    def own_entries(self) -> Sequence[Observed]:
        """The tracking error and the command."""
        return [
            Observed("tracking_error", "rad", -np.inf, np.inf),
            Observed("speed_command", "rad/s", -FASTEST_COMMAND, FASTEST_COMMAND),
        ]

    def draw(self, row: int, rng: np.random.Generator, options: dict[str, Any]) -> float:
        """Draw a robot's command, rad/s."""
        command = rng.uniform(*self.speed_command[row])
        return option(options, "speed_command", command, -FASTEST_COMMAND, FASTEST_COMMAND)

    def begin(self, rows: Ints, drawn: Sequence[Any]) -> None:
        """Start with commands, rad/s."""
        self.rows["info"]["speed_command"][rows] = drawn

    def score(self, rows: Ints) -> None:
        """Do nothing: :meth:`finish_step` scores."""

    def finish_step(self, active: Bools) -> None:
        """Score the step of the ``active`` robots (n,), and observe them, in one kernel."""
        crank_tracking.finish_step(active, *self._step_arguments())

    def describe(self, rows: Ints) -> None:
        """Fill observations and information of some robots as they are now."""
        crank_tracking.describe(rows, *self._describe_arguments())

    def reference(self, row: int) -> float:
        """r(t) = w t + pi, rad: where a robot's crank should be now."""
        passed = self.world.rows[row]["steps"] * self.control_dt
        return float(self.rows[row]["info"]["speed_command"] * passed + START_ANGLE)

    def _step_arguments(self) -> tuple[Any, ...]:
        world = self.world
        return (
            world.plant.rows, world.plant.sums, self.control_dt, self._weights, world.rows,
            self.rows, self.reward, self.terminated, self.observation,
        )  # fmt: skip

    def _describe_arguments(self) -> tuple[Any, ...]:
        world = self.world
        return world.plant.rows, self.control_dt, world.rows, self.rows, self.observation

    def kernels(self) -> list[Kernel]:
        """Return what is compiled of it."""
        one, every = np.arange(1), np.ones(self.num_envs, bool)
        return [
            Kernel("observation", crank_tracking.describe, (one, *self._describe_arguments())),
            Kernel("reward", crank_tracking.finish_step, (every, *self._step_arguments())),
        ]

    def checked(self, row: int, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return a change of ``speed_command``, rad/s: a number or a range."""
        limits = -FASTEST_COMMAND, FASTEST_COMMAND
        return {name: number_range(name, value, *limits) for name, value in changes.items()}

    def apply(self, row: int, checked: dict[str, Any]) -> None:
        """Draw the next commands from another range."""
        for limits in checked.values():
            self.speed_command[row] = limits

    def get_attr(self, name: str) -> list[Any] | None:
        """Return what each robot has of its own: the world's, ``speed_command``."""
        if name == "speed_command":
            return [(low, high) for low, high in self.speed_command.tolist()]
        return super().get_attr(name)

    def get_state(self, row: int) -> dict[str, Any]:
        """Return all that a robot's future depends on but its random numbers."""
        command = float(self.rows[row]["info"]["speed_command"])
        return {**self.world.get_state(row), "command": command}

    def checked_state(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return the command of a state. Raises ValueError: it is out of range."""
        limits = -FASTEST_COMMAND, FASTEST_COMMAND
        return {"command": within("state['command']", state["command"], *limits)}

    def resume(self, row: int, state: dict[str, Any]) -> None:
        """Go on with a command, rad/s."""
        self.begin(np.array([row]), [state["command"]])

    def scene(self, row: int) -> dict[str, Any]:
        """Return the arguments of the renderer."""
        speed_range = 2.0 * max(1e-3, *map(abs, self.speed_command[row].tolist()))
        return {**super().scene(row), "speed_range": speed_range}

    def command(self, row: int) -> float:
        """Return a robot's command, rad/s."""
        return float(self.rows[row]["info"]["speed_command"])
