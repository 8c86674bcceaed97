"""Walks under the paper's PID, on any simulation backend and terrain, and measurements of them."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.engine.walk_reward import FALLEN_PITCH
from jansen_env.plants.base import StepResult
from jansen_env.plants.plant import Plant
from jansen_env.policies.pid import PID
from jansen_env.policies.policy import PAPER_PID

CONTROL_DT = 0.02  # time for which a torque is held, in s
SETTLE = 2.0  # time of walking that is not measured, in s


class Walked(NamedTuple):
    """Results of a walk. If the robot fell, they describe the walk until the fall.

    Attributes:
        distance: Distance along x, in m.
        speed: Mean speed, in m/s.
        crank_speed: Mean crank speed, in rad/s.
        rms_torque: RMS torque of the motor, in N m.
        peak_torque: Largest torque of the motor, in N m.
        slip: Slip of all toes per distance.
        cost_of_transport: Absolute work of the motor, divided by the weight and the distance.
        electrical: Electrical energy, divided by the weight and the distance.
        heave: Difference between the highest and the lowest position of the crank axis above the
            ground, in m.
        fell: Whether the robot fell.
    """

    distance: float
    speed: float
    crank_speed: float
    rms_torque: float
    peak_torque: float
    slip: float
    cost_of_transport: float
    electrical: float
    heave: float
    fell: bool


NAN = math.nan
FELL_EARLY = Walked(NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, True)
"""Results of a robot that fell before anything was measured."""


def nothing(result: StepResult) -> None:
    """Ignore the result of a step."""


def walk(
    plant: Plant,
    speed: float,
    duration: float,
    start: float = 0.0,
    watch: Callable[[StepResult], None] = nothing,
    pid: PID = PAPER_PID,
    settle: float = SETTLE,
) -> Walked:
    """Let a robot walk at a crank speed, and measure its walk.

    The walk is measured for the whole number of half turns whose duration is closest to
    ``duration``. The PID knows the torque limit of the motor.

    Args:
        plant: Robot on a terrain.
        speed: Crank speed, in rad/s.
        duration: Duration that is measured, in s.
        start: Initial crank angle, in rad.
        watch: Function that is called with the result of each measured step.
        pid: Gains of the PID.
        settle: Duration of walking before the measurement, in s.
    """
    plant.reset(crank_angle=start)
    ground: Any = plant.terrain
    motor, reference, integral = plant.robot.motor, start, np.zeros(())
    limit = motor.torque_limit
    measured = max(1, round(duration * speed / math.pi)) * math.pi / speed
    first, last = round(settle / CONTROL_DT), round((settle + measured) / CONTROL_DT)
    results: list[StepResult] = []
    torques: list[float] = []
    heights: list[float] = []
    fell = False
    for k in range(last):
        angle, rate = plant.state[[3, 7]].tolist()
        if k == first:
            x, crank = plant.x, angle
        commanded, integral = pid.torque(
            reference - angle, speed - rate, integral, CONTROL_DT, limit
        )
        torque = min(limit, max(-limit, float(commanded)))
        reference += speed * CONTROL_DT
        result = plant.step(torque, CONTROL_DT)
        fell = bool(result.non_toe_contact) or abs(plant.state[2]) > FALLEN_PITCH
        if fell:
            break
        if k >= first:
            watch(result)
            results.append(result)
            torques.append(float(motor.torque(torque, rate)))
            heights.append(float(plant.state[1] - ground.height(plant.x)))
    if not results:
        return FELL_EARLY
    walked, way = CONTROL_DT * len(results), plant.x - x
    carried = plant.robot.mass * GRAVITY * abs(way)
    return Walked(
        distance=way,
        speed=way / walked,
        crank_speed=(plant.state[3] - crank) / walked,
        rms_torque=math.sqrt(np.mean(np.square(torques))),
        peak_torque=max(map(abs, torques)),
        slip=sum(result.slip.sum() for result in results) / abs(way),
        cost_of_transport=sum(abs(result.motor_work) for result in results) / carried,
        electrical=sum(result.electrical_work for result in results) / carried,
        heave=float(np.ptp(heights)),
        fell=fell,
    )
