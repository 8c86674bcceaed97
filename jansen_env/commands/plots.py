"""Figures and files of scores."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from jansen_env.files import write_json, write_text, write_whole
from jansen_env.scoring.benchmarks import Benchmark, find_benchmark
from jansen_env.scoring.evaluation import Scores
from jansen_env.scoring.metrics import INTERVALS, Metric, score_table, tabled

LEAST = 1e-4  # at which a logarithmic axis shows all that is less: rigid feet may not slip at all


def write_scores(scores: Scores, folder: Path, drawn: Scores | None = None) -> None:
    """Write scores.json, .md and .png; ``drawn``: those of drawn commands, if any."""
    benchmark, both = find_benchmark(scores.env_id), dict(scores)
    text = score_table(benchmark.metrics, scores, "metric")
    if drawn:
        both = {name: {**own, "drawn": drawn[name]} for name, own in scores.items()}
        text += f"\n\nDrawn commands:\n\n{score_table(benchmark.metrics, drawn, 'metric')}"
    write_json(folder / "scores.json", both)
    write_text(folder / "scores.md", f"{text}\n\n{INTERVALS}\n")
    plot_scores(benchmark, scores, folder / "scores.png")


def plot_scores(benchmark: Benchmark, scores: dict[str, dict[str, Any]], path: str | Path) -> Path:
    """Draw each metric against the command, a line per policy with its 95 % interval; with one
    command a point per policy instead, side by side."""
    shown = {name: metric for name, metric in tabled(benchmark.metrics).items() if metric.axis}
    columns = (len(shown) + 1) // 2
    figure, axes = plt.subplots(2, columns, figsize=(12, 6.4), layout="constrained", sharex=True)
    commands = next(iter(scores.values()))["by_command"]["return"]["command"]
    single = len(commands) == 1
    for axis, (name, metric) in zip(axes.flat, shown.items(), strict=False):
        for i, (policy, summary) in enumerate(scores.items()):
            rows = summary["by_command"][name]
            intervals = [rows[key] for key in ("value", "low", "high")]
            if single:
                value, low, high = (_drawable(part, metric.axis) for part in intervals)
                spread = np.nan_to_num(np.maximum([value - low, high - value], 0.0))
                axis.errorbar([i], value, spread, fmt="o", capsize=4, color=f"C{i}", label=policy)
            else:
                draw_curve(axis, metric, commands, intervals, policy)
        axis.set_title(metric.heading, fontsize=11)
        finish_panel(axis, metric)
        if single:
            axis.set_xticks([])
            axis.margins(x=0.3)
    for axis in axes.flat[len(shown) :]:
        axis.remove()
        axes[0, -1].xaxis.set_tick_params(labelbottom=True)  # which now is the lowest of its column
    legend_above(figure, axes.flat[0])
    at = f" {commands[0]:g} {benchmark.command_unit}" if single else f", {benchmark.command_unit}"
    figure.supxlabel(f"command{at}", fontsize=11)
    return save(figure, path)


def draw_curve(axis: Any, metric: Metric, x: Any, intervals: Any, label: str) -> None:
    """Draw a metric over ``x`` (n,): ``intervals`` (3, n) are values, lower and upper ends."""
    value, low, high = (_drawable(part, metric.axis) for part in intervals)
    line = axis.plot(x, value, marker="o", markersize=4, label=label)[0]
    if metric.axis == "fraction":  # whose bands would cover one another
        axis.vlines(x, low, high, color=line.get_color(), alpha=0.4)
    else:
        axis.fill_between(x, low, high, color=line.get_color(), alpha=0.18)


def finish_panel(axis: Any, metric: Metric) -> None:
    """Set scale and grid of a metric's panel, once its curves are drawn."""
    if metric.axis == "log" and np.isfinite(axis.dataLim.get_points()[:, 1]).all():
        axis.set_yscale("log")
    elif metric.axis == "fraction":
        axis.set_ylim(-0.03, 1.03)
    axis.grid(alpha=0.3)


def legend_above(figure: Any, axis: Any) -> None:
    """Put the labels of a panel's curves above the whole figure."""
    handles, labels = axis.get_legend_handles_labels()
    columns = min(len(labels), 4)  # more would not fit
    figure.legend(handles, labels, loc="outside upper center", ncols=columns, frameon=False)


def _drawable(values: Any, axis: str) -> Any:
    """Return numbers to draw: NaN for what is none; on a logarithmic axis at least LEAST."""
    numbers = np.array(values, float)
    numbers[~np.isfinite(numbers)] = np.nan
    return np.maximum(numbers, LEAST) if axis == "log" else numbers


def save(figure: Any, path: str | Path) -> Path:
    """Write a figure whole, and close it; returns ``path``."""
    written = write_whole(path, lambda name: figure.savefig(name, dpi=120))
    plt.close(figure)
    return written
