"""Score anything that has ``predict``: rollout, metrics, statistics."""
