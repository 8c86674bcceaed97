"""From episodes to numbers: metrics over a grid of commands, with bootstrap intervals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple, TypeAlias
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray
from scipy.stats import DegenerateDataWarning, bootstrap
from tabulate import tabulate

Array = NDArray[np.float64]
Episodes: TypeAlias = dict[str, NDArray[Any]]
"""Of n episodes, each (n,): "command", "returns", "duration" (s), and the task's aggregates."""

RESAMPLES = 2000
CONFIDENCE = 0.95
SETTLING = 2.0  # s, after which a walk counts as steady
MIN_DISTANCE = 1e-3  # m, below which a ratio per metre is not formed


class Aggregate(NamedTuple):
    """What is kept of an episode from each step's ``info``.

    Attributes:
        reduction: the "sum" over its steps or over the "steady" ones (after :data:`SETTLING`), the
            "peak" of the absolute value, the "rms" (root of the mean square), the "last" value, the
            last "early" one (within :data:`SETTLING`), or the "change": the sum of the absolute
            changes from step to step, the first from 0.
        function: the step's values (n,) from a vector environment's ``infos``.
    """

    reduction: Literal["sum", "steady", "peak", "rms", "last", "early", "change"]
    function: Callable[[dict[str, Any]], Any]


class Metric(NamedTuple):
    """A number for many episodes: a mean, or with a normaliser the ratio of two sums.

    Attributes:
        label, unit: in tables and figures.
        function: episodes and their environment to a value of each episode (n,).
        normaliser: the same, m; the sum of ``function`` is divided by its sum.
        axis: in figures "linear", "log" or "fraction" (0 to 1); "" for in tables alone.
        digits: in tables.
    """

    label: str
    unit: str
    function: Callable[[Episodes, Any], Array]
    normaliser: Callable[[Episodes, Any], Array] | None = None
    axis: Literal["linear", "log", "fraction", ""] = "linear"
    digits: int = 3

    @property
    def heading(self) -> str:
        """Label and unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label


def _estimator(metric: Metric, run: Episodes, env: Any) -> Callable[[Any], Array]:
    """The metric of episodes picked by an index array (..., n): (...)."""
    values = metric.function(run, env)
    if metric.normaliser is None:
        return lambda pick: values[pick].mean(axis=-1)
    lengths = metric.normaliser(run, env)

    def ratio(pick: Any) -> Array:
        length = lengths[pick].sum(axis=-1)
        value = values[pick].sum(axis=-1) / np.maximum(length, MIN_DISTANCE)
        return np.where(length > MIN_DISTANCE, value, np.nan)

    return ratio


def point_estimates(metrics: dict[str, Metric], run: Episodes, env: Any) -> dict[str, float | None]:
    """Every metric over all episodes, without intervals; NaN is None."""
    return {
        name: _number(_estimator(metric, run, env)(slice(None))) for name, metric in metrics.items()
    }


def summarise(metrics: dict[str, Metric], run: Episodes, env: Any, seed: int = 0) -> dict[str, Any]:
    """Every metric over all episodes and for each command, with 95 % bootstrap intervals.

    The percentile bootstrap (Efron and Tibshirani 1993), stratified: episodes are resampled within
    each command. Resamples in which nobody walked have no ratio per metre and do not count; with
    one episode per command there is no interval.

    Args:
        metrics: by name. run: episodes, the same number for each command. seed: of the resampling.
        env: the environment they were run in, as ``gym.make`` gives it.

    Returns:
        {"overall": {metric: [value, low, high]}, "by_command": {metric: {"command": [...],
        "value": [...], "low": [...], "high": [...]}}, "episodes": n}; NaN is None.
    """
    commands = np.unique(run["command"])
    groups = [np.flatnonzero(run["command"] == command) for command in commands]
    overall, by_command = {}, {}
    for name, metric in metrics.items():
        estimator = _estimator(metric, run, env)
        overall[name] = _interval(estimator, groups, seed)
        rows = [_interval(estimator, [group], seed) for group in groups]
        value, low, high = map(list, zip(*rows, strict=True))
        by_command[name] = {
            "command": commands.tolist(), "value": value, "low": low, "high": high,
        }  # fmt: skip
    return {"overall": overall, "by_command": by_command, "episodes": len(run["command"])}


def _interval(
    estimator: Callable[[Any], Array], groups: list[NDArray[np.int64]], seed: int
) -> list[float | None]:
    """The metric of all groups' episodes, and its interval."""
    value = estimator(np.concatenate(groups))
    if np.isnan(value) or min(map(len, groups)) < 2:
        return [_number(value), None, None]
    with catch_warnings():
        simplefilter("ignore", DegenerateDataWarning)  # of its interval, where one is NaN
        resampled = bootstrap(
            groups, lambda *picks, axis: estimator(np.concatenate(picks, axis)), vectorized=True,
            n_resamples=RESAMPLES, method="percentile", rng=seed,
        ).bootstrap_distribution  # fmt: skip
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.nanpercentile(resampled, [tail, 100.0 - tail])
    return [_number(value), _number(low), _number(high)]


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


def score_table(metrics: dict[str, Metric], scores: dict[str, dict[str, Any]]) -> str:
    """A Markdown table: a row per policy, value [low, high] per metric."""

    def cell(interval: list[float | None], digits: int) -> str:
        value, low, high = ("-" if v is None else f"{v:.{digits}g}" for v in interval)
        return value if low == "-" else f"{value} [{low}, {high}]"

    rows = [
        [policy, *(cell(summary["overall"][name], m.digits) for name, m in metrics.items())]
        for policy, summary in scores.items()
    ]
    headers = ["policy", *(metric.heading for metric in metrics.values())]
    return tabulate(rows, headers, tablefmt="github", disable_numparse=True)
