"""The benchmark of speed: turns, ratios, and that it runs to its end and writes its tables."""

import pytest

from benchmarks import speed


def test_contestants_take_turns():
    called = []
    plays = {name: lambda name=name: called.append(name) or len(called) for name in "ab"}
    assert speed.take_turns(plays, 2) == {"a": [3, 6], "b": [4, 5]}
    assert called == list("ababba")


def test_rates_and_their_ratios():
    """Of the medians, not the median of the ratios."""
    text = speed.rate_table({"b": [1.0, 2.0, 1.0], "a": [2000.0, 4000.0, 6000.0]})
    cells = [cell.strip() for cell in text.splitlines()[3].split("|")[1:-1]]
    assert cells == ["a", "4,000", "2,000", "6,000", "4000.00"]


@pytest.mark.parametrize("arguments", (["--rounds", "0"], ["--only", "x"], ["--out", "FILE"]))
def test_what_cannot_be_measured_is_refused(arguments, tmp_path, capsys):
    (tmp_path / "FILE").touch()
    with pytest.raises(SystemExit):
        speed.main([str(tmp_path / a) if a == "FILE" else a for a in arguments])
    assert arguments[-1] in capsys.readouterr().err


@pytest.mark.slow
def test_the_benchmark_runs(tmp_path):
    for module in ("mujoco", "Box2D"):
        pytest.importorskip(module)
    speed.main(["--quick", "--out", str(tmp_path)])
    text = (tmp_path / "speed.md").read_text(encoding="utf-8")
    assert text.startswith("# ") and text.count("\n|:--") == 3
