"""The baseline of ``JansenGoal-v0``: from the distance to a speed, from the speed to a torque."""

from __future__ import annotations

import math

import numpy as np

from jansen_env.baselines.policy import Array, Bools, Controlled, Memory, TorquePolicy, columns
from jansen_env.robot.kinematics import advance_per_turn

GAIN, FASTEST, RAMP = 1.3, 0.42, 0.3  # 1/s of the distance; m/s; m/s^2: faster starts make it fall
PROPORTIONAL, INTEGRAL = 0.16, 1.2  # action per rad/s of crank speed, and per rad
MOST_INTEGRAL = 0.6  # of the action


def goal_pid(env: Controlled) -> TorquePolicy:
    """Return PI control of the crank's speed, which is asked for in proportion to the distance."""
    read, dt = columns(env, "goal_distance", "crank_speed"), env.control_dt
    per_radian = abs(advance_per_turn(env.robot)) / (2.0 * math.pi)  # m

    def controller(seen: Array, memory: Memory, starts: Bools) -> tuple[Array, Memory]:
        distance, crank_speed = seen[:, read].T
        before, integral = memory or (0.0, 0.0)
        before, integral = np.where(starts, 0.0, before), np.where(starts, 0.0, integral)
        wanted = np.clip(GAIN * distance, -FASTEST, FASTEST)
        speed = before + np.clip(wanted - before, -RAMP * dt, RAMP * dt)
        error = speed / per_radian - crank_speed
        integral = np.clip(integral + INTEGRAL * dt * error, -MOST_INTEGRAL, MOST_INTEGRAL)
        return PROPORTIONAL * error + integral, (speed, integral)

    return TorquePolicy(controller, torque_limit=1.0)  # of the action
