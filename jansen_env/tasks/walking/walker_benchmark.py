"""Benchmark and baselines of ``JansenWalker-v0`` and its presets.

The baselines are a PID controller, a constant torque, and a crank-speed profile. They read only the
observation. Their parameters depend on the robot; see :mod:`jansen_env.tasks.walking.tuned`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from jansen_env.arrays import Array, Bools
from jansen_env.engine.crank_control import put_reference_errors
from jansen_env.engine.mathematics import angles_of
from jansen_env.policies.pid import PID
from jansen_env.policies.policy import (
    Controlled,
    Memory,
    Policy,
    TorquePolicy,
    columns,
    pid_policy,
)
from jansen_env.scoring.metrics import (
    SETTLING,
    TORQUE,
    Aggregate,
    Benchmark,
    Env,
    Episodes,
    Metric,
    horizon,
    mean_of,
    per_weight,
)
from jansen_env.tasks.walking.tuned import Setting, gains_of, profile_of, setting_of


def walking_pid(crank_speed: Setting, env: Controlled, pid: PID | None = None) -> Policy:
    """Return a policy in which the PID controller (13) follows a turning reference.

    The reference turns at the crank speed that corresponds to the commanded speed. It starts at the
    initial crank angle of the episode (pi in the paper).

    Args:
        crank_speed: Function that returns crank speeds in rad/s, shape (n,), for commanded speeds
            in m/s, shape (n,).
        env: Unwrapped walker.
        pid: Gains. None for the gains that hold the crank of the environment's robot at a constant
            speed.
    """
    cos, sin, rate, command = columns(
        env, "cos_crank_angle", "sin_crank_angle", "crank_speed", "speed_command"
    )

    def reference(seen: Array, memory: Memory, starts: Bools) -> tuple[Array, Array, Memory]:
        angle = angles_of(np.stack([seen[:, cos], seen[:, sin]], axis=-1))
        begun = np.stack([angle, angle], axis=-1)
        kept = begun if memory is None else np.where(starts[:, None], begun, memory)
        errors = np.empty(len(seen))
        error_rates = np.empty(len(seen))
        rates = np.ascontiguousarray(seen[:, rate])
        speeds = crank_speed(seen[:, command])
        put_reference_errors(angle, rates, speeds, env.control_dt, kept, errors, error_rates)
        return errors, error_rates, kept

    gains = gains_of(env.robot, "steady") if pid is None else pid
    return pid_policy(reference, env.torque_limit, env.control_dt, gains)


def constant_torque(torque: Setting, env: Controlled) -> Policy:
    """Return a policy with one constant torque per command, as the paper concludes.

    Args:
        torque: Function that returns torques in N m, shape (n,), for commanded speeds in m/s, shape
            (n,).
        env: Unwrapped walker.
    """
    (command,) = columns(env, "speed_command")
    return TorquePolicy(lambda seen, *_: (torque(seen[:, command]), None), env.torque_limit)


BASELINES: dict[str, Callable[[Controlled], Policy]] = {
    "pid": lambda env: walking_pid(setting_of("pid", env.robot), env, gains_of(env.robot)),
    "constant": lambda env: constant_torque(setting_of("constant", env.robot), env),
    "profile": lambda env: profile_of(env.robot).policy(env),
}
"""Functions that make a baseline for an unwrapped environment, by name."""


# Parts of the labels of metrics.
LATER = f"after {SETTLING:g} s"
FIRST = f"in the first {SETTLING:g} s"
COST = "mechanical cost of transport"


def _speed_error(run: Episodes, env: Env) -> Array:
    """Return the error of the mean speed over the time limit of an episode, in m/s.

    After a fall, the robot counts as standing still.
    """
    return np.abs(run["distance"] / horizon(env) - run["command"])


def _steady_speed_error(run: Episodes, env: Env) -> Array:
    """Return the error of the mean speed after :data:`SETTLING`, in m/s.

    The error is NaN if the time limit is not longer than :data:`SETTLING`.
    """
    rest = max(horizon(env) - SETTLING, 0.0) or np.nan
    return np.abs((run["distance"] - run["early_distance"]) / rest - run["command"])


def _torque_change(run: Episodes, env: Env) -> Array:
    """Return the mean absolute change of the torque from step to step, in N m."""
    return run["torque_change"] * env.get_wrapper_attr("control_dt") / run["duration"]


def _unsupported(run: Episodes, env: Env) -> Array:
    """Return the fraction of an episode's time in which the robot is unsupported."""
    return run["unsupported"] * env.get_wrapper_attr("control_dt") / run["duration"]


def _start_work(run: Episodes, env: Env) -> Array:
    """Return the work within :data:`SETTLING` divided by the weight, in m."""
    return per_weight("work")(run, env) - per_weight("steady_work")(run, env)


def _start_lag(run: Episodes, env: Env) -> Array:
    """Return the distance by which the robot is behind the command at :data:`SETTLING`, in m."""
    return SETTLING * np.abs(run["command"]) - np.sign(run["command"]) * run["early_distance"]


def _distance(run: Episodes, env: Env) -> Array:
    """Return the distance in the commanded direction, in m, at least 0."""
    return np.maximum(np.sign(run["command"]) * run["distance"], 0.0)


def _steady_distance(run: Episodes, env: Env) -> Array:
    """Return the distance in the commanded direction after :data:`SETTLING`, in m, at least 0."""
    return _distance({**run, "distance": run["distance"] - run["early_distance"]}, env)


WALKER = Benchmark(
    commands=(0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8),
    option="speed_command",
    command_unit="m/s",
    aggregates={
        "distance": Aggregate("last", lambda info: info["x_position"]),
        "early_distance": Aggregate("early", lambda info: info["x_position"]),
        "slip": Aggregate("sum", lambda info: info["slip"].sum(axis=-1)),
        "steady_slip": Aggregate("steady", lambda info: info["slip"].sum(axis=-1)),
        "work": Aggregate("sum", lambda info: np.abs(info["energy"]["motor_work"])),
        "steady_work": Aggregate("steady", lambda info: np.abs(info["energy"]["motor_work"])),
        "drawn": Aggregate("sum", lambda info: info["energy"]["electrical_work"]),
        # A simulation that diverged counts as a fall.
        "fell": Aggregate("last", lambda info: info["fallen"] | info["diverged"]),
        "success": Aggregate("last", lambda info: 1.0 * info["is_success"]),
        "steps_in_ground": Aggregate("sum", lambda info: 1.0 * (info["links_in_ground"] > 0)),
        "unsupported": Aggregate("sum", lambda info: info["unsupported"]),
        "load": Aggregate("p99", lambda info: info["ground_load"]),
        "peak_load": Aggregate("peak", lambda info: info["ground_load"]),
        "torque_change": Aggregate("change", lambda info: info["crank_torque"]),
        **TORQUE,
    },
    metrics={
        "return": Metric("return", "", mean_of("returns")),
        "speed_error": Metric("speed error", "m/s", _speed_error),
        "steady_speed_error": Metric(f"speed error {LATER}", "m/s", _steady_speed_error),
        "slip_per_metre": Metric("slip per metre", "m/m", mean_of("slip"), _distance),
        "steady_slip_per_metre": Metric(
            f"slip per metre {LATER}", "m/m", mean_of("steady_slip"), _steady_distance, "log"
        ),
        "cost_of_transport": Metric(COST, "1", per_weight("work"), _distance),
        "steady_cost_of_transport": Metric(
            f"{COST} {LATER}", "1", per_weight("steady_work"), _steady_distance, "log"
        ),
        "electrical_cost_of_transport": Metric(
            "electrical cost of transport", "1", per_weight("drawn"), _distance, ""
        ),
        "start_slip": Metric(
            f"slip {FIRST}", "m", lambda run, _: run["slip"] - run["steady_slip"], axis=""
        ),
        "start_work": Metric(f"work / weight {FIRST}", "m", _start_work, axis=""),
        "start_lag": Metric(f"behind the command {LATER}", "m", _start_lag, axis=""),
        "success": Metric("success", "fraction", mean_of("success"), axis="fraction"),
        "falls": Metric("falls", "fraction", mean_of("fell"), axis="fraction"),
        "unsupported": Metric("unsupported", "fraction of time", _unsupported),
        "load": Metric("ground load, 99th percentile", "weights", mean_of("load")),
        "peak_load": Metric("largest ground load", "weights", mean_of("peak_load"), axis=""),
        "peak_torque": Metric("peak torque", "N m", mean_of("peak_torque"), axis=""),
        "rms_torque": Metric("RMS torque", "N m", mean_of("rms_torque")),
        "torque_change": Metric("change of torque per step", "N m", _torque_change, axis=""),
    },
    baselines=BASELINES,
)
"""Benchmark of ``JansenWalker-v0`` and ``JansenWalkerBuilt-v0``."""

WORLD = replace(WALKER, commands=(0.1, 0.2, 0.3, 0.4, 0.5), chosen_by="success", variety=8)
"""Benchmark of ``JansenWalkerRough-v0`` and ``JansenWalkerHardcore-v0``."""
