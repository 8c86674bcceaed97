"""Numbers of a study: what came out of each run, and of each group with intervals over seeds."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.studies.plan import Run, Study
from agents.studies.progress import run_state
from agents.studies.run import SCORES, read_status
from agents.studies.seed_statistics import (
    improvement_over,
    interquartile_mean,
    iqm_with_interval,
    mean_with_interval,
    median_with_never,
    probability_of_improvement,
    resampled,
)
from agents.training.runs import read_evaluations
from jansen_env.scoring.benchmarks import Benchmark, find_benchmark
from jansen_env.scoring.metrics import tabled

Row = dict[str, Any]


def collect(study: Study, folder: Path) -> list[Row]:
    """Read what came out of each run: a row, with ``state`` "finished", "failed", ...

    Finished ones also have ``scores`` of all policies by metric, ``by_command`` of all policies by
    metric, ``ahead`` by baseline and ``evaluations``.

    Raises:
        ValueError: a file of a finished run is damaged.
    """
    return [_collect(run) for run in study.runs(folder)]


def _collect(run: Run) -> Row:
    state, config = run_state(run), run.config
    row: Row = {"group": run.group, "env": config["env"], "algo": config["algo"],
                "seed": config["seed"], "state": state}  # fmt: skip
    if state != "finished":
        return {**row, "error": read_status(run.folder).get("error", "")}
    path, evaluations = run.folder / SCORES, read_evaluations(run.folder)
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        *baselines, own = found
        scores, by_command = {}, {}
        for name, policy in found.items():
            key = "run" if name == own else name
            scores[key] = {metric: value[0] for metric, value in policy["overall"].items()}
            by_command[key] = {
                metric: {"command": rows["command"], "value": rows["value"]}
                for metric, rows in policy["by_command"].items()
            }
        ahead = {name: _first_ahead(evaluations, scores[name]["return"]) for name in baselines}
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path} is damaged: {error}; without it the run is scored again"
                         ) from error  # fmt: skip
    return {**row, "error": "", "scores": scores, "by_command": by_command, "ahead": ahead,
            "evaluations": evaluations}  # fmt: skip


def _first_ahead(evaluations: list[Row], target: float) -> dict[str, float] | None:
    """Return steps and seconds of the first evaluation with a return above a target."""
    for row in evaluations:
        if row["return"] > target:
            return {"steps": row["steps"], "seconds": row.get("seconds", math.nan)}
    return None


def analyse(study: Study, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the numbers of tables and figures: by group, and of each pair of groups.

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


def _analyse(env_id: str, rows: list[Row]) -> dict[str, Any]:
    finished = [row for row in rows if row["state"] == "finished"]
    returns = [row["scores"]["run"]["return"] for row in finished]
    known = finished[0]["scores"] if finished else {"run": {}}
    runs = {name: [row["scores"]["run"][name] for row in finished] for name in known["run"]}
    baselines = {}
    for name in filter(known.__contains__, find_benchmark(env_id).baselines):
        target = known[name]["return"]  # on the same episodes for all runs
        ahead = [row["ahead"][name] for row in finished]
        baselines[name] = {
            "return": target, "metrics": known[name],
            "improvement": listed(improvement_over(target, returns)),
            "ahead": sum(place is not None for place in ahead),
            **{key: median_with_never([place and place[key] for place in ahead])
               for key in ("steps", "seconds")},
        }  # fmt: skip
    worst = min(finished, key=lambda row: row["scores"]["run"]["return"], default=None)
    return {
        "finished": len(finished),
        "returns": returns,
        "mean": listed(mean_with_interval(returns)),
        "iqm": listed(iqm_with_interval(returns)),
        "worst": worst and {"return": min(returns), "seed": worst["seed"]},
        "metrics": {name: listed(mean_with_interval(_numbers(v))) for name, v in runs.items()},
        "baselines": baselines,
        "by_command": over_seeds(find_benchmark(env_id), finished),
        "curve": _curve([row["evaluations"] for row in finished if row["evaluations"]]),
    }


def over_seeds(benchmark: Benchmark, rows: Sequence[Row]) -> dict[str, Any]:
    """Return mean and worst seed of finished runs at each command, of metrics where less is better.

    Args:
        rows: with ``seed`` and ``by_command``, see :func:`collect`.

    Returns:
        {"command": [...], "columns": {heading: {"mean", "worst", "worst_seed": [...]}}}, None for
        what some seed has no value of, such as a ratio per metre where it does not walk; {} without
        a run.
    """
    if not rows:
        return {}
    first, columns = rows[0]["by_command"]["run"], {}
    for name, metric in tabled(benchmark.metrics).items():
        if metric.axis and name not in ("return", benchmark.chosen_by) and name in first:
            values = np.stack([_numbers(row["by_command"]["run"][name]["value"]) for row in rows])
            columns[metric.heading] = {
                "mean": listed(values.mean(axis=0)),
                "worst": listed(values.max(axis=0)),
                "worst_seed": [rows[i]["seed"] for i in values.argmax(axis=0)],  # NaN, if any
            }
    return {"command": next(iter(first.values()))["command"], "columns": columns}


def _curve(runs: Sequence[list[Row]]) -> dict[str, list[float | None]]:
    """Return mean and IQM over runs of the returns at each evaluation, with the IQM's interval.

    At the steps that all runs have; one that was evaluated at other steps is interpolated.
    """
    every = [{row["steps"]: row["return"] for row in run} for run in runs]
    first, last = max(map(min, every), default=0), min(map(max, every), default=0)
    steps = sorted({step for run in every for step in run if first <= step <= last})
    if not steps:
        return {}
    returns = np.array([np.interp(steps, [*run], [*run.values()]) for run in every])
    low, high = resampled(interquartile_mean, returns)
    curves = {"mean": returns.mean(axis=0), "iqm": interquartile_mean(returns)}
    curves |= {"steps": np.array(steps), "low": low, "high": high}
    return {name: listed(values) for name, values in curves.items()}


def _numbers(values: Iterable[float | None]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return an array with NaN for None."""
    return np.array([math.nan if value is None else value for value in values], float)


def listed(values: Iterable[Any]) -> list[float | None]:
    """Return numbers for JSON: None for those that are not finite."""
    return [float(value) if math.isfinite(value) else None for value in values]
