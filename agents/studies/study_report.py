"""Report of a study: tables and figures in report.md, numbers in runs.csv and commands.csv.

Intervals are over runs: spread over training runs, not over evaluations. After Agarwal et al.,
"Deep Reinforcement Learning at the Edge of the Statistical Precipice", NeurIPS 2021.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import combinations
from pathlib import Path
from warnings import catch_warnings, simplefilter

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import bootstrap, mannwhitneyu, trim_mean, ttest_1samp

from agents.training.runs import read_evaluations
from jansen_env.commands.plots import save
from jansen_env.files import write_text
from jansen_env.scoring.metrics import (
    CONFIDENCE,
    Array,
    Interval,
    interval_text,
    proportion_with_interval,
)

NOTES = """\
A run's score is the mean return of its best model over the commands; brackets are 95 % intervals
over runs. Means have Student's t interval; the interquartile mean (IQM, the mean of the middle half
of the runs) and P(run of X > run of Y) have that of the BCa bootstrap, P(run > baseline) the exact
one, with the baseline's return taken as exact. With few runs a bootstrap's nominal 95 % cover less:
some 75 % with 3 runs, 90 % with 10. Intervals over episodes are in each run's scores.json."""
SCORES = "*-seed_*/scores.json"  # of finished runs
DASHES = ("--", ":", "-.", (0, (1, 4)))


def write_report(folder: Path) -> str:
    """Write the report of the runs in a study's folder that are finished; return its first table.

    A ValueError names a damaged file.
    """
    if not any(folder.glob(SCORES)):
        return "no run is finished"
    runs, commands, curves = read_runs(folder)
    runs.to_csv(folder / "runs.csv", index=False)
    commands.to_csv(folder / "commands.csv", index=False)
    table = groups_table(runs)
    parts = [f"# {folder.name}", table, improvement_table(runs), NOTES.replace("\n", " ")]
    for env_id, of_env in runs.groupby("env"):
        path = plot(of_env, curves[curves.env == env_id], folder / f"{env_id}.png")
        parts += [f"## {env_id}", f"![Runs on {env_id}]({path.name})"]
    write_text(folder / "report.md", "\n\n".join(parts) + "\n")
    return table


def read_runs(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Return the metrics of each finished run and its baselines, the same by command, and the
    evaluations; ``policy`` is "run" or a baseline's name."""
    rows, commands, curves = [], [], []
    for path in sorted(folder.glob(SCORES)):
        group, _, seed = path.parent.name.rpartition("-seed_")
        try:
            scores = json.loads(path.read_text("utf-8"))
            for number, (name, score) in enumerate(scores.items(), 1):
                policy = "run" if number == len(scores) else name
                key = {"group": group, "env": group.split("_")[0], "seed": int(seed),
                       "policy": policy}  # fmt: skip
                rows.append({**key, **{k: v[0] for k, v in score["overall"].items()}})
                values = {k: v["value"] for k, v in score["by_command"].items()}
                grid = score["by_command"]["return"]["command"]
                commands.append(pd.DataFrame({**key, "command": grid, **values}))
        except (ValueError, LookupError, TypeError, AttributeError) as error:
            raise ValueError(f"{path} is damaged: {error}") from error
        curves.append(pd.DataFrame(read_evaluations(path.parent)).assign(**key))
    return pd.DataFrame(rows), pd.concat(commands), pd.concat(curves)


def groups_table(runs: pd.DataFrame) -> str:
    """Return a Markdown table: of each group a row for each baseline."""
    rows = []
    for group, of_group in runs.groupby("group"):
        runs_of = of_group[of_group.policy == "run"]
        returns, worst = runs_of["return"].to_numpy(), runs_of.loc[runs_of["return"].idxmin()]
        baselines = of_group[of_group.policy != "run"].groupby("policy", sort=False)["return"]
        for baseline, score in baselines.first().items():
            better = proportion_with_interval(int((returns > score).sum()), len(returns))
            rows.append({
                "runs of": group, "finished": len(returns),
                "mean return": interval_text(mean_with_interval(returns)),
                "IQM of return": interval_text(with_interval(interquartile_mean, returns)),
                "worst run": f"{worst['return']:.3g} (seed {worst.seed})",
                "baseline": baseline, "its return": f"{score:.3g}",
                "P(run > baseline)": interval_text(better, 2),
            })  # fmt: skip
    return markdown(pd.DataFrame(rows))


def improvement_table(runs: pd.DataFrame) -> str:
    """Return a Markdown table: the probability that a run of one group is better than another's."""
    groups, rows = runs[runs.policy == "run"].groupby(["env", "group"])["return"], []
    for ((env, x), first), ((other_env, y), second) in combinations(groups, 2):
        if env == other_env:
            better = with_interval(improvement, first.to_numpy(), second.to_numpy())
            rows.append({"X": x, "Y": y, "P(run of X > run of Y)": interval_text(better, 2)})
    return markdown(pd.DataFrame(rows)) if rows else ""


def markdown(table: pd.DataFrame) -> str:
    """Return a table of text in Markdown."""
    return str(table.to_markdown(index=False, tablefmt="github", disable_numparse=True))


def mean_with_interval(values: Array) -> Interval:
    """Return the mean of scores (n,) with Student's interval, which few runs need."""
    if len(values) < 2:
        return float(values[0]), np.nan, np.nan
    low, high = ttest_1samp(values, 0.0).confidence_interval(CONFIDENCE)
    return float(values.mean()), float(low), float(high)


def interquartile_mean(values: Array, axis: int = -1) -> Array:
    """Return the mean of the middle half of the runs: 25 % at either end left out."""
    return np.asarray(trim_mean(values, 0.25, axis=axis))


def improvement(x: Array, y: Array, axis: int = -1) -> Array:
    """Return P(X > Y), the share of all pairs of runs, ties counted half (Mann and Whitney)."""
    pairs = x.shape[axis] * y.shape[axis]
    return np.asarray(mannwhitneyu(x, y, axis=axis, method="asymptotic").statistic / pairs)


def with_interval(statistic: Callable[..., Array], *groups: Array) -> Interval:
    """Return a statistic of runs with its BCa interval (Efron 1987); NaN where it has none."""
    value = float(statistic(*groups))
    if min(map(len, groups)) < 2:
        return value, np.nan, np.nan
    with catch_warnings():
        simplefilter("ignore")  # of runs that are all alike
        result = bootstrap(groups, statistic, rng=0, confidence_level=CONFIDENCE, method="BCa")
    low, high = result.confidence_interval
    return value, float(low), float(high)


def plot(runs: pd.DataFrame, curves: pd.DataFrame, path: Path) -> Path:
    """Draw the learning curves and the scores of an environment's runs, and the baselines."""
    figure = Figure((12, 4.6), layout="constrained")
    axes = figure.subplots(1, 2)
    groups = runs[runs.policy == "run"].groupby("group")["return"]
    for i, (group, scores) in enumerate(groups):
        curve = curves[curves.group == group].groupby("steps")["return"].apply(interquartile_mean)
        axes[0].plot(curve.index, curve, color=f"C{i}", label=group)
        axes[1].plot([i] * len(scores), scores, ".", color=f"C{i}")
    baselines = runs[runs.policy != "run"].groupby("policy", sort=False)["return"].first()
    for axis in axes:
        for name, dashes in zip(baselines.index, DASHES, strict=False):
            axis.axhline(baselines[name], linestyle=dashes, color="0.35", label=name)
        axis.set_ylabel("return")
    axes[0].set(title="While training: IQM over runs", xlabel="environment steps")
    axes[1].set(title="Scores of the runs", xticks=range(len(groups)))
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return save(figure, path)
