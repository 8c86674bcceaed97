"""Base class of tasks whose reward, end of episode and observation are computed by kernels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from typing_extensions import override

from jansen_env.arrays import Array, Bools
from jansen_env.tasks.task import CommandedTask


class CompiledTask(CommandedTask):
    """Task whose reward, end of episode and observation the engine computes within a control step.

    A derived class may extend the task in NumPy. It then overrides :meth:`reward`,
    :meth:`terminated` or :meth:`observe`, and declares the observations that :meth:`observe`
    returns. The kernel has filled :attr:`rewards` and :attr:`ended` before these methods are
    called.

    Args:
        settings: Validated arguments of the environment.
        threads: Number of CPU cores to use. If None, it is chosen from the batch size.

    Attributes:
        ROW: Record of the task.
        COMPILED: Names of the observations that the kernel fills, in their order.
        fully_compiled: Whether the kernel computes everything, so that no method is called after a
            step. This is the case if no derived class overrides one of the three methods.
    """

    ROW: ClassVar[np.dtype[np.void]]

    def __init__(self, settings: Any, threads: int | None = None) -> None:
        methods = ("observe", "reward", "terminated")
        base = CompiledTask
        self.fully_compiled = all(getattr(type(self), m) is getattr(base, m) for m in methods)
        super().__init__(settings, threads)
        self.world.plant.engine_settings["fully_compiled"] = self.fully_compiled

    @override
    def observe(self) -> Mapping[str, Array]:
        """Return the observations that the kernel does not fill. By default there are none."""
        return {}

    @override
    def reward(self) -> Array:
        """Return the rewards that the kernel has computed, shape (n,)."""
        return self.rewards

    @override
    def terminated(self) -> Bools:
        """Return whether each episode is over according to the kernel, shape (n,)."""
        return self.ended
