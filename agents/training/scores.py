"""Comparison of a run's best model with the baselines: score files and the final summary."""

import json
import shlex
from pathlib import Path

from agents.training.runs import BEST, FINAL, read_evaluations
from jansen_env.cli.named_policies import label, load_named
from jansen_env.cli.plots import write_scores
from jansen_env.cli.progress import progress
from jansen_env.sb3.run_config import RunConfig
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.evaluation import Scores, evaluate
from jansen_env.scoring.metrics import interval_text
from jansen_env.scoring.rollout import make_env


def score_run(folder: Path, config: RunConfig, episodes: int) -> Scores:
    """Score the best model of a run and the baselines; write scores.json, scores.md and scores.png.

    Args:
        folder: Folder of the run.
        config: Configuration of the run.
        episodes: Number of episodes per command.

    Raises:
        ValueError: If a file is damaged. The message names the file.
    """
    model = folder / BEST if (folder / BEST).is_file() else folder / FINAL
    env_id = config.env
    env_kwargs = config.env_kwargs
    benchmark = find_benchmark(env_id)
    env = make_env(env_id, env_kwargs)
    policies = {name: load_named(name, env) for name in benchmark.baselines}
    policies[label(str(model))] = load_named(str(model), env)
    env.close()
    total = len(policies) * len(benchmark.commands) * episodes
    with progress("scoring", total) as advance:
        scores = evaluate(policies, env_id, env_kwargs, episodes=episodes, advance=advance)
    write_scores(scores, folder)
    return scores


def outcome(folder: Path, config: RunConfig, scores: Scores) -> str:
    """Return the summary that is printed at the end of a run.

    The summary compares the main metrics of the run with those of the baselines and tells whether
    the run beats them.

    Args:
        folder: Folder of the run.
        config: Configuration of the run.
        scores: Scores that :func:`score_run` returned.
    """
    *baselines, run = scores
    shown = {"this run": scores[run], **{name: scores[name] for name in baselines}}
    ours, *others = (scores[policy]["overall"]["return"] for policy in (run, *baselines))
    most, best = max(zip(others, baselines, strict=True))
    verdict = "misses"
    since = ""
    if ours[0] > most[0]:
        verdict = "is above"
        ahead = [row["steps"] for row in read_evaluations(folder) if row["return"] > most[0]]
        if ahead:
            since = f" (since {ahead[0]:,.0f} steps)"
    watch = ["jansen-env", "enjoy", "--env", config.env, "--policy", str(folder)]
    if config.env_kwargs:
        watch += ["--env-kwargs", json.dumps(config.env_kwargs)]
    return "\n".join(
        [
            Scores(scores.env_id, shown).table(),
            f"return {interval_text(ours)} {verdict} the best baseline, "
            f"{best}'s {interval_text(most)}{since}",
            f"brackets: 95 % intervals; episodes: {scores[run]['episodes']}; all scores: "
            f"{folder}/scores.md, scores.png",
            f"watch it: {shlex.join(watch)}",
        ]
    )
