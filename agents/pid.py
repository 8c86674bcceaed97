"""The paper's PID controller (13) on the crank angle, whatever its reference comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from agents.policy import as_action, rows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gains:
    """Gains of the PID (13) and how its reference starts.

    Attributes:
        kp: N m / rad. ki: N m / (rad s). kd: N m s / rad. Default: the paper's.
        ramp: s in which the reference crank speed rises from 0, where the controller makes the
            reference itself; the paper's starts at once.
    """

    kp: float = 10.0
    ki: float = 1.0
    kd: float = 1.0
    ramp: float = 0.0


class Reference(Protocol):
    """Where the crank should be, for n environments side by side."""

    def follow(
        self, seen: Array, memory: Any, fresh: NDArray[np.bool_]
    ) -> tuple[Array, Array, Any]:
        """Errors of the crank's angle (n,), rad, and speed (n,), rad/s, and the memory after it.

        Args:
            seen: (n, d) observations. memory: of the step before, None before the first.
            fresh: (n,) whether an episode starts here.
        """
        ...


class PIDState(NamedTuple):
    """A PID's memory for n environments: its reference's, and the integral (n,), rad s."""

    reference: Any
    integral: Array


class PIDController:
    """Torque from (13): tau = kp e + ki int e + kd de/dt, e = reference - crank angle.

    The integral is a sum of e dt from the start of the episode; it waits while the torque is at its
    limit.

    Args:
        gains: see :class:`Gains`.
        reference: says e and de/dt.
        torque_limit: of the environment, N m. control_dt: s.
    """

    def __init__(
        self, gains: Gains, reference: Reference, torque_limit: float, control_dt: float
    ) -> None:
        self.gains, self.reference = gains, reference
        self.torque_limit, self.control_dt = torque_limit, control_dt

    def predict(
        self,
        observation: Any,
        state: PIDState | None = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], PIDState]:
        """Actions (n, 1) or (1,) for observations (n, d) or (d,), and the state to pass back."""
        seen = rows(observation)
        n = len(seen)
        if state is None:
            state, episode_start = PIDState(None, np.zeros(n)), True
        elif episode_start is None:
            episode_start = False
        fresh = np.broadcast_to(np.asarray(episode_start, dtype=bool), (n,))
        error, speed_error, memory = self.reference.follow(seen, state.reference, fresh)
        gains = self.gains
        before = np.where(fresh, 0.0, state.integral)
        integral = before + error * self.control_dt
        torque = gains.kp * error + gains.ki * integral + gains.kd * speed_error
        free = np.abs(torque) < self.torque_limit
        after = PIDState(memory, np.where(free, integral, before))
        return as_action(torque / self.torque_limit, observation), after
