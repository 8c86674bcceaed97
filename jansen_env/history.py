"""Histories of observations: what a policy sees that is to know more than the present one shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import positive_integer

MOST = 1000  # observations, steps from one to the next, and steps that are remembered
MOST_NUMBERS = 20_000  # that are remembered of a robot; the package's policies have 385 at most


@dataclass(frozen=True)
class History:
    """The last observations side by side, the present one first.

    An episode's first observation stands for those before it.

    Args:
        length: how many, the present one too. every: steps from one to the next.

    Raises:
        ValueError: one of them is no whole number from 1 to :data:`MOST`, or more than so many
            steps would be remembered.
    """

    length: int = 1
    every: int = 1

    def __post_init__(self) -> None:
        positive_integer("history.length", self.length, MOST)
        positive_integer("history.every", self.every, MOST)
        if self.steps > MOST:
            raise ValueError(
                f"history.length is {self.length} and history.every {self.every}, which remembers "
                f"{self.steps} steps, must remember at most {MOST}"
            )

    @property
    def steps(self) -> int:
        """How many observations must be kept, the present one too."""
        return (self.length - 1) * self.every + 1

    def check_size(self, size: int) -> None:
        """Check that observations of ``size`` numbers are not too much to remember.

        Raises:
            ValueError: they have more than :data:`MOST_NUMBERS` numbers together.
        """
        if self.length > 1 and (count := self.steps * size) > MOST_NUMBERS:
            raise ValueError(
                f"history.length is {self.length} and history.every {self.every}, which remembers "
                f"{count} numbers of observations of {size}, must remember at most {MOST_NUMBERS}"
            )

    def extend(
        self, memory: NDArray[Any] | None, observations: NDArray[Any], starts: NDArray[np.bool_]
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """What is seen in a step, and what is to be remembered for the next one.

        Args:
            memory: (n, steps, d) of the step before; None for none.
            observations: (n, d) the present ones. starts: (n,) whether an episode starts.

        Returns:
            (n, length d) and (n, steps, d).

        Raises:
            ValueError: the memory is of other observations.
        """
        present = observations[:, None]
        if memory is None:
            memory = np.repeat(present, self.steps, axis=1)
        elif memory.shape != (found := (len(present), self.steps, present.shape[2])):
            raise ValueError(f"memory has shape {memory.shape}, must have {found}")
        else:
            memory = np.concatenate([present, memory[:, :-1]], axis=1)
            memory[starts] = present[starts]
        return memory[:, :: self.every].reshape(len(present), -1), memory
