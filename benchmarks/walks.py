"""Walks under the paper's PID, on any plant and ground: what the benchmarks measure of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jansen_env.baselines.pid import PID
from jansen_env.engine.walk_reward import FALLEN_PITCH
from jansen_env.gravity import GRAVITY
from jansen_env.plants.base import StepResult
from jansen_env.plants.plant import Plant

CONTROL_DT = 0.02  # s for which a torque is held
SETTLE = 2.0  # s of walking that are not measured
TORQUE_LIMIT = 20.0  # N m


class Walked(NamedTuple):
    """Results of a walk; of one that fell, until then."""

    distance: float  # m along x
    speed: float  # m/s
    crank_speed: float  # mean, rad/s
    rms_torque: float  # of the motor, N m
    peak_torque: float
    slip: float  # of all toes, m a metre
    cost_of_transport: float  # |motor work| per weight and distance
    electrical: float  # energy drawn, likewise
    heave: float  # highest less lowest crank axis over the ground, m
    fell: bool


def walk(
    plant: Plant,
    speed: float,
    duration: float,
    settle: float = SETTLE,
    start: float = 0.0,
    limit: float = TORQUE_LIMIT,
    windup_limit: float = math.inf,
    watch: Callable[[StepResult], None] | None = None,
) -> Walked:
    """Walk at a crank speed (rad/s) under the paper's PID and measure.

    Args:
        duration, settle: s measured, as many half turns of the crank as come next to it, one at
            least; and before that. start: crank angle at first, rad.
        limit: of the torque asked for, N m. windup_limit: the same, for the PID's integral.
        watch: called with the result of each measured step, also of one that ends in a fall.
    """
    plant.reset(crank_angle=start)
    pid, motor, reference, integral = PID(), plant.robot.motor, start, np.zeros(())
    measured = max(1, round(duration * speed / math.pi)) * math.pi / speed
    steps = round(settle / CONTROL_DT), round((settle + measured) / CONTROL_DT)
    x = crank = work = drawn = slip = 0.0
    torques: list[float] = []
    heights: list[float] = []
    fell = False
    for k in range(steps[1]):
        angle, rate = plant.state[[3, 7]].tolist()
        if k == steps[0]:
            x, crank = plant.x, angle
        wanted, integral = pid.torque(
            reference - angle, speed - rate, integral, CONTROL_DT, windup_limit
        )
        torque = min(limit, max(-limit, float(wanted)))
        reference += speed * CONTROL_DT
        result = plant.step(torque, CONTROL_DT)
        if watch is not None and k >= steps[0]:
            watch(result)
        # As the walking task has it.
        fell = bool(result.non_toe_contact) or abs(float(plant.state[2])) > FALLEN_PITCH
        if fell:
            break
        if k >= steps[0]:
            work, drawn = work + abs(result.motor_work), drawn + result.electrical_work
            slip += float(result.slip.sum())
            torques.append(float(motor.torque(torque, rate)))
            heights.append(float(plant.state[1] - plant.terrain.height(plant.x)))
    if not torques:
        return Walked(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, fell)
    distance, walked = plant.x - x, CONTROL_DT * len(torques)
    path = max(abs(distance), 1e-9)
    carried = plant.robot.mass * GRAVITY * path
    return Walked(
        distance, distance / walked, (float(plant.state[3]) - crank) / walked,
        math.sqrt(float(np.mean(np.square(torques)))), max(map(abs, torques)), slip / path,
        work / carried, drawn / carried, float(np.ptp(heights)), fell,
    )  # fmt: skip
