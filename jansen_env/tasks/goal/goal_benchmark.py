"""Benchmark of ``JansenGoal-v0``, and its baseline.

The baseline computes a speed from the distance to the goal, and a torque from the speed.
"""

from __future__ import annotations

import math

import numpy as np

from jansen_env.arrays import Array, Bools
from jansen_env.policies.policy import Controlled, Memory, TorquePolicy, columns
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.scoring.metrics import (
    Aggregate,
    Benchmark,
    Env,
    Episodes,
    Metric,
    horizon,
    mean_of,
    per_weight,
)
from jansen_env.tasks.goal.goal_env import FARTHEST

GAIN = 1.3  # speed per distance to the goal, in 1/s
FASTEST = 0.42  # largest speed, in m/s
RAMP = 0.3  # largest acceleration, in m/s^2; with larger accelerations, the robot falls
PROPORTIONAL = 0.16  # action per rad/s of crank speed error
INTEGRAL = 1.2  # action per rad of the integral of the crank speed error
MOST_INTEGRAL = 0.6  # largest magnitude of the integral part of the action


def goal_pid(env: Controlled) -> TorquePolicy:
    """Return PI control of the crank speed, with a set point that is proportional to the distance.

    Args:
        env: Unwrapped environment.
    """
    read = columns(env, "goal_distance", "crank_speed")
    dt = env.control_dt
    per_radian = abs(advance_per_turn(env.robot)) / (2.0 * math.pi)  # in m

    def controller(seen: Array, memory: Memory, starts: Bools) -> tuple[Array, Memory]:
        distance, crank_speed = seen[:, read].T
        before, integral = memory or (0.0, 0.0)
        before = np.where(starts, 0.0, before)
        integral = np.where(starts, 0.0, integral)
        wanted = np.clip(GAIN * distance, -FASTEST, FASTEST)
        speed = before + np.clip(wanted - before, -RAMP * dt, RAMP * dt)
        error = speed / per_radian - crank_speed
        integral = np.clip(integral + INTEGRAL * dt * error, -MOST_INTEGRAL, MOST_INTEGRAL)
        return PROPORTIONAL * error + integral, (speed, integral)

    return TorquePolicy(controller, torque_limit=1.0)  # the controller returns actions


def _time_to_success(run: Episodes, env: Env) -> Array:
    """Return the time to success of each episode, in s, or the time limit if it has no success."""
    return np.where(run["success"], run["steps"] * env.get_wrapper_attr("control_dt"), horizon(env))


GOAL = Benchmark(
    commands=(-2.5, -1.5, -0.5, 0.5, 1.5, 2.5),
    command_unit="m",
    aggregates={
        "success": Aggregate("last", lambda info: info["is_success"]),
        "steps": Aggregate("sum", lambda info: 1.0 - info["is_success"]),
        "slip": Aggregate("sum", lambda info: info["slip"].sum(axis=-1)),
        "work": Aggregate("sum", lambda info: np.abs(info["energy"]["motor_work"])),
        "fell": Aggregate("last", lambda info: info["fallen"] | info["diverged"]),
    },
    metrics={
        "return": Metric("return", "", mean_of("returns")),
        "success": Metric("success", "fraction", mean_of("success"), axis="fraction"),
        "time": Metric("time to success", "s", _time_to_success),
        "work": Metric("work / weight", "m", per_weight("work")),
        "slip": Metric("slip", "m", mean_of("slip")),
        "falls": Metric("falls", "fraction", mean_of("fell"), axis="fraction"),
    },
    baselines={"pid": goal_pid},
    option="goal",
    drawn=(-FARTHEST, FARTHEST),
)
