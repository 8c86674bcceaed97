"""Where the bodies of the rigid-body plant are at an instant, and what its step adds up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pymunk
import pymunk.batch
from numpy.typing import NDArray

from jansen_env.plants.base import StepResult

Array = NDArray[np.float64]

X, Y, ANGLE, VX, VY, SPIN = range(6)  # columns of a motion
_Body = pymunk.batch.BodyFields
_MOTION = _Body.POSITION | _Body.ANGLE | _Body.VELOCITY | _Body.ANGULAR_VELOCITY


class Snapshot(NamedTuple):
    """Where everything is: the bodies' motion (n, 6), the pads' centres (k, 2) m, the energy (J)
    without what springs hold, and the widest gap of a joint (m)."""

    motion: Array
    pads: Array
    energy: float
    joint_gap: float

    def speed_along(self, body: int, x: float, y: float, tx: float, ty: float) -> float:
        """Velocity (m/s) along (tx, ty) of the point of a body that is at (x, y)."""
        cx, cy, _, vx, vy, w = self.motion[body].tolist()
        return float((vx - w * (y - cy)) * tx + (vy + w * (x - cx)) * ty)


class Sums:
    """Sums over a step: energies in J, of each pad the path it slid (m) and its impulse (N s).

    Impulses are tangential and normal; ``torque_impulse``: of the motor beyond what was last asked
    for, N m s.
    """

    def __init__(self, pads: int) -> None:
        self.motor_work = self.push_work = self.electrical_work = 0.0
        self.joint_loss = self.slip_loss = self.impact_loss = 0.0
        self.joint_gap = self.torque_impulse = 0.0
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


class BodyReader:
    """Reads where the bodies of a space are.

    Args:
        space: that holds the bodies, first and in this order. pins: their joints. pads: their
            circles. owners: the body of each pad.

    Attributes:
        index: of the bodies by pymunk's ids. rows: bodies of the space, the ground's too.
    """

    def __init__(
        self,
        space: pymunk.Space,
        bodies: Sequence[pymunk.Body],
        pins: Sequence[Any],
        pads: Sequence[pymunk.Circle],
        owners: Sequence[int],
    ) -> None:
        found = pymunk.batch.Buffer()
        pymunk.batch.get_space_bodies(space, _Body.BODY_ID, found)
        rows = list(memoryview(found.int_buf()).cast("P"))
        self.index, self.rows = {body.id: i for i, body in enumerate(bodies)}, len(rows)
        if rows[: len(self.index)] != list(self.index):
            raise RuntimeError("pymunk lists the bodies in another order than they were added in")
        ends = [*(pin.a for pin in pins), *(pin.b for pin in pins)]
        places = [
            *(tuple(pin.anchor_a) for pin in pins),
            *(tuple(pin.anchor_b) for pin in pins),
            *(tuple(pad.offset) for pad in pads),
        ]
        self._carriers = np.array([*(self.index[body.id] for body in ends), *owners])
        self._carried = np.array(places).T
        self._space, self._pins, self._got = space, len(pins), pymunk.batch.Buffer()

    def read(self, inertias: Array, gravity: tuple[float, float]) -> Snapshot:
        """Return where everything is now; inertias: (n, 2) kg, kg m^2. gravity: (x, y) m/s^2."""
        self._got.clear()
        pymunk.batch.get_space_bodies(self._space, _MOTION, self._got)
        motion = np.frombuffer(self._got.float_buf()).reshape(-1, 6)[: len(self.index)].copy()
        mass, inertia = inertias.T
        twice = mass @ (motion[:, VX] ** 2 + motion[:, VY] ** 2) + inertia @ motion[:, SPIN] ** 2
        energy = float(0.5 * twice - gravity @ (mass @ motion[:, :ANGLE]))
        angle, (x, y) = motion[:, ANGLE], self._carried
        cos, sin = np.cos(angle)[self._carriers], np.sin(angle)[self._carriers]
        points = motion[self._carriers, :ANGLE]
        points[:, 0] += cos * x - sin * y
        points[:, 1] += sin * x + cos * y
        pins = self._pins
        apart = points[:pins] - points[pins : 2 * pins]
        return Snapshot(motion, points[2 * pins :], energy, math.sqrt((apart**2).sum(axis=1).max()))
