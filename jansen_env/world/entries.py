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
    """Return the observed numbers of a robot with so many toes and places of a height scan.

    In the order of :func:`jansen_env.engine.readings.read`.
    """
    any_number, unit, positive_number = (-np.inf, np.inf), (-1.0, 1.0), (0.0, np.inf)
    return [
        Observed("cos_crank_angle", "1", *unit),
        Observed("sin_crank_angle", "1", *unit),
        Observed("crank_speed", "rad/s", *any_number),
        Observed("sin_pitch", "1", *unit),
        Observed("cos_pitch", "1", *unit),
        Observed("pitch_rate", "rad/s", *any_number),
        Observed("crank_axis_x_velocity", "m/s", *any_number),
        Observed("crank_axis_y_velocity", "m/s", *any_number),
        Observed("crank_axis_height", "m", *any_number),
        Observed("last_action", "1", *unit),
        *(Observed(f"toe_load_{toe}", "1", *positive_number) for toe in range(toes)),
        *(Observed(f"height_scan_{place}", "m", *any_number) for place in range(scanned)),
    ]
