"""What a policy is, and the simplest one: constant torque."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Policy(Protocol):
    """What is scored: anything with Stable-Baselines3's ``predict``."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Actions for a batch of observations, and the state to pass back."""
        ...


class ConstantTorque:
    """The paper's conclusion as a policy: one constant torque for each command.

    Args:
        torque_for: commands (n,) to torques (n,), N m.
        command_place: where in the observation the command is.
        torque_limit: of the environment, N m.
    """

    def __init__(
        self, torque_for: Callable[[Array], Array], command_place: int, torque_limit: float
    ) -> None:
        self.torque_for, self.command_place = torque_for, command_place
        self.torque_limit = torque_limit

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (n, 1) or (1,) for observations (n, d) or (d,); the state is not used."""
        torque = self.torque_for(rows(observation)[:, self.command_place])
        return as_action(torque / self.torque_limit, observation), state


def rows(observation: Any) -> Array:
    """Observations (n, d), also of a single one (d,)."""
    return np.atleast_2d(np.asarray(observation, dtype=float))


def as_action(share: Array, observation: Any) -> NDArray[np.float32]:
    """Shares (n,) of the torque limit, clipped, as actions (n, 1), or (1,) for a single one."""
    action = np.clip(share, -1.0, 1.0).astype(np.float32)[:, None]
    return action if np.ndim(observation) > 1 else action[0]
