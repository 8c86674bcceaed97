"""A study's table by command: means over seeds, and worst seeds."""

from __future__ import annotations

import csv

import pytest

from agents.study_commands import by_command, command_csv, command_table
from agents.tasks import WALKER


def scores(slip, torque):
    """Of a policy at two commands, all metrics."""
    values = {name: [0.0, 0.0] for name in WALKER.metrics}
    values |= {"steady_slip_per_metre": slip, "rms_torque": torque}
    return {name: {"command": [0.1, 0.3], "value": value} for name, value in values.items()}


@pytest.fixture
def rows():
    """Runs with three seeds, of which the last does not walk at 0.3 m/s."""
    baselines = {"pid": scores([1.0, 0.1], [3.0, 6.0]), "profile": scores([0.2, 0.0], [4.0, 8.0])}
    runs = [([0.1, 0.3], [2.0, 6.0]), ([0.4, 0.2], [6.0, 6.0]), ([0.1, None], [4.0, 9.0])]
    return [
        {"group": "g", "env": "JansenWalker-v0", "seed": 7 + i,
         "by_command": {**baselines, "run": scores(*run)}}
        for i, run in enumerate(runs)
    ]  # fmt: skip


def test_mean_and_worst_over_seeds(rows):
    """By hand; None where a seed has no value."""
    found = by_command(WALKER, rows)
    assert found["command"] == [0.1, 0.3]
    slip = found["columns"]["slip per metre after 2 s (m/m)"]
    assert slip["mean"] == [pytest.approx(0.2), None] and slip["worst"] == [0.4, None]
    assert slip["worst_seed"] == [8, 9]
    torque = found["columns"]["RMS torque (N m)"]
    assert torque["mean"] == pytest.approx([4.0, 7.0])
    assert torque["worst"] == [6.0, 9.0] and torque["worst_seed"] == [8, 9]
    assert "return" not in found["columns"], "more of it is better"
    table = command_table(WALKER, found, 3)
    assert "over the 3 seeds" in table and "| 0.2 (0.4) " in table and "| - " in table


def test_what_earlier_versions_lack_is_left_out(rows):
    """A metric."""
    for row in rows:
        del row["by_command"]["run"]["falls"]
    headings = list(by_command(WALKER, rows)["columns"])
    assert "RMS torque (N m)" in headings
    assert not any("falls" in heading for heading in headings)
    assert by_command(WALKER, []) == {} and command_table(WALKER, {}, 0) == ""


def test_raw_scores_are_written(rows):
    """A row for each run and command, and of the baselines once."""
    written = list(csv.DictReader(command_csv([*rows, {"group": "unfinished"}]).splitlines()))
    assert len(written) == (3 + 2) * 2
    (own,) = [row for row in written if (row["seed"], row["command"]) == ("8", "0.3")]
    assert (own["group"], own["policy"], float(own["steady_slip_per_metre"])) == ("g", "run", 0.2)
    (pid,) = [r for r in written if (r["policy"], r["command"]) == ("pid", "0.3")]
    assert pid["seed"] == "" and float(pid["rms_torque"]) == 6.0


def test_raw_scores_of_groups_that_differ(rows):
    """Each environment's own metrics, and the baselines of a group on other ground."""
    crank = {"rms_error": {"command": [1.0], "value": [0.1]}}
    ice = rows[2]["by_command"] | {"pid": scores([2.0, 0.2], [3.0, 6.0])}
    rows += [
        {"group": "ice", "env": "JansenWalker-v0", "seed": 7, "by_command": ice},
        {"group": "ice", "env": "JansenWalker-v0", "seed": 8, "by_command": ice},
        {"group": "crank", "env": "JansenCrank-v0", "seed": 7, "by_command": {"run": crank}},
    ]
    written = list(csv.DictReader(command_csv(rows).splitlines()))
    pids = [r for r in written if (r["policy"], r["command"]) == ("pid", "0.1")]
    slip = [(r["group"], float(r["steady_slip_per_metre"])) for r in pids]
    assert slip == [("JansenWalker-v0", 1.0), ("ice", 2.0)]
    (turned,) = [r for r in written if r["group"] == "crank"]
    assert turned["rms_error"] == "0.1" and turned["steady_slip_per_metre"] == ""
    assert sum(r["policy"] == "profile" for r in written) == 2  # the same everywhere, at 2 commands
