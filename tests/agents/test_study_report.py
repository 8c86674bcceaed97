"""A study's scores by command: means over seeds, and worst seeds."""

import pytest

from agents.studies.study_report import command_table, over_seeds
from jansen_env.scoring.benchmarks import WALKER


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
    found = over_seeds(WALKER, rows)
    assert found["command"] == [0.1, 0.3]
    slip = found["columns"]["slip per metre after 2 s (m/m)"]
    assert slip["mean"] == [pytest.approx(0.2), None] and slip["worst"] == [0.4, None]
    torque = found["columns"]["RMS torque (N m)"]
    assert torque["mean"] == pytest.approx([4.0, 7.0])
    assert torque["worst"] == [6.0, 9.0]
    assert "return" not in found["columns"], "more of it is better"
    table = command_table(found)
    assert "| 0.2 (0.4) " in table and "| - " in table
    assert over_seeds(WALKER, []) == {}
