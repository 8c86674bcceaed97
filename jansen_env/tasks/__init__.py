"""Tasks: observation, reward and end of episode of robots in their world."""
