"""Find the baselines' numbers."""
