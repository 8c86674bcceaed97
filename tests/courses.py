"""Grounds over which several tests walk: a step, and a course of pymunk's shapes."""

from jansen_env import Terrain
from jansen_env.terrain import Piece, Shapes

WALL = Terrain([[-9.0, 0.0], [0.6, 0.0], [0.66, 0.24], [9.0, 0.24]])
"""A step of 0.24 m."""


def box(left, bottom, right, top):
    """Return a piece of ground with vertical and horizontal sides, in m."""
    return Piece(((left, bottom), (right, bottom), (right, top), (left, top)))


FLOOR = box(-30.0, -1.0, 30.0, 0.0)
COURSE = Shapes(
    (
        FLOOR,
        box(0.25, -0.2, 0.45, 0.02),
        Piece(((0.7, -0.08),), 0.1),
        box(-0.8, -0.5, -0.6, 2.0),
        box(1.2, 0.6, 1.5, 0.7),
    )
)
"""A course with a step, a ball in the floor, a wall behind the robot, and a roof ahead of it."""
