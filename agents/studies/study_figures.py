"""Figures of a study: one for each environment, of runs rather than episodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from agents.plots import save

BASELINE = {"color": "0.35", "linewidth": 1.0}
DASHES = ("--", ":", "-.")


def plot_study(found: dict[str, Any], folder: Path) -> list[Path]:
    """Write ENV.png, learning curves and scores, for each environment with finished runs.

    Args:
        found: :func:`agents.studies.study_report.analyse`. folder: of the study.
    """
    finished = {name: group for name, group in found["groups"].items() if group["finished"]}
    written = []
    for env_id in dict.fromkeys(group["env"] for group in finished.values()):
        groups = {name: group for name, group in finished.items() if group["env"] == env_id}
        written.append(_plot(env_id, groups, folder / f"{env_id}.png"))
    return written


def _plot(env_id: str, groups: dict[str, Any], path: Path) -> Path:
    figure, (curves, scores) = plt.subplots(1, 2, figsize=(12, 4.6), layout="constrained")
    hues = plt.get_cmap("tab10" if len(groups) <= 10 else "tab20")
    for i, (name, group) in enumerate(groups.items()):
        _learning_curve(curves, name, group, hues(i))
        _scores(scores, i, group, hues(i))
    for axis in (curves, scores):
        baselines = next(iter(groups.values()))["baselines"].items()
        for (name, score), dashes in zip(baselines, DASHES * 9, strict=False):
            axis.axhline(score["return"], linestyle=dashes, label=name, **BASELINE)
        axis.set_ylabel("return")
        axis.grid(alpha=0.3)
    curves.set_title("While training: IQM with interval, thin the mean", fontsize=11)
    curves.set_xlabel("environment steps")
    scores.set_title("Scores: runs (dots), IQM (circle), mean (square)", fontsize=11)
    many = {"rotation": 20, "ha": "right", "fontsize": 8} if len(groups) > 4 else {}
    scores.set_xticks(range(len(groups)), [_short(name) for name in groups], **many)
    scores.set_xlim(-0.6, len(groups) - 0.4)
    handles, labels = curves.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", frameon=False,
                  ncols=min(len(labels), 4))  # fmt: skip
    figure.suptitle(f"{env_id}: intervals are 95 %, over runs", fontsize=12)
    return save(figure, path)


def _learning_curve(axis: Any, name: str, group: dict[str, Any], colour: Any) -> None:
    curve = {key: np.array(values, float) for key, values in group["curve"].items()}
    label = f"{_short(name)} ({group['finished']} run{'s' * (group['finished'] > 1)})"
    axis.plot(curve["steps"], curve["iqm"], color=colour, label=label, marker="o", markersize=3)
    axis.plot(curve["steps"], curve["mean"], color=colour, linewidth=0.8, alpha=0.7)
    axis.fill_between(curve["steps"], curve["low"], curve["high"], color=colour, alpha=0.18,
                      linewidth=0)  # fmt: skip


def _scores(axis: Any, place: int, group: dict[str, Any], colour: Any) -> None:
    """Draw each run as a dot; IQM and mean beside them with their intervals."""
    returns = np.array(group["returns"])
    spread = np.linspace(-0.12, 0.12, len(returns)) if len(returns) > 1 else np.zeros(1)
    axis.plot(place - 0.15 + spread, returns, ".", color=colour, alpha=0.6)
    for shift, key, marker in ((0.12, "iqm", "o"), (0.28, "mean", "s")):
        value, low, high = np.array(group[key], float)
        ends = np.nan_to_num(np.maximum([[value - low], [high - value]], 0.0))
        axis.errorbar([place + shift], [value], ends, fmt=marker, capsize=4, markersize=5,
                      color=colour)  # fmt: skip


def _short(name: str) -> str:
    """Return a group's name without the environment, which the figure's title has."""
    return name.split("_", 1)[-1]
