"""Pads with which a robot touches the ground: round, at every toe and at other joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jansen_env.arrays import Ints, Rows
from jansen_env.engine.foot_pads import put_layout, put_sides
from jansen_env.engine.records import PAD
from jansen_env.robot import Robot
from jansen_env.robot.robot_arrays import leg_links, leg_rows


@dataclass(frozen=True)
class Pads:
    """The round pads by which a robot can touch the ground, toes first (in the order of legs)."""

    leg: Ints  #: (n,) index of the leg
    joint: Ints  #: (n,) index into ``linkage.all_pads``
    toes: int  #: how many of them are toes
    rows: Rows  #: (n,) records ``PAD`` of the pads, which kernels read


def pad_layout(robot: Robot) -> Pads:
    """Toes of all legs first; then the other pads leg by leg, the frame's once for each side."""
    legs, pads = leg_rows(robot), np.array(robot.linkage.all_pads)
    rows, leg = np.zeros(len(legs) * len(pads), PAD), np.empty(len(legs) * len(pads), np.int64)
    count = put_layout(legs, pads, len(robot.linkage.toes), rows, leg)
    return Pads(leg[:count], rows["table"][:count], len(robot.toes), rows[:count])


def pad_sides(robot: Robot) -> Ints:
    """Straight sides of links as pairs (n, 2) of pads: those with a pad's joint at both ends.

    In order, so that those of toes come first. Rods that end at a crank pin have none.
    """
    layout, legs, members = pad_layout(robot), leg_rows(robot), leg_links(robot).members
    sides = np.empty((len(legs) * members.size, 2), np.int64)
    pads = np.array(robot.linkage.all_pads)
    count = put_sides(legs, members, pads, layout.rows, layout.leg, sides)
    return sides[:count].copy()
