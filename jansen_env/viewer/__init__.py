"""Recordings of robots, and web pages that show robots."""
