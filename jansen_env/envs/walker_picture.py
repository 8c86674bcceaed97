"""What is drawn of a walker, from its plant and its last step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jansen_env.plants.base import Plant
from jansen_env.rendering import Frame

Array = NDArray[np.float64]

SLIPPING = 0.01  # m/s of mean slip speed from which a toe is drawn as slipping


def walking_frame(
    plant: Plant,
    slip: Array,
    force: Array,
    command: float,
    torque: float,
    torque_limit: float,
    time: float,
    period: float,
) -> Frame:
    """The frame to draw of a plant as it stands.

    Args:
        slip: (toes,) m, force: (toes, 2) tangential and normal, N, of the last step.
        command: m/s. torque, torque_limit: N m. time: s since the reset. period: of control, s.
    """
    state = plant.state
    points, tangents = plant.contact_frames()
    return Frame(
        q=state[:4],
        contact_point=points,
        contact_tangent=tangents,
        contact_force=force,
        slipping=slip > SLIPPING * period,
        command=command,
        speed=float(state[4]),
        torque=torque,
        torque_limit=torque_limit,
        time=time,
    )
