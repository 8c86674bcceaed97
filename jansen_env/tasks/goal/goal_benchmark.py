"""How policies are scored on ``JansenGoal-v0``."""

from __future__ import annotations

import numpy as np

from jansen_env.scoring.metrics import (
    Aggregate,
    Array,
    Benchmark,
    Env,
    Episodes,
    Metric,
    horizon,
    mean_of,
    per_weight,
)
from jansen_env.tasks.goal.goal_pid import goal_pid
from jansen_env.tasks.goal.goal_task import FARTHEST


def _time_to_success(run: Episodes, env: Env) -> Array:
    """Return s; of an episode without success its time limit."""
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
