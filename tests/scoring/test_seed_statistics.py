"""Statistics over runs, against values worked out by hand and what must hold for any scores."""

import math

import numpy as np
import pytest
from scipy.stats import binom

from agents.studies import seed_statistics as over_runs
from jansen_env.scoring.metrics import proportion_with_interval

TEN = np.array([3.0, 1.0, 4.0, 1.5, 9.0, 2.6, 5.0, 3.5, 8.0, 9.7])


def test_interquartile_mean_is_that_of_the_middle_half():
    """Of eight runs the middle four; of ten, of which 2.5 are 25 %, the middle six."""
    assert over_runs.interquartile_mean([100, 2, 3, 4, 5, 6, -100, 1]) == (2 + 3 + 4 + 5) / 4
    assert over_runs.interquartile_mean(TEN) == pytest.approx(
        (2.6 + 3.0 + 3.5 + 4.0 + 5.0 + 8.0) / 6
    )
    assert over_runs.interquartile_mean([1.0, 2.0, 6.0]) == 3.0
    columns = np.stack([TEN, 2.0 * TEN], axis=1)
    np.testing.assert_allclose(
        over_runs.interquartile_mean(columns), over_runs.interquartile_mean(TEN) * np.array([1, 2])
    )


def test_interval_of_the_mean_is_students():
    half = 4.302652729911275 * math.sqrt(7.0 / 3.0)
    assert over_runs.mean_with_interval([1.0, 2.0, 6.0]) == pytest.approx((3, 3 - half, 3 + half))


def test_bca_shifts_the_interval_of_skewed_scores():
    """To the side of the long tail; of the mean of exponential scores, scipy's own."""
    scores = np.random.default_rng(2).exponential(size=12)
    plain = over_runs.resampled(np.mean, scores)
    shifted = over_runs.resampled(np.mean, scores, method="BCa")
    assert shifted[0] > plain[0] and shifted[1] > plain[1]
    assert over_runs.iqm_with_interval([2.0, 2.0, 2.0]) == (2.0, 2.0, 2.0)


def test_what_few_runs_cannot_say_is_nan():
    for interval in (over_runs.mean_with_interval, over_runs.iqm_with_interval):
        assert np.isnan(interval([])).all()
        assert interval([2.0])[0] == 2.0 and np.isnan(interval([2.0])[1:]).all()
    assert np.isnan(over_runs.with_interval(np.mean, [])).all()
    assert over_runs.with_interval(np.mean, [2.0])[0] == 2.0
    assert np.isnan(over_runs.with_interval(np.mean, [2.0])[1:]).all()
    assert over_runs.with_interval(np.mean, [2.0, 2.0]) == (2.0, 2.0, 2.0)
    assert np.isnan(over_runs.improvement_over(0.0, [])).all()
    assert over_runs.share_with_interval([0.5], 90)[0] == 0.5
    assert np.isnan(over_runs.share_with_interval([0.5], 90)[1:]).all()


def test_coverage_is_what_is_said_of_it():
    """Of a nominal 95 %, with ten and with three normal scores: the bootstraps' and Student's."""
    rng = np.random.default_rng(11)
    samples = rng.normal(size=(10, 1000))
    low, high = over_runs.resampled(np.mean, samples, resamples=1000)
    assert 0.86 < np.mean((low < 0.0) & (high > 0.0)) < 0.93
    few, many = over_runs.resampled(np.mean, samples[:3], resamples=1000)
    assert 0.65 < np.mean((few < 0.0) & (many > 0.0)) < 0.82
    low, high = over_runs.resampled(
        over_runs.interquartile_mean, samples[:, :300], resamples=1000, method="BCa"
    )
    assert 0.87 < np.mean((low < 0.0) & (high > 0.0)) < 0.95
    for runs in (samples, samples[:3]):
        ends = np.array([over_runs.mean_with_interval(column)[1:] for column in runs.T])
        assert 0.93 < np.mean((ends[:, 0] < 0.0) & (ends[:, 1] > 0.0)) < 0.97


def test_shares_of_runs_have_a_width_where_all_runs_are_alike():
    """Ten runs without a fall are 900 episodes; runs that are all or nothing are so many draws, and
    runs that scatter as independent episodes would are all their episodes (Korn and Graubard)."""
    none, half, ever = (
        over_runs.share_with_interval(shares, episodes)
        for shares, episodes in (([0.0] * 10, 90), ([0.125, 0.125], 16), ([1.0] * 10, 90))
    )
    assert none == pytest.approx((0.0, 0.0, 1.0 - 0.025 ** (1 / 900)))
    assert half == pytest.approx(proportion_with_interval(4, 32))
    assert ever == pytest.approx((1.0, 0.025 ** (1 / 900), 1.0))
    rng = np.random.default_rng(5)
    found = np.array([
        over_runs.share_with_interval(rng.binomial(50, rng.beta(2.0, 8.0, size=10)) / 50, 50)
        for _ in range(400)
    ])  # fmt: skip
    assert 0.92 < np.mean((found[:, 1] < 0.2) & (found[:, 2] > 0.2)) < 0.99


def test_improvement_over_a_mark_is_a_proportion_with_its_exact_interval():
    value, low, high = over_runs.improvement_over(2.0, TEN)
    assert value == 0.8
    assert binom.sf(7, 10, low) == pytest.approx(0.025)
    assert binom.cdf(8, 10, high) == pytest.approx(0.025)
    value, low, high = over_runs.improvement_over(0.0, TEN)
    assert (value, high) == (1.0, 1.0) and low == pytest.approx(0.025**0.1)
    assert over_runs.improvement_over(9.7, TEN)[0] == 0.0  # no better than the best is no better


def test_probability_of_improvement_counts_pairs():
    value, low, high = over_runs.probability_of_improvement([5.0, 6.0, 3.0, 0.0], [3.0, 1.0])
    assert value == (2 + 2 + 1.5 + 0) / 8
    assert low < value < high
    assert over_runs.probability_of_improvement(TEN, TEN)[0] == 0.5
    there, back = (
        over_runs.probability_of_improvement(*pair)[0] for pair in ((TEN, TEN + 1), (TEN + 1, TEN))
    )
    assert there + back == pytest.approx(1.0) and there < 0.5
