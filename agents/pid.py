"""The paper's PID controller on the crank angle, and constant torque: what learning must beat.

Both read nothing but the observation and answer ``predict`` as Stable-Baselines3's models do, so
the same code scores all. The crank speed (or torque) for a commanded walking speed comes from a
map measured on the environment (``python -m agents.tune``, kept in ``agents/data``).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COS_CRANK, SIN_CRANK, CRANK_SPEED, COMMAND = 0, 1, 2, 9  # places in JansenWalker-v0's observation
DATA = Path(__file__).parent / "data" / "baselines.json"


@dataclass(frozen=True)
class Gains:
    """Gains of the PID (13) and how its reference starts.

    Attributes:
        kp: N m / rad. ki: N m / (rad s). kd: N m s / rad. Default: the paper's.
        ramp: s in which the reference crank speed rises from 0; the paper's starts at once.
    """

    kp: float = 10.0
    ki: float = 1.0
    kd: float = 1.0
    ramp: float = 0.0


@dataclass(frozen=True)
class SpeedMap:
    """Measured walking speeds of a constant setting (crank speed in rad/s, or torque in N m).

    Attributes:
        settings: (n,) increasing, > 0.
        speeds: (n, episodes) distance over the whole episode's time, m/s; a fall ends the way.
    """

    settings: Array
    speeds: Array

    def setting_for(self, command: Array) -> Array:
        """The setting whose episodes came closest to each commanded speed (n,), m/s.

        A negative command turns the crank the other way: the machine is its own mirror image.
        """
        target = np.abs(np.asarray(command, dtype=float))
        error = np.abs(self.speeds[None] - target[:, None, None]).mean(axis=2)
        best = self.settings[np.argmin(error, axis=1)]
        result: Array = np.sign(command) * best
        return result


class PIDState(NamedTuple):
    """A PID's memory for n environments, each (n,): unwrapped angle, reference, integral, time."""

    angle: Array
    reference: Array
    integral: Array
    time: Array


class PIDController:
    """Torque from (13): tau = kp e + ki int e + kd de/dt, e = r - crank angle.

    r starts at the crank angle at which the episode starts (the paper's pi) and grows with the
    reference crank speed of the commanded walking speed. The integral waits while the torque is at
    its limit.

    Args:
        gains: see :class:`Gains`.
        speed_map: crank speed (rad/s) for a walking speed.
        torque_limit: of the environment, N m. control_dt: s.
    """

    def __init__(
        self,
        gains: Gains,
        speed_map: SpeedMap,
        torque_limit: float = 20.0,
        control_dt: float = 0.02,
    ) -> None:
        self.gains, self.speed_map = gains, speed_map
        self.torque_limit, self.control_dt = torque_limit, control_dt

    def predict(
        self,
        observation: Any,
        state: PIDState | None = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], PIDState]:
        """Actions (n, 1) or (1,) for observations (n, d) or (d,), and the state to pass back."""
        seen = np.atleast_2d(np.asarray(observation, dtype=float))
        angle = np.arctan2(seen[:, SIN_CRANK], seen[:, COS_CRANK])
        n = len(angle)
        if state is None:
            state = PIDState(angle, angle, np.zeros(n), np.zeros(n))
        elif episode_start is not None:
            fresh = np.broadcast_to(np.asarray(episode_start, dtype=bool), (n,))
            state = PIDState(
                np.where(fresh, angle, state.angle),
                np.where(fresh, angle, state.reference),
                np.where(fresh, 0.0, state.integral),
                np.where(fresh, 0.0, state.time),
            )
        turned = (angle - state.angle + np.pi) % (2.0 * np.pi) - np.pi
        unwrapped = state.angle + turned
        gains, dt = self.gains, self.control_dt
        rise = np.minimum(state.time / gains.ramp, 1.0) if gains.ramp > 0.0 else 1.0
        reference_speed = rise * self.speed_map.setting_for(seen[:, COMMAND])
        error = state.reference - unwrapped
        integral = state.integral + error * dt
        torque = (
            gains.kp * error
            + gains.ki * integral
            + gains.kd * (reference_speed - seen[:, CRANK_SPEED])
        )
        free = np.abs(torque) < self.torque_limit
        after = PIDState(
            unwrapped,
            state.reference + reference_speed * dt,
            np.where(free, integral, state.integral),
            state.time + dt,
        )
        return _as_action(torque / self.torque_limit, observation), after


class ConstantTorque:
    """The paper's conclusion as a policy: one constant torque for each commanded walking speed.

    Args:
        torque_map: torque (N m) for a walking speed. torque_limit: of the environment, N m.
    """

    def __init__(self, torque_map: SpeedMap, torque_limit: float = 20.0) -> None:
        self.torque_map, self.torque_limit = torque_map, torque_limit

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (n, 1) or (1,) for observations (n, d) or (d,); the state is not used."""
        seen = np.atleast_2d(np.asarray(observation, dtype=float))
        torque = self.torque_map.setting_for(seen[:, COMMAND])
        return _as_action(torque / self.torque_limit, observation), state


def _as_action(share: Array, observation: Any) -> NDArray[np.float32]:
    action = np.clip(share, -1.0, 1.0).astype(np.float32)[:, None]
    return action if np.ndim(observation) > 1 else action[0]


BASELINES = ("pid", "pid-paper", "constant")


def load_baseline(
    name: str, torque_limit: float = 20.0, control_dt: float = 0.02
) -> PIDController | ConstantTorque:
    """``"pid"`` (tuned gains), ``"pid-paper"`` (the paper's), or ``"constant"`` torque.

    Raises:
        ValueError: another name.
    """
    if name not in BASELINES:
        raise ValueError(f"baseline is {name!r}, must be one of {BASELINES}")
    entry = json.loads(DATA.read_text(encoding="utf-8"))[name]
    measured = SpeedMap(np.array(entry["settings"]), np.array(entry["speeds"]))
    if name == "constant":
        return ConstantTorque(measured, torque_limit)
    return PIDController(Gains(**entry["gains"]), measured, torque_limit, control_dt)
