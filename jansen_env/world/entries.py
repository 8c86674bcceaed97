"""Numbers of observations, by name."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

EXACT = "exact"  # what no sensor measures, or is measured from other sensors


class Observed(NamedTuple):
    """A number of the observation: its name, as in ``info`` if it is there too; unit, limits.

    ``sensor``: the field of :class:`jansen_env.world.noise.Noise` whose noise it has, or
    :data:`EXACT`; without one it cannot be observed in an environment with ``noise``.
    """

    name: str
    unit: str
    low: float
    high: float
    sensor: str = ""


def list_entries(toes: int, scanned: int) -> list[Observed]:
    """Return the numbers of a robot in the order of :func:`jansen_env.engine.readings.read`."""
    inf = np.inf
    return [
        Observed("cos_crank_angle", "1", -1.0, 1.0, "encoder"),
        Observed("sin_crank_angle", "1", -1.0, 1.0, "encoder"),
        Observed("crank_speed", "rad/s", -inf, inf, "crank_speed"),
        Observed("sin_pitch", "1", -1.0, 1.0, "pitch"),
        Observed("cos_pitch", "1", -1.0, 1.0, "pitch"),
        Observed("pitch_rate", "rad/s", -inf, inf, "gyro"),
        Observed("crank_axis_x_velocity", "m/s", -inf, inf, "velocity"),
        Observed("crank_axis_y_velocity", "m/s", -inf, inf, "velocity"),
        Observed("crank_axis_height", "m", -inf, inf, "height"),
        Observed("last_action", "1", -1.0, 1.0, EXACT),
        *(Observed(f"toe_load_{toe}", "1", 0.0, inf, "loads") for toe in range(toes)),
        *(Observed(f"height_scan_{k}", "m", -inf, inf, "height_scan") for k in range(scanned)),
    ]
