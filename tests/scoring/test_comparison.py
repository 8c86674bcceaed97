"""Statistics of the benchmark, on scores for which the answer is known."""

import numpy as np
import pytest

from jansen_env.scoring import comparison
from jansen_env.scoring.comparison import (
    compare,
    interval,
    metric_rows,
    probability_of_improvement,
    resampled_weights,
    score_rows,
)
from jansen_env.scoring.protocol import COLUMNS, METRICS, TRACKS, Scale, metric_value, scales
from jansen_env.scoring.result_files import Result, TrackResult

FLAT = TRACKS["flat"]


@pytest.fixture(autouse=True)
def plain_scale(monkeypatch):
    """Give every track the scale from 0 to 1."""
    monkeypatch.setattr(comparison, "scales", lambda: dict.fromkeys(TRACKS, Scale(0.0, 1.0)))


def run_of(track, values):
    """Return a run whose return and success are these values."""
    count = len(track.episodes.seed)
    columns = {name: np.ones(count) for name in COLUMNS}
    values = np.broadcast_to(np.asarray(values, float), count)
    return TrackResult("x", None, {**columns, "return": values, "success": values})


def result_of(name, tracks):
    return Result(
        name, {}, "", {}, {track: run_of(TRACKS[track], v) for track, v in tracks.items()}
    )


def test_mean_and_worst_track():
    values = dict(zip(TRACKS, (0.1, 0.9, 0.5, 0.5, 0.5, 0.5), strict=True))
    scores = compare([result_of("a", values)])
    assert scores.mean == pytest.approx((0.5, 0.5, 0.5))
    assert scores.worst == pytest.approx((0.1, 0.1, 0.1))
    assert scores.tracks["terrain"] == pytest.approx((0.9, 0.9, 0.9))


def test_no_mean_without_all_tracks():
    scores = compare([result_of("a", {"flat": 0.5})])
    assert scores.mean is None and scores.worst is None and [*scores.tracks] == ["flat"]


def test_interquartile_mean_over_runs():
    """The worst and the best quarter of the runs do not count."""
    runs = [
        result_of("a", {"flat": value}) for value in (-100.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 99.0)
    ]
    value, low, high = compare(runs).tracks["flat"]
    assert value == pytest.approx(3.5)
    assert low < 2.0 and high > 5.0


def test_intervals_of_one_run_come_from_its_episodes(rng):
    """About 95 % of the intervals of random episodes contain the true mean."""
    inside = 0
    for _ in range(60):
        values = rng.normal(10.0, 3.0, len(FLAT.episodes.seed))
        _, low, high = compare([result_of("a", {"flat": values})]).tracks["flat"]
        inside += low <= 10.0 <= high
        assert 0.6 < high - low < 1.1  # 2 x 1.96 x 3 / sqrt(180) = 0.88
    assert inside >= 50


def test_strata_keep_their_weight(rng):
    weights = resampled_weights(FLAT, rng)
    np.testing.assert_allclose(weights[0], FLAT.episodes.weight)
    for rows in FLAT.groups.values():
        np.testing.assert_allclose(weights[:, rows].sum(axis=1), 1.0 / 9.0)
    np.testing.assert_allclose(weights.mean(axis=0), FLAT.episodes.weight, rtol=0.2)


def test_runs_widen_the_interval(rng):
    count = len(FLAT.episodes.seed)
    runs = [run_of(FLAT, rng.normal(mean, 0.1, count)) for mean in (1.0, 2.0, 3.0)]
    results = [Result("a", {}, "", {}, {"flat": run}) for run in runs]
    wide, narrow = (compare(chosen).tracks["flat"] for chosen in (results, results[:1]))
    assert wide[2] - wide[1] > 10.0 * (narrow[2] - narrow[1])


def test_probability_of_improvement(rng):
    values = rng.normal(size=len(FLAT.episodes.seed))
    same, better = [run_of(FLAT, values)], [run_of(FLAT, values + 0.001)]
    assert probability_of_improvement(same, same, FLAT) == pytest.approx((0.5, 0.5, 0.5))
    assert probability_of_improvement(better, same, FLAT) == pytest.approx((1.0, 1.0, 1.0))
    assert probability_of_improvement(same, better, FLAT) == pytest.approx((0.0, 0.0, 0.0))
    mixed = [run_of(FLAT, values + 0.001), run_of(FLAT, values - 0.001)]
    value, low, high = probability_of_improvement(mixed, same, FLAT)
    assert value == pytest.approx(0.5) and low == 0.0 and high == 1.0


def test_ratios_are_those_of_sums():
    count = len(FLAT.episodes.seed)
    columns = run_of(FLAT, 1.0).columns
    columns |= {"slip": np.arange(count) * 1.0, "distance": np.arange(count) + 5.0}
    metric, weights = METRICS["slip_per_metre"], FLAT.episodes.weight
    expected = columns["slip"].sum() / columns["distance"].sum()
    assert metric_value(columns, metric, weights) == pytest.approx(expected)
    still = {**columns, "distance": np.zeros(count)}
    assert np.isnan(metric_value(still, metric, weights))


def test_tables_have_a_row_per_algorithm_best_first():
    all_tracks = [result_of(name, dict.fromkeys(TRACKS, v)) for name, v in (("a", 0.1), ("b", 0.7))]
    partial = result_of("c", {"flat": 0.9})
    head, *rows = score_rows([*all_tracks, partial, result_of("b", {"flat": 0.7})])
    assert head[:2] == ["algorithm", "runs"] and [row[0] for row in rows] == ["b", "a", "c"]
    assert rows[0][1] == "2" and rows[2][3:] == ["-"] * 7
    assert rows[0][-1] == "0.70 [0.70, 0.70]"
    assert [row[0] for row in metric_rows([partial], FLAT)] == ["algorithm", "c"]
    assert len(metric_rows([partial], TRACKS["robust"])) == 1


def test_an_interval_is_of_the_resamples_alone():
    values = np.concatenate([[1e6], np.arange(1001)])
    assert interval(values) == pytest.approx((1e6, 25.0, 975.0))


def test_the_scale_is_frozen():
    """The score 0 is the better one of standing and random actions, and 1 the reference."""
    for scale in scales().values():
        assert scale.zero < scale.one
        np.testing.assert_allclose(scale.normalise(np.array(scale)), [0.0, 1.0])
