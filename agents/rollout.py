"""Running a policy: episodes side by side, one prediction for all of them at each step."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.policy import Policy
from agents.tasks import Episodes, Task, Total, check_env_kwargs, find_task

Array = NDArray[np.float64]


def make_env(env_id: str, env_kwargs: dict[str, Any], **more: Any) -> gym.Env[Any, Any]:
    """``gym.make`` of one of :data:`agents.tasks.TASKS`.

    Raises:
        ValueError: another id, or an argument that the environment does not take.
    """
    arguments = {**env_kwargs, **more}
    check_env_kwargs(env_id, arguments)
    return gym.make(env_id, **arguments)


def none_yet(task: Task, commands: Array) -> Episodes:
    """Episodes of the given commands (n,) with everything else at zero."""
    n = len(commands)
    return {
        "command": np.array(commands, dtype=float),
        "returns": np.zeros(n),
        "duration": np.zeros(n),
        **{
            name: np.zeros(n, bool if total.how == "flag" else float)
            for name, total in task.totals.items()
        },
    }


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
    task, n = find_task(env_id), len(commands)
    result = none_yet(task, commands)
    pool = [make_env(env_id, env_kwargs) for _ in range(min(at_once, n))]
    for begin in range(0, n, at_once):
        episodes = np.arange(begin, min(begin + at_once, n))
        _run_batch(policy, pool, task, result, seeds, episodes)
    for env in pool:
        env.close()
    for name, total in task.totals.items():
        if total.how == "rms":  # a sum of squares times time until now
            result[name] = np.sqrt(result[name] / np.maximum(result["duration"], 1e-12))
    return result


def _run_batch(
    policy: Policy,
    pool: list[gym.Env[Any, Any]],
    task: Task,
    result: Episodes,
    seeds: NDArray[np.int64],
    episodes: NDArray[np.int64],
) -> None:
    observations = np.stack(
        [
            env.reset(seed=int(seeds[e]), options={"speed_command": float(result["command"][e])})[0]
            for env, e in zip(pool, episodes, strict=False)
        ]
    )
    alive = np.ones(len(episodes), bool)
    start, state = np.ones(len(episodes), bool), None
    while alive.any():
        actions, state = policy.predict(observations, state, start, True)
        start = np.zeros(len(episodes), bool)
        for i in np.flatnonzero(alive):
            e, env = episodes[i], pool[i]
            observations[i], reward, terminated, truncated, info = env.step(actions[i])
            dt = float(env.unwrapped.control_dt)  # type: ignore[attr-defined]
            result["returns"][e] += float(reward)
            result["duration"][e] += dt
            for name, total in task.totals.items():
                result[name][e] = _gather(total, result[name][e], info, dt)
            alive[i] = not (terminated or truncated)


def _gather(total: Total, before: Any, info: dict[str, Any], dt: float) -> Any:
    value = total.of(info)
    if total.how == "sum":
        return before + value
    if total.how == "peak":
        return max(before, abs(value))
    if total.how == "rms":
        return before + value**2 * dt
    return value
