"""What is asked of robots in their world: observation, reward, end of episode."""
