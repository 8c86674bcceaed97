"""Fixtures of the workshop's tests."""

import numpy as np
import pytest
from training_fixtures import few_episodes, no_scores  # noqa: F401


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240229)
