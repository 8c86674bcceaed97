"""Pads of a robot: which legs have them, and which sides of links lie between two of them."""

from __future__ import annotations

import math

from jansen_env.engine.closure import FRAME
from jansen_env.engine.kernel import Floats2, Ints1, Ints2, kernel, stage
from jansen_env.engine.records import Layout

JOINT, BODY = range(2)  # of the pads of a leg


@kernel
def put_layout(legs: Floats2, pads: Ints2, toes: int, layout: Layout, leg_of: Ints1) -> int:
    """Put all pads of a robot: toes of all legs first; then the other pads leg by leg.

    The frame's pads come once for each side of the robot.

    Args:
        legs: (legs, 2) 1 of a fore leg and -1 of a back leg; and phase, rad.
        pads: (pads, 2) joint and body of each pad of a leg, toes first. toes: how many are toes.
        layout: (legs pads,) out. leg_of: (legs pads,) out.

    Returns:
        The number of pads.
    """
    count = 0
    for others in range(2):
        first, end = (toes, len(pads)) if others == 1 else (0, toes)
        for leg in range(len(legs)):
            side, phase = legs[leg]
            is_new = True
            for before in range(leg):
                is_new = is_new and legs[before, 0] != side
            for k in range(first, end):
                if others == 1 and pads[k, BODY] == FRAME and not is_new:
                    continue
                row = layout[count]
                row.table, row.mirror = k, side
                row.phase = phase if side > 0.0 else math.pi - phase
                leg_of[count] = leg
                count += 1
    return count


@stage(inline=False)
def _pad_at(leg, joint, legs, pads, fixed, layout, leg_of):
    """The pad at a joint of a leg; of joints that are fixed in the frame, on its side; or -1."""
    found = -1
    for k in range(len(leg_of)):
        if pads[layout[k].table, JOINT] == joint:
            other = leg_of[k]
            if other == leg or (fixed and legs[other, 0] == legs[leg, 0]):
                found = k
    return found


@kernel
def put_sides(
    legs: Floats2, members: Ints2, pads: Ints2, layout: Layout, leg_of: Ints1, sides: Ints2
) -> int:
    """Put the straight sides of links that have a pad at both ends, as pairs of pads, in order.

    Args:
        members: (bodies, most joints) joints of each body; -1 where a body has fewer.
        layout, leg_of: (n,) of :func:`put_layout`.
        sides: (legs members, 2) out.

    Returns:
        The number of sides.
    """
    count = 0
    for leg in range(len(legs)):
        for body in range(len(members)):
            joints, size = members[body], 0
            while size < len(joints) and joints[size] >= 0:
                size += 1
            for k in range(1 if size == 2 else size):
                a = _end(leg, joints[k], legs, members, pads, layout, leg_of)
                b = _end(leg, joints[(k + 1) % size], legs, members, pads, layout, leg_of)
                if a >= 0 and b >= 0:
                    count = _insert(min(a, b), max(a, b), sides, count)
    return count


@stage
def _end(leg, joint, legs, members, pads, layout, leg_of):
    """The pad at a joint of a leg, or -1."""
    fixed = False
    for k in range(members.shape[1]):
        fixed = fixed or members[FRAME, k] == joint
    return _pad_at(leg, joint, legs, pads, fixed, layout, leg_of)


@stage(inline=False)
def _insert(a, b, sides, count):
    """Insert a pair into pairs in order, unless it is there; returns their number."""
    place = count
    while place > 0 and (
        sides[place - 1, 0] > a or (sides[place - 1, 0] == a and sides[place - 1, 1] >= b)
    ):
        place -= 1
    if place < count and sides[place, 0] == a and sides[place, 1] == b:
        return count
    for k in range(count, place, -1):
        sides[k, 0], sides[k, 1] = sides[k - 1, 0], sides[k - 1, 1]
    sides[place, 0], sides[place, 1] = a, b
    return count + 1
