"""The benchmark of speed: turns, ratios, and that it runs to its end and writes its tables."""

import pytest

from benchmarks import speed


def test_contestants_take_turns():
    called = []
    plays = {name: lambda name=name: called.append(name) or len(called) for name in "ab"}
    assert speed.take_turns(plays, 2) == {"a": [3, 6], "b": [4, 5]}
    assert called == list("ababba")


def test_rates_and_their_ratios():
    """Ratios are those of the medians, not the median of the ratios."""
    text = speed.rate_table({"b": [1.0, 2.0, 1.0], "a": [2000.0, 4000.0, 6000.0]})
    cells = [cell.strip() for cell in text.splitlines()[3].split("|")[1:-1]]
    assert cells == ["a", "4,000", "2,000", "6,000", "4000.00"]


@pytest.mark.slow
def test_the_benchmark_runs(tmp_path):
    for module in ("mujoco", "Box2D"):
        pytest.importorskip(module)
    speed.main(["--quick", "--out", str(tmp_path)])
    text = (tmp_path / "speed.md").read_text(encoding="utf-8")
    assert text.startswith("# ") and text.count("\n|:--") == 3
