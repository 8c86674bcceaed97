"""Random numbers of compiled code: SplitMix64's own, with their moments, independent."""

import numpy as np
import pytest

from jansen_env.engine import random

COUNT = 20_000
number = random.number
normal = random.normal
pytestmark = pytest.mark.filterwarnings("ignore:overflow")


def numbers(function, key):
    """The first ones of a key."""
    return np.array([function(key, k) for k in range(COUNT)], float)


def test_numbers_are_those_of_splitmix64():
    """They match Vigna's reference code, https://prng.di.unimi.it/splitmix64.c."""
    for seed, *known in (
        (1234567, 6457827717110365317, 3203168211198807973, 9817491932198370423),
        (0, 0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F),
    ):
        assert [int(number(seed, k)) for k in range(3)] == known


def test_normal_numbers_have_their_moments():
    drawn = numbers(normal, 4)
    assert np.mean(drawn) == pytest.approx(0.0, abs=4.0 / np.sqrt(COUNT))
    assert np.var(drawn) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / COUNT))
    assert np.mean(drawn**3) == pytest.approx(0.0, abs=4.0 * np.sqrt(15.0 / COUNT))
    assert np.mean(drawn**4) == pytest.approx(3.0, abs=4.0 * np.sqrt(96.0 / COUNT))


@pytest.mark.slow
def test_keys_and_their_keys_are_independent_of_one_another():
    """This holds for neighbouring seeds, steps of an episode, and channels of a step."""
    each = range(COUNT // 100)
    seeds = np.array([[normal(seed, k) for k in range(100)] for seed in each])
    steps = np.array([[normal(np.uint64(number(5, step)), k) for k in range(100)] for step in each])
    limit = 5.0 / np.sqrt(seeds.size)
    for table in (seeds, steps):
        for some, others in ((table[1:], table[:-1]), (table[:, 1:], table[:, :-1])):
            assert abs(np.corrcoef(some.ravel(), others.ravel())[0, 1]) < limit
    assert abs(np.corrcoef(seeds.ravel(), steps.ravel())[0, 1]) < limit
