"""Benchmarks, and from episodes to numbers: metrics over commands, with 95 % intervals."""

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
from jansen_env.baselines.policy import Policy, still

Episodes: TypeAlias = dict[str, NDArray[Any]]
"""Values (n,) of n episodes: "command", "returns", "duration" (s) and the aggregates."""

Infos: TypeAlias = dict[str, Any]
"""What a vector environment's step tells, by name."""

Summary: TypeAlias = dict[str, Any]
"""Scores of a policy, as :func:`summarise` returns them."""

Env: TypeAlias = gym.Env[Any, Any]
Pick: TypeAlias = Ints | slice  # of episodes

Interval: TypeAlias = tuple[float, float, float]
"""Value, lower and upper end of its 95 % interval; NaN for ends that are not known."""

MAIN = 8  # metrics of short tables
RESAMPLES = 2000
CONFIDENCE, ENDS = 0.95, (2.5, 97.5)  # of intervals; their percentiles
INTERVALS = (
    "95 % intervals over episodes: exact (Clopper-Pearson) for fractions, percentile bootstrap for "
    "the others"
)
SETTLING = 2.0  # s, after which a walk counts as steady
MIN_DISTANCE = 1e-3  # m, below which a ratio per metre is not formed


class Aggregate(NamedTuple):
    """Sum over an episode: values (n,) of each step's ``infos``, and their reduction.

    To the "sum" over its steps or the "steady" ones (after :data:`SETTLING`), the "peak" of the
    absolute value, the "rms", the "p99" (the 99th percentile of its steps), the "last" value, the
    last "early" one (within :data:`SETTLING`), or the "change": the sum of the absolute changes
    from step to step, the first from 0.
    """

    reduction: Literal["sum", "steady", "peak", "rms", "p99", "last", "early", "change"]
    function: Callable[[Infos], Array]


class Metric(NamedTuple):
    """A number for many episodes: a mean, or with a normaliser the ratio of two sums."""

    label: str
    unit: str  # "fraction" of what is 0 or 1 in each episode
    function: Callable[[Episodes, Env], Array]  # episodes and their environment to values (n,)
    normaliser: Callable[[Episodes, Env], Array] | None = None  # the same, m
    axis: Literal["linear", "log", "fraction", ""] = "linear"  # of figures; "" for tables alone
    digits: int = 3  # in tables

    @property
    def heading(self) -> str:
        """Label and unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label


@dataclass(frozen=True)
class Benchmark:
    """Rules by which policies are scored on an environment; by default its return alone.

    Attributes:
        commands: the grid on which policies are scored; one 0 for a task without commands.
        option: of a reset, that takes the command; "" for none. command_unit: of it.
        aggregates: kept of each episode. metrics: the first is "return".
        baselines: for an unwrapped environment; the main one first.
        chosen_by: the metric by which the best model of a run is chosen.
        variety: times the episodes that choosing takes where only the start differs.
        drawn: commands of a reset; None: the environment's ``speed_command``.
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
        """The command in the middle of the grid."""
        return self.commands[(len(self.commands) - 1) // 2]

    def options(self, command: object) -> dict[str, Any]:
        """Return the options of a reset with a command."""
        return {self.option: command} if self.option else {}


def mean_of(name: str) -> Callable[[Episodes, Env], Array]:
    """Return a metric's function: the mean of an aggregate."""
    return lambda run, _: np.asarray(run[name], dtype=float)


def horizon(env: Env) -> float:
    """Return the time limit of an episode, s."""
    steps = env.get_wrapper_attr("spec").max_episode_steps
    return float(steps * env.get_wrapper_attr("control_dt"))


def per_weight(name: str) -> Callable[[Episodes, Env], Array]:
    """Return a metric's function: work / weight, m; of the episodes' own "weight", N, if any."""

    def work_per_weight(run: Episodes, env: Env) -> Array:
        weight = run.get("weight", env.get_wrapper_attr("task").world.weight[0])
        return run[name] / weight

    return work_per_weight


TORQUE = {
    "peak_torque": Aggregate("peak", lambda info: info["crank_torque"]),
    "rms_torque": Aggregate("rms", lambda info: info["crank_torque"]),
}
"""Aggregates of the crank's torque, N m."""


def _estimator(metric: Metric, run: Episodes, env: Env) -> Callable[[Pick], Array]:
    """The metric of episodes picked by an index array (..., n): (...)."""
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
    """Every metric over all episodes, without intervals; NaN is None."""
    return {
        name: _number(_estimator(metric, run, env)(slice(None))) for name, metric in metrics.items()
    }


def tabled(metrics: dict[str, Metric]) -> dict[str, Metric]:
    """Return the metrics of tables and figures: those that have no ``steady_`` one beside them."""
    return {name: metric for name, metric in metrics.items() if f"steady_{name}" not in metrics}


def main_metrics(metrics: dict[str, Metric]) -> dict[str, Metric]:
    """Return the metrics that matter most: the return, fractions, then others of the figures."""
    drawn = {name: metric for name, metric in tabled(metrics).items() if metric.axis}
    first = sorted(drawn, key=lambda name: (name != "return", drawn[name].unit != "fraction"))
    return {name: drawn[name] for name in first[:MAIN]}


def proportion_with_interval(k: int, n: int) -> Interval:
    """Return k / n with its exact 95 % interval (Clopper and Pearson 1934), both ends at 2.5 %.

    It has a width where k is 0 or n, too, and never covers less than 95 %, as Wilson's may.

    Raises:
        ValueError: n is 0, or k is not within 0 and n.
    """
    from scipy.stats import binomtest  # only now, as it takes long to import

    test = binomtest(k, n)
    ends = test.proportion_ci(CONFIDENCE, method="exact")
    return float(test.statistic), float(ends.low), float(ends.high)


def summarise(metrics: dict[str, Metric], run: Episodes, env: Env, seed: int = 0) -> Summary:
    """Every metric over all episodes and for each command, with 95 % intervals.

    Fractions have :func:`proportion_with_interval` of their episodes, other metrics the percentile
    bootstrap (Efron and Tibshirani 1993), resampled within each command. Resamples in which nobody
    walked do not count; with one episode per command there is no such interval.

    Args:
        metrics: by name. run: episodes, the same number for each command. seed: of the resampling.
        env: the environment they were run in, as ``gym.make`` gives it.

    Returns:
        {"overall": {metric: [value, low, high]}, "by_command": {metric: {"command": [...],
        "value": [...], "low": [...], "high": [...]}}, "episodes": n}; NaN is None.
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
    """Return :func:`summarise` without ``"by_command"``: the commands may all differ.

    Args:
        groups: indices of the episodes that are resampled together; none for all of them as one.
    """
    count = len(run["command"])
    strata = groups or [np.arange(count)]
    overall = {name: _interval(m, run, env, strata, seed) for name, m in metrics.items()}
    return {"overall": overall, "episodes": count}


def _interval(
    metric: Metric, run: Episodes, env: Env, groups: Sequence[Ints], seed: int
) -> list[float | None]:
    """The metric of all groups' episodes, and its interval."""
    estimator, episodes = _estimator(metric, run, env), np.concatenate(groups)
    value = estimator(episodes)
    if metric.unit == "fraction":
        return [*proportion_with_interval(round(float(value) * len(episodes)), len(episodes))]
    if np.isnan(value) or min(map(len, groups)) < 2:
        return [_number(value), None, None]
    from scipy.stats import DegenerateDataWarning, bootstrap

    with catch_warnings():
        simplefilter("ignore", DegenerateDataWarning)  # of its interval, where one is NaN
        resampled = bootstrap(
            groups, lambda *picks, axis: estimator(np.concatenate(picks, axis)), vectorized=True,
            n_resamples=RESAMPLES, method="percentile", rng=seed,
        ).bootstrap_distribution  # fmt: skip
    low, high = np.nanpercentile(resampled, ENDS)
    return [_number(value), _number(low), _number(high)]


def _number(value: float | Array) -> float | None:
    return float(value) if np.isfinite(value) else None


def interval_text(interval: Sequence[float | None], digits: int = 3) -> str:
    """Return "value [low, high]", to so many significant digits; "-" for None and NaN."""
    value, *ends = ("-" if n is None or np.isnan(n) else f"{n:.{digits}g}" for n in interval)
    return f"{value} [{', '.join(ends)}]" if ends and ends[0] != "-" else value


def screen_table(cells: Sequence[Sequence[str]]) -> str:
    """Return a table in plain text, its head first, whose cells wrap at the terminal's width."""
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
    """Return the cells of a table, its head first: a row per policy, a column per metric.

    ``parts`` is 3 for values [low, high], 1 for values alone.
    """
    rows = [
        [policy, *(interval_text(summary["overall"][name][:parts], metric.digits)
                   for name, metric in metrics.items())]
        for policy, summary in scores.items()
    ]  # fmt: skip
    return [["", *(metric.heading for metric in metrics.values())], *rows]


def score_table(
    metrics: dict[str, Metric], scores: Mapping[str, Summary], rows_are: str = "policy"
) -> str:
    """A Markdown table of each policy's value [low, high] of each metric of :func:`tabled`: a row
    per policy, or with "metric" for ``rows_are`` a row per metric."""
    from tabulate import tabulate

    table = score_cells(tabled(metrics), scores)
    table[0][0] = rows_are
    if rows_are == "metric":
        table = [list(row) for row in zip(*table, strict=True)]
    return tabulate(table[1:], table[0], tablefmt="github", disable_numparse=True)
