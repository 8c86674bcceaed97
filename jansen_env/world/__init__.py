"""Robots in their surroundings: plant, terrain, parameters, delay, pushes, sensors."""
