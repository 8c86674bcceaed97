"""Scores of policies on the same episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from jansen_env.baselines.policy import Policy
from jansen_env.checks import instance, numbers_of, positive_integer, shown, whole_number
from jansen_env.scoring.benchmarks import DEFAULT, find_benchmark
from jansen_env.scoring.metrics import (
    Summary,
    main_metrics,
    pooled,
    score_cells,
    screen_table,
    summarise,
    tabled,
)
from jansen_env.scoring.rollout import (
    Advance,
    EnvKwargs,
    Options,
    draw_episodes,
    make_env,
    no_progress,
    run_episodes,
)

MOST_EPISODES = 100_000  # per command
FIRST_SEED = 40_000  # of scored episodes; training, tuning and selection use others


class Scores(dict[str, Summary]):
    """Summary of :func:`evaluate` by policy, on the environment ``env_id``."""

    def __init__(self, env_id: str, summaries: Mapping[str, Summary] | None = None) -> None:
        super().__init__(summaries or {})
        self.env_id = env_id

    def table(self, all_metrics: bool = False) -> str:
        """Return a table of the main metrics, or of all with their 95 % intervals."""
        metrics = find_benchmark(self.env_id).metrics
        shown, parts = (tabled(metrics), 3) if all_metrics else (main_metrics(metrics), 1)
        cells = score_cells(shown, self, parts)
        if len(self) <= len(shown):
            cells = [list(row) for row in zip(*cells, strict=True)]
        return screen_table(cells)


def evaluate(
    policies: Mapping[str, Policy], env_id: str = DEFAULT,
    env_kwargs: EnvKwargs | None = None,
    commands: Sequence[float] | None = None, episodes: int = 10, seed: int = 0,
    drawn: bool = False, options: Options | None = None, advance: Advance = no_progress,
) -> Scores:  # fmt: skip
    """Score policies, by name, on the same episodes, each with a different start.

    Args:
        policies: anything with ``predict``, as a model of Stable-Baselines3 has it.
        env_id, env_kwargs: environment, and its arguments.
        commands: speeds or goals; None for the benchmark's own grid. drawn: whether they are drawn
            from the environment's whole range instead.
        episodes: per command, or of ``drawn`` ones in all. seed: of commands and starts.
        options: of each episode's reset, (n,) by name.
        advance: called with the number of episodes that ran since its last call, also with parts
            of them.

    Returns:
        For each policy :func:`jansen_env.scoring.metrics.summarise`, or with ``drawn``
        :func:`jansen_env.scoring.metrics.pooled`, and its episodes under ``"raw"``;
        ``print(scores.table())`` shows them.

    Raises:
        ValueError: an argument, also of the environment, or a command is not allowed.
    """
    for name, value in (("policies", policies), ("env_kwargs", env_kwargs), ("options", options)):
        instance(name, {} if value is None else value, Mapping)
    episodes = positive_integer("episodes", episodes, MOST_EPISODES)
    seed = whole_number("seed", seed)
    env_kwargs = env_kwargs or {}
    benchmark = find_benchmark(env_id)
    grid = numbers_of(benchmark.commands if commands is None else commands)
    if grid.ndim != 1 or not grid.size or not np.isfinite(grid).all():
        raise ValueError(f"commands must be at least one finite number, got {shown(commands)}")
    if drawn and commands is not None:
        raise ValueError("drawn is True, so commands must be None")
    env, scores = make_env(env_id, env_kwargs), Scores(env_id)
    if drawn:
        command, seeds = draw_episodes(env, episodes, seed)
    else:
        command = np.repeat(grid, episodes)
        seeds = FIRST_SEED + seed * len(command) + np.arange(len(command))
    summary = pooled if drawn else summarise
    for name, policy in policies.items():
        run = run_episodes(policy, env_id, env_kwargs, command, seeds, options=options,
                           advance=advance)  # fmt: skip
        raw = {key: values.tolist() for key, values in run.items()}
        scores[name] = {**summary(benchmark.metrics, run, env, seed), "raw": raw}
    env.close()
    return scores
