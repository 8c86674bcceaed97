"""Baselines of JansenWalker-v0: the paper's PID, and constant torque.

Both read nothing but the observation and answer ``predict`` as Stable-Baselines3's models do, so
the same code scores all. The crank speed (or torque) for a commanded walking speed comes from a
map measured on the environment (``python -m agents.tune``, kept in ``agents/data``).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from agents.pid import Gains, PIDController
from agents.policy import ConstantTorque, Policy

Array = NDArray[np.float64]

COS_CRANK, SIN_CRANK, CRANK_SPEED, COMMAND = 0, 1, 2, 9  # places in the observation
DATA = Path(__file__).parent / "data" / "baselines.json"
TORQUE_LIMIT, CONTROL_DT = 20.0, 0.02  # N m and s, the environment's defaults
BASELINES = ("pid", "pid-paper", "constant")


class Map(Protocol):
    """Says which setting (crank speed in rad/s, or torque in N m) walks at a commanded speed."""

    def setting_for(self, command: Array) -> Array:
        """Settings (n,) for commands (n,), m/s."""
        ...


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


class WalkMemory(NamedTuple):
    """Of n environments, each (n,): unwrapped crank angle, reference (rad), time (s)."""

    angle: Array
    reference: Array
    time: Array


@dataclass(frozen=True)
class WalkReference:
    """A turning reference for the crank, made from the commanded walking speed.

    It starts at the crank angle at which the episode starts (the paper's pi) and grows with the
    crank speed that the map gives.

    Attributes:
        speed_map: crank speed (rad/s) for a walking speed.
        ramp: s in which the crank speed rises from 0. control_dt: s.
    """

    speed_map: Map
    ramp: float
    control_dt: float

    def follow(
        self, seen: Array, memory: WalkMemory | None, fresh: NDArray[np.bool_]
    ) -> tuple[Array, Array, WalkMemory]:
        """See :class:`agents.pid.Reference`."""
        angle = np.arctan2(seen[:, SIN_CRANK], seen[:, COS_CRANK])
        if memory is None:
            memory = WalkMemory(angle, angle, np.zeros(len(angle)))
        start = np.where(fresh, angle, memory.angle)
        reference = np.where(fresh, angle, memory.reference)
        time = np.where(fresh, 0.0, memory.time)
        turned = (angle - start + np.pi) % (2.0 * np.pi) - np.pi
        unwrapped = start + turned
        rise = np.minimum(time / self.ramp, 1.0) if self.ramp > 0.0 else 1.0
        speed = rise * self.speed_map.setting_for(seen[:, COMMAND])
        after = WalkMemory(unwrapped, reference + speed * self.control_dt, time + self.control_dt)
        return reference - unwrapped, speed - seen[:, CRANK_SPEED], after


def walking_pid(
    gains: Gains,
    speed_map: Map,
    torque_limit: float = TORQUE_LIMIT,
    control_dt: float = CONTROL_DT,
) -> PIDController:
    """The PID (13) behind a :class:`WalkReference`."""
    reference = WalkReference(speed_map, gains.ramp, control_dt)
    return PIDController(gains, reference, torque_limit, control_dt)


def walking_torque(torque_map: Map, torque_limit: float = TORQUE_LIMIT) -> ConstantTorque:
    """One constant torque (N m) for each commanded walking speed."""
    return ConstantTorque(torque_map.setting_for, COMMAND, torque_limit)


def load_baseline(name: str, env: Any) -> Policy:
    """``"pid"`` (tuned gains), ``"pid-paper"`` (the paper's), or ``"constant"`` torque.

    Args:
        name: one of :data:`BASELINES`. env: the unwrapped environment it is to act in.

    Raises:
        ValueError: another name.
    """
    if name not in BASELINES:
        raise ValueError(f"baseline is {name!r}, must be one of {BASELINES}")
    entry = json.loads(DATA.read_text(encoding="utf-8"))[name]
    measured = SpeedMap(np.array(entry["settings"]), np.array(entry["speeds"]))
    if name == "constant":
        return walking_torque(measured, env.torque_limit)
    return walking_pid(Gains(**entry["gains"]), measured, env.torque_limit, env.control_dt)
