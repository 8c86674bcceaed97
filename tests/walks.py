"""Walks under the paper's PID, on any plant and ground, and what is measured of them."""

import math
from typing import NamedTuple

import numpy as np

from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.engine.walk_reward import FALLEN_PITCH
from jansen_env.policies.policy import PAPER_PID

CONTROL_DT = 0.02  # s for which a torque is held
SETTLE = 2.0  # s of walking that are not measured


class Walked(NamedTuple):
    """Results of a walk; of one that fell, until then."""

    speed: float  # m/s
    crank_speed: float  # mean, rad/s
    rms_torque: float  # of the motor, N m
    peak_torque: float
    slip: float  # of all toes, m a metre
    cost_of_transport: float  # |motor work| per weight and distance
    electrical: float  # energy drawn, likewise
    fell: bool


def walk(plant, speed, duration, start=0.0, watch=lambda result: None, pid=PAPER_PID):
    """Walk at a crank speed, rad/s, for so many s after :data:`SETTLE`, from a crank angle, rad.

    Measured are as many half turns as come next to ``duration``. The motor's limit holds for the
    PID, too. ``watch`` gets the result of each measured step.
    """
    plant.reset(crank_angle=start)
    motor, reference, integral = plant.robot.motor, start, np.zeros(())
    measured = max(1, round(duration * speed / math.pi)) * math.pi / speed
    first, last = round(SETTLE / CONTROL_DT), round((SETTLE + measured) / CONTROL_DT)
    results, torques, fell = [], [], False
    for k in range(last):
        angle, rate = plant.state[[3, 7]].tolist()
        if k == first:
            x, crank = plant.x, angle
        limit = motor.torque_limit
        asked, integral = pid.torque(reference - angle, speed - rate, integral, CONTROL_DT, limit)
        torque = min(limit, max(-limit, float(asked)))
        reference += speed * CONTROL_DT
        result = plant.step(torque, CONTROL_DT)
        fell = bool(result.non_toe_contact) or abs(plant.state[2]) > FALLEN_PITCH
        if fell:
            break
        if k >= first:
            watch(result)
            results.append(result)
            torques.append(float(motor.torque(torque, rate)))
    walked, way = CONTROL_DT * len(results), plant.x - x
    carried = plant.robot.mass * GRAVITY * abs(way)
    return Walked(
        way / walked, (plant.state[3] - crank) / walked,
        math.sqrt(np.mean(np.square(torques))), max(map(abs, torques)),
        sum(result.slip.sum() for result in results) / abs(way),
        sum(abs(result.motor_work) for result in results) / carried,
        sum(result.electrical_work for result in results) / carried, fell,
    )  # fmt: skip
