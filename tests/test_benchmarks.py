"""The agreement report: how walks are measured and judged, and what is written."""

from __future__ import annotations

import json
import math

import pytest

from benchmarks import plants
from benchmarks.plant_tables import ALLOWED
from benchmarks.plant_walks import Comparison, Walk, Way, make, measure
from jansen_env import paper_robot


def way(distance, cost=1.0, fell=False):
    """A walk's outcome."""
    return Way(distance, cost, 5.0, 0.03, 0.1, 1e-5, fell)


def test_verdicts():
    """Agree within 5 % in distance and cost; chaotic if the projection plant itself is."""

    def verdict(ensemble, rigid, others=()):
        return Comparison(Walk(1.0), ensemble, list(others), rigid).verdict(ALLOWED)

    steady, wild = [way(1.0), way(1.01), way(1.02)], [way(1.0), way(1.2), way(1.5)]
    assert verdict(steady, [way(9.0), way(1.05)]) == "agree"
    assert verdict(steady, [way(1.0), way(1.1)]) == "differ"
    assert verdict(steady, [way(1.0), way(1.0, cost=1.1)]) == "differ"
    assert verdict(steady, [way(1.0), way(1.1)], [way(1.6), way(1.12)]) == "other gait"
    assert verdict(steady, [way(1.0), way(1.1)], [way(1.12, cost=2.0)]) == "differ"
    assert verdict(wild, [way(1.0), way(2.0)]) == verdict(wild, [way(1.2)]) == "chaotic"
    assert verdict(steady, [way(1.0), way(1.0, fell=True)]) == "falls at times"
    assert verdict([way(1.0, fell=True)] * 3, [way(1.0, fell=True)] * 2) == "falls on both"
    assert Comparison(Walk(1.0), [way(1.0, fell=True)], [], []).spread == math.inf


def test_a_walk_is_measured():
    """At 4 rad/s on friction 0.3: the motor's power is about torque times speed, 10 %."""
    walk = Walk(4.0, friction=0.3, duration=4.0)
    plant = make(walk, "projection")
    out = measure(walk, plant)
    assert not out.fell and out.joint_gap == 0.0 and 0.4 < out.distance / 4.0 < 0.7
    power = out.cost_of_transport * paper_robot().mass * 9.81 * out.distance / 4.0
    assert power == pytest.approx(out.rms_torque * 4.0, rel=0.1)
    assert make(walk, "rigid_body", 1).time_step == make(walk, "rigid_body").time_step / 2.0
    uphill = make(Walk(1.0, slope=0.1, payload=2.0), "projection")
    assert uphill.robot.payload.mass == 2.0 and uphill.terrain.height(1.0) == pytest.approx(
        math.tan(0.1)
    )


@pytest.mark.slow
def test_report(tmp_path, capsys):
    """The short form: both plants agree, and tables and pictures are written."""
    plants.main(["--quick", "--out", str(tmp_path)])
    assert "agree: 2" in capsys.readouterr().out
    result = json.loads((tmp_path / "plants.json").read_text())
    assert all(row["difference"] < 3e-3 * row["of"] for row in result["fixed"])
    for picture in ("walks.png", "torque.png"):
        assert (tmp_path / picture).stat().st_size > 10_000
    with pytest.raises(SystemExit):
        plants.main(["--jobs", "0"])
