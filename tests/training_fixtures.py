"""Fixtures of the tests that train."""

from collections.abc import Iterator

import pytest

import train
from agents.training import callbacks


@pytest.fixture(scope="module")
def few_episodes() -> Iterator[None]:
    """One episode for each evaluation's command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(callbacks, "EPISODES", 1)
        yield


@pytest.fixture
def no_scores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let train.py end without scoring."""
    monkeypatch.setattr(train, "score_run", lambda *given: {})
    monkeypatch.setattr(train, "outcome", lambda *given: "")
