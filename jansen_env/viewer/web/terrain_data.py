"""Data from which ``ground.js`` generates grounds with the engine's kernels."""

from jansen_env.engine.ground_lines import KINDS, REACH
from jansen_env.terrain import Terrain
from jansen_env.terrain.generators import HIGHEST, MIXTURE, at_level


def terrain_data() -> dict[str, object]:
    """Return the parameters of each kind of ground and level, in m and rad, and level ground."""
    levels = range(HIGHEST + 1)
    return {
        "kinds": KINDS,
        "mixture": MIXTURE,
        "levels": {name: [[*at_level(name, level).values()] for level in levels] for name in KINDS},
        "reach": REACH,
        "flat": Terrain.flat().points,
    }
