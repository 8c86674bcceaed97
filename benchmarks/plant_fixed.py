"""The fixed frame on both plants: free swing, and the torque that a constant speed takes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env import Terrain, paper_robot
from jansen_env.plants.fixed_base import FixedBasePlant
from jansen_env.plants.rigid_body import TIME_STEP, RigidBodyPlant

Array = NDArray[np.float64]

HEIGHT = 5.0  # m, at which the rigid-body plant's frame is held, clear of the ground
SERVO_DT = 1e-3  # s for which the servo holds a torque
STIFFNESS, DAMPING = 400.0, 20.0  # of the servo, N m / rad and N m s / rad
SWING = (0.5, 3.0)  # rad and rad/s, from where the crank swings free
SWING_TIME = 3.0  # s
STEPS = (TIME_STEP, 0.5 * TIME_STEP)  # s, of the rigid-body plant


class Pair:
    """The pinned plant and the rigid-body plant with its frame held, started alike."""

    def __init__(self, angle: float, rate: float, time_step: float) -> None:
        self.exact = FixedBasePlant(paper_robot())
        self.exact.reset(angle, rate)
        self.rigid = RigidBodyPlant(paper_robot(), Terrain.flat(), time_step, pinned=True)
        self.rigid.state = np.array([0.0, HEIGHT, 0.0, angle, 0.0, 0.0, 0.0, rate])


class Fixed(NamedTuple):
    """How far the plants are apart.

    Attributes:
        what: was done. time_step: of the rigid-body plant, s.
        difference: of the crank's angle (rad) or of the torque (N m, root mean square).
        of: what it is to be compared with: the angle turned, or the RMS torque.
        joint_gap: m.
    """

    what: str
    time_step: float
    difference: float
    of: float
    joint_gap: float


def free_swing(time_step: float) -> Fixed:
    """The largest difference of the crank angle in :data:`SWING_TIME` without torque."""
    pair = Pair(*SWING, time_step)
    worst = gap = 0.0
    angles = []
    for _ in range(round(SWING_TIME / 0.01)):
        pair.exact.step(0.0, 0.01)
        gap = max(gap, pair.rigid.step(0.0, 0.01).joint_gap)
        angles.append(float(pair.exact.state[0]))
        worst = max(worst, abs(angles[-1] - float(pair.rigid.state[3])))
    return Fixed("free swing, rad", time_step, worst, float(np.ptp(angles)), gap)


def constant_speed(speed: float, time_step: float) -> tuple[Fixed, Array]:
    """The torque of a stiff servo over the second turn, (n, 3): angle, torque on either plant."""
    pair = Pair(0.0, speed, time_step)
    rows, gap, turn = [], 0.0, 2.0 * math.pi / speed
    for k in range(round(2.0 * turn / SERVO_DT)):
        torques = []
        for plant, (angle, rate) in (
            (pair.exact, pair.exact.state),
            (pair.rigid, pair.rigid.state[[3, 7]]),
        ):
            ahead = speed * k * SERVO_DT - float(angle)
            torques.append(STIFFNESS * ahead + DAMPING * (speed - float(rate)))
            gap = max(gap, getattr(plant.step(torques[-1], SERVO_DT), "joint_gap", 0.0))
        rows.append((speed * k * SERVO_DT, *torques))
    curve = np.array(rows)[len(rows) // 2 :]
    difference = float(np.sqrt(np.mean((curve[:, 1] - curve[:, 2]) ** 2)))
    rms = float(np.sqrt(np.mean(curve[:, 1] ** 2)))
    return Fixed(f"torque at {speed:g} rad/s, N m", time_step, difference, rms, gap), curve
