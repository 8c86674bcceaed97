"""Round contact pads of a robot, at every toe and at other joints."""

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
    """The n round contact pads of a robot, those of the toes first, in the order of the legs.

    Attributes:
        leg: Index of the leg of each pad, shape (n,).
        joint: Index of each pad in ``linkage.all_pads``, shape (n,).
        toes: Number of pads that are toes.
        rows: Records of type ``PAD``, which kernels read, shape (n,).
    """

    leg: Ints
    joint: Ints
    toes: int
    rows: Rows


def pad_layout(robot: Robot) -> Pads:
    """Return the contact pads of a robot.

    The toes of all legs come first. The other pads follow leg by leg. The pads of the frame occur
    once for each side.
    """
    legs = leg_rows(robot)
    pads = np.array(robot.linkage.all_pads)
    rows = np.zeros(len(legs) * len(pads), PAD)
    leg = np.empty(len(legs) * len(pads), np.int64)
    count = put_layout(legs, pads, len(robot.linkage.toes), rows, leg)
    return Pads(leg[:count], rows["table"][:count], len(robot.toes), rows[:count])


def pad_sides(robot: Robot) -> Ints:
    """Return the straight sides of links that have a pad at both ends.

    A rod that ends at a crank pin has no such side, because a crank pin has no pad.

    Returns:
        Sorted pairs of indices of pads, so that the sides at toes come first, shape (n, 2).
    """
    layout = pad_layout(robot)
    legs = leg_rows(robot)
    members = leg_links(robot).members
    sides = np.empty((len(legs) * members.size, 2), np.int64)
    pads = np.array(robot.linkage.all_pads)
    count = put_sides(legs, members, pads, layout.rows, layout.leg, sides)
    return sides[:count].copy()
