"""What a study found: one table, the numbers behind it, and the raw data."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate

from agents.metrics import tabled
from agents.runs import read_evaluations
from agents.seed_statistics import (
    improvement_over,
    interquartile_mean,
    iqm_with_interval,
    mean,
    mean_with_interval,
    median_with_never,
    probability_of_improvement,
    resampled,
)
from agents.study_commands import by_command, command_csv, command_table, listed, numbers
from agents.study_figures import plot_study
from agents.study_plan import Run, Study
from agents.study_runs import SCORES, is_finished, read_status
from agents.tasks import find_task
from jansen_env.files import write_json, write_text

NOTES = """\
A run's score is the mean return of its best model over the commands; brackets are 95 % intervals
over runs, that is over seeds: what training again would give, not what scoring again would
(intervals over episodes are in each run's scores.json). Means have Student's t interval; the
interquartile mean (IQM, the mean of the middle half of the runs) has that of the BCa bootstrap over
runs (Efron 1987), P(run of X > run of Y) and the performance profile the percentile bootstrap's
(Agarwal et al. 2021), P(run > baseline) the exact one (Clopper and Pearson 1934), with the
baseline's return taken as exact.
With few runs a bootstrap's nominal 95 % cover less: some 75 % with 3 runs, 90 % with 10. Steps and
seconds until a baseline is beaten are those of the first evaluation during training with a higher
return than the baseline's; the median is over all runs, of which those that never do count as later
than all. Seconds are of training, with its evaluations."""


def collect(study: Study, folder: Path) -> list[dict[str, Any]]:
    """What came out of each run: a row, with ``state`` "finished", "failed", ... and, where it is
    finished, ``scores`` of all policies by metric, ``by_command`` of all policies by metric and
    command, ``ahead`` by baseline and ``evaluations``.

    Raises:
        ValueError: a file of a finished run is damaged.
    """
    return [_collect(run) for run in study.runs(folder)]


def _collect(run: Run) -> dict[str, Any]:
    status = read_status(run.folder)
    row: dict[str, Any] = {
        "group": run.group, "env": run.config["env"], "algo": run.config["algo"],
        "seed": run.config["seed"], "state": status.get("state", "waiting"),
        "steps": status.get("steps"), "error": status.get("error", ""),
    }  # fmt: skip
    if not is_finished(run.folder):
        return row
    path = run.folder / SCORES
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        *baselines, own = found
        names = {name: "run" if name == own else name for name in found}
        scores = {
            names[name]: {metric: value[0] for metric, value in policy["overall"].items()}
            for name, policy in found.items()
        }
        by_command = {
            names[name]: {
                metric: {"command": rows["command"], "value": rows["value"]}
                for metric, rows in policy["by_command"].items()
            }
            for name, policy in found.items()
        }
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path} is damaged: {error}; without it the run is scored again"
                         ) from error  # fmt: skip
    evaluations = read_evaluations(run.folder)
    ahead = {name: _first_ahead(evaluations, scores[name]["return"]) for name in baselines}
    row |= {"state": "finished", "error": "", "scores": scores, "by_command": by_command}
    return row | {"ahead": ahead, "evaluations": evaluations}


def _first_ahead(evaluations: list[dict[str, Any]], mark: float) -> dict[str, float] | None:
    """Steps and seconds of the first evaluation with a return above a mark."""
    for row in evaluations:
        if row["return"] > mark:
            return {"steps": row["steps"], "seconds": row.get("seconds", math.nan)}
    return None


def analyse(study: Study, rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The numbers of the table and the figures: by group, and of each pair of groups.

    Returns:
        {"groups": {name: {"env", "runs", "finished", "returns", "mean", "iqm", "worst", "metrics",
        "baselines", "by_command", "curve"}}, "improvement": {name: {other: [value, low, high]}}}
        with intervals as lists [value, low, high].
    """
    groups = {}
    for name, config in study.groups.items():
        own = [row for row in rows if row["group"] == name]
        groups[name] = {"env": config["env"], "runs": len(own), **_analyse(config["env"], own)}
    improvement = {
        name: {
            other: listed(probability_of_improvement(group["returns"], compared["returns"]))
            for other, compared in groups.items()
            if other != name and compared["env"] == group["env"]
        }
        for name, group in groups.items()
    }
    return {"groups": groups, "improvement": improvement}


def _analyse(env_id: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    finished = [row for row in rows if row["state"] == "finished"]
    returns = [row["scores"]["run"]["return"] for row in finished]
    task, baselines = find_task(env_id), {}
    known = finished[0]["scores"] if finished else {}  # a later version may have more baselines
    runs = {name: [row["scores"]["run"][name] for row in finished] for name in known.get("run", {})}
    for name in filter(known.__contains__, task.baselines):
        mark = finished[0]["scores"][name]["return"]  # on the same episodes for all runs
        ahead = [row["ahead"][name] for row in finished]
        baselines[name] = {
            "return": mark,
            "metrics": finished[0]["scores"][name],
            "improvement": listed(improvement_over(mark, returns)),
            "ahead": sum(place is not None for place in ahead),
            **{
                key: median_with_never([place and place[key] for place in ahead])
                for key in ("steps", "seconds")
            },
        }
    return {
        "finished": len(finished),
        "returns": returns,
        "mean": listed(mean_with_interval(returns)),
        "iqm": listed(iqm_with_interval(returns)),
        "worst": min(
            ({"return": row["scores"]["run"]["return"], "seed": row["seed"]} for row in finished),
            key=lambda worst: worst["return"],
            default=None,
        ),
        "metrics": {name: listed(mean_with_interval(numbers(own))) for name, own in runs.items()},
        "baselines": baselines,
        "by_command": by_command(task, finished),
        "curve": _curve([row["evaluations"] for row in finished]),
    }


def _curve(runs: Sequence[list[dict[str, Any]]]) -> dict[str, list[float | None]]:
    """Mean and IQM of the evaluations' returns over runs at each step, with the IQM's interval.

    At the steps that all runs have; one that was evaluated at other steps is interpolated.
    """
    runs = [evaluations for evaluations in runs if evaluations]
    if not runs:
        return {}
    first, last = (
        pick(fold([row["steps"] for row in run]) for run in runs)
        for pick, fold in ((max, min), (min, max))
    )
    steps = sorted({row["steps"] for run in runs for row in run if first <= row["steps"] <= last})
    if not steps:
        return {}
    returns = np.array(
        [
            np.interp(steps, [row["steps"] for row in run], [row["return"] for row in run])
            for run in runs
        ]
    )
    low, high = resampled(interquartile_mean, returns)
    numbers = {"mean": mean(returns), "iqm": interquartile_mean(returns), "low": low, "high": high}
    return {"steps": steps, **{name: listed(values) for name, values in numbers.items()}}


def study_table(study: Study, found: dict[str, Any]) -> str:
    """A Markdown table: of each group a row for each baseline."""
    table = []
    for name, group in found["groups"].items():
        worst = group["worst"]
        own = [name, f"{group['finished']}/{group['runs']}", _cell(group["mean"]),
               _cell(group["iqm"]),
               f"{worst['return']:.3g} (seed {worst['seed']})" if worst else "-"]  # fmt: skip
        for baseline, score in group["baselines"].items() or {"-": None}.items():
            if score is None:
                table.append([*own, *["-"] * 6])
                continue
            table.append([
                *own, baseline, f"{score['return']:.3g}", _cell(score["improvement"], 2),
                f"{score['ahead']}/{group['finished']}", _count(score["steps"]),
                _count(score["seconds"]),
            ])  # fmt: skip
            own = [""] * len(own)
    headers = ["runs of", "finished", "mean return", "IQM of return", "worst run", "baseline",
               "its return", "P(run > baseline)", "ahead while training", "median steps until",
               "median seconds until"]  # fmt: skip
    return tabulate(table, headers, tablefmt="github", disable_numparse=True)


def metrics_table(found: dict[str, Any], env_id: str) -> str:
    """A Markdown table: of each group, and of the baselines, the means of all metrics."""
    metrics = tabled(find_task(env_id).metrics)
    groups = {name: group for name, group in found["groups"].items() if group["env"] == env_id}
    table = [
        [name, *(_cell(group["metrics"].get(key, [None] * 3), m.digits)
                 for key, m in metrics.items())]
        for name, group in groups.items()
        if group["finished"]
    ]  # fmt: skip
    baselines: dict[str, Any] = next(
        (group["baselines"] for group in groups.values() if group["finished"]), {}
    )
    table += [
        [name, *(_cell([score["metrics"].get(key), None, None], m.digits)
                 for key, m in metrics.items())]
        for name, score in baselines.items()
    ]  # fmt: skip
    headers = ["runs of", *(metric.heading for metric in metrics.values())]
    return tabulate(table, headers, tablefmt="github", disable_numparse=True)


def _cell(interval: Sequence[float | None], digits: int = 3) -> str:
    value, low, high = ("-" if v is None else f"{v:.{digits}g}" for v in interval)
    return value if low == "-" else f"{value} [{low}, {high}]"


def _count(value: float | None) -> str:
    return "never" if value is None else f"{value:,.0f}" if value >= 10 else f"{value:.2g}"


def unfinished(rows: Sequence[dict[str, Any]]) -> list[str]:
    """A line for each run that is not finished."""
    return [
        f"{row['group']}/seed_{row['seed']}: {row['state']}"
        + (f", {row['error']}" if row["error"] else "")
        for row in rows
        if row["state"] != "finished"
    ]


def write_report(study: Study, folder: Path) -> str:
    """Write report.md, its figures, report.json, runs.csv and commands.csv into a study's folder.

    Returns:
        The table, and which runs are not finished.

    Raises:
        ValueError: a file of a finished run is damaged.
    """
    rows = collect(study, folder)
    found = analyse(study, rows)
    figures = plot_study(found, folder)
    write_json(folder / "report.json", {**found, "runs": rows})
    write_text(folder / "runs.csv", _csv(rows))
    write_text(folder / "commands.csv", command_csv(rows))
    lines = unfinished(rows)
    text = study_table(study, found)
    if lines:
        text += "\n\nNot finished:\n\n" + "\n".join(f"- {line}" for line in lines)
    seeds = len(study.seeds)
    page = [f"# {folder.name}", f"{len(study.groups)} groups of {seeds} runs.", text,
            *_comparison(found), NOTES.replace("\n", " "), *_details(found),
            *(f"![Runs on {path.stem}]({path.name})" for path in figures)]  # fmt: skip
    write_text(folder / "report.md", "\n\n".join(page) + "\n")
    return text


def _details(found: dict[str, Any]) -> Iterator[str]:
    """All metrics, and those of each group at each command."""
    for env_id in dict.fromkeys(group["env"] for group in found["groups"].values()):
        yield f"## {env_id}"
        yield f"Means over the seeds.\n\n{metrics_table(found, env_id)}"
        for name, group in found["groups"].items():
            if group["env"] == env_id:
                table = command_table(find_task(env_id), group["by_command"], group["finished"])
                if table:
                    yield f"### {name}"
                    yield table


def _comparison(found: dict[str, Any]) -> list[str]:
    """The probability of improvement of each group over those after it on its environment."""
    names = list(found["groups"])
    pairs = [
        [name, other, _cell(interval, 2)]
        for name, others in found["improvement"].items()
        for other, interval in others.items()
        if interval[0] is not None and names.index(name) < names.index(other)
    ]
    if not pairs:
        return []
    return [tabulate(pairs, ["X", "Y", "P(run of X > run of Y)"], tablefmt="github",
                     disable_numparse=True)]  # fmt: skip


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    """A row per run: what it is, its metrics, and for each baseline return, steps and seconds."""
    flat = []
    for row in rows:
        one = {key: row[key] for key in ("group", "env", "algo", "seed", "state", "steps", "error")}
        one |= row.get("scores", {}).get("run", {})
        for baseline, place in row.get("ahead", {}).items():
            one[f"{baseline}_return"] = row["scores"][baseline]["return"]
            one[f"steps_to_{baseline}"] = place and place["steps"]
            one[f"seconds_to_{baseline}"] = place and place["seconds"]
        flat.append(one)
    file = io.StringIO()
    writer = csv.DictWriter(file, list(dict.fromkeys(k for one in flat for k in one)))
    writer.writeheader()
    writer.writerows(flat)
    return file.getvalue()
