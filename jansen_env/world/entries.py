"""Numbers of observations, by name."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Observed(NamedTuple):
    """A number of the observation: its name, as in ``info`` if it is there too; unit, limits."""

    name: str
    unit: str
    low: float
    high: float


def list_entries(toes: int, scanned: int) -> list[Observed]:
    """Return the numbers of a robot in the order of :func:`jansen_env.engine.readings.read`."""
    inf = np.inf
    return [
        Observed("cos_crank_angle", "1", -1.0, 1.0),
        Observed("sin_crank_angle", "1", -1.0, 1.0),
        Observed("crank_speed", "rad/s", -inf, inf),
        Observed("sin_pitch", "1", -1.0, 1.0),
        Observed("cos_pitch", "1", -1.0, 1.0),
        Observed("pitch_rate", "rad/s", -inf, inf),
        Observed("crank_axis_x_velocity", "m/s", -inf, inf),
        Observed("crank_axis_y_velocity", "m/s", -inf, inf),
        Observed("crank_axis_height", "m", -inf, inf),
        Observed("last_action", "1", -1.0, 1.0),
        *(Observed(f"toe_load_{toe}", "1", 0.0, inf) for toe in range(toes)),
        *(Observed(f"height_scan_{place}", "m", -inf, inf) for place in range(scanned)),
    ]
