"""What a policy is: anything with Stable-Baselines3's ``predict``."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Policy(Protocol):
    """What is scored."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Actions for a batch of observations, and the state to pass back."""
        ...


def as_batch(observation: Any) -> Array:
    """Observations (n, d), also of a single one (d,)."""
    return np.atleast_2d(np.asarray(observation, dtype=float))


def as_action(normalised: Array, observation: Any) -> NDArray[np.float32]:
    """Torques (n,) over the torque limit, clipped, as actions (n, 1), or (1,) for a single one."""
    action = np.clip(normalised, -1.0, 1.0).astype(np.float32)[:, None]
    return action if np.ndim(observation) > 1 else action[0]
