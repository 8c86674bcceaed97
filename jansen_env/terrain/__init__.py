"""Terrains: height lines, grounds of pymunk shapes, and generators with a curriculum of levels."""

from jansen_env.terrain.ground import MAX_SLOPE, Terrain, heights_of, make_terrain
from jansen_env.terrain.shapes import Ground, Piece, Shapes, make_ground

__all__ = [
    "MAX_SLOPE",
    "Ground",
    "Piece",
    "Shapes",
    "Terrain",
    "heights_of",
    "make_ground",
    "make_terrain",
]
