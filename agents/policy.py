"""What a policy is, and two simple ones: the paper's PID (13), and torque from the observation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from jansen_env.control import PID

Array = NDArray[np.float64]

Reference: TypeAlias = Callable[[Array, Any, NDArray[np.bool_]], tuple[Array, Array, Any]]
"""Where the crank should be, for n environments side by side: from observations (n, d), the memory
returned at the step before (None at first) and whether an episode starts (n,), to the error of the
crank's angle (n,), rad, of its speed (n,), rad/s, and the memory to pass next."""

PAPER_PID = PID()


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


class PIDState(NamedTuple):
    """Memory for n environments: the reference's, and the error's integral (n,), rad s."""

    reference: Any
    integral: Array


class PIDPolicy:
    """Torque from (13); the integral waits while the torque is at its limit.

    Args:
        reference: gives the errors. torque_limit: of the environment, N m. control_dt: s.
        pid: gains; default: the paper's.
    """

    def __init__(
        self, reference: Reference, torque_limit: float, control_dt: float, pid: PID = PAPER_PID
    ) -> None:
        self.reference, self.pid = reference, pid
        self.torque_limit, self.control_dt = torque_limit, control_dt

    def predict(
        self,
        observation: Any,
        state: PIDState | None = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], PIDState]:
        """Actions (n, 1) or (1,) for observations (n, d) or (d,), and the state to pass back."""
        batch = as_batch(observation)
        n = len(batch)
        if state is None:
            state, episode_start = PIDState(None, np.zeros(n)), True
        starts = np.broadcast_to(np.asarray(episode_start, dtype=bool), (n,))
        error, error_rate, memory = self.reference(batch, state.reference, starts)
        torque, integral = self.pid.torque(
            error, error_rate, np.where(starts, 0.0, state.integral),
            self.control_dt, self.torque_limit,
        )  # fmt: skip
        return as_action(torque / self.torque_limit, observation), PIDState(memory, integral)


class TorquePolicy:
    """Torque as a function of the observation alone.

    Args:
        torque: observations (n, d) to torques (n,), N m. torque_limit: of the environment, N m.
    """

    def __init__(self, torque: Callable[[Array], Array], torque_limit: float) -> None:
        self.torque, self.torque_limit = torque, torque_limit

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (n, 1) or (1,) for observations (n, d) or (d,); the state is not used."""
        torque = self.torque(as_batch(observation))
        return as_action(torque / self.torque_limit, observation), state


def as_batch(observation: Any) -> Array:
    """Observations (n, d), also of a single one (d,)."""
    return np.atleast_2d(np.asarray(observation, dtype=float))


def as_action(normalised: Array, observation: Any) -> NDArray[np.float32]:
    """Torques (n,) over the torque limit, clipped, as actions (n, 1), or (1,) for a single one."""
    action = np.clip(normalised, -1.0, 1.0).astype(np.float32)[:, None]
    return action if np.ndim(observation) > 1 else action[0]
