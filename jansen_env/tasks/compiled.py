"""Base of tasks that kernels reward and observe."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from jansen_env.arrays import Array, Bools
from jansen_env.tasks.task import CommandedTask


class CompiledTask(CommandedTask):
    """A task that the engine rewards, ends and observes within a control step.

    A derived class may extend it in NumPy: it overrides :meth:`reward`, :meth:`terminated` or
    :meth:`observe`, and declares the observations that :meth:`observe` returns. The kernel has
    filled :attr:`rewards` and :attr:`ended` before these methods are called.

    Attributes:
        ROW: Record of the task.
        COMPILED: Names of the observations that the kernel fills, in its order.
        is_whole: Whether the kernel does everything, so that no method is called after a step:
            no derived class overrides one.
    """

    ROW: ClassVar[np.dtype[np.void]]

    def __init__(self, settings: Any, threads: int | None = None) -> None:
        methods = ("observe", "reward", "terminated")
        base = CompiledTask
        self.is_whole = all(getattr(type(self), m) is getattr(base, m) for m in methods)
        super().__init__(settings, threads)
        self.world.plant.world["is_whole"] = self.is_whole

    def observe(self) -> Mapping[str, Array]:
        """Return what the kernel does not fill: nothing."""
        return {}

    def reward(self) -> Array:
        """Return the kernel's rewards (n,)."""
        return self.rewards

    def terminated(self) -> Bools:
        """Return whether episodes (n,) are over, as the kernel says."""
        return self.ended
