"""How policies are scored on ``JansenCrank-v0``."""

from __future__ import annotations

import numpy as np

from jansen_env.scoring.metrics import TORQUE, Aggregate, Benchmark, Metric, mean_of
from jansen_env.tasks.crank.crank_baselines import BASELINES
from jansen_env.tasks.crank.crank_task import LOST

CRANK = Benchmark(
    commands=(1.0,),
    option="speed_command",
    command_unit="rad/s",
    aggregates={
        "rms_error": Aggregate("rms", lambda info: info["tracking_error"]),
        "peak_error": Aggregate("peak", lambda info: info["tracking_error"]),
        "work": Aggregate("sum", lambda info: info["energy"]["motor_work"]),
        "lost": Aggregate("last", lambda info: np.abs(info["tracking_error"]) > LOST),
        **TORQUE,
    },
    metrics={
        "return": Metric("return", "", mean_of("returns")),
        "rms_error": Metric("RMS tracking error", "rad", mean_of("rms_error")),
        "peak_error": Metric("peak tracking error", "rad", mean_of("peak_error")),
        # Whoever turns the crank feeds the same friction: policies differ in the last digits.
        "rms_torque": Metric("RMS torque", "N m", mean_of("rms_torque"), digits=4),
        "peak_torque": Metric("peak torque", "N m", mean_of("peak_torque")),
        "power": Metric("mean motor power", "W", lambda run, _: run["work"] / run["duration"]),
        "lost": Metric("lost", "fraction", mean_of("lost"), axis=""),
    },
    baselines=BASELINES,
)
