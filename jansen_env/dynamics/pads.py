"""Pads with which a robot touches the ground: round, at every toe and at other joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jansen_env.arrays import Ints
from jansen_env.robot import Robot, Side
from jansen_env.robot.linkage import FRAME


@dataclass(frozen=True)
class Pads:
    """The round pads by which a robot can touch the ground, toes first (in the order of legs)."""

    leg: Ints  #: (n,) index of the leg
    joint: Ints  #: (n,) index into ``linkage.all_pads``
    toes: int  #: how many of them are toes


def pad_layout(robot: Robot) -> Pads:
    """Toes of all legs first; then the other pads leg by leg, the frame's once for each side."""
    pads, toes = robot.linkage.all_pads, len(robot.linkage.toes)
    rows = [(i, k) for i in range(len(robot.legs)) for k in range(toes)]
    seen: set[Side] = set()
    for i, leg in enumerate(robot.legs):
        rows += [
            (i, k) for k in range(toes, len(pads))
            if pads[k][1] != FRAME - 1 or leg.side not in seen
        ]  # fmt: skip
        seen.add(leg.side)
    leg_index, joint = np.array(rows, dtype=np.int64).T
    return Pads(leg_index, joint, len(robot.toes))


def pad_sides(robot: Robot) -> Ints:
    """Straight sides of links as pairs (n, 2) of pads: those with a pad's joint at both ends.

    In order, so that those of toes come first. Rods that end at a crank pin have none.
    """
    layout, linkage = pad_layout(robot), robot.linkage

    def key(leg: int, joint: int) -> tuple[int | Side, int]:
        fixed = joint in linkage.members[FRAME - 1]  # which legs of one side share
        return robot.legs[leg].side if fixed else leg, joint

    joints = [linkage.all_pads[k][0] for k in layout.joint.tolist()]
    pad = {key(*pair): k for k, pair in enumerate(zip(layout.leg.tolist(), joints, strict=True))}
    sides = {
        tuple(sorted((pad[key(leg, a)], pad[key(leg, b)])))
        for leg in range(len(robot.legs)) for a, b in linkage.skeleton
        if key(leg, a) in pad and key(leg, b) in pad
    }  # fmt: skip
    return np.array(sorted(sides), np.int64).reshape(-1, 2)
