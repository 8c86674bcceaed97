"""Fixtures of training's tests."""

from training_fixtures import few_episodes, no_scores  # noqa: F401
