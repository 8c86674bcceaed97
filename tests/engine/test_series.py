"""Fourier series by the engine's own transform, beside NumPy's."""

import math

import numpy as np
import pytest

from jansen_env.engine.series import analyse, expand, sample


def turn(count):
    angle = 2.0 * math.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)])


def work(count, functions):
    return np.empty((4, count * ((functions + 1) // 2)))


@pytest.mark.parametrize("count", [6, 32, 64, 256, 384, 512])
@pytest.mark.parametrize("functions", [1, 2, 5])
def test_a_series_has_the_coefficients_of_the_discrete_transform(count, functions, rng):
    """Samples of a series times a factor are those of the inverse transform; both agree to
    1e-13.
    """
    values = rng.normal(size=(count, functions))
    factors = rng.normal(size=(2, count // 2))
    factors[1, 0] = 0.0  # a constant stays real
    series = np.empty((2, count // 2, functions))
    analyse(values, turn(count), work(count, functions), series)
    expected = np.fft.rfft(values, axis=0)[: count // 2] / count
    assert np.abs(series[0] + 1j * series[1] - expected).max() <= 1e-15
    back = np.empty((count, functions))
    sample(series, factors, turn(count), work(count, functions), back)
    expected = np.fft.irfft(expected * (factors[0] + 1j * factors[1])[:, None] * count, count, 0)
    assert np.abs(back - expected).max() <= 1e-13


def test_polynomials_are_the_taylor_series_of_what_the_weights_say(rng):
    """Sums of waves up to the eighth, in 64 intervals and with six terms, agree to 1e-7."""
    intervals = 64
    harmonics = 9
    order = 6
    series = rng.normal(size=(2, harmonics, 6))
    n = np.arange(harmonics)
    half = math.pi / intervals
    weights = np.array([n**k / math.factorial(k) for k in range(order)])
    step = np.stack([np.cos(n * half), np.sin(n * half)])
    out = np.empty((2, intervals, order, 3))
    expand(series, weights, step, turn(intervals), work(intervals, 6), np.empty((2, 9)), out)
    for row, t in [(0, 0.0), (5, 0.3 * half), (63, -0.2 * half)]:
        waves = np.exp(1j * n * ((2 * row + 1) * half + t))
        waves[1:] *= 2.0
        expected = (waves[:, None] * (series[0] + 1j * series[1])).sum(axis=0).real
        values = t ** np.arange(order) @ out[:, row]
        assert values.ravel() == pytest.approx(expected, abs=1e-7)
