"""Benchmarks, and metrics that summarise episodes over commands, with 95 % intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from io import StringIO
from shutil import get_terminal_size
from typing import Any, Literal, NamedTuple, TypeAlias
from warnings import catch_warnings, simplefilter

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Array, Ints
from jansen_env.policies.policy import Policy, still

Episodes: TypeAlias = dict[str, NDArray[Any]]
"""Values of n episodes, by name: "command", "returns", "duration" (in s) and the aggregates.

Each has shape (n,).
"""

Infos: TypeAlias = dict[str, Any]
"""The ``info`` of a step of a vector environment, by name."""

Summary: TypeAlias = dict[str, Any]
"""Scores of a policy, as :func:`summarise` returns them."""

Env: TypeAlias = gym.Env[Any, Any]
Pick: TypeAlias = Ints | slice
"""Indices of episodes."""

Interval: TypeAlias = tuple[float, float, float]
"""Value, lower and upper end of its 95 % interval; NaN for ends that are not known."""

MAIN = 8  # number of metrics in short tables
RESAMPLES = 2000
CONFIDENCE = 0.95  # confidence of intervals
ENDS = (2.5, 97.5)  # percentiles of the ends of intervals
INTERVALS = (
    "95 % intervals over episodes: exact (Clopper-Pearson) for fractions, percentile bootstrap for "
    "the others"
)
SETTLING = 2.0  # time after which a walk counts as steady, in s
MIN_DISTANCE = 1e-3  # distance below which no ratio per metre is computed, in m


class Aggregate(NamedTuple):
    """Number of an episode, computed from one value per step.

    Attributes:
        reduction: How the values of the steps are reduced to one number. "sum" is their sum, and
            "steady" the sum over the steps after :data:`SETTLING`. "peak" is the largest absolute
            value, "rms" the root mean square, and "p99" the 99th percentile over the steps. "last"
            is the value of the last step, and "early" the value of the last step within
            :data:`SETTLING`. "change" is the sum of the absolute changes from step to step; the
            first change is counted from 0.
        function: Function that returns the values of n robots from the ``infos`` of a step, shape
            (n,).
    """

    reduction: Literal["sum", "steady", "peak", "rms", "p99", "last", "early", "change"]
    function: Callable[[Infos], Array]


class Metric(NamedTuple):
    """Number for many episodes: a mean, or the ratio of two sums if there is a normaliser.

    Attributes:
        label: Name in tables and figures.
        unit: Unit. "fraction" marks a metric that is 0 or 1 in each episode.
        function: Function that returns the value of each episode from the episodes and their
            environment, shape (n,).
        normaliser: Function that returns the distance of each episode, in m, shape (n,). None for a
            mean.
        axis: Kind of axis in figures. A metric with "" appears only in tables.
        digits: Number of significant digits in tables.
    """

    label: str
    unit: str
    function: Callable[[Episodes, Env], Array]
    normaliser: Callable[[Episodes, Env], Array] | None = None
    axis: Literal["linear", "log", "fraction", ""] = "linear"
    digits: int = 3

    @property
    def heading(self) -> str:
        """Label, followed by the unit in brackets."""
        return f"{self.label} ({self.unit})" if self.unit else self.label


@dataclass(frozen=True)
class Benchmark:
    """Rules by which policies are scored on an environment; by default by their return alone.

    Attributes:
        commands: Commands at which policies are scored. A single 0 for a task without commands.
        option: Name of the reset option that sets the command; "" for none.
        command_unit: Unit of the command.
        aggregates: Numbers that are computed for each episode, by name.
        metrics: Metrics, by name. The first one is "return".
        baselines: Functions that make a baseline for an unwrapped environment, by name. The first
            one is the main baseline.
        chosen_by: Name of the metric by which the best model of a training run is chosen.
        variety: Factor by which the number of episodes for this choice is larger than for an
            environment in which only the initial state differs.
        drawn: Range of the commands that are sampled. None for the ``speed_command`` of the
            environment.
    """

    commands: tuple[float, ...] = (0.0,)
    option: str = ""
    command_unit: str = ""
    aggregates: dict[str, Aggregate] = field(default_factory=dict)
    metrics: dict[str, Metric] = field(
        default_factory=lambda: {"return": Metric("return", "", mean_of("returns"))}
    )
    baselines: dict[str, Callable[[Any], Policy]] = field(default_factory=lambda: {"still": still})
    chosen_by: str = "return"
    variety: int = 1
    drawn: tuple[float, float] | None = None

    @property
    def middle(self) -> float:
        """Command in the middle of :attr:`commands`."""
        return self.commands[(len(self.commands) - 1) // 2]

    def options(self, command: object) -> dict[str, Any]:
        """Return the reset options that set a command."""
        return {self.option: command} if self.option else {}


def mean_of(name: str) -> Callable[[Episodes, Env], Array]:
    """Return the function of a metric that is the mean of an aggregate."""
    return lambda run, _: np.asarray(run[name], dtype=float)


def horizon(env: Env) -> float:
    """Return the time limit of an episode, in s."""
    steps = env.get_wrapper_attr("spec").max_episode_steps
    return float(steps * env.get_wrapper_attr("control_dt"))


def per_weight(name: str) -> Callable[[Episodes, Env], Array]:
    """Return the function of a metric that is an amount of work divided by the weight, in m.

    If the episodes have values "weight", in N, the function divides by these. Otherwise it divides
    by the weight of the robot in the environment.

    Args:
        name: Name of the aggregate that contains the work, in J.
    """

    def work_per_weight(run: Episodes, env: Env) -> Array:
        weight = run.get("weight", env.get_wrapper_attr("task").world.weight[0])
        return run[name] / weight

    return work_per_weight


TORQUE = {
    "peak_torque": Aggregate("peak", lambda info: info["crank_torque"]),
    "rms_torque": Aggregate("rms", lambda info: info["crank_torque"]),
}
"""Aggregates of the crank torque, in N m."""


def _estimator(metric: Metric, run: Episodes, env: Env) -> Callable[[Pick], Array]:
    """Return a function that computes a metric from selected episodes.

    The function takes indices of episodes, shape (..., n), and returns the metric, shape (...).
    """
    values = metric.function(run, env)
    if metric.normaliser is None:
        return lambda pick: values[pick].mean(axis=-1)
    lengths = metric.normaliser(run, env)

    def ratio(pick: Pick) -> Array:
        length = lengths[pick].sum(axis=-1)
        value = values[pick].sum(axis=-1) / np.maximum(length, MIN_DISTANCE)
        return np.where(length > MIN_DISTANCE, value, np.nan)

    return ratio


def point_estimates(metrics: dict[str, Metric], run: Episodes, env: Env) -> dict[str, float | None]:
    """Return every metric over all episodes, without intervals; NaN becomes None."""
    return {
        name: _number(_estimator(metric, run, env)(slice(None))) for name, metric in metrics.items()
    }


def tabled(metrics: dict[str, Metric]) -> dict[str, Metric]:
    """Return the metrics of tables and figures: those without a ``steady_`` counterpart.

    Args:
        metrics: The metrics, by name.
    """
    return {name: metric for name, metric in metrics.items() if f"steady_{name}" not in metrics}


def main_metrics(metrics: dict[str, Metric]) -> dict[str, Metric]:
    """Return the metrics of short tables: the return, then fractions, then others with an axis.

    Args:
        metrics: The metrics, by name.
    """
    drawn = {name: metric for name, metric in tabled(metrics).items() if metric.axis}
    first = sorted(drawn, key=lambda name: (name != "return", drawn[name].unit != "fraction"))
    return {name: drawn[name] for name in first[:MAIN]}


def proportion_with_interval(k: int, n: int) -> Interval:
    """Return k / n with its exact, central 95 % interval (Clopper and Pearson 1934).

    The interval has a width above 0 even if k is 0 or n, and its coverage is never less than 95 %,
    whereas that of Wilson's interval may be.

    Args:
        k: Number of successes.
        n: Number of trials.

    Raises:
        ValueError: If n is 0, or k is not between 0 and n.
    """
    from scipy.stats import binomtest  # imported here, because the import takes long

    test = binomtest(k, n)
    ends = test.proportion_ci(CONFIDENCE, method="exact")
    return float(test.statistic), float(ends.low), float(ends.high)


def summarise(metrics: dict[str, Metric], run: Episodes, env: Env, seed: int = 0) -> Summary:
    """Return every metric over all episodes and for each command, with 95 % intervals.

    The interval of a fraction is that of :func:`proportion_with_interval`. The interval of any
    other metric is a percentile bootstrap (Efron and Tibshirani 1993), for which episodes are
    resampled within each command. Resamples in which no robot walked are ignored. With a single
    episode per command, there is no bootstrap interval.

    Args:
        metrics: The metrics, by name.
        run: Values of the episodes, with the same number of episodes for each command.
        env: Environment in which the episodes were run, as ``gym.make`` returns it.
        seed: Seed of the resampling.

    Returns:
        {"overall": {metric: [value, low, high]}, "by_command": {metric: {"command": [...], "value":
            [...], "low": [...], "high": [...]}}, "episodes": n}. None replaces NaN.
    """
    commands = np.unique(run["command"])
    groups = [np.flatnonzero(run["command"] == command) for command in commands]
    by_command = {}
    for name, metric in metrics.items():
        rows = [_interval(metric, run, env, [group], seed) for group in groups]
        ends = dict(zip(("value", "low", "high"), map(list, zip(*rows, strict=True)), strict=True))
        by_command[name] = {"command": commands.tolist(), **ends}
    return {**pooled(metrics, run, env, seed, groups), "by_command": by_command}


def pooled(
    metrics: dict[str, Metric], run: Episodes, env: Env, seed: int = 0, groups: Sequence[Ints] = ()
) -> Summary:
    """Return the result of :func:`summarise` without ``"by_command"``.

    The commands of the episodes may all be different.

    Args:
        metrics: The metrics, by name.
        run: Values of the episodes.
        env: Environment in which the episodes were run, as ``gym.make`` returns it.
        seed: Seed of the resampling.
        groups: Indices of the episodes in each group that is resampled by itself. If it is empty,
            all episodes are one group.
    """
    count = len(run["command"])
    strata = groups or [np.arange(count)]
    overall = {name: _interval(m, run, env, strata, seed) for name, m in metrics.items()}
    return {"overall": overall, "episodes": count}


def _interval(
    metric: Metric, run: Episodes, env: Env, groups: Sequence[Ints], seed: int
) -> list[float | None]:
    """Return a metric over all episodes: its value, and lower and upper end of its interval."""
    estimator = _estimator(metric, run, env)
    episodes = np.concatenate(groups)
    value = estimator(episodes)
    if metric.unit == "fraction":
        return [*proportion_with_interval(round(float(value) * len(episodes)), len(episodes))]
    if np.isnan(value) or min(map(len, groups)) < 2:
        return [_number(value), None, None]
    from scipy.stats import DegenerateDataWarning, bootstrap

    with catch_warnings():
        simplefilter("ignore", DegenerateDataWarning)  # issued if a value is NaN
        resampled = bootstrap(
            groups,
            lambda *picks, axis: estimator(np.concatenate(picks, axis)),
            vectorized=True,
            n_resamples=RESAMPLES,
            method="percentile",
            rng=seed,
        ).bootstrap_distribution
    low, high = np.nanpercentile(resampled, ENDS)
    return [_number(value), _number(low), _number(high)]


def _number(value: float | Array) -> float | None:
    """Return a number as a float, or None if it is not finite."""
    return float(value) if np.isfinite(value) else None


def interval_text(interval: Sequence[float | None], digits: int = 3) -> str:
    """Return "value [low, high]" with ``digits`` significant digits; None and NaN become "-"."""
    value, *ends = ("-" if n is None or np.isnan(n) else f"{n:.{digits}g}" for n in interval)
    return f"{value} [{', '.join(ends)}]" if ends and ends[0] != "-" else value


def screen_table(cells: Sequence[Sequence[str]]) -> str:
    """Return a table in plain text, whose cells wrap so that it fits the terminal.

    Args:
        cells: Rows of the table. The first row is its head.
    """
    from rich.box import MARKDOWN
    from rich.console import Console
    from rich.table import Column, Table

    table = Table(*(Column(name, overflow="fold") for name in cells[0]), box=MARKDOWN)
    for row in cells[1:]:
        table.add_row(*row)
    width = get_terminal_size().columns
    console = Console(file=StringIO(), width=width, markup=False, emoji=False, color_system=None)
    with console.capture() as captured:
        console.print(table)
    return captured.get().strip()


def score_cells(
    metrics: dict[str, Metric], scores: Mapping[str, Summary], parts: int = 3
) -> list[list[str]]:
    """Return the cells of a table with one row per policy and one column per metric.

    Args:
        metrics: The metrics, by name.
        scores: Scores of each policy, by name.
        parts: 3 for values with intervals, 1 for values alone.

    Returns:
        The rows of the table. The first row is its head.
    """
    rows = [
        [
            policy,
            *(
                interval_text(summary["overall"][name][:parts], metric.digits)
                for name, metric in metrics.items()
            ),
        ]
        for policy, summary in scores.items()
    ]
    return [["", *(metric.heading for metric in metrics.values())], *rows]


def score_table(
    metrics: dict[str, Metric], scores: Mapping[str, Summary], rows_are: str = "policy"
) -> str:
    """Return a Markdown table with the scores of policies and their intervals.

    Args:
        metrics: The metrics, by name. The table contains those of :func:`tabled`.
        scores: Scores of each policy, by name.
        rows_are: "policy" for one row per policy, "metric" for one row per metric.
    """
    from tabulate import tabulate

    table = score_cells(tabled(metrics), scores)
    table[0][0] = rows_are
    if rows_are == "metric":
        table = [list(row) for row in zip(*table, strict=True)]
    return tabulate(table[1:], table[0], tablefmt="github", disable_numparse=True)
