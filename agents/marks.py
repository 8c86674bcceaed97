"""Marks: what a policy is to reach at each commanded speed, and how far it falls short of it.

A mean over all commands hides what is given up at one of them: a policy is chosen by the table of
its scores, command by command.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from agents.metrics import Array, Episodes, point_estimates
from agents.tasks import Task

MISS = 10.0  # shortfall of 1 where nothing is allowed: so that one fall in ten episodes counts full

ByCommand = Mapping[str, Array]
"""Metrics by name, each (c,) at the c commands; NaN where there is none."""


def at_commands(task: Task, run: Episodes, env: Any) -> dict[str, Array]:
    """The metrics that a task's marks are about, of episodes.

    Args:
        env: the environment they were run in, as ``gym.make`` gives it.
    """
    metrics = {mark.metric: task.metrics[mark.metric] for mark in task.marks}
    rows = [
        point_estimates(metrics, {k: v[run["command"] == command] for k, v in run.items()}, env)
        for command in np.unique(run["command"])
    ]
    return {name: _numbers(row[name] for row in rows) for name in metrics}


def from_summary(summary: Mapping[str, Any]) -> dict[str, Array]:
    """The same from :func:`agents.metrics.summarise`."""
    return {name: _numbers(found["value"]) for name, found in summary["by_command"].items()}


def limits(task: Task, commands: Array, baselines: Mapping[str, ByCommand]) -> Array:
    """(marks, c) the most that each mark allows at each command; NaN where it sets no limit.

    Args:
        commands: (c,). baselines: by name, all that the marks speak of.
    """
    return np.array(
        [
            np.where(
                np.abs(commands) <= mark.up_to,
                mark.limit * (baselines[mark.baseline][mark.metric] if mark.baseline else 1.0),
                np.nan,
            )
            for mark in task.marks
        ]
    )


def shortfalls(task: Task, policy: ByCommand, most: Array) -> Array:
    """(marks, commands) by which share each mark is missed, from 0 to 1; 1 for no value at all.

    Args:
        policy: of whom. most: as of :func:`limits`.
    """
    found = []
    for mark, limit in zip(task.marks, most, strict=True):
        value = policy[mark.metric]
        with np.errstate(divide="ignore", invalid="ignore"):
            missed = np.where(limit > 0.0, value / limit - 1.0, MISS * value)
        missed = np.where(np.isnan(value), 1.0, np.clip(missed, 0.0, 1.0))
        found.append(np.where(np.isnan(limit), 0.0, missed))
    return np.array(found)


def describe(task: Task, scores: Mapping[str, Mapping[str, Any]], name: str) -> str:
    """In words which marks a policy meets; "" for a task without marks.

    Args:
        scores: of the policy ``name`` and of the baselines, as of :func:`agents.evaluate.evaluate`.
    """
    if not task.marks:
        return ""
    baselines = {own: from_summary(scores[own]) for own in baseline_names(task)}
    commands = np.unique(scores[name]["raw"]["command"])
    policy, most = from_summary(scores[name]), limits(task, commands, baselines)
    missed = [
        f"{task.metrics[task.marks[i].metric].label} at {commands[j]:g} {task.command_unit} "
        f"({policy[task.marks[i].metric][j]:.3g}, at most {most[i, j]:.3g})"
        for i, j in np.argwhere(shortfalls(task, policy, most) > 0.0)
    ]
    count = np.isfinite(most).sum()
    met = f"{count - len(missed)} of {count} marks met"
    return f"{met}; missed: {', '.join(missed)}" if missed else met


def baseline_names(task: Task) -> list[str]:
    """The baselines that a task's marks speak of."""
    return list(dict.fromkeys(mark.baseline for mark in task.marks if mark.baseline))


def _numbers(values: Iterable[float | None]) -> Array:
    """As an array; NaN for None."""
    return np.array([np.nan if value is None else value for value in values], float)
