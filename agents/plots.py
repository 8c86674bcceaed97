"""Figures of scores and of training."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from agents.tasks import Task
from jansen_env.files import write_whole


def plot_scores(task: Task, scores: dict[str, dict[str, Any]], path: str | Path) -> Path:
    """Each metric against the commanded speed, a line per policy; bootstrapped over episodes.

    With one commanded speed a point per policy instead, side by side.
    """
    shown = {name: metric for name, metric in task.metrics.items() if metric.axis}
    columns = (len(shown) + 1) // 2
    figure, axes = plt.subplots(2, columns, figsize=(12, 6.4), layout="constrained", sharex=True)
    commands = next(iter(scores.values()))["by_command"]["return"]["command"]
    single = len(commands) == 1
    for axis, (name, metric) in zip(axes.flat, shown.items(), strict=False):
        for i, (policy, summary) in enumerate(scores.items()):
            rows = summary["by_command"][name]
            value, low, high = (
                _drawable(rows[key], metric.axis) for key in ("value", "low", "high")
            )
            if single:
                spread = np.nan_to_num(np.maximum([value - low, high - value], 0.0))
                axis.errorbar([i], value, spread, fmt="o", capsize=4, color=f"C{i}", label=policy)
                continue
            line = axis.plot(commands, value, marker="o", markersize=4, label=policy)[0]
            axis.fill_between(commands, low, high, color=line.get_color(), alpha=0.18)
        axis.set_title(metric.heading, fontsize=11)
        if metric.axis == "log" and np.isfinite(axis.dataLim.get_points()[:, 1]).all():
            axis.set_yscale("log")
        elif metric.axis == "fraction":
            axis.set_ylim(-0.03, 1.03)
        axis.grid(alpha=0.3)
        if single:
            axis.set_xticks([])
            axis.margins(x=0.3)
    for axis in axes.flat[len(shown) :]:
        axis.remove()
        axes[0, -1].xaxis.set_tick_params(labelbottom=True)  # which now is the lowest of its column
    handles, labels = axes.flat[0].get_legend_handles_labels()
    columns = min(len(labels), 4)  # more would not fit
    figure.legend(handles, labels, loc="outside upper center", ncols=columns, frameon=False)
    at = f" {commands[0]:g} {task.command_unit}" if single else f", {task.command_unit}"
    figure.supxlabel(f"commanded speed{at}", fontsize=11)
    return _save(figure, path)


def _drawable(values: Any, axis: str) -> Any:
    """Numbers to draw: NaN for what is none, and on a logarithmic axis for what is not above 0."""
    numbers = np.array(values, float)
    numbers[~np.isfinite(numbers)] = np.nan
    if axis == "log":
        numbers[~(numbers > 0.0)] = np.nan
    return numbers


def plot_training(
    evaluations: list[dict[str, Any]], baselines: dict[str, float], path: str | Path
) -> Path:
    """Mean return of the evaluations during training, with the baselines as level lines."""
    figure, axis = plt.subplots(figsize=(7, 4), layout="constrained")
    steps = [row["steps"] for row in evaluations]
    axis.plot(steps, [row["return"] for row in evaluations], marker="o", label="trained policy")
    for i, (name, value) in enumerate(baselines.items()):
        axis.axhline(value, color=f"C{i + 1}", linestyle="--", label=name)
    axis.set_xlabel("environment steps")
    axis.set_ylabel("mean return over the commands")
    axis.legend(frameon=False)
    axis.grid(alpha=0.3)
    return _save(figure, path)


def _save(figure: Any, path: str | Path) -> Path:
    written = write_whole(path, lambda name: figure.savefig(name, dpi=120))
    plt.close(figure)
    return written
