"""The benchmarks: turns, ratios, verdicts, and that each runs to its end and writes its tables."""

import pytest

from benchmarks import climbing, measure, plants, speed
from benchmarks.plants import Comparison, Walk
from benchmarks.walks import Walked


def test_contestants_take_turns():
    called = []
    plays = {name: lambda name=name: called.append(name) or len(called) for name in "ab"}
    assert measure.take_turns(plays, 2) == {"a": [3, 6], "b": [4, 5]}
    assert called == list("ababba")


def test_rates_and_their_ratios():
    """Of the medians, not the median of the ratios."""
    text = measure.rate_table({("a",): [2000.0, 4000.0, 6000.0], ("b",): [1.0, 2.0, 1.0]},
                              ("name",), [("b",)])  # fmt: skip
    cells = [cell.strip() for cell in text.splitlines()[2].split("|")[1:-1]]
    assert cells == ["a", "4,000", "2,000", "6,000", "4000.00"]


def test_verdicts():
    """Agree within 5 % in distance and cost; chaotic if the projection plant itself is."""

    def run(distance, cost=1.0, fell=False):
        return Walked(distance, 0.1, 1.0, 5.0, 9.0, 0.1, cost, cost, 0.03, fell)

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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("main", "needs", "arguments", "written"),
    [
        (speed.main, ("mujoco", "Box2D"), ["--only", "one", "many", "worlds"], "speed"),
        (plants.main, (), [], "plants"),
        (plants.main, (), ["--machines"], "machines"),
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


def test_an_unknown_policy_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        climbing.main(["--policy", str(tmp_path / "none"), "--out", str(tmp_path)])
    assert "must be one of" in capsys.readouterr().err
