"""Report of a study: tables and figures in report.md, numbers in report.json, two CSV files."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from tabulate import tabulate

from agents.studies.plan import Study
from agents.studies.study_figures import plot_study
from agents.studies.study_scores import Row, analyse, collect
from jansen_env.files import write_json, write_text
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.metrics import tabled

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
RUNS = ("runs of", "finished", "mean return", "IQM of return", "worst run", "baseline",
        "its return", "P(run > baseline)", "ahead while training", "median steps until",
        "median seconds until")  # fmt: skip


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
    write_text(folder / "runs.csv", _csv([_flat(row) for row in rows]))
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


def study_table(found: dict[str, Any]) -> str:
    """Return a Markdown table: of each group a row for each baseline."""
    table = []
    for name, group in found["groups"].items():
        worst = group["worst"]
        own = [name, f"{group['finished']}/{group['runs']}", _cell(group["mean"]),
               _cell(group["iqm"]),
               f"{worst['return']:.3g} (seed {worst['seed']})" if worst else "-"]  # fmt: skip
        for baseline, score in group["baselines"].items():
            table.append([
                *own, baseline, f"{score['return']:.3g}", _cell(score["improvement"], 2),
                f"{score['ahead']}/{group['finished']}", _count(score["steps"]),
                _count(score["seconds"]),
            ])  # fmt: skip
            own = [""] * len(own)
        if not group["baselines"]:
            table.append([*own, *["-"] * 6])
    return _table(table, RUNS)


def metrics_table(found: dict[str, Any], env_id: str) -> str:
    """Return a Markdown table: the means of all metrics of each group and of the baselines."""
    metrics = tabled(find_benchmark(env_id).metrics)
    groups = [
        (name, group)
        for name, group in found["groups"].items()
        if group["env"] == env_id and group["finished"]
    ]
    rows = [(name, group["metrics"]) for name, group in groups]
    for name, score in groups[0][1]["baselines"].items() if groups else ():
        rows.append((name, {key: [value] for key, value in score["metrics"].items()}))
    table = [
        [name, *(_cell(values.get(key, [None]), m.digits) for key, m in metrics.items())]
        for name, values in rows
    ]
    return _table(table, ["runs of", *(metric.heading for metric in metrics.values())])


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


def _details(found: dict[str, Any]) -> Iterator[str]:
    """Give all metrics of each environment, and those of each group at each command."""
    for env_id in dict.fromkeys(group["env"] for group in found["groups"].values()):
        yield f"## {env_id}"
        yield f"Means over the seeds.\n\n{metrics_table(found, env_id)}"
        for name, group in found["groups"].items():
            if group["env"] == env_id and group["by_command"].get("columns"):
                yield f"### {name}"
                yield (f"At each command ({find_benchmark(env_id).command_unit}) the mean "
                       f"over the {group['finished']} seeds and, in brackets, the worst seed's; "
                       "less is better in each column.")  # fmt: skip
                yield command_table(group["by_command"])


def _comparison(found: dict[str, Any]) -> list[str]:
    """Return the probability of improvement of each group over those after it."""
    names = list(found["groups"])
    pairs = [
        [name, other, _cell(interval, 2)]
        for name, others in found["improvement"].items()
        for other, interval in others.items()
        if interval[0] is not None and names.index(name) < names.index(other)
    ]
    return [_table(pairs, ["X", "Y", "P(run of X > run of Y)"])] if pairs else []


def _table(rows: Sequence[Sequence[str]], headers: Sequence[str]) -> str:
    return tabulate(rows, headers, tablefmt="github", disable_numparse=True)


def _cell(interval: Sequence[float | None], digits: int = 3) -> str:
    value, *ends = ("-" if v is None else f"{v:.{digits}g}" for v in interval)
    return f"{value} [{', '.join(ends)}]" if ends and ends[0] != "-" else value


def _count(value: float | None) -> str:
    return "never" if value is None else f"{value:,.0f}" if value >= 10 else f"{value:.2g}"


def _flat(row: Row) -> Row:
    """Return a run's line of runs.csv: its metrics; of each baseline return, steps, seconds."""
    one = {key: row[key] for key in ("group", "env", "algo", "seed", "state", "error")}
    one |= row.get("scores", {}).get("run", {})
    for baseline, place in row.get("ahead", {}).items():
        one[f"{baseline}_return"] = row["scores"][baseline]["return"]
        one[f"steps_to_{baseline}"] = place and place["steps"]
        one[f"seconds_to_{baseline}"] = place and place["seconds"]
    return one


def command_rows(rows: Sequence[Row]) -> list[Row]:
    """Return the lines of commands.csv: each run's metrics, each group's baselines, by command."""
    lines, seen = [], set()
    for row in rows:
        for policy, metrics in row.get("by_command", {}).items():
            seed = row["seed"] if policy == "run" else ""
            own = {"group": row["group"], "seed": seed, "policy": policy}
            if tuple(own.values()) in seen:
                continue
            seen.add(tuple(own.values()))
            for i, command in enumerate(next(iter(metrics.values()))["command"]):
                values = {name: found["value"][i] for name, found in metrics.items()}
                lines.append({**own, "command": command, **values})
    return lines


def _csv(lines: Sequence[Row]) -> str:
    file = io.StringIO()
    writer = csv.DictWriter(file, list(dict.fromkeys(name for line in lines for name in line)))
    writer.writeheader()
    writer.writerows(lines)
    return file.getvalue()
