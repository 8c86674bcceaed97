"""Running a policy: episodes side by side, one prediction for all of them at each step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from jansen_env.arrays import Array, Ints
from jansen_env.baselines.policy import Policy
from jansen_env.scoring.benchmarks import can_be_batched, check_env_kwargs, find_benchmark
from jansen_env.scoring.metrics import SETTLING, Benchmark, Env, Episodes

DRAWN_SEED = 20_000  # of episodes with drawn commands: training, tuning and other scores use others

EnvKwargs: TypeAlias = dict[str, Any]
"""Arguments of an environment."""

Options: TypeAlias = dict[str, NDArray[Any]]
"""Options of each episode's reset, (n,) by name."""

Advance: TypeAlias = Callable[[float], None]
"""Called with the amount of work, such as episodes, that has been done since its last call."""

VectorEnv: TypeAlias = gym.vector.VectorEnv[Any, Any, Any]

REDUCTIONS: dict[str, Callable[..., Array]] = {
    "sum": lambda total, value, **_: total + value,
    "steady": lambda total, value, early, **_: total if early else total + value,
    "peak": lambda total, value, **_: np.maximum(total, np.abs(value)),
    "rms": lambda total, value, dt, **_: total + np.square(value) * dt,  # mean and root at the end
    "last": lambda total, value, **_: value,
    "early": lambda total, value, early, **_: value if early else total,
    "change": lambda total, value, last, **_: total + np.abs(value - last),
}
"""From the total so far and a step's value; ``early``: the step ends within SETTLING; ``dt``: of a
step, s; ``last``: the value before."""


def no_progress(amount: float) -> None:
    """Show no progress."""


def make_env(env_id: str, env_kwargs: EnvKwargs, **more: object) -> Env:
    """``gym.make`` of a benchmark's id; ``env_kwargs`` come from users and are checked.

    Raises:
        ValueError: another id, or an argument that the environment does not take.
    """
    check_env_kwargs(env_id, env_kwargs)
    return gym.make(env_id, **{**env_kwargs, **more})


def draw_episodes(env: Env, count: int, seed: int = 0) -> tuple[Array, Ints]:
    """Return commands (count,), uniform in the range of ``env``, and seeds (count,) of resets."""
    benchmark = find_benchmark(env.get_wrapper_attr("spec").id)
    low, high = benchmark.drawn or (
        env.get_wrapper_attr("task").speed_command[0] if benchmark.option else (0.0, 0.0)
    )
    commands = np.random.default_rng([DRAWN_SEED, seed]).uniform(low, high, count)
    return commands, DRAWN_SEED + seed * 1_000_000 + np.arange(count)


def make_envs(env_id: str, env_kwargs: EnvKwargs, count: int) -> VectorEnv:
    """``gym.make_vec`` of one of them: simulated together where that is possible.

    Raises:
        ValueError: another id, or an argument that the environment does not take.
    """
    check_env_kwargs(env_id, env_kwargs)
    together = can_be_batched(env_id, env_kwargs)
    return gym.make_vec(
        env_id, count, None if together else "sync",
        {} if together else {"autoreset_mode": AutoresetMode.NEXT_STEP}, **env_kwargs,
    )  # fmt: skip


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
    """Run one episode for each pair of command and seed, up to ``at_once`` side by side.

    An episode is what it is alone, bit for bit, if the policy's actions do not depend on how many
    it is asked for; it acts deterministically.

    Args:
        commands: (n,), in the benchmark's unit. seeds: (n,) of each episode's reset.
        options: more of them for each reset, (n,) by name. envs: of :func:`make_envs` with
            ``at_once`` robots, used and left open, where n is a multiple of that.
        advance: called with the number of episodes that ran since its last call, also with parts
            of them.

    Raises:
        ValueError: no benchmark is known for ``env_id``.
    """
    benchmark, parts = find_benchmark(env_id), []
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
    policy: Policy, envs: VectorEnv, benchmark: Benchmark, options: Options, seeds: Ints,
    longest: int, advance: Advance,
) -> Episodes:  # fmt: skip
    n, dt = len(seeds), envs.get_attr("control_dt")[0]  # type: ignore[attr-defined]
    totals: Episodes = {}
    ranked = {name: a for name, a in benchmark.aggregates.items() if a.reduction == "p99"}
    kept: dict[str, list[Array]] = {name: [] for name in ranked}
    last: Episodes = {}
    left = float(n)
    observations = _reset(envs, options, seeds)
    running, starts, state, time = np.ones(n, bool), np.ones(n, bool), None, 0.0
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
    advance(left)  # of episodes that ended early
    return totals | {name: np.nanpercentile(steps, 99.0, axis=0) for name, steps in kept.items()}


def _reset(envs: VectorEnv, options: Options, seeds: Ints) -> NDArray[np.float32]:
    """Start the episodes; returns their first observations (n, d)."""
    if not isinstance(envs, gym.vector.SyncVectorEnv):
        return envs.reset(seed=seeds.tolist(), options=options)[0]
    # It has one set of options for all: the first time for everyone, then one after another.
    for k in range(len(seeds)):
        named = {} if k == 0 else {"reset_mask": np.arange(len(seeds)) == k}
        given = {name: values[k] for name, values in options.items()}
        observations, _ = envs.reset(seed=seeds.tolist(), options={**given, **named})
    return observations
