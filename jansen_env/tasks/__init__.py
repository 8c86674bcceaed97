"""Tasks: observation, reward and end of episode of simulated robots."""
