"""Baselines of JansenWalker-v0: the paper's PID, and constant torque.

Both read nothing but the observation. The crank speed (or torque) for a commanded walking speed
comes from a map measured on the environment (``python -m agents.tune``, kept in ``agents/data``).
The PID has the paper's gains: of 100 others, drawn log-uniformly from kp 3-300, ki 0.1-300,
kd 0.3-30 and ramps of the reference of 0.1-4 s, none earned more once its own map was measured.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from agents.policy import PAPER_PID, Array, PIDPolicy, Policy, Reference, TorquePolicy
from jansen_env.control import PID

COS_CRANK, SIN_CRANK, CRANK_SPEED, COMMAND = 0, 1, 2, 9  # places in the observation
DATA = Path(__file__).parent / "data" / "baselines.json"
BASELINES = ("pid", "constant")

Setting: TypeAlias = Callable[[Array], Array]
"""Commands (n,), m/s, to crank speeds (n,), rad/s, or torques (n,), N m, that walk at them."""


@dataclass(frozen=True)
class SpeedMap:
    """Measured walking speeds of a constant setting (crank speed in rad/s, or torque in N m).

    Attributes:
        settings: (n,) increasing, > 0.
        speeds: (n, episodes) distance over the whole episode's time, m/s; a fall ends the walk.
    """

    settings: Array
    speeds: Array

    def setting_for(self, command: Array) -> Array:
        """The setting whose episodes came closest to each commanded speed (n,), m/s.

        A negative command turns the crank backwards: the machine is its own mirror image.
        """
        target = np.abs(np.asarray(command, dtype=float))
        error = np.abs(self.speeds[None] - target[:, None, None]).mean(axis=2)
        best: Array = np.sign(command) * self.settings[np.argmin(error, axis=1)]
        return best


class CrankMemory(NamedTuple):
    """Of n environments, each (n,), rad: unwrapped crank angle, reference."""

    angle: Array
    reference: Array


def turning_reference(crank_speed: Setting, control_dt: float) -> Reference:
    """A reference that turns with the crank speed for the commanded walking speed.

    It starts at the crank angle at which the episode starts (the paper's pi).
    """

    def follow(
        observations: Array, memory: CrankMemory | None, starts: NDArray[np.bool_]
    ) -> tuple[Array, Array, CrankMemory]:
        angle = np.arctan2(observations[:, SIN_CRANK], observations[:, COS_CRANK])
        before = memory or CrankMemory(angle, angle)
        last = np.where(starts, angle, before.angle)
        unwrapped = last + ((angle - last + np.pi) % (2.0 * np.pi) - np.pi)
        reference = np.where(starts, angle, before.reference)
        speed = crank_speed(observations[:, COMMAND])
        after = CrankMemory(unwrapped, reference + speed * control_dt)
        return reference - unwrapped, speed - observations[:, CRANK_SPEED], after

    return follow


def walking_pid(
    crank_speed: Setting, torque_limit: float, control_dt: float, pid: PID = PAPER_PID
) -> PIDPolicy:
    """The PID (13) behind a :func:`turning_reference`."""
    return PIDPolicy(turning_reference(crank_speed, control_dt), torque_limit, control_dt, pid)


def constant_torque(torque: Setting, torque_limit: float) -> TorquePolicy:
    """The paper's conclusion as a policy: one constant torque for each command."""
    return TorquePolicy(lambda observations: torque(observations[:, COMMAND]), torque_limit)


def load_baseline(name: str, env: Any) -> Policy:
    """``"pid"``, or ``"constant"`` torque.

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
        return constant_torque(measured.setting_for, env.torque_limit)
    return walking_pid(measured.setting_for, env.torque_limit, env.control_dt)
