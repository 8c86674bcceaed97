"""Figures of a study: one for each environment, of runs rather than episodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from agents.plots import save
from agents.studies.seed_statistics import performance_profile

LEVELS = 201  # of the performance profile
BASELINE = {"color": "0.35", "linewidth": 1.0}
DASHES = ("--", ":", "-.")


def plot_study(found: dict[str, Any], folder: Path) -> list[Path]:
    """Write ENV.png for each environment with finished runs.

    Learning curves, scores, performance profile and probability of improvement over baselines.

    Args:
        found: :func:`agents.studies.study_scores.analyse`. folder: of the study.
    """
    written = []
    for env_id in dict.fromkeys(group["env"] for group in found["groups"].values()):
        groups = {
            name: group
            for name, group in found["groups"].items()
            if group["env"] == env_id and group["finished"]
        }
        if groups:
            written.append(_plot(env_id, groups, folder / f"{env_id}.png"))
    return written


def _plot(env_id: str, groups: dict[str, Any], path: Path) -> Path:
    figure, axes = plt.subplots(2, 2, figsize=(12, 8.4), layout="constrained")
    (curves, scores), (profile, improvement) = axes
    hues = plt.get_cmap("tab10" if len(groups) <= 10 else "tab20")
    colours = {name: hues(i) for i, name in enumerate(groups)}
    baselines = {
        name: score
        for name, score in next(iter(groups.values()))["baselines"].items()
        if all(name in group["baselines"] for group in groups.values())
    }
    _learning_curves(curves, groups, colours)
    _scores(scores, groups, colours)
    _profile(profile, groups, baselines, colours)
    _improvement(improvement, groups, baselines, colours)
    for axis, line in ((curves, "axhline"), (scores, "axhline"), (profile, "axvline")):
        for (name, score), dashes in zip(baselines.items(), DASHES * 9, strict=False):
            getattr(axis, line)(score["return"], linestyle=dashes, label=name, **BASELINE)
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    handles, labels = curves.get_legend_handles_labels()
    if not handles:
        handles, labels = profile.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", frameon=False,
                  ncols=min(len(labels), 4))  # fmt: skip
    figure.suptitle(f"{env_id}: intervals are 95 %, over runs", fontsize=12)
    return save(figure, path)


def _learning_curves(axis: Any, groups: dict[str, Any], colours: dict[str, Any]) -> None:
    for name, group in groups.items():
        curve = {key: np.array(values, float) for key, values in group["curve"].items()}
        if not curve:
            continue
        runs = f"{group['finished']} run{'s' * (group['finished'] > 1)}"
        label = f"{_short([name])[0]} ({runs})"
        axis.plot(curve["steps"], curve["iqm"], color=colours[name], label=label,
                  marker="o", markersize=3)  # fmt: skip
        axis.plot(curve["steps"], curve["mean"], color=colours[name], linewidth=0.8, alpha=0.7)
        axis.fill_between(curve["steps"], curve["low"], curve["high"], color=colours[name],
                          alpha=0.18, linewidth=0)  # fmt: skip
    axis.set_title("While training: IQM with interval, thin the mean", fontsize=11)
    axis.set_xlabel("environment steps")
    axis.set_ylabel("return")


def _scores(axis: Any, groups: dict[str, Any], colours: dict[str, Any]) -> None:
    """Each run a dot; IQM and mean beside them with their intervals."""
    for i, (name, group) in enumerate(groups.items()):
        returns = np.array(group["returns"])
        spread = np.linspace(-0.12, 0.12, len(returns)) if len(returns) > 1 else np.zeros(1)
        axis.plot(i - 0.15 + spread, returns, ".", color=colours[name], alpha=0.6)
        for place, key, marker in ((0.12, "iqm", "o"), (0.28, "mean", "s")):
            value, low, high = np.array(group[key], float)
            ends = np.nan_to_num(np.maximum([[value - low], [high - value]], 0.0))
            axis.errorbar([i + place], [value], ends, fmt=marker, capsize=4, markersize=5,
                          color=colours[name])  # fmt: skip
    axis.set_title("Scores: runs (dots), IQM (circle), mean (square)", fontsize=11)
    many = {"rotation": 20, "ha": "right", "fontsize": 8} if len(groups) > 4 else {}
    axis.set_xticks(range(len(groups)), _short(list(groups)), **many)
    axis.set_xlim(-0.6, len(groups) - 0.4)
    axis.set_ylabel("return")


def _profile(
    axis: Any, groups: dict[str, Any], baselines: dict[str, Any], colours: dict[str, Any]
) -> None:
    returns = [score["return"] for score in baselines.values()]
    returns += [value for group in groups.values() for value in group["returns"]]
    low, high = min(returns), max(returns)
    margin = 0.05 * (high - low) or 1.0
    levels = np.linspace(low - margin, high + margin, LEVELS)
    for name, group in groups.items():
        fraction, low, high = performance_profile(group["returns"], levels)
        axis.plot(levels, fraction, color=colours[name], label=_short([name])[0])
        axis.fill_between(levels, low, high, color=colours[name], alpha=0.18, linewidth=0)
    axis.set_title("Performance profile, with pointwise interval", fontsize=11)
    axis.set_xlabel("return $\\tau$")
    axis.set_ylabel("fraction of runs with return > $\\tau$")
    axis.set_ylim(-0.03, 1.03)


def _improvement(
    axis: Any, groups: dict[str, Any], baselines: dict[str, Any], colours: dict[str, Any]
) -> None:
    step = 0.7 / len(groups)
    for i, (name, group) in enumerate(groups.items()):
        for j, baseline in enumerate(baselines):
            value, low, high = group["baselines"][baseline]["improvement"]
            place = j + step * (i - 0.5 * (len(groups) - 1))
            axis.errorbar([value], [place], xerr=[[value - low], [high - value]], fmt="o",
                          capsize=4, color=colours[name])  # fmt: skip
    axis.axvline(0.5, color="0.6", linewidth=0.8)
    axis.set_title("Probability that a run beats the baseline", fontsize=11)
    axis.set_yticks(range(len(baselines)), list(baselines))
    axis.set_ylim(len(baselines) - 0.4, -0.6)
    axis.set_xlim(-0.03, 1.03)
    axis.set_xlabel("P(run > baseline)")


def _short(names: list[str]) -> list[str]:
    """Groups' names without the environment, which the figure's title has."""
    return [name.split("_", 1)[-1] for name in names]
