"""Terrains: the ground, and generators with a curriculum."""

from jansen_env.terrain.ground import MAX_SLOPE, Terrain, heights_of, make_terrain

__all__ = ["MAX_SLOPE", "Terrain", "heights_of", "make_terrain"]
