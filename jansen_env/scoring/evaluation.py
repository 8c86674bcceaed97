"""Evaluation of policies on the same episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from jansen_env.checks import instance, numbers_of, positive_integer, shown, whole_number
from jansen_env.policies.policy import Policy
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

MOST_EPISODES = 100_000  # largest number of episodes per command
# First seed of scored episodes. Training, tuning and selection use other seeds.
FIRST_SEED = 40_000


class Scores(dict[str, Summary]):
    """Summaries of :func:`evaluate`, by name of the policy.

    Args:
        env_id: Id of the environment on which the policies were scored.
        summaries: The summaries. None for no summaries.

    Attributes:
        env_id: Id of the environment on which the policies were scored.
    """

    def __init__(self, env_id: str, summaries: Mapping[str, Summary] | None = None) -> None:
        super().__init__(summaries or {})
        self.env_id = env_id

    def table(self, all_metrics: bool = False) -> str:
        """Return a table of the scores.

        Args:
            all_metrics: Whether to include all metrics with their 95 % intervals, instead of only
                the values of the main metrics.
        """
        metrics = find_benchmark(self.env_id).metrics
        shown, parts = (tabled(metrics), 3) if all_metrics else (main_metrics(metrics), 1)
        cells = score_cells(shown, self, parts)
        if len(self) <= len(shown):
            cells = [list(row) for row in zip(*cells, strict=True)]
        return screen_table(cells)


def evaluate(
    policies: Mapping[str, Policy],
    env_id: str = DEFAULT,
    env_kwargs: EnvKwargs | None = None,
    commands: Sequence[float] | None = None,
    episodes: int = 10,
    seed: int = 0,
    drawn: bool = False,
    options: Options | None = None,
    advance: Advance = no_progress,
) -> Scores:
    """Score policies on the same episodes, each of which has a different initial state.

    ``print(scores.table())`` shows the scores.

    Args:
        policies: Policies, by name: objects with the method ``predict``, such as models of
            Stable-Baselines3.
        env_id: Id of the environment.
        env_kwargs: Arguments of the environment. None for no arguments.
        commands: Commands at which the policies are scored, such as speeds or positions of goals.
            None for the commands of the benchmark.
        episodes: Number of episodes per command; with ``drawn``, the total number of episodes.
        seed: Seed of the commands and the initial states.
        drawn: Whether to sample the commands from the whole range of the environment. ``commands``
            must then be None.
        options: Reset options of each episode, by name, each with shape (n,).
        advance: Function that is called with the number of episodes that ran since its last call.
            The number may contain fractions of episodes.

    Returns:
        For each policy the result of :func:`jansen_env.scoring.metrics.summarise`, or with
            ``drawn`` of :func:`jansen_env.scoring.metrics.pooled`. In addition, ``"raw"`` contains
            the values of the policy's episodes.

    Raises:
        ValueError: If an argument (also of the environment) or a command is not allowed.
    """
    for name, value in (("policies", policies), ("env_kwargs", env_kwargs), ("options", options)):
        instance(name, {} if value is None else value, Mapping)
    episodes = positive_integer("episodes", episodes, MOST_EPISODES)
    seed = whole_number("seed", seed)
    env_kwargs = env_kwargs or {}
    benchmark = find_benchmark(env_id)
    grid = numbers_of(benchmark.commands if commands is None else commands)
    if grid.ndim != 1 or not grid.size or not np.isfinite(grid).all():
        raise ValueError(f"commands must be finite numbers, at least one, got {shown(commands)}")
    if drawn and commands is not None:
        raise ValueError(f"commands must be None with drawn, got {shown(commands)}")
    env = make_env(env_id, env_kwargs)
    scores = Scores(env_id)
    if drawn:
        command, seeds = draw_episodes(env, episodes, seed)
    else:
        command = np.repeat(grid, episodes)
        seeds = FIRST_SEED + seed * len(command) + np.arange(len(command))
    summary = pooled if drawn else summarise
    for name, policy in policies.items():
        run = run_episodes(
            policy, env_id, env_kwargs, command, seeds, options=options, advance=advance
        )
        raw = {key: values.tolist() for key, values in run.items()}
        scores[name] = {**summary(benchmark.metrics, run, env, seed), "raw": raw}
    env.close()
    return scores
