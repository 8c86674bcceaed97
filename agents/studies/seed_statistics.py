"""Scores of many runs, with 95 % intervals over seeds: of training again, not of scoring again.

After Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical Precipice",
NeurIPS 2021.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Literal
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import DegenerateDataWarning, beta, bootstrap, t, trim_mean

from jansen_env.scoring.metrics import ENDS, TAIL, Interval, proportion_with_interval

Array = NDArray[np.float64]
Method = Literal["percentile", "BCa"]

RESAMPLES = 5000
AT_ONCE = 10**7  # numbers, of resamples
TRIMMED = 0.25  # of the runs at either end, left out of the interquartile mean
UNKNOWN = (math.nan, math.nan, math.nan)


def mean_with_interval(scores: ArrayLike) -> Interval:
    """Return the mean of scores (n,) with Student's interval, which few runs need: a nominal 95 %
    bootstrap of 10 holds the true mean 90 % of the time, of 3 runs 75 %."""
    values = np.asarray(scores, float)
    if len(values) < 2:
        return (float(values[0]), *UNKNOWN[1:]) if len(values) else UNKNOWN
    half = t.ppf(1.0 - TAIL, len(values) - 1) * values.std(ddof=1) / len(values) ** 0.5
    return float(values.mean()), float(values.mean() - half), float(values.mean() + half)


def share_with_interval(shares: ArrayLike, episodes: int) -> Interval:
    """Return the mean of shares (n,), each of so many episodes, with its interval over runs.

    That of Korn and Graubard (1998): Clopper and Pearson's of as many episodes as the spread of the
    runs is worth, all of them at most. So it has a width where no run, or each, has a fall.
    """
    values = np.asarray(shares, float)
    mean, low, high = mean_with_interval(values)
    if math.isnan(low):
        return mean, low, high
    count = worth = len(values) * episodes
    if high > low:
        narrower = t.ppf(1.0 - TAIL, count - 1) / t.ppf(1.0 - TAIL, len(values) - 1)
        variance = values.var(ddof=1) / len(values)
        worth = min(count, mean * (1.0 - mean) / variance * narrower**2)
    k = mean * worth
    low, high = beta.ppf((TAIL, 1.0 - TAIL), (k, k + 1.0), (worth - k + 1.0, worth - k))
    return mean, float(np.nan_to_num(low, nan=0.0)), float(np.nan_to_num(high, nan=1.0))


def interquartile_mean(scores: ArrayLike, axis: int = 0) -> Any:
    """Return the mean of the middle half of the runs: 25 % at either end left out, rounded down."""
    return trim_mean(np.asarray(scores, float), TRIMMED, axis=axis)


def resampled(
    statistic: Callable[..., Any], *groups: ArrayLike, resamples: int = RESAMPLES,
    method: Method = "percentile",
) -> tuple[Array, Array]:  # fmt: skip
    """Return the ends of the bootstrap interval of a statistic, each group resampled on its own.

    Where BCa has no value, as of runs that are all alike, the percentiles stand; NaN with less than
    two runs in a group.

    Args:
        statistic: of as many arrays as there are groups, along their ``axis``.
        groups: (n_i, ...) of each run. resamples, method: of the bootstrap.
    """
    arrays = [np.moveaxis(np.asarray(group, float), 0, -1) for group in groups]
    if min(array.shape[-1] for array in arrays) < 2:
        nothing = np.full(np.shape(statistic(*arrays, axis=-1)), np.nan)
        return nothing, nothing
    with catch_warnings(), np.errstate(invalid="ignore"):
        simplefilter("ignore", DegenerateDataWarning)  # of runs that are all alike
        found = bootstrap(
            arrays, statistic, vectorized=True, axis=-1, n_resamples=resamples, method=method,
            confidence_level=1.0 - 2.0 * TAIL, rng=0,
            batch=1 + AT_ONCE // math.prod(a.size for a in arrays),
        )  # fmt: skip
    plain = np.percentile(found.bootstrap_distribution, ENDS, axis=-1)
    low, high = np.where(np.isnan(found.confidence_interval), plain, found.confidence_interval)
    return low, high


def with_interval(
    statistic: Callable[..., Any], *groups: ArrayLike, method: Method = "percentile"
) -> Interval:
    """Return a number over runs with its interval, see :func:`resampled`; NaN without a run."""
    arrays = [np.asarray(group, float) for group in groups]
    if min(map(len, arrays)) == 0:
        return UNKNOWN
    low, high = resampled(statistic, *arrays, method=method)
    return float(statistic(*arrays, axis=-1)), float(low), float(high)


def iqm_with_interval(scores: ArrayLike) -> Interval:
    """Return the interquartile mean of scores (n,) with its BCa interval (Efron 1987)."""
    return with_interval(interquartile_mean, scores, method="BCa")


def improvement_over(target: float, scores: ArrayLike) -> Interval:
    """Return the probability that a run's score is above a fixed number, with its exact interval:
    the bootstrap's would have no width where all runs or none are above."""
    above = np.asarray(scores, float) > target
    return proportion_with_interval(int(above.sum()), len(above)) if len(above) else UNKNOWN


def probability_of_improvement(scores: ArrayLike, others: ArrayLike) -> Interval:
    """Return P(X > Y), the probability that a run of one kind is better than one of another.

    The share of all pairs of ``scores`` (n,) and ``others`` (m,), ties counted half (Mann-Whitney).
    """
    return with_interval(_wins, scores, others)


def _wins(x: Array, y: Array, axis: int) -> Any:
    left, right = x[..., :, None], y[..., None, :]
    return np.mean((left > right) + 0.5 * (left == right), axis=(-2, -1))
