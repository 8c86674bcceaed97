"""Scores of anything that has ``predict``: rollouts, metrics and statistics."""
