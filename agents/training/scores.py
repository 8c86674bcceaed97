"""Scores of a run beside the baselines, and what is said of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from agents.training.runs import BEST, FINAL, read_evaluations
from jansen_env.commands.named_policies import label, load_named
from jansen_env.commands.plots import plot_scores
from jansen_env.files import write_json
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.evaluation import Scores, evaluate
from jansen_env.scoring.metrics import score_table
from jansen_env.scoring.rollout import make_env


def score_run(folder: Path, config: dict[str, Any], episodes: int) -> Scores:
    """Score the best model in a run's folder and the baselines, with so many ``episodes`` per
    command; writes scores.json and scores.png. A ValueError names a damaged file."""
    model = folder / BEST if (folder / BEST).is_file() else folder / FINAL
    env_id, env_kwargs = config["env"], config.get("env_kwargs", {})
    benchmark, env = find_benchmark(env_id), make_env(env_id, env_kwargs)
    policies = {name: load_named(name, env) for name in benchmark.baselines}
    policies[label(str(model))] = load_named(str(model), env)
    env.close()
    scores = evaluate(policies, env_id, env_kwargs, episodes=episodes)
    write_json(folder / "scores.json", scores)
    plot_scores(benchmark, scores, folder / "scores.png")
    return scores


def outcome(folder: Path, env_id: str, scores: Scores) -> str:
    """Return scores of :func:`score_run` as a Markdown table and a sentence."""
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
                 f"figure in {folder}")  # fmt: skip
    return "\n".join(lines)


def _mean_return(score: dict[str, Any]) -> float:
    return float(score["overall"]["return"][0])
