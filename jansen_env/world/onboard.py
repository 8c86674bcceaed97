"""Observations of the sensors on board a machine: encoder, IMU, and motor current.

:mod:`jansen_env.engine.onboard_estimates` reads these sensors and computes the estimates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Ints
from jansen_env.engine.onboard_estimates import SAMPLES
from jansen_env.engine.records import ESTIMATES as ESTIMATES
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import advance_per_turn, toe_positions
from jansen_env.world.observations import EXACT, Observed

ONBOARD = (
    Observed("cos_crank_angle", "1", -1.0, 1.0, "encoder"),
    Observed("sin_crank_angle", "1", -1.0, 1.0, "encoder"),
    Observed("crank_speed", "rad/s", -np.inf, np.inf, EXACT),  # from noisy angles
    Observed("sin_pitch", "1", -1.0, 1.0, EXACT),  # from noisy IMU readings
    Observed("cos_pitch", "1", -1.0, 1.0, EXACT),
    Observed("pitch_rate", "rad/s", -np.inf, np.inf, "gyro"),
    Observed("crank_axis_x_velocity", "m/s", -np.inf, np.inf, EXACT),  # estimate
    Observed("acceleration_x", "m/s^2", -np.inf, np.inf, "accelerometer"),
    Observed("acceleration_y", "m/s^2", -np.inf, np.inf, "accelerometer"),
    Observed("crank_torque", "N m", -np.inf, np.inf, "torque"),
    Observed("last_action", "1", -1.0, 1.0, EXACT),
)
COLUMNS = (
    "cos_crank_angle",
    "sin_crank_angle",
    "crank_speed",
    "sin_pitch",
    "cos_pitch",
    "pitch_rate",
    "crank_axis_x_velocity",
    "acceleration_x",
    "acceleration_y",
    "crank_torque",
)
"""Names of the columns that the engine reads and fills, in the order that it uses."""


def onboard_columns(columns: Mapping[str, int]) -> Ints:
    """Return the index of each column of :data:`COLUMNS` in an observation.

    Args:
        columns: Indices of the observed columns, by name.

    Returns:
        The indices, shape (10,), with -1 for columns that are not observed.
    """
    return np.array([columns.get(name, -1) for name in COLUMNS], np.int64)


@cache
def toe_paths(robot: Robot) -> NDArray[np.float32]:
    """Return the positions of the toes over a turn of the crank that walks towards +x.

    Args:
        robot: The robot.

    Returns:
        Positions in the chassis frame, in m, shape (SAMPLES + 1, toes, 2).
    """
    angles = np.copysign(np.linspace(0.0, 2.0 * math.pi, SAMPLES + 1), advance_per_turn(robot))
    return toe_positions(robot, angles).astype(np.float32)
