"""Base of tasks with a commanded speed, whose steps a compiled module works out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from jansen_env.checks import within
from jansen_env.tasks.task import Task
from jansen_env.world.argument_checks import Array, Bools, Ints, number_range, option


class CommandedTask(Task):
    """A task with a commanded speed, ``rows["info"]["speed_command"]``.

    Attributes:
        FASTEST: the largest command. speed_command: (n, 2) range of the next ones.
    """

    FASTEST: ClassVar[float]
    OPTIONS = ("speed_command",)
    SETTABLE: ClassVar[tuple[str, ...]] = ("speed_command",)
    speed_command: Array

    def score(self, rows: Ints) -> None:
        """Do nothing: :meth:`finish_step` scores."""

    def finish_step(self, active: Bools) -> None:
        """Score the step of the ``active`` robots (n,), and observe them, in one kernel."""
        self.ENGINE.finish_step(active, *self.step_arguments())

    def draw(self, row: int, rng: np.random.Generator, options: dict[str, Any]) -> float:
        """Draw a robot's command."""
        command = rng.uniform(*self.speed_command[row])
        return option(options, "speed_command", command, -self.FASTEST, self.FASTEST)

    def begin(self, rows: Ints, drawn: Sequence[Any]) -> None:
        """Start with commands."""
        self.rows["info"]["speed_command"][rows] = drawn

    def checked(self, row: int, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return changes of ``speed_command``, a number or a range, and ``command``."""
        limits = -self.FASTEST, self.FASTEST
        checks: dict[str, Callable[..., Any]] = {"speed_command": number_range, "command": within}
        return {name: checks[name](name, value, *limits) for name, value in changes.items()}

    def apply(self, row: int, checked: dict[str, Any]) -> None:
        """Draw commands from another range from now on."""
        if "speed_command" in checked:
            self.speed_command[row] = checked["speed_command"]

    def get_attr(self, name: str) -> list[Any] | None:
        """Return what each robot has of its own, see :attr:`SETTABLE` and the world's."""
        if name not in self.SETTABLE:
            return super().get_attr(name)
        if name == "command":
            return list(self.rows["info"]["speed_command"].tolist())
        return [(low, high) for low, high in self.speed_command.tolist()]

    def get_state(self, row: int) -> dict[str, Any]:
        """Return all that a robot's future depends on but its random numbers."""
        return {**super().get_state(row), "command": self.command(row)}

    def checked_state(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return the task's entries of a state. Raises ValueError: one is out of range."""
        command = within("state['command']", state["command"], -self.FASTEST, self.FASTEST)
        return {**super().checked_state(state), "command": command}

    def resume(self, row: int, state: dict[str, Any]) -> None:
        """Go on with a command and the other entries of a state."""
        self.begin(np.array([row]), [state["command"]])
        super().resume(row, state)

    def command(self, row: int) -> float:
        """Return a robot's command."""
        return float(self.rows["info"]["speed_command"][row])
