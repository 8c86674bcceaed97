"""The benchmarks by environment id: commands, metrics and baselines."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import load_env_creator

from jansen_env.baselines import crank_baselines, walker_baselines
from jansen_env.baselines.goal_pid import GoalPid
from jansen_env.baselines.policy import Policy
from jansen_env.checks import listed, one_of, positive_integer
from jansen_env.dynamics.projection import leg_sides
from jansen_env.scoring.metrics import SETTLING, Aggregate, Array, Episodes, Metric
from jansen_env.tasks.crank import LOST
from jansen_env.tasks.goal import FARTHEST
from jansen_env.world.settings import load_robot

ENOUGH = 0.8  # of the commanded distance
LATER, FIRST = f"after {SETTLING:g} s", f"in the first {SETTLING:g} s"
COST = "mechanical cost of transport"


@dataclass(frozen=True)
class Benchmark:
    """Rules by which policies are scored on an environment."""

    commands: tuple[float, ...]  # the grid on which policies are scored
    command_unit: str
    aggregates: dict[str, Aggregate]  # kept of each episode
    metrics: dict[str, Metric]  # the first is "return"
    baselines: dict[str, Callable[[Any], Policy]]  # for an unwrapped environment; main one first
    chosen_by: str = "return"  # the metric by which the best model of a run is chosen
    variety: int = 1  # times the episodes that choosing takes where only the start differs
    option: str = "speed_command"  # of a reset, that takes the command
    drawn: tuple[float, float] | None = None  # commands of a reset; None: the env's speed_command

    @property
    def middle(self) -> float:
        """The command in the middle of the grid."""
        return self.commands[(len(self.commands) - 1) // 2]


def _mean(name: str) -> Callable[[Episodes, Any], Array]:
    return lambda run, _: np.asarray(run[name], dtype=float)


def _horizon(env: Any) -> float:
    """Time limit of an episode, s."""
    return float(env.spec.max_episode_steps * env.unwrapped.control_dt)


def _speed_error(run: Episodes, env: Any) -> Array:
    """Over the full length of an episode: after a fall the robot is taken to stand still."""
    return np.abs(run["distance"] / _horizon(env) - run["command"])


def _steady_speed_error(run: Episodes, env: Any) -> Array:
    """The same after :data:`SETTLING` s; NaN for episodes that are not longer."""
    horizon = max(_horizon(env) - SETTLING, 0.0) or np.nan
    return np.abs((run["distance"] - run["early_distance"]) / horizon - run["command"])


def succeeded(run: Episodes, env: Any) -> Array:
    """1 for each episode (n,) without a fall and :data:`ENOUGH` of the way commanded, else 0."""
    enough = _distance(run, env) >= ENOUGH * np.abs(run["command"]) * _horizon(env)
    return (~run["fell"].astype(bool) & enough).astype(float)


def _per_step(name: str) -> Callable[[Episodes, Any], Array]:
    """Mean over an episode's steps."""
    return lambda run, env: np.asarray(run[name] * env.unwrapped.control_dt / run["duration"])


def _per_weight(name: str) -> Callable[[Episodes, Any], Array]:
    """Work / weight, m; of the episodes' own robots where they have a "weight", N."""

    def per_weight(run: Episodes, env: Any) -> Array:
        return np.asarray(run[name] / run.get("weight", env.unwrapped.task.world.weight[0]))

    return per_weight


def _start_work(run: Episodes, env: Any) -> Array:
    """Work within :data:`SETTLING` / weight, m."""
    return _per_weight("work")(run, env) - _per_weight("steady_work")(run, env)


def _start_lag(run: Episodes, env: Any) -> Array:
    """Distance behind the command at :data:`SETTLING`, m."""
    return SETTLING * np.abs(run["command"]) - np.sign(run["command"]) * run["early_distance"]


def _distance(run: Episodes, env: Any) -> Array:
    """Distance in the commanded direction, m."""
    return np.maximum(np.sign(run["command"]) * run["distance"], 0.0)


def _steady_distance(run: Episodes, env: Any) -> Array:
    """Distance in the commanded direction after :data:`SETTLING`, m."""
    return _distance({**run, "distance": run["distance"] - run["early_distance"]}, env)


def _time_to_success(run: Episodes, env: Any) -> Array:
    """Return s; of an episode without success its time limit."""
    return np.where(run["success"], run["steps"] * env.unwrapped.control_dt, _horizon(env))


TORQUE = {
    "peak_torque": Aggregate("peak", lambda info: info["crank_torque"]),
    "rms_torque": Aggregate("rms", lambda info: info["crank_torque"]),
}

WALKER = Benchmark(
    commands=(0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8),
    command_unit="m/s",
    aggregates={
        "distance": Aggregate("last", lambda info: info["x_position"]),
        "early_distance": Aggregate("early", lambda info: info["x_position"]),
        "slip": Aggregate("sum", lambda info: info["slip"].sum(axis=-1)),
        "steady_slip": Aggregate("steady", lambda info: info["slip"].sum(axis=-1)),
        "work": Aggregate("sum", lambda info: np.abs(info["energy"]["motor_work"])),
        "steady_work": Aggregate("steady", lambda info: np.abs(info["energy"]["motor_work"])),
        "drawn": Aggregate("sum", lambda info: info["energy"]["electrical_work"]),
        # A simulation that diverged is no walk either: it counts as a fall.
        "fell": Aggregate("last", lambda info: info["fallen"] | info["diverged"]),
        "torque_change": Aggregate("change", lambda info: info["crank_torque"]),
        **TORQUE,
    },
    metrics={
        "return": Metric("return", "", _mean("returns")),
        "speed_error": Metric("speed error", "m/s", _speed_error),
        "steady_speed_error": Metric(f"speed error {LATER}", "m/s", _steady_speed_error),
        "slip_per_metre": Metric("slip per metre", "m/m", _mean("slip"), _distance),
        "steady_slip_per_metre": Metric(
            f"slip per metre {LATER}", "m/m", _mean("steady_slip"), _steady_distance, "log"
        ),
        "cost_of_transport": Metric(COST, "1", _per_weight("work"), _distance),
        "steady_cost_of_transport": Metric(
            f"{COST} {LATER}", "1", _per_weight("steady_work"), _steady_distance, "log"
        ),
        "electrical_cost_of_transport": Metric(
            "electrical cost of transport", "1", _per_weight("drawn"), _distance, ""
        ),
        "start_slip": Metric(
            f"slip {FIRST}", "m", lambda run, _: run["slip"] - run["steady_slip"], axis=""
        ),
        "start_work": Metric(f"work / weight {FIRST}", "m", _start_work, axis=""),
        "start_lag": Metric(f"behind the command {LATER}", "m", _start_lag, axis=""),
        "falls": Metric("falls", "fraction", _mean("fell"), axis="fraction"),
        "peak_torque": Metric("peak torque", "N m", _mean("peak_torque"), axis=""),
        "rms_torque": Metric("RMS torque", "N m", _mean("rms_torque")),
        "torque_change": Metric(
            "change of torque per step", "N m", _per_step("torque_change"), axis=""
        ),
    },
    baselines=walker_baselines.BASELINES,
)

WORLD = replace(
    WALKER,
    commands=(0.1, 0.2, 0.3, 0.4, 0.5),
    metrics=WALKER.metrics | {"success": Metric("success", "fraction", succeeded, axis="fraction")},
    chosen_by="success",
    variety=4,
)

CRANK = Benchmark(
    commands=(1.0,),
    command_unit="rad/s",
    aggregates={
        "rms_error": Aggregate("rms", lambda info: info["tracking_error"]),
        "peak_error": Aggregate("peak", lambda info: info["tracking_error"]),
        "work": Aggregate("sum", lambda info: info["energy"]["motor_work"]),
        "lost": Aggregate("last", lambda info: np.abs(info["tracking_error"]) > LOST),
        **TORQUE,
    },
    metrics={
        "return": Metric("return", "", _mean("returns")),
        "rms_error": Metric("RMS tracking error", "rad", _mean("rms_error")),
        "peak_error": Metric("peak tracking error", "rad", _mean("peak_error")),
        # Whoever turns the crank feeds the same friction: policies differ in the last digits.
        "rms_torque": Metric("RMS torque", "N m", _mean("rms_torque"), digits=4),
        "peak_torque": Metric("peak torque", "N m", _mean("peak_torque")),
        "power": Metric("mean motor power", "W", lambda run, _: run["work"] / run["duration"]),
        "lost": Metric("lost", "fraction", _mean("lost"), axis=""),
    },
    baselines=crank_baselines.BASELINES,
)

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
        "return": Metric("return", "", _mean("returns")),
        "success": Metric("success", "fraction", _mean("success"), axis="fraction"),
        "time": Metric("time to success", "s", _time_to_success),
        "work": Metric("work / weight", "m", _per_weight("work")),
        "slip": Metric("slip", "m", _mean("slip")),
        "falls": Metric("falls", "fraction", _mean("fell"), axis="fraction"),
    },
    baselines={"pid": GoalPid},
    option="goal",
    drawn=(-FARTHEST, FARTHEST),
)

BENCHMARKS: dict[str, Benchmark] = {
    "JansenWalker-v0": WALKER,
    "JansenWalkerBuilt-v0": WALKER,
    "JansenWalkerRough-v0": WORLD,
    "JansenWalkerHardcore-v0": WORLD,
    "JansenCrank-v0": CRANK,
    "JansenGoal-v0": GOAL,
}
DEFAULT = "JansenWalkerBuilt-v0"  # of the commands, where no other is named
WALKERS = [name for name in BENCHMARKS if name.startswith("JansenWalker")]


def find_benchmark(env_id: str) -> Benchmark:
    """Return the benchmark of an environment.

    No other id may reach ``gym.make``, which imports "MODULE:ID".

    Raises:
        ValueError: no benchmark is known for this id.
    """
    return BENCHMARKS[one_of("environment id", env_id, sorted(BENCHMARKS))]


def can_be_batched(
    env_id: str, env_kwargs: dict[str, Any], variants: Sequence[dict[str, Any]] = ({},)
) -> bool:
    """Whether one batch can hold environments with these arguments."""
    task = vector_env(env_id).TASK
    given = [variant.get("robot", env_kwargs.get("robot", "paper")) for variant in variants]
    each = [one for robots in given for one in (robots if isinstance(robots, list) else [robots])]
    return (
        len({leg_sides(load_robot("robot", robot)) for robot in each}) == 1
        and all(env_kwargs.get(name, value) == value for name, value in task.SINGLE_ONLY.items())
        and env_kwargs.get("render_mode") in (None, "rgb_array")
        and all(set(variant) <= {*task.PER_ROBOT, "max_episode_steps"} for variant in variants)
    )


def vector_env(env_id: str) -> Any:
    """The vector environment of a task."""
    entry: Any = gym.spec(env_id).vector_entry_point
    return load_env_creator(entry)


def check_env_kwargs(env_id: str, env_kwargs: dict[str, Any]) -> None:
    """Check the names of an environment's arguments, and its time limit; it checks the rest itself.

    Gymnasium's own arguments, with which other code could be made to run, are refused.

    Raises:
        ValueError: an unknown id or argument, no time limit, or a ``render_mode`` with windows.
    """
    find_benchmark(env_id)
    entry: Any = gym.spec(env_id).entry_point
    allowed = {*inspect.signature(load_env_creator(entry)).parameters, "max_episode_steps"}
    if env_kwargs.get("render_mode") == "human":
        raise ValueError("render_mode is 'human', must be None or 'rgb_array' for many robots")
    for name in env_kwargs:
        if name not in allowed:
            known = listed(sorted(allowed), name)
            raise ValueError(f"{name!r} is no argument of {env_id}, must be in {known}")
    if "max_episode_steps" in env_kwargs:  # -1, no limit, would be an episode without an end
        positive_integer("max_episode_steps", env_kwargs["max_episode_steps"])
