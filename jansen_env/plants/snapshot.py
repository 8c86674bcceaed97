"""Where the bodies of the rigid-body plant are at an instant, and what its step adds up."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.plants.base import StepResult

Array = NDArray[np.float64]

X, Y, ANGLE, VX, VY, SPIN = range(6)  # columns of a motion


class Snapshot(NamedTuple):
    """Where everything is."""

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

    def result(self, toes: int, time: float, torque: float, energy_change: float) -> StepResult:
        """Return the result of a step of ``time`` s under a torque, N m, that was asked for."""
        return StepResult(
            slip=self.slip[:toes],
            contact_force=self.impulse[:toes] / time,
            motor_work=self.motor_work,
            joint_loss=self.joint_loss,
            slip_loss=self.slip_loss,
            impact_loss=self.impact_loss,
            energy_change=energy_change,
            non_toe_contact=bool(self.impulse[toes:, 1].any()),
            residual=math.nan,
            contact_gain=math.nan,
            joint_gap=self.joint_gap,
            electrical_work=self.electrical_work,
            torque=torque + self.torque_impulse / time,
            push_work=self.push_work,
        )
