"""Pose of the rigid-body plant's bodies at an instant, and sums over its step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

X, Y, ANGLE, VX, VY, SPIN = range(6)  # columns of a motion


SUMS = (
    "motor_work", "push_work", "electrical_work", "joint_loss", "slip_loss", "impact_loss",
)  # fmt: skip


class Snapshot(NamedTuple):
    """Pose of all bodies at an instant."""

    motion: Array  # (bodies, 6)
    pads: Array  # (pads, 2) centres, m
    energy: float  # J, without what springs hold
    joint_gap: float  # m, the widest

    def speed_along(self, body: int, x: float, y: float, tx: float, ty: float) -> float:
        """Velocity (m/s) along (tx, ty) of the point of a body that is at (x, y)."""
        cx, cy, _, vx, vy, w = self.motion[body].tolist()
        return float((vx - w * (y - cy)) * tx + (vy + w * (x - cx)) * ty)


class Sums:
    """Sums over a step: energies, J; of each pad the path it slid, m, and its impulse (2,), N s."""

    def __init__(self, pads: int) -> None:
        self.motor_work = self.push_work = self.electrical_work = 0.0
        self.joint_loss = self.slip_loss = self.impact_loss = 0.0
        self.joint_gap = self.torque_impulse = 0.0  # of the motor beyond what was last asked for
        self.slip, self.impulse = np.zeros(pads), np.zeros((pads, 2))

    def fill(self, total: np.void, toes: int, torque: float, steps: int, h: float) -> None:
        """Put them into ACCUMULATORS after steps of ``h`` s under a torque asked for, N m."""
        for name in SUMS:
            total[name] = getattr(self, name)
        total["contact_gain"] = total["worst_residual"] = math.nan
        total["non_toe_impulse"] = self.impulse[toes:, 1].sum()
        lacking = torque + self.torque_impulse / (steps * h) - torque  # of the mean, as rounded
        total["torque_impulse"] = lacking * steps * h
