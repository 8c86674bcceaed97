"""The benchmarks: turns, ratios, verdicts, and that each runs to its end and writes its tables."""

import pytest

from benchmarks import (
    built_robot,
    climbing,
    measure,
    plants,
    ranking,
    speed,
)
from benchmarks.plants import Comparison, Walk
from benchmarks.walks import Walked


def test_contestants_take_turns():
    called = []
    plays = {name: lambda name=name: called.append(name) or len(called) for name in "ab"}
    assert measure.take_turns(plays, 2) == {"a": [3, 6], "b": [4, 5]}
    assert called == list("ababba")


def test_ratios():
    """Of the medians, not the median of the ratios; the range is that of the rounds."""
    found = measure.ratio([2.0, 4.0, 6.0], [1.0, 2.0, 1.0])
    assert found == (4.0, 2.0, 6.0)
    assert measure.spread([1000.0, 3000.0, 2500.0]) == ("2,500", "1,000", "3,000")


def test_verdicts():
    """Agree within 5 % in distance and cost; chaotic if the projection plant itself is."""

    def run(distance, cost=1.0, fell=False):
        return Walked(distance, 0.1, 1.0, 5.0, 9.0, 0.1, cost, cost, 0.03, 1e-5, fell)

    def verdict(ensemble, rigid, others=()):
        return Comparison(Walk(1.0), ensemble, list(others), rigid).verdict

    steady, wild = [run(1.0), run(1.01), run(1.02)], [run(1.0), run(1.2), run(1.5)]
    assert verdict(steady, [run(9.0), run(1.05)]) == "agree"
    assert verdict(steady, [run(1.0), run(1.1)]) == "differ"
    assert verdict(steady, [run(1.0), run(1.0, cost=1.1)]) == "differ"
    assert verdict(steady, [run(1.0), run(1.1)], [run(1.6), run(1.12)]) == "other gait"
    assert verdict(steady, [run(1.0), run(1.1)], [run(1.12, cost=2.0)]) == "differ"
    assert verdict(wild, [run(1.0), run(2.0)]) == verdict(wild, [run(1.2)]) == "chaotic"
    assert verdict(steady, [run(1.0), run(1.0, fell=True)]) == "falls at times"
    assert verdict([run(1.0, fell=True)] * 3, [run(1.0, fell=True)] * 2) == "falls on both"


@pytest.mark.parametrize("arguments", (["--rounds", "0"], ["--only", "x"], ["--out", "FILE"]))
def test_what_cannot_be_measured_is_refused(arguments, tmp_path, capsys):
    (tmp_path / "FILE").touch()
    with pytest.raises(SystemExit):
        speed.main([str(tmp_path / a) if a == "FILE" else a for a in arguments])
    assert arguments[-1] in capsys.readouterr().err
    with pytest.raises(SystemExit, match="no_such_module"):
        measure.require("json", "no_such_module")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("main", "needs", "arguments", "written"),
    [
        (speed.main, ("mujoco", "Box2D"), ["--only", "one", "many", "worlds"], "speed"),
        (speed.main, ("stable_baselines3", "mujoco"), ["--only", "ppo"], "speed"),
        (plants.main, (), [], "plants"),
        (plants.main, (), ["--machines"], "machines"),
        (built_robot.main, (), ["--plant", "rigid_body"], "motors_rigid_body"),
    ],
)
def test_a_benchmark_runs(main, needs, arguments, written, tmp_path):
    for module in needs:
        pytest.importorskip(module)
    main(["--quick", "--out", str(tmp_path), *arguments])
    text = (tmp_path / f"{written}.md").read_text(encoding="utf-8")
    assert text.startswith("# ") and "\n|:--" in text
    if written in ("plants", "machines"):
        assert not any(verdict in text for verdict in ("chaotic", "differ", "falls", "gait"))


def scored(error, slip, cost, falls, torque, share=1.0, returned=0.0):
    """A controller's row, over all commands and at the only one."""
    names = ("return", "speed_error", "slip_per_metre", "cost_of_transport", "falls", "rms_torque")
    row = dict(zip(names, (returned, error, slip, cost, falls, torque), strict=True))
    return [{**row, "share": share}] * 2


def test_ranks_by_return_and_by_table():
    rows = {
        "good": scored(0.01, 0.1, 1.0, 0.0, 5.0, returned=9.0),
        "rough": scored(0.02, 0.2, 3.0, 0.0, 9.0, returned=5.0),
        "near": scored(0.3, float("nan"), float("nan"), 0.0, 0.0, share=0.1, returned=1.0),
        "far": scored(0.4, float("nan"), float("nan"), 0.0, 0.0, share=-0.1, returned=2.0),
    }
    at_command = [row[1] for row in rows.values()]
    assert ranking.table_ranks(at_command) == pytest.approx([1.1, 1.9, 3.0, 4.0])
    table, correlation = ranking.rank(rows)
    assert correlation == pytest.approx(0.8)
    assert [line.split("|")[1].strip() for line in table.splitlines()[2:]] == [
        "good", "rough", "far", "near",
    ]  # fmt: skip


def test_ranking_runs(tmp_path, capsys):
    ranking.main(["--quick", "--out", str(tmp_path)])
    lines = (tmp_path / "ranking.md").read_text().splitlines()[2:]
    order = [line.split("|")[1].strip() for line in lines if line.startswith("|")]
    assert set(order) == {ranking.SHIPPED, *ranking.CONTROLLERS} and len(order) >= 10
    assert order[-1] == "standing"
    assert order.index("profile") < order.index("PID, bang-bang")
    assert "rank correlation" in capsys.readouterr().out


def test_an_unknown_policy_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        climbing.main(["--policy", str(tmp_path / "none"), "--out", str(tmp_path)])
    assert "must be one of" in capsys.readouterr().err
