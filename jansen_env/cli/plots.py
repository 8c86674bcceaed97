"""Figures and files that present scores."""

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from jansen_env.arrays import Array
from jansen_env.files import write_json, write_text, write_whole
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.evaluation import Scores
from jansen_env.scoring.metrics import INTERVALS, Metric, Summary, score_table, tabled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 2  # panels in a row, so that their text is legible on a phone

# Lower values are drawn as this value on a logarithmic axis. Rigid feet may not slip at all.
LEAST = 1e-4

Sweeps: TypeAlias = dict[str, dict[str, dict[str, Summary]]]
"""Results of :func:`jansen_env.scoring.metrics.pooled` by sweep, condition and policy."""


def write_scores(scores: Scores, folder: Path, drawn: Scores | None = None) -> None:
    """Write ``scores.json``, ``scores.md`` and ``scores.png``.

    Args:
        scores: Scores for the commands of the benchmark's grid.
        folder: Folder of the files.
        drawn: Scores for sampled commands; None or empty if there are none.
    """
    benchmark = find_benchmark(scores.env_id)
    text = score_table(benchmark.metrics, scores, "metric")
    if drawn:
        text += f"\n\nDrawn commands:\n\n{score_table(benchmark.metrics, drawn, 'metric')}"
        both = {name: {**summary, "drawn": drawn[name]} for name, summary in scores.items()}
    sweep = {f"command ({benchmark.command_unit})": by_command(scores)}
    metrics = {name: m for name, m in tabled(benchmark.metrics).items() if m.axis}
    write_files(folder / "scores", both if drawn else scores, text, sweep, metrics)


def write_files(
    stem: Path, scores: object, table: str, sweeps: Sweeps, metrics: dict[str, Metric]
) -> None:
    """Write scores as JSON, a table of them as Markdown, and a figure of them as PNG.

    Args:
        stem: Path of the files without suffix.
        scores: Scores to write as JSON.
        table: Table of the scores.
        sweeps: Scores to plot.
        metrics: Metrics to plot, by name.
    """
    write_text(stem.with_suffix(".md"), f"{table}\n\n{INTERVALS}\n")
    plot_sweeps(sweeps, metrics, stem.with_suffix(".png"))
    # This file is written last: if it exists, the other files exist.
    write_json(stem.with_suffix(".json"), scores)


def by_command(scores: Scores) -> dict[str, dict[str, Summary]]:
    """Return scores as a sweep over the commands.

    Args:
        scores: Scores of all policies.
    """
    commands = next(iter(scores.values()))["by_command"]["return"]["command"]
    return {
        f"{command:g}": {
            policy: {
                "overall": {
                    name: [row["value"][k], row["low"][k], row["high"][k]]
                    for name, row in summary["by_command"].items()
                }
            }
            for policy, summary in scores.items()
        }
        for k, command in enumerate(commands)
    }


def by_condition(sweeps: Sweeps) -> dict[str, Summary]:
    """Return the scores of sweeps by condition and policy, such as "friction 0.3, pid".

    Args:
        sweeps: Scores by sweep, condition and policy.
    """
    return {
        f"{sweep} {condition}, {policy}": summary
        for sweep, conditions in sweeps.items()
        for condition, policies in conditions.items()
        for policy, summary in policies.items()
    }


def plot_sweeps(sweeps: Sweeps, metrics: dict[str, Metric], path: Path) -> Path:
    """Draw one panel per metric and sweep, with one line per policy and its 95 % intervals.

    Args:
        sweeps: Scores by sweep, condition and policy.
        metrics: Metrics to draw, by name.
        path: Path of the figure.

    Returns:
        The path of the figure.
    """
    from matplotlib.figure import Figure

    rows, columns = len(metrics), len(sweeps)
    if columns == 1:
        columns = min(len(metrics), COLUMNS)
        rows = -(-len(metrics) // columns)
    figure = Figure((3.2 * columns, 2.4 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    panels = [*product(metrics.items(), sweeps.items())]
    for axis, ((name, metric), (sweep, conditions)) in zip(axes.flat, panels, strict=False):
        for i, policy in enumerate(next(iter(conditions.values()))):
            scores = [policies[policy]["overall"][name] for policies in conditions.values()]
            places = np.arange(len(scores), dtype=float) + (0.1 * i if len(scores) == 1 else 0.0)
            _draw_curve(axis, metric, places, np.array(scores, float).T, policy)
        axis.set_title(metric.heading, fontsize=10)
        axis.set_xlabel(sweep)
        axis.set_xticks(range(len(conditions)), conditions, fontsize=9)
        axis.grid(alpha=0.3)
    for axis in axes.flat[len(panels) :]:
        axis.remove()
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=min(len(labels), 3))
    return save(figure, path)


def _draw_curve(axis: "Axes", metric: Metric, x: Array, intervals: Array, label: str) -> None:
    """Draw the curve of a metric with its intervals.

    Args:
        axis: Axes to draw on.
        metric: Metric that is drawn.
        x: Positions on the horizontal axis, shape (n,).
        intervals: Values, lower ends and upper ends of the intervals, shape (3, n).
        label: Label of the curve.
    """
    from matplotlib.ticker import LogLocator

    if metric.axis == "log":
        intervals = np.maximum(intervals, LEAST)
        axis.set_yscale("log")
        axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter("")
    elif metric.axis == "fraction":
        axis.set_ylim(-0.03, 1.03)
    value, low, high = intervals
    spread = np.nan_to_num(np.maximum([value - low, high - value], 0.0))
    axis.errorbar(x, value, spread, fmt="o-", markersize=4, elinewidth=0.8, capsize=2, label=label)


def save(figure: "Figure", path: str | Path) -> Path:
    """Write a figure to a file, atomically.

    Args:
        figure: Figure to write.
        path: Path of the file.

    Returns:
        The path of the file.
    """
    return write_whole(path, lambda name: figure.savefig(name, dpi=140))
