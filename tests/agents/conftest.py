"""Fixtures of training's tests."""

import pytest

from agents.training import callbacks


@pytest.fixture(scope="module")
def few_episodes():
    """One episode for each evaluation's command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(callbacks, "EPISODES", 1)
        yield
