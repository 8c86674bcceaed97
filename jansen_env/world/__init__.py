"""Simulation of robots: backend, terrain, episode parameters, delay, pushes, and sensor noise."""
