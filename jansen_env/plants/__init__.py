"""Simulation backends: robots on their terrains, and how they move."""
