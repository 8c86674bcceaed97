"""Report of a study: a table of its groups, learning curves and performance profiles."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
from matplotlib import ticker
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import bootstrap, trim_mean
from tabulate import tabulate

from agents.training.runs import read_evaluations
from jansen_env.arrays import Array
from jansen_env.cli.plots import save
from jansen_env.files import write_text
from jansen_env.scoring.metrics import CONFIDENCE, Interval, interval_text

SCORES = "scores.json"  # file in the folder of a run: written last, when the run is finished
KEYS = ["group", "env", "seed", "policy"]  # columns that identify a run or a baseline
POINTS = ["steps", "cpu_seconds", "return"]  # columns of a point on a learning curve
NOTES = """\
A run's score is the mean return of its best model over the commands. IQM is the interquartile mean,
that of the middle half of the runs (Agarwal et al., NeurIPS 2021); brackets are its 95 % bootstrap
interval, over training runs, drawn within each environment. With few runs that covers less: some
75 % with 3 runs, 90 % with 10. Intervals over episodes are in each run's scores.json. The processor
time of a run includes its evaluations."""
FIGURES = """\
The figures show the learning curves of the groups against environment steps (upper left panel) and
against the processor time of a run (upper right). Solid and dotted lines are IQMs, bands contain
all runs, and dashed lines are the baselines. The lower panel shows, for each return, the fraction
of runs and commands with a higher return."""


def write_report(folder: Path) -> str:
    """Write report.md, runs.csv, returns.csv and figures (see ``docs/studies.md``).

    The report covers the finished runs. If there are none, it is made from an existing returns.csv.

    Args:
        folder: Folder of the study.

    Returns:
        The table of the report.

    Raises:
        ValueError: If there is neither a finished run nor a file returns.csv.
    """
    collected = collect_returns(folder)
    path = folder / "returns.csv"
    if collected is not None:
        scores, returns = collected
        scores.to_csv(folder / "runs.csv", index=False)
        returns.to_csv(path, index=False)
    if not path.is_file():
        raise ValueError(f"{folder} must contain a finished run, got none")
    returns = pd.read_csv(path)
    if "threshold" not in returns:  # the column is optional
        returns["threshold"] = returns.env.map(threshold_of)
    table = groups_table(returns)
    notes = [text.replace("\n", " ") for text in (NOTES, FIGURES)]
    parts = [f"# {folder.name}", table, *notes]
    for env, of_env in returns.groupby("env"):
        plot(of_env, folder / f"{env}.png")
        parts.append(f"![Learning curves and performance profile on {env}]({env}.png)")
    write_text(folder / "report.md", "\n\n".join(parts) + "\n")
    return table


def collect_returns(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame] | None:
    """Return the contents of runs.csv and returns.csv for the finished runs of a study.

    Args:
        folder: Folder of the study.

    Returns:
        The scores of each run and baseline, and their returns with the learning curves; None if no
        run is finished.
    """
    rows = []
    curves = []
    for file in sorted(folder.glob(f"*-seed_*/{SCORES}")):
        group, _, seed = file.parent.name.rpartition("-seed_")
        if not seed.isdecimal():  # the folder was not made by this program
            continue
        key = {"group": group, "env": group.split("_")[0], "seed": int(seed)}
        rows += read_scores(file, key)
        evaluations = pd.DataFrame(read_evaluations(file.parent))
        curves.append(evaluations.reindex(columns=POINTS).assign(**key, policy="run"))
    if not rows:
        return None
    scores = pd.concat(rows, ignore_index=True)
    returns = pd.concat([scores[[*KEYS, "command", "return"]], *curves]).round(3)
    # The baselines are the same for all runs.
    returns.loc[returns.policy != "run", ["group", "seed"]] = None
    returns["threshold"] = returns.env.map(threshold_of)
    columns = [*KEYS, "command", *POINTS, "threshold"]
    return scores, returns[columns].drop_duplicates()


def read_scores(file: Path, key: dict[str, object]) -> list[pd.DataFrame]:
    """Return the scores of a run and of the baselines, overall and at each command.

    Args:
        file: File with the scores.
        key: Group, environment and seed of the run by the names of their columns.
    """
    *baselines, (_, run) = json.loads(file.read_text("utf-8")).items()
    tables = []
    for policy, score in [("run", run), *baselines]:
        overall = score["overall"]
        commands = score["by_command"]
        values = {name: [overall[name][0], *commands[name]["value"]] for name in overall}
        grid = [None, *commands["return"]["command"]]
        tables.append(pd.DataFrame({**key, "policy": policy, "command": grid, **values}))
    return tables


def threshold_of(env_id: str) -> float | None:
    """Return the reward threshold of an environment; None if it has none.

    Args:
        env_id: Id of the environment.
    """
    return gym.spec(env_id).reward_threshold


def groups_table(returns: pd.DataFrame) -> str:
    """Return a Markdown table with one row per group of runs and one row per baseline.

    If the study has several environments, further rows combine the groups that differ only in the
    environment. Their returns are divided by the reward thresholds, and only seeds that are
    finished in all environments count.

    Args:
        returns: Contents of returns.csv, with a column ``threshold``.
    """
    rows: list[dict[str, object]] = []
    overall = returns[returns.command.isna() & returns.steps.isna()]
    runs = overall[overall.policy == "run"]
    if runs.env.nunique() > 1:
        runs = pd.concat([runs, relative_to_threshold(runs)])
    for group, scores in runs.groupby("group", sort=False):
        rows.append(group_row(str(group), scores, returns[returns.group == group]))
    for (env, policy), scores in overall[overall.policy != "run"].groupby(["env", "policy"]):
        rows.append({"group": f"{env}: {policy}", "mean return": f"{scores['return'].mean():.3g}"})
    return tabulate(rows, "keys", "github", disable_numparse=True)


def relative_to_threshold(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the runs in groups over all environments, with returns divided by the thresholds.

    Args:
        runs: Overall returns of all runs.
    """
    kinds = runs.group.str.partition("_")[2] + ", / threshold"
    relative = runs.assign(**{"group": kinds, "return": runs["return"] / runs.threshold})
    environments = relative.groupby(["group", "seed"]).env.transform("nunique")
    return relative[environments == runs.env.nunique()]


def group_row(group: str, scores: pd.DataFrame, returns: pd.DataFrame) -> dict[str, object]:
    """Return the row of a group of runs in the table.

    Args:
        group: Name of the group.
        scores: Overall returns of its runs.
        returns: Rows of returns.csv of the group.
    """
    strata = [of_env for _, of_env in scores.groupby("env")["return"]]
    values = scores.set_index("seed")["return"]
    steps, seconds = returns.groupby("seed")[POINTS[:2]].max().mean()
    return {
        "group": group,
        "runs": len(values),
        "steps": f"{steps:,.0f}".replace("nan", ""),
        "processor time (s)": f"{seconds:.0f}".replace("nan", ""),
        "IQM": interval_text(interquartile_mean(*strata)),
        "mean return": f"{values.mean():.3g}",
        "worst run": f"{values.min():.3g} (seed {values.idxmin():.0f})",
    }


def interquartile_mean(*strata: Array) -> Interval:
    """Return the mean of the middle half of all runs and its bootstrap percentile interval.

    The bootstrap resamples runs within each environment. The interval is NaN if an environment has
    a single run.

    Args:
        *strata: Returns of the runs on each environment, shape (n,) each.
    """
    low = high = np.nan
    if min(map(len, strata)) > 1:
        resampled = bootstrap(
            strata, _middle_mean, confidence_level=CONFIDENCE, method="percentile", rng=0
        )
        low, high = resampled.confidence_interval
    return float(_middle_mean(*strata)), float(low), float(high)


def _middle_mean(*samples: Array, axis: int = -1) -> Array:
    """Return the mean of the middle half of all samples along an axis."""
    return np.asarray(trim_mean(np.concatenate(samples, axis=axis), 0.25, axis=axis))


def plot(returns: pd.DataFrame, path: Path) -> None:
    """Draw the learning curves and the performance profile of an environment.

    The learning curves are drawn against steps and against processor time. The performance profile
    is the fraction of pairs of a run and a command whose return is above each value.

    Args:
        returns: Rows of returns.csv for this environment.
        path: Image file to write.
    """
    figure = Figure((6.4, 6.4), layout="constrained")
    (by_steps, by_time), (profile, key) = figure.subplots(2, 2)
    is_run = returns.policy == "run"
    for group, name, look in _group_looks(returns[is_run].group.drop_duplicates()):
        runs = returns[is_run & (returns.group == group)]
        _plot_curves(by_steps, by_time, runs, name, look)
        profile.ecdf(runs["return"][runs.command.notna()], complementary=True, **look)
    baselines = returns[~is_run & returns.command.isna()].groupby("policy")["return"].first()
    for i, (name, value) in enumerate(baselines.items()):
        for axis in (by_steps, by_time):
            axis.axhline(value, linestyle="--", color=f"C{9 - i}", label=name)
    by_steps.set(xscale="log", xlabel="environment steps", ylabel="return: IQM, band: all runs")
    by_steps.xaxis.set_major_locator(ticker.LogLocator(subs=(1.0, 3.0)))
    by_steps.xaxis.set_major_formatter(ticker.EngFormatter(sep=""))
    by_steps.xaxis.set_minor_locator(ticker.NullLocator())
    by_time.set(xlabel="processor time (s)")
    profile.set(xlabel="return of a run at a command", ylabel="fraction above this return")
    key.set_axis_off()
    key.legend(*by_steps.get_legend_handles_labels(), loc="center", frameon=False)
    save(figure, path)


def _group_looks(groups: pd.Series) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield each group with its name in the legend, and the colour and style of its lines.

    The algorithm determines the colour. If there are several configurations, they determine the
    style.
    """
    names = groups.str.partition("_")[2]
    kinds = names.str.partition("_")
    colours, _ = pd.factorize(kinds[0])
    styles, _ = pd.factorize(kinds[2])
    for group, name, colour, style in zip(groups, names, colours, styles, strict=True):
        yield group, name, {"color": f"C{colour}", "linestyle": ("-", ":", "-.")[style % 3]}


def _plot_curves(
    by_steps: Axes, by_time: Axes, runs: pd.DataFrame, name: str, look: dict[str, Any]
) -> None:
    """Draw the learning curve of a group against steps and against processor time."""
    curves = runs.pivot_table(POINTS[1:], "steps", "seed").dropna()  # steps common to all runs
    if not len(curves):
        return
    values = curves["return"]
    low = values.min(axis=1)
    high = values.max(axis=1)
    for axis, x in ((by_steps, low.index), (by_time, curves["cpu_seconds"].mean(axis=1))):
        axis.plot(x, trim_mean(values, 0.25, axis=1), label=name, **look)
        axis.fill_between(x, low, high, color=look["color"], alpha=0.15)
