"""A study's scores at each commanded speed: the mean over its seeds, and the worst of them."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tabulate import tabulate

from agents.metrics import tabled
from agents.tasks import Task

NOTES = """\
At each commanded speed ({unit}) the mean over the {seeds} seeds and, in brackets, the worst seed's;
less is better in each column."""


def numbers(values: Iterable[float | None]) -> NDArray[np.float64]:
    """As an array; NaN for None."""
    return np.array([math.nan if value is None else value for value in values], float)


def listed(values: Iterable[Any]) -> list[float | None]:
    """Numbers for JSON: None for those that are not finite."""
    return [float(value) if math.isfinite(value) else None for value in values]


def by_command(task: Task, rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the scores of finished runs at each command, where less is better.

    Args:
        rows: with ``seed`` and ``by_command``, see :func:`agents.study_report.collect`.

    Returns:
        {"command": [...], "columns": {heading: {"mean", "worst", "worst_seed": [...]}}}, None for
        what some seed has no value of, such as a ratio per metre where it does not walk; {} without
        a run. What runs of earlier versions lack is left out.
    """
    if not rows:
        return {}
    first = rows[0]["by_command"]
    columns = {}
    for name, metric in tabled(task.metrics).items():
        if metric.axis and name not in ("return", task.chosen_by) and name in first["run"]:
            columns[metric.heading] = _over_seeds(_values(rows, "run", name), rows)
    return {"command": next(iter(first["run"].values()))["command"], "columns": columns}


def _values(rows: Sequence[dict[str, Any]], policy: str, metric: str) -> NDArray[np.float64]:
    """(runs, commands)."""
    return np.stack([numbers(row["by_command"][policy][metric]["value"]) for row in rows])


def _over_seeds(values: NDArray[np.float64], rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    worst = values.argmax(axis=0)  # NaN, if any
    return {
        "mean": listed(values.mean(axis=0)),
        "worst": listed(values.max(axis=0)),
        "worst_seed": [rows[i]["seed"] for i in worst],
    }


def command_table(task: Task, found: dict[str, Any], seeds: int) -> str:
    """A Markdown table of :func:`by_command`, with a note on what it shows; "" of nothing."""
    if not found.get("columns"):
        return ""
    table: list[list[str]] = []
    for i, command in enumerate(found["command"]):
        cells = (
            "-"
            if column["mean"][i] is None
            else f"{column['mean'][i]:.2g} ({column['worst'][i]:.2g})"
            for column in found["columns"].values()
        )
        table.append([f"{command:g}", *cells])
    headers = ["command", *found["columns"]]
    note = NOTES.replace("\n", " ").format(unit=task.command_unit, seeds=seeds)
    return note + "\n\n" + tabulate(table, headers, tablefmt="github", disable_numparse=True)


def command_csv(rows: Sequence[dict[str, Any]]) -> str:
    """The raw scores: all metrics of each run and of the baselines at each command.

    A baseline stands there once for each environment, and once more for a group in whose
    environments, with other arguments, it scores otherwise.
    """
    lines: list[dict[str, Any]] = []
    baselines: dict[str, Any] = {}
    for row in rows:
        for policy, metrics in row.get("by_command", {}).items():
            own = {"group": row["group"], "seed": row["seed"], "policy": policy}
            if policy != "run":
                first = baselines.setdefault(f"{row['env']} {policy}", metrics)
                place = row["env"] if first == metrics else row["group"]
                if baselines.setdefault(f"{policy} at {place}", row) is not row:
                    continue  # as of another run
                own |= {"group": place, "seed": ""}
            for i, command in enumerate(next(iter(metrics.values()))["command"]):
                values = {name: found["value"][i] for name, found in metrics.items()}
                lines.append({**own, "command": command, **values})
    if not lines:
        return ""
    file = io.StringIO()
    writer = csv.DictWriter(file, list(dict.fromkeys(name for line in lines for name in line)))
    writer.writeheader()
    writer.writerows(lines)
    return file.getvalue()
