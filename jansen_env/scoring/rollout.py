"""Rollouts of a policy: many episodes side by side, with one call of the policy per step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from jansen_env.arrays import Array, Ints
from jansen_env.policies.policy import Policy
from jansen_env.scoring.benchmarks import can_be_batched, check_env_kwargs, find_benchmark
from jansen_env.scoring.metrics import SETTLING, Benchmark, Env, Episodes

# First seed of episodes with sampled commands. Training, tuning and other scores use other seeds.
DRAWN_SEED = 20_000

EnvKwargs: TypeAlias = dict[str, Any]
"""Arguments of an environment."""

Options: TypeAlias = dict[str, NDArray[Any]]
"""Options of the reset of each episode, by name; each has shape (n,)."""

Advance: TypeAlias = Callable[[float], None]
"""Function that is called with the amount of work, such as episodes, done since its last call."""

VectorEnv: TypeAlias = gym.vector.VectorEnv[Any, Any, Any]
"""Vector environment of Gymnasium."""

REDUCTIONS: dict[str, Callable[..., Array]] = {
    "sum": lambda total, value, **_: total + value,
    "steady": lambda total, value, early, **_: total if early else total + value,
    "peak": lambda total, value, **_: np.maximum(total, np.abs(value)),
    # The mean and the root follow at the end of the episode.
    "rms": lambda total, value, dt, **_: total + np.square(value) * dt,
    "last": lambda total, value, **_: value,
    "early": lambda total, value, early, **_: value if early else total,
    "change": lambda total, value, last, **_: total + np.abs(value - last),
}
"""Functions that add the value of a step to the total of an episode, by the name of the reduction.

``early`` tells whether the step ends within SETTLING, ``dt`` is the duration of the step in s, and
``last`` is the value of the previous step.
"""


def no_progress(amount: float) -> None:
    """Ignore the progress of a computation.

    Args:
        amount: Amount of work done.
    """


def make_env(env_id: str, env_kwargs: EnvKwargs, **more: object) -> Env:
    """Make an environment of a benchmark with ``gym.make``.

    Args:
        env_id: Id of the environment.
        env_kwargs: Arguments of the environment. They come from users and are checked.
        more: Further arguments, which are not checked.

    Raises:
        ValueError: If there is no benchmark for the id, or the environment does not take an
            argument.
    """
    check_env_kwargs(env_id, env_kwargs)
    return gym.make(env_id, **{**env_kwargs, **more})


def draw_episodes(env: Env, count: int, seed: int = 0) -> tuple[Array, Ints]:
    """Sample the commands of episodes, uniformly within the range of the environment.

    Args:
        env: The environment.
        count: Number of episodes.
        seed: Seed of the commands and of the resets.

    Returns:
        The command of each episode, in the unit of the benchmark, and the seed of its reset. Both
        have shape (count,).
    """
    benchmark = find_benchmark(env.get_wrapper_attr("spec").id)
    low, high = benchmark.drawn or (
        env.get_wrapper_attr("task").speed_command[0] if benchmark.option else (0.0, 0.0)
    )
    commands = np.random.default_rng([DRAWN_SEED, seed]).uniform(low, high, count)
    return commands, DRAWN_SEED + seed * 1_000_000 + np.arange(count)


def make_envs(env_id: str, env_kwargs: EnvKwargs, count: int) -> VectorEnv:
    """Make a vector environment of a benchmark with ``gym.make_vec``.

    The robots are simulated in one batch if the arguments allow that.

    Args:
        env_id: Id of the environment.
        env_kwargs: Arguments of the environment.
        count: Number of robots.

    Raises:
        ValueError: If there is no benchmark for the id, or the environment does not take an
            argument.
    """
    check_env_kwargs(env_id, env_kwargs)
    together = can_be_batched(env_id, env_kwargs)
    return gym.make_vec(
        env_id,
        count,
        None if together else "sync",
        {} if together else {"autoreset_mode": AutoresetMode.NEXT_STEP},
        **env_kwargs,
    )


def run_episodes(
    policy: Policy,
    env_id: str,
    env_kwargs: EnvKwargs,
    commands: Array,
    seeds: Ints,
    at_once: int = 256,
    options: Options | None = None,
    envs: VectorEnv | None = None,
    advance: Advance = no_progress,
) -> Episodes:
    """Run one episode for each pair of command and seed.

    The policy acts deterministically. Each episode is bit for bit the same as it would be alone,
    provided that an action of the policy does not depend on how many actions it computes at once.

    Args:
        policy: The policy.
        env_id: Id of the environment.
        env_kwargs: Arguments of the environment.
        commands: Command of each episode, in the unit of the benchmark, shape (n,).
        seeds: Seed of the reset of each episode, shape (n,).
        at_once: Largest number of episodes that run side by side.
        options: Further options of the reset of each episode, by name, each with shape (n,).
        envs: Environment of :func:`make_envs` with ``at_once`` robots, which is used and left open.
            n must be a multiple of ``at_once`` in that case. None to make new environments.
        advance: Function that is called with the number of episodes that ran since its last call.
            The number may contain fractions of episodes.

    Returns:
        Values of each episode, by name, each with shape (n,).

    Raises:
        ValueError: If there is no benchmark for ``env_id``.
    """
    benchmark = find_benchmark(env_id)
    parts = []
    every: Options = {**benchmark.options(commands), **(options or {})}
    longest = env_kwargs.get("max_episode_steps") or gym.spec(env_id).max_episode_steps or 1
    for begin in range(0, len(commands), at_once):
        part = slice(begin, begin + at_once)
        used = make_envs(env_id, env_kwargs, len(commands[part])) if envs is None else envs
        given = {name: values[part] for name, values in every.items()}
        parts.append(
            _run_side_by_side(policy, used, benchmark, given, seeds[part], longest, advance)
        )
        if envs is None:
            used.close()
    run = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    run = {"command": np.asarray(commands), **run}
    for name, aggregate in benchmark.aggregates.items():
        if aggregate.reduction == "rms":
            run[name] = np.sqrt(run[name] / np.maximum(run["duration"], 1e-12))
    return run


def _run_side_by_side(
    policy: Policy,
    envs: VectorEnv,
    benchmark: Benchmark,
    options: Options,
    seeds: Ints,
    longest: int,
    advance: Advance,
) -> Episodes:
    """Run one episode on each robot of a vector environment.

    Args:
        policy: The policy.
        envs: Vector environment with one robot per episode.
        benchmark: Benchmark whose aggregates are computed.
        options: Options of the reset of each episode, by name, each with shape (n,).
        seeds: Seed of the reset of each episode, shape (n,).
        longest: Largest number of steps of an episode, by which the progress is computed.
        advance: Function that is called with the progress, in episodes.

    Returns:
        Values of each episode, by name, each with shape (n,).
    """
    n = len(seeds)
    dt = envs.get_attr("control_dt")[0]  # type: ignore[attr-defined]
    totals: Episodes = {}
    ranked = {name: a for name, a in benchmark.aggregates.items() if a.reduction == "p99"}
    kept: dict[str, list[Array]] = {name: [] for name in ranked}
    last: Episodes = {}
    left = float(n)
    observations = _reset(envs, options, seeds)
    running = np.ones(n, bool)
    starts = np.ones(n, bool)
    state = None
    time = 0.0
    while running.any():
        actions, state = policy.predict(observations, state, starts, True)
        starts = np.zeros(n, bool)
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        time += dt
        values = {"returns": ("sum", rewards), "duration": ("sum", np.full(n, dt))}
        for name, (reduction, function) in benchmark.aggregates.items():
            if name in ranked:
                kept[name].append(np.where(running, function(infos), np.nan))
            else:
                values[name] = reduction, function(infos)
        for name, (how, value) in values.items():
            before = totals.get(name, np.zeros_like(value))
            more = {"early": time < SETTLING + 0.5 * dt, "dt": dt, "last": last.get(name, 0.0)}
            totals[name] = np.where(running, REDUCTIONS[how](before, value, **more), before)
            last[name] = value
        running &= ~(terminated | truncated)
        advance(n / longest)
        left -= n / longest
    advance(left)  # the rest of the episodes that ended early
    return totals | {name: np.nanpercentile(steps, 99.0, axis=0) for name, steps in kept.items()}


def _reset(envs: VectorEnv, options: Options, seeds: Ints) -> NDArray[np.float32]:
    """Start the episodes, and return their first observations, shape (n, d)."""
    if not isinstance(envs, gym.vector.SyncVectorEnv):
        return envs.reset(seed=seeds.tolist(), options=options)[0]
    # SyncVectorEnv takes one set of options for all robots. Reset all robots with the options of
    # the first one, and then the others one after another with their own options.
    for k in range(len(seeds)):
        named = {} if k == 0 else {"reset_mask": np.arange(len(seeds)) == k}
        given = {name: values[k] for name, values in options.items()}
        observations, _ = envs.reset(seed=seeds.tolist(), options={**given, **named})
    return observations
