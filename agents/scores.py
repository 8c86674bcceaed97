"""From episodes to numbers: means over a grid of commands, each with a bootstrap interval."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.rollout import Episodes

Array = NDArray[np.float64]

RESAMPLES = 2000
CONFIDENCE = 0.95
WALKED = 1e-3  # m, distance below which a ratio per metre is not formed

METRICS: dict[str, tuple[str, str]] = {
    "return": ("return", ""),
    "speed_error": ("speed error", "m/s"),
    "slip_per_metre": ("slip per metre", "m/m"),
    "cost_of_transport": ("cost of transport", "1"),
    "falls": ("falls", "share"),
    "peak_torque": ("peak torque", "N m"),
    "rms_torque": ("RMS torque", "N m"),
}
"""Name -> (title, unit). Ratios are sums over episodes: total slip / total way ahead."""


def _metric(name: str, run: Episodes, horizon: float, weight: float) -> Callable[[Any], Array]:
    """The metric of episodes picked by an index array (resamples, n): (resamples,)."""
    way = np.maximum(np.sign(run.command) * run.distance, 0.0)  # in the commanded direction

    def ratio(total: Array) -> Callable[[Any], Array]:
        def of(pick: Any) -> Array:
            length = way[pick].sum(axis=-1)
            value = total[pick].sum(axis=-1) / np.maximum(length, WALKED)
            return np.where(length > WALKED, value, np.nan)

        return of

    def mean(values: Array) -> Callable[[Any], Array]:
        return lambda pick: values[pick].mean(axis=-1)

    table: dict[str, Callable[[Any], Array]] = {
        "return": mean(run.returns),
        "speed_error": mean(np.abs(run.distance / horizon - run.command)),
        "slip_per_metre": ratio(run.slip),
        "cost_of_transport": ratio(run.work / weight),
        "falls": mean(run.fell.astype(float)),
        "peak_torque": mean(run.peak_torque),
        "rms_torque": mean(run.rms_torque),
    }
    return table[name]


def summarise(run: Episodes, horizon: float, weight: float, seed: int = 0) -> dict[str, Any]:
    """Every metric over all episodes and for each command.

    Args:
        run: episodes, the same number for each command.
        horizon: full length of an episode, s: after a fall the robot is taken to stand still.
        weight: of the robot, N, for the cost of transport |work| / (weight * distance).
        seed: of the bootstrap, which resamples episodes within each command.

    Returns:
        {"overall": {metric: [value, low, high]}, "by_command": {metric: {"command": [...],
        "value": [...], "low": [...], "high": [...]}}}; NaN is None.
    """
    rng = np.random.default_rng(seed)
    commands = np.unique(run.command)
    groups = [np.flatnonzero(run.command == c) for c in commands]
    picks = [g[rng.integers(0, len(g), (RESAMPLES, len(g)))] for g in groups]
    everything = np.concatenate(picks, axis=1)
    tail = 100.0 * (1.0 - CONFIDENCE) / 2.0
    overall: dict[str, Any] = {}
    by_command: dict[str, Any] = {}
    for name in METRICS:
        metric = _metric(name, run, horizon, weight)

        def interval(pick: Any, whole: Any, metric: Any = metric) -> list[float | None]:
            spread = metric(pick)
            if np.isnan(spread).all():
                return [None, None, None]
            low, high = np.nanpercentile(spread, [tail, 100.0 - tail])
            return [_number(v) for v in (metric(whole), low, high)]

        overall[name] = interval(everything, np.concatenate(groups))
        rows = [interval(p, g) for p, g in zip(picks, groups, strict=True)]
        by_command[name] = {
            "command": commands.tolist(),
            **{key: [row[i] for row in rows] for i, key in enumerate(("value", "low", "high"))},
        }
    return {"overall": overall, "by_command": by_command, "episodes": len(run.command)}


def episode_table(run: Episodes) -> dict[str, list[Any]]:
    """The raw episodes as lists, for the JSON file."""
    return {f.name: np.asarray(getattr(run, f.name)).tolist() for f in fields(run)}


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


def markdown_table(scores: dict[str, dict[str, Any]]) -> str:
    """A Markdown table: a row per policy, value [low, high] per metric."""
    titles = [f"{title} ({unit})" if unit else title for title, unit in METRICS.values()]
    rows = [["policy", *titles]]
    for policy, summary in scores.items():
        cells = [_cell(summary["overall"][name]) for name in METRICS]
        rows.append([policy, *cells])
    width = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = [
        "| " + " | ".join(c.ljust(w) for c, w in zip(r, width, strict=True)) + " |" for r in rows
    ]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in width) + "|")
    return "\n".join(lines)


def _cell(interval: list[float | None]) -> str:
    texts = ["-" if v is None else f"{v:.3g}" for v in interval]
    return f"{texts[0]} [{texts[1]}, {texts[2]}]"
