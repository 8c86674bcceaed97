"""Terrains: shapes, generators, curriculum."""

from jansen_env.terrain.ground import Terrain, heights_of, make_terrain
from jansen_env.terrain.shapes import MAX_SLOPE

__all__ = ["MAX_SLOPE", "Terrain", "heights_of", "make_terrain"]
