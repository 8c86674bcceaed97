"""Numbers from which ``terrain.js`` draws grounds."""

import math

from jansen_env.engine.mathematics import cos, tan
from jansen_env.terrain.generators import HIGHEST, LEVELS, MIXTURE, SHIFT, UP_OR_DOWN, at_level
from jansen_env.terrain.ground import LEAST_RUN, PER_WAVE, REACH, RISER_SLOPE, START


def terrain_data() -> dict[str, object]:
    """Parameters of each generator and level, lengths in m; angles are given as gradients, too."""
    levels = {name: [at_level(name, level) for level in range(HIGHEST + 1)] for name in LEVELS}
    for values in (*levels["slope"], *levels["ramps"]):
        values["gradient"] = tan(values.pop("angle"))
    gradients = {name: "gradient" if key == "angle" else key for name, key in UP_OR_DOWN.items()}
    return {
        "kinds": list(MIXTURE),
        "levels": levels,
        "upOrDown": gradients,
        "start": START,
        "shift": SHIFT,
        "reach": REACH,
        "steepness": tan(RISER_SLOPE),
        "leastRun": LEAST_RUN,
        "wave": [0.5 - 0.5 * cos(2.0 * math.pi * k / PER_WAVE) for k in range(PER_WAVE)],
    }
