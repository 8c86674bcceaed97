"""The policy protocol, and controllers of the crank's torque as policies: the paper's PID (13)."""

from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jansen_env.arrays import Array, Bools
from jansen_env.baselines.pid import PID
from jansen_env.checks import one_of
from jansen_env.robot import Robot
from jansen_env.world.observations import Observed

Memory: TypeAlias = Any
"""A policy's state, passed from step to step."""

Controller: TypeAlias = Callable[[Array, Memory, Bools], tuple[Array, Memory]]
"""For n environments side by side: from observations (n, d), the memory returned at the step before
(None at first) and whether an episode starts (n,), to torques (n,), N m, and the memory to pass
next."""

Reference: TypeAlias = Callable[[Array, Memory, Bools], tuple[Array, Array, Memory]]
"""Reference of the crank: like a controller, but to the error of the crank's angle (n,), rad, of
its speed (n,), rad/s, and the memory."""

PAPER_PID = PID()


class Controlled(Protocol):
    """Attributes that controllers read from an unwrapped environment, of one robot or many."""

    @property
    def observed(self) -> tuple[Observed, ...]: ...
    @property
    def torque_limit(self) -> float: ...
    @property
    def control_dt(self) -> float: ...
    @property
    def robot(self) -> Robot: ...


class Policy(Protocol):
    """Policy that can be scored: has Stable-Baselines3's ``predict``, its defaults included."""

    def predict(
        self,
        observation: Any,
        state: Memory = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Memory]:
        """Actions for a batch of observations, and the state to pass back."""
        ...


class TorquePolicy:
    """A controller as a policy, within the environment's torque limit, N m."""

    def __init__(self, controller: Controller, torque_limit: float) -> None:
        self.controller, self.torque_limit = controller, torque_limit

    def predict(
        self,
        observation: ArrayLike,
        state: Memory = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.float32], Memory]:
        """Actions (n, 1) or (1,) for observations (n, d) or (d,), and the state to pass back."""
        batch = np.atleast_2d(np.asarray(observation, dtype=float))
        starts = np.asarray(True if state is None else episode_start, dtype=bool)
        torque, state = self.controller(batch, state, np.broadcast_to(starts, len(batch)))
        action = np.clip(torque / self.torque_limit, -1.0, 1.0).astype(np.float32)[:, None]
        return (action if np.ndim(observation) > 1 else action[0]), state


def still(env: Controlled) -> TorquePolicy:
    """Return the policy that asks for no torque."""
    return TorquePolicy(lambda seen, *_: (np.zeros(len(seen)), None), env.torque_limit)


def pid_policy(
    reference: Reference, torque_limit: float, control_dt: float, pid: PID = PAPER_PID
) -> TorquePolicy:
    """Torque from (13); the integral waits while the torque is at its limit (N m)."""

    def controller(observations: Array, memory: Memory, starts: Bools) -> tuple[Array, Memory]:
        before, integral = memory or (None, 0.0)  # the reference's memory; rad s
        error, error_rate, after = reference(observations, before, starts)
        integral = np.where(starts, 0.0, integral)
        torque, integral = pid.torque(error, error_rate, integral, control_dt, torque_limit)
        return torque, (after, integral)

    return TorquePolicy(controller, torque_limit)


def columns(env: Controlled, *names: str) -> list[int]:
    """Return where names stand in the observation of an environment, single or batched.

    Raises ValueError: the environment does not show one of them.
    """
    inner: Controlled = getattr(env, "unwrapped", env)
    shown = [entry.name for entry in inner.observed]
    return [shown.index(one_of("name", name, shown)) for name in names]
