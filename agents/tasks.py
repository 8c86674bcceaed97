"""The tasks by environment id: commands, what is gathered and scored, and the baselines."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import load_env_creator
from numpy.typing import NDArray

from agents import crank_baselines, walker_baselines
from agents.policy import Policy
from jansen_env.checks import positive_integer
from jansen_env.envs.crank_task import LOST

Array = NDArray[np.float64]
Episodes = dict[str, NDArray[Any]]
"""Of n episodes, each (n,): "command", "returns", "duration" (s), and the totals of the task."""


class Total(NamedTuple):
    """What is gathered of an episode from each step's ``info``.

    Attributes:
        how: the "sum" over its steps, the "peak" of the absolute value, the "rms" (root of the mean
            square), the "last" value, or whether at the end there is a "flag".
        of: the step's value from its ``info``.
    """

    how: Literal["sum", "peak", "rms", "last", "flag"]
    of: Callable[[dict[str, Any]], Any]


class Metric(NamedTuple):
    """A number for many episodes: the mean of ``of``, or where there is ``per`` the sums' ratio.

    Attributes:
        title, unit: of tables and pictures.
        of: episodes and their environment to a value of each episode (n,).
        per: the same, what the sum of ``of`` is divided by, m.
        axis: in pictures "linear", "log" or "share" (0 to 1); "" for in tables alone.
        digits: in tables.
    """

    title: str
    unit: str
    of: Callable[[Episodes, Any], Array]
    per: Callable[[Episodes, Any], Array] | None = None
    axis: Literal["linear", "log", "share", ""] = "linear"
    digits: int = 3


@dataclass(frozen=True)
class Task:
    """How policies are scored on an environment.

    Attributes:
        commands: the grid of ``speed_command`` on which policies are scored.
        command_unit: its unit.
        totals: what is gathered of each episode, by name.
        metrics: by name; the first is "return".
        baselines: names. rivals: those that ``train.py`` scores against, the main one first.
        load_baseline: one of them by name, for an unwrapped environment.
    """

    commands: tuple[float, ...]
    command_unit: str
    totals: dict[str, Total]
    metrics: dict[str, Metric]
    baselines: tuple[str, ...]
    rivals: tuple[str, ...]
    load_baseline: Callable[[str, Any], Policy]


def _mean(name: str) -> Callable[[Episodes, Any], Array]:
    return lambda run, _: np.asarray(run[name], dtype=float)


def _walked_speed_error(run: Episodes, env: Any) -> Array:
    """Over the full length of an episode: after a fall the robot is taken to stand still."""
    horizon = env.spec.max_episode_steps * env.unwrapped.control_dt
    return np.abs(run["distance"] / horizon - run["command"])


def _work_per_weight(run: Episodes, env: Any) -> Array:
    """|Motor work| / weight, m."""
    return run["work"] / env.unwrapped.weight


def _way(run: Episodes, env: Any) -> Array:
    """Distance in the commanded direction, m."""
    return np.maximum(np.sign(run["command"]) * run["distance"], 0.0)


TORQUE = {
    "peak_torque": Total("peak", lambda info: info["crank_torque"]),
    "rms_torque": Total("rms", lambda info: info["crank_torque"]),
}

WALKER = Task(
    commands=(0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7),
    command_unit="m/s",
    totals={
        "distance": Total("last", lambda info: info["x_position"]),
        "slip": Total("sum", lambda info: info["slip"].sum()),
        "work": Total("sum", lambda info: abs(info["energy"]["motor_work"])),
        # A simulation that diverged is no walk either: it counts as a fall.
        "fell": Total("flag", lambda info: info["fallen"] or info["diverged"]),
        **TORQUE,
    },
    metrics={
        "return": Metric("return", "", _mean("returns")),
        "speed_error": Metric("speed error", "m/s", _walked_speed_error),
        "slip_per_metre": Metric("slip per metre", "m/m", _mean("slip"), _way, "log"),
        "cost_of_transport": Metric("cost of transport", "1", _work_per_weight, _way, "log"),
        "falls": Metric("falls", "share", _mean("fell"), axis="share"),
        "peak_torque": Metric("peak torque", "N m", _mean("peak_torque"), axis=""),
        "rms_torque": Metric("RMS torque", "N m", _mean("rms_torque")),
    },
    baselines=walker_baselines.BASELINES,
    rivals=("pid", "constant"),
    load_baseline=walker_baselines.load_baseline,
)

CRANK = Task(
    commands=(1.0,),
    command_unit="rad/s",
    totals={
        "rms_error": Total("rms", lambda info: info["tracking_error"]),
        "peak_error": Total("peak", lambda info: info["tracking_error"]),
        "work": Total("sum", lambda info: info["energy"]["motor_work"]),
        "lost": Total("flag", lambda info: abs(info["tracking_error"]) > LOST),
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
        "lost": Metric("lost", "share", _mean("lost"), axis=""),
    },
    baselines=crank_baselines.BASELINES,
    rivals=("pid-paper", "constant", "inverse"),
    load_baseline=crank_baselines.load_baseline,
)

TASKS: dict[str, Task] = {"JansenWalker-v0": WALKER, "JansenCrank-v0": CRANK}


def find_task(env_id: str) -> Task:
    """The task of an environment; no other id may reach ``gym.make``, which imports "MODULE:ID".

    Raises:
        ValueError: no task is known for this id.
    """
    if not isinstance(env_id, str) or env_id not in TASKS:
        raise ValueError(f"environment id is {env_id!r}, must be one of {sorted(TASKS)}")
    return TASKS[env_id]


def check_env_kwargs(env_id: str, env_kwargs: dict[str, Any]) -> None:
    """Check the names of an environment's arguments, and its time limit; it checks the rest itself.

    Gymnasium's own arguments, with which other code could be made to run, are not among them.

    Raises:
        ValueError: no task is known for this id, the environment has no argument of a name,
            ``max_episode_steps`` is no limit, or ``render_mode`` opens windows.
    """
    find_task(env_id)
    creator: Any = gym.spec(env_id).entry_point
    constructor = load_env_creator(creator) if isinstance(creator, str) else creator
    allowed = {*inspect.signature(constructor).parameters, "max_episode_steps"}
    if env_kwargs.get("render_mode") == "human":
        raise ValueError("render_mode is 'human', must be None or 'rgb_array' for many robots")
    for name in env_kwargs:
        if name not in allowed:
            raise ValueError(f"{name!r} is no argument of {env_id}, must be in {sorted(allowed)}")
    if "max_episode_steps" in env_kwargs:  # -1, no limit, would be an episode without an end
        positive_integer("max_episode_steps", env_kwargs["max_episode_steps"])
