"""A finished run scored against the baselines: table, figures, and what came out of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from agents.evaluate import evaluate, label
from agents.plots import plot_scores, plot_training
from agents.training.models import load_policy
from agents.training.runs import BEST, FINAL, read_evaluations
from jansen_env.files import write_json
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.metrics import score_table
from jansen_env.scoring.rollout import make_env

Scores = dict[str, dict[str, Any]]
"""Of each policy what :func:`agents.evaluate.evaluate` gives; the run's own comes last."""


def score_run(folder: Path, config: dict[str, Any], episodes: int) -> Scores:
    """Score a run's best model and the baselines; writes scores.json and the figures.

    Args:
        folder: the run's. config: its configuration. episodes: per command.

    Raises:
        ValueError: the run's files are damaged, or it has no model yet.
    """
    model = folder / BEST if (folder / BEST).is_file() else folder / FINAL
    env_id, env_kwargs = config["env"], config.get("env_kwargs", {})
    benchmark, name = find_benchmark(env_id), label(str(model))
    env = make_env(env_id, env_kwargs)
    policies = {baseline: load(env.unwrapped) for baseline, load in benchmark.baselines.items()}
    policies[name] = load_policy(model)
    env.close()
    scores = evaluate(policies, env_id, env_kwargs, episodes=episodes)
    write_json(folder / "scores.json", scores)
    plot_scores(benchmark, scores, folder / "scores.png")
    evaluations = read_evaluations(folder)
    if evaluations:
        levels = {baseline: _mean_return(scores[baseline]) for baseline in benchmark.baselines}
        plot_training(evaluations, levels, folder / "training.png")
    return scores


def outcome(folder: Path, env_id: str, scores: Scores) -> str:
    """Return what :func:`score_run` found, in words and a Markdown table."""
    benchmark = find_benchmark(env_id)
    baseline, run = next(iter(benchmark.baselines)), list(scores)[-1]
    target, table = _mean_return(scores[baseline]), score_table(benchmark.metrics, scores)
    lines = [table, "brackets: 95 % intervals over episodes, not seeds"]
    ahead = [row for row in read_evaluations(folder) if row["return"] > target]
    if ahead and "seconds" in ahead[0]:
        steps, seconds = ahead[0]["steps"], ahead[0]["seconds"]
        lines.append(f"ahead of {baseline} at the evaluation after {steps:.0f} steps, "
                     f"{seconds:.0f} s from the start")  # fmt: skip
    lines.append(f"return: {_mean_return(scores[run]):.0f} against {target:.0f} of {baseline}; "
                 f"figures in {folder}")  # fmt: skip
    return "\n".join(lines)


def _mean_return(score: dict[str, Any]) -> float:
    return float(score["overall"]["return"][0])
