"""Running a policy: episodes side by side, one prediction for all of them at each step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.metrics import Array, Episodes
from agents.policy import Policy
from agents.tasks import Task, check_env_kwargs, find_task

REDUCTIONS: dict[str, Callable[[Any, Any, float], Any]] = {
    "sum": lambda total, value, dt: total + value,
    "peak": lambda total, value, dt: max(total, abs(value)),
    "rms": lambda total, value, dt: total + value**2 * dt,  # its mean and root at the end
    "last": lambda total, value, dt: value,
}


def make_env(env_id: str, env_kwargs: dict[str, Any], **more: Any) -> gym.Env[Any, Any]:
    """``gym.make`` of one of :data:`agents.tasks.TASKS`.

    Raises:
        ValueError: another id, or an argument that the environment does not take.
    """
    arguments = {**env_kwargs, **more}
    check_env_kwargs(env_id, arguments)
    return gym.make(env_id, **arguments)


def run_episodes(
    policy: Policy,
    env_id: str,
    env_kwargs: dict[str, Any],
    commands: Array,
    seeds: NDArray[np.int64],
    at_once: int = 64,
) -> Episodes:
    """Run one episode for each pair of command and seed, up to ``at_once`` side by side.

    Args:
        policy: acts deterministically.
        env_id, env_kwargs: of the environment, one of :data:`agents.tasks.TASKS`.
        commands: (n,) speed commands, in the task's unit. seeds: (n,) of each episode's reset.

    Raises:
        ValueError: no task is known for ``env_id``.
    """
    task, rows = find_task(env_id), []
    envs = [make_env(env_id, env_kwargs) for _ in range(min(at_once, len(commands)))]
    for begin in range(0, len(commands), at_once):
        part = slice(begin, begin + at_once)
        rows += _run_side_by_side(policy, envs, task, commands[part], seeds[part])
    for env in envs:
        env.close()
    run = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    for name, aggregate in task.aggregates.items():
        if aggregate.reduction == "rms":
            run[name] = np.sqrt(run[name] / np.maximum(run["duration"], 1e-12))
    return run


def _run_side_by_side(
    policy: Policy, envs: list[Any], task: Task, commands: Array, seeds: NDArray[np.int64]
) -> list[dict[str, Any]]:
    """One episode in each environment; what is kept of each."""
    rows: list[dict[str, Any]] = [
        {"command": command, **dict.fromkeys(("returns", "duration", *task.aggregates), 0.0)}
        for command in commands.tolist()
    ]
    observations = np.stack(
        [
            env.reset(seed=seed, options={"speed_command": row["command"]})[0]
            for env, seed, row in zip(envs, seeds.tolist(), rows, strict=False)
        ]
    )
    running, state = np.ones(len(rows), bool), None
    starts = running.copy()
    while running.any():
        actions, state = policy.predict(observations, state, starts, True)
        starts = np.zeros(len(rows), bool)
        for i in np.flatnonzero(running):
            row, dt = rows[i], envs[i].unwrapped.control_dt
            observations[i], reward, terminated, truncated, info = envs[i].step(actions[i])
            row["returns"] += float(reward)
            row["duration"] += dt
            for name, (reduction, function) in task.aggregates.items():
                row[name] = REDUCTIONS[reduction](row[name], function(info), dt)
            running[i] = not (terminated or truncated)
    return rows
