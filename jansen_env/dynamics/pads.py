"""Pads with which a robot touches the ground: round, at every toe and at other joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jansen_env.robot import Robot, Side
from jansen_env.robot.kinematics import B, C, D, E, P, T

PAD_JOINTS = (T, C, E, D, B, P)
"""Joints that can touch the ground: the toe; and knee, ankle, hip corners and pivot (non-toe
contact)."""
PAD_BODIES = (8, 8, 8, 4, 4, 1)
"""The body each of them is rounded on: its pad turns with that body."""


@dataclass(frozen=True)
class Pads:
    """The round pads by which a robot can touch the ground, toes first (in the order of legs)."""

    leg: NDArray[np.int64]  #: (n,) index of the leg
    joint: NDArray[np.int64]  #: (n,) index into :data:`PAD_JOINTS`
    toes: int  #: how many of them are toes


def pad_layout(robot: Robot) -> Pads:
    """Toes of all legs first; then the other pads leg by leg, a pivot once for each side."""
    rows = [(i, 0) for i in range(len(robot.legs))]
    seen: set[Side] = set()
    for i, leg in enumerate(robot.legs):
        rows += [(i, joint) for joint in range(1, len(PAD_JOINTS) - 1)]
        if leg.side not in seen:
            rows.append((i, len(PAD_JOINTS) - 1))
            seen.add(leg.side)
    leg_index, joint = np.array(rows, dtype=np.int64).T
    return Pads(leg_index, joint, len(robot.legs))
