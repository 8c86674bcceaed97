"""Report of a study: tables and figures in report.md, numbers in report.json, two CSV files."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from tabulate import tabulate

from agents.studies.plan import Run, Study
from agents.studies.run import SCORES, read_status, run_state
from agents.studies.seed_statistics import (
    improvement_over,
    interquartile_mean,
    iqm_with_interval,
    mean_with_interval,
    probability_of_improvement,
    resampled,
    share_with_interval,
)
from agents.training.runs import read_evaluations
from jansen_env.commands.plots import save
from jansen_env.files import write_json, write_text
from jansen_env.scoring.benchmarks import Benchmark, find_benchmark
from jansen_env.scoring.metrics import tabled

Row = dict[str, Any]

NOTES = """\
A run's score is the mean return of its best model over the commands; brackets are 95 % intervals
over runs, that is over seeds: what training again would give, not what scoring again would
(intervals over episodes are in each run's scores.json). Means have Student's t interval, those of
fractions Korn and Graubard's (1998); the interquartile mean (IQM, the mean of the middle half of
the runs) has that of the BCa bootstrap over runs (Efron 1987), P(run of X > run of Y) the
percentile bootstrap's (Agarwal et al. 2021), P(run > baseline) the exact one (Clopper and Pearson
1934), with the baseline's return taken as exact. With few runs a bootstrap's nominal 95 % cover
less: some 75 % with 3 runs, 90 % with 10."""
RUNS = ("runs of", "finished", "mean return", "IQM of return", "worst run", "baseline",
        "its return", "P(run > baseline)")  # fmt: skip
BASELINE = {"color": "0.35", "linewidth": 1.0}
DASHES = ("--", ":", "-.")


def write_report(study: Study, folder: Path) -> str:
    """Write report.md, its figures, report.json, runs.csv and commands.csv into a study's folder;
    return the table, and which runs are not finished. A ValueError names a damaged file."""
    rows = [_collect(run) for run in study.runs(folder)]
    found = analyse(study, rows)
    figures = plot_study(found, folder)
    write_json(folder / "report.json", {**found, "runs": rows})
    keys = ("group", "env", "algo", "seed", "state", "error")
    lines = [{key: row[key] for key in keys} | row.get("scores", {}).get("run", {}) for row in rows]
    write_text(folder / "runs.csv", _csv(lines))
    write_text(folder / "commands.csv", _csv(command_rows(rows)))
    text = study_table(found)
    unfinished = [
        f"- {row['group']}/seed_{row['seed']}: {row['state']}" + f", {row['error']}".rstrip(", ")
        for row in rows
        if row["state"] != "finished"
    ]
    if unfinished:
        text += "\n\nNot finished:\n\n" + "\n".join(unfinished)
    page = [f"# {folder.name}", f"{len(study.groups)} groups of {len(study.seeds)} runs.", text,
            *_comparison(found), NOTES.replace("\n", " "), *_details(found),
            *(f"![Runs on {path.stem}]({path.name})" for path in figures)]  # fmt: skip
    write_text(folder / "report.md", "\n\n".join(page) + "\n")
    return text


def _collect(run: Run) -> Row:
    """Return a run's ``state`` ("finished", "failed", ...), and once it is finished ``scores`` and
    ``by_command`` of all policies by metric, and ``evaluations``."""
    row: Row = {"group": run.group, "env": run.config["env"], "algo": run.config["algo"],
                "seed": run.config["seed"], "state": run_state(run), "error": ""}  # fmt: skip
    if row["state"] != "finished":
        return {**row, "error": read_status(run.folder).get("error", "")}
    path = run.folder / SCORES
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        found["run"] = found.pop([*found][-1])
        row["scores"], row["by_command"], row["episodes"] = {}, {}, found["run"]["episodes"]
        for name, policy in found.items():
            row["scores"][name] = {key: value[0] for key, value in policy["overall"].items()}
            row["by_command"][name] = {
                key: {"command": values["command"], "value": values["value"]}
                for key, values in policy["by_command"].items()
            }
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise ValueError(f"{path} is damaged: {error}; without it the run is scored again"
                         ) from error  # fmt: skip
    return {**row, "evaluations": read_evaluations(run.folder)}


def analyse(study: Study, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the numbers of tables and figures: "groups" by name, and "improvement" of each over
    those after it; intervals are lists [value, low, high]."""
    groups = {}
    for name, config in study.groups.items():
        own = [row for row in rows if row["group"] == name]
        groups[name] = {"env": config["env"], "runs": len(own), **_analyse(config["env"], own)}
    improvement: dict[str, Any] = {name: {} for name in groups}
    for (name, group), (other, compared) in combinations(groups.items(), 2):
        if compared["env"] == group["env"]:
            found = probability_of_improvement(group["returns"], compared["returns"])
            improvement[name][other] = listed(found)
    return {"groups": groups, "improvement": improvement}


def _analyse(env_id: str, rows: list[Row]) -> dict[str, Any]:
    benchmark = find_benchmark(env_id)
    finished = [row for row in rows if row["state"] == "finished"]
    returns = [row["scores"]["run"]["return"] for row in finished]
    known = finished[0]["scores"] if finished else {"run": {}}  # baselines: the same for all runs
    runs = {name: [row["scores"]["run"][name] for row in finished] for name in known["run"]}
    metrics = {
        name: share_with_interval(_numbers(shares), finished[0]["episodes"])
        if (metric := benchmark.metrics.get(name)) and metric.unit == "fraction"
        else mean_with_interval(_numbers(shares))
        for name, shares in runs.items()
    }
    worst = min(finished, key=lambda row: row["scores"]["run"]["return"], default=None)
    baselines = {
        name: {"return": known[name]["return"], "metrics": known[name],
               "improvement": listed(improvement_over(known[name]["return"], returns))}
        for name in benchmark.baselines if name in known
    }  # fmt: skip
    return {
        "finished": len(finished), "returns": returns, "baselines": baselines,
        "mean": listed(mean_with_interval(returns)), "iqm": listed(iqm_with_interval(returns)),
        "worst": worst and {"return": min(returns), "seed": worst["seed"]},
        "metrics": {name: listed(interval) for name, interval in metrics.items()},
        "by_command": over_seeds(benchmark, finished),
        "curve": _curve([row["evaluations"] for row in finished]),
    }  # fmt: skip


def over_seeds(benchmark: Benchmark, rows: Sequence[Row]) -> dict[str, Any]:
    """Return "mean" and "worst" seed of finished runs at each command, by heading, of metrics where
    less is better; None for what some seed has no value of, {} without a run."""
    if not rows:
        return {}
    first, columns = rows[0]["by_command"]["run"], {}
    for name, metric in tabled(benchmark.metrics).items():
        if metric.axis and name not in ("return", benchmark.chosen_by) and name in first:
            values = np.stack([_numbers(row["by_command"]["run"][name]["value"]) for row in rows])
            mean, worst = listed(values.mean(axis=0)), listed(values.max(axis=0))
            columns[metric.heading] = {"mean": mean, "worst": worst}
    return {"command": next(iter(first.values()))["command"], "columns": columns}


def _curve(runs: Sequence[list[Row]]) -> dict[str, list[float | None]]:
    """Return mean and IQM of the returns, with the IQM's interval, at the steps of all runs."""
    every = [{row["steps"]: row["return"] for row in run} for run in runs if run]
    steps = sorted(set.intersection(*map(set, every))) if every else []
    curves: dict[str, Any] = dict.fromkeys(("mean", "iqm", "low", "high"), ())
    if steps:
        returns = np.array([[run[step] for step in steps] for run in every])
        low, high = resampled(interquartile_mean, returns)
        curves = {"mean": returns.mean(axis=0), "iqm": interquartile_mean(returns)}
        curves |= {"low": low, "high": high}
    return {name: listed(values) for name, values in {"steps": steps, **curves}.items()}


def study_table(found: dict[str, Any]) -> str:
    """Return a Markdown table: of each group a row for each baseline."""
    table = []
    for name, group in found["groups"].items():
        worst = group["worst"]
        own = [name, f"{group['finished']}/{group['runs']}", _cell(group["mean"]),
               _cell(group["iqm"]),
               f"{worst['return']:.3g} (seed {worst['seed']})" if worst else "-"]  # fmt: skip
        for baseline, score in group["baselines"].items():
            table.append([*own, baseline, f"{score['return']:.3g}", _cell(score["improvement"], 2)])
            own = [""] * len(own)
        if not group["baselines"]:
            table.append([*own, "-", "-", "-"])
    return _table(table, RUNS)


def _details(found: dict[str, Any]) -> Iterator[str]:
    """Give all metrics of each environment, and those of each group at each command."""
    for env_id in dict.fromkeys(group["env"] for group in found["groups"].values()):
        benchmark = find_benchmark(env_id)
        groups = {name: group for name, group in found["groups"].items()
                  if group["env"] == env_id and group["finished"]}  # fmt: skip
        rows = {name: group["metrics"] for name, group in groups.items()}
        for group in list(groups.values())[:1]:
            for name, score in group["baselines"].items():
                rows[name] = {key: [value] for key, value in score["metrics"].items()}
        metrics = tabled(benchmark.metrics)
        table = [
            [name, *(_cell(values.get(key, [None]), m.digits) for key, m in metrics.items())]
            for name, values in rows.items()
        ]
        headings = [metric.heading for metric in metrics.values()]
        yield f"## {env_id}\n\nMeans over the seeds.\n\n{_table(table, ['runs of', *headings])}"
        for name, group in groups.items():
            if group["by_command"]["columns"]:
                yield (f"### {name}\n\nAt each command ({benchmark.command_unit}) the mean over "
                       f"the {group['finished']} seeds and, in brackets, the worst seed's; less is "
                       f"better in each column.\n\n{command_table(group['by_command'])}"
                       )  # fmt: skip


def command_table(found: dict[str, Any]) -> str:
    """Return a Markdown table of :func:`over_seeds`: the mean and, in brackets, the worst seed."""
    columns = found["columns"].values()
    table = [
        [f"{command:g}", *("-" if column["mean"][i] is None
                           else f"{column['mean'][i]:.2g} ({column['worst'][i]:.2g})"
                           for column in columns)]
        for i, command in enumerate(found["command"])
    ]  # fmt: skip
    return _table(table, ["command", *found["columns"]])


def _comparison(found: dict[str, Any]) -> list[str]:
    """Return the probability of improvement of each group over those after it."""
    pairs = [
        [name, other, _cell(interval, 2)]
        for name, others in found["improvement"].items()
        for other, interval in others.items()
        if interval[0] is not None
    ]
    return [_table(pairs, ["X", "Y", "P(run of X > run of Y)"])] if pairs else []


def command_rows(rows: Sequence[Row]) -> list[Row]:
    """Return the lines of commands.csv: each run's metrics, each group's baselines, by command."""
    lines: dict[tuple[Any, ...], Row] = {}
    for row in rows:
        for policy, metrics in row.get("by_command", {}).items():
            seed = row["seed"] if policy == "run" else ""
            for i, command in enumerate(next(iter(metrics.values()))["command"]):
                own = {"group": row["group"], "seed": seed, "policy": policy, "command": command}
                values = {name: found["value"][i] for name, found in metrics.items()}
                lines.setdefault((*own.values(),), {**own, **values})
    return list(lines.values())


def _table(rows: Sequence[Sequence[str]], headers: Sequence[str]) -> str:
    return tabulate(rows, headers, tablefmt="github", disable_numparse=True)


def _cell(interval: Sequence[float | None], digits: int = 3) -> str:
    value, *ends = ("-" if v is None else f"{v:.{digits}g}" for v in interval)
    return f"{value} [{', '.join(ends)}]" if ends and ends[0] != "-" else value


def _csv(lines: Sequence[Row]) -> str:
    file = io.StringIO()
    writer = csv.DictWriter(file, list(dict.fromkeys(name for line in lines for name in line)))
    writer.writeheader()
    writer.writerows(lines)
    return file.getvalue()


def _numbers(values: Iterable[float | None]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return an array with NaN for None."""
    return np.array([math.nan if value is None else value for value in values], float)


def listed(values: Iterable[Any]) -> list[float | None]:
    """Return numbers for JSON: None for those that are not finite."""
    return [float(value) if math.isfinite(value) else None for value in values]


def plot_study(found: dict[str, Any], folder: Path) -> list[Path]:
    """Write ENV.png, learning curves and scores, for each environment with finished runs."""
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
