"""Pictures of scores and of training."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from agents.files import write_whole
from agents.scores import METRICS

SHOWN = ("return", "speed_error", "slip_per_metre", "cost_of_transport", "falls", "rms_torque")
LOGARITHMIC = ("slip_per_metre", "cost_of_transport")


def score_figure(scores: dict[str, dict[str, Any]], path: str | Path) -> Path:
    """Each metric against the commanded speed, a line per policy with its bootstrap interval."""
    figure, axes = plt.subplots(2, 3, figsize=(12, 6.4), layout="constrained", sharex=True)
    for axis, name in zip(axes.flat, SHOWN, strict=True):
        for policy, summary in scores.items():
            rows = summary["by_command"][name]
            value, low, high = (
                np.array([np.nan if v is None else v for v in rows[key]], dtype=float)
                for key in ("value", "low", "high")
            )
            line = axis.plot(rows["command"], value, marker="o", markersize=4, label=policy)[0]
            axis.fill_between(rows["command"], low, high, color=line.get_color(), alpha=0.18)
        title, unit = METRICS[name]
        axis.set_title(f"{title}, {unit}" if unit else title, fontsize=11)
        if name in LOGARITHMIC:
            axis.set_yscale("log")
        elif name == "falls":
            axis.set_ylim(-0.03, 1.03)
        axis.grid(alpha=0.3)
    for axis in axes[-1]:
        axis.set_xlabel("commanded speed, m/s")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    return _save(figure, path)


def training_figure(
    history: list[dict[str, float]], baselines: dict[str, float], path: str | Path
) -> Path:
    """Mean return of the evaluations during training, with the baselines as level lines."""
    figure, axis = plt.subplots(figsize=(7, 4), layout="constrained")
    steps = [row["steps"] for row in history]
    axis.plot(steps, [row["return"] for row in history], marker="o", label="trained policy")
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
