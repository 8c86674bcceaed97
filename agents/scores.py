"""From episodes to numbers: means over a grid of commands, each with a bootstrap interval."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.tasks import Episodes, Metric, Task

Array = NDArray[np.float64]

RESAMPLES = 2000
CONFIDENCE = 0.95
WALKED = 1e-3  # m, distance below which a ratio per metre is not formed


def _estimate(metric: Metric, run: Episodes, env: Any) -> Callable[[Any], Array]:
    """The metric of episodes picked by an index array (resamples, n): (resamples,)."""
    values = metric.of(run, env)
    if metric.per is None:
        return lambda pick: values[pick].mean(axis=-1)
    lengths = metric.per(run, env)

    def ratio(pick: Any) -> Array:
        length = lengths[pick].sum(axis=-1)
        value = values[pick].sum(axis=-1) / np.maximum(length, WALKED)
        return np.where(length > WALKED, value, np.nan)

    return ratio


def values(task: Task, run: Episodes, env: Any) -> dict[str, float | None]:
    """Every metric over all episodes, without intervals; NaN is None."""
    return {
        name: _number(_estimate(metric, run, env)(slice(None)))
        for name, metric in task.metrics.items()
    }


def summarise(task: Task, run: Episodes, env: Any, seed: int = 0) -> dict[str, Any]:
    """Every metric over all episodes and for each command.

    Args:
        task: whose metrics. run: episodes, the same number for each command.
        env: the environment they were run in, as ``gym.make`` gives it.
        seed: of the bootstrap, which resamples episodes within each command.

    Returns:
        {"overall": {metric: [value, low, high]}, "by_command": {metric: {"command": [...],
        "value": [...], "low": [...], "high": [...]}}}; NaN is None.
    """
    rng = np.random.default_rng(seed)
    commands = np.unique(run["command"])
    groups = [np.flatnonzero(run["command"] == c) for c in commands]
    picks = [g[rng.integers(0, len(g), (RESAMPLES, len(g)))] for g in groups]
    everything = np.concatenate(picks, axis=1)
    tail = 100.0 * (1.0 - CONFIDENCE) / 2.0
    overall: dict[str, Any] = {}
    by_command: dict[str, Any] = {}
    for name, metric in task.metrics.items():
        estimate = _estimate(metric, run, env)

        def interval(pick: Any, whole: Any, estimate: Any = estimate) -> list[float | None]:
            spread = estimate(pick)
            if np.isnan(spread).all():
                return [None, None, None]
            low, high = np.nanpercentile(spread, [tail, 100.0 - tail])
            return [_number(v) for v in (estimate(whole), low, high)]

        overall[name] = interval(everything, np.concatenate(groups))
        rows = [interval(p, g) for p, g in zip(picks, groups, strict=True)]
        by_command[name] = {
            "command": commands.tolist(),
            **{key: [row[i] for row in rows] for i, key in enumerate(("value", "low", "high"))},
        }
    return {"overall": overall, "by_command": by_command, "episodes": len(run["command"])}


def episode_table(run: Episodes) -> dict[str, list[Any]]:
    """The raw episodes as lists, for the JSON file."""
    return {name: total.tolist() for name, total in run.items()}


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


def markdown_table(task: Task, scores: dict[str, dict[str, Any]]) -> str:
    """A Markdown table: a row per policy, value [low, high] per metric."""
    titles = [f"{m.title} ({m.unit})" if m.unit else m.title for m in task.metrics.values()]
    rows = [["policy", *titles]]
    for policy, summary in scores.items():
        cells = [_cell(summary["overall"][name], m.digits) for name, m in task.metrics.items()]
        rows.append([policy, *cells])
    width = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "| " + " | ".join(c.ljust(w) for c, w in zip(r, width, strict=True)) + " |" for r in rows
    ]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in width) + "|")
    return "\n".join(lines)


def _cell(interval: list[float | None], digits: int) -> str:
    texts = ["-" if v is None else f"{v:.{digits}g}" for v in interval]
    return f"{texts[0]} [{texts[1]}, {texts[2]}]"
