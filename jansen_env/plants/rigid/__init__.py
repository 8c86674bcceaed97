"""Rigid-body backend, in which pymunk simulates every link as a body."""
