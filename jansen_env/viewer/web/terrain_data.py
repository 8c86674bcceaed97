"""Data from which ``ground.js`` generates terrains with the kernels of the engine."""

from jansen_env.engine.ground_lines import KINDS, REACH
from jansen_env.terrain import Terrain
from jansen_env.terrain.generators import GENERATORS, HIGHEST, MIXTURE, at_level


def terrain_data() -> dict[str, object]:
    """Return the names of terrains, and the parameters of each kind and level, in m and rad."""
    levels = range(HIGHEST + 1)
    return {
        "generators": GENERATORS,
        "kinds": KINDS,
        "mixture": MIXTURE,
        "levels": {name: [[*at_level(name, level).values()] for level in levels] for name in KINDS},
        "reach": REACH,
        "flat": Terrain.flat().points,
    }
