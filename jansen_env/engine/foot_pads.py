"""Contact pads of a robot: their order, and the sides of links that end at two pads."""

from __future__ import annotations

import math

from jansen_env.engine.closure import FRAME
from jansen_env.engine.kernel import Floats2, Ints1, Ints2, kernel, stage
from jansen_env.engine.records import Layout

JOINT, BODY = range(2)  # columns of the array ``pads``, which lists the pads of a leg


@kernel
def put_layout(legs: Floats2, pads: Ints2, toes: int, layout: Layout, leg_of: Ints1) -> int:
    """List all pads of a robot: first the toes of all legs, then the other pads leg by leg.

    A pad of the frame is listed only once for each side of the robot.

    Args:
        legs: Side of each leg (1 for fore, -1 for back) and its phase in rad, shape (legs, 2).
        pads: Joint and body of each pad of a leg, toes first, shape (pads, 2).
        toes: Number of pads of a leg that are toes.
        layout: Output, records of all pads, shape (legs * pads,).
        leg_of: Output, index of each pad's leg, shape (legs * pads,).

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
    """Return the pad at a joint of a leg, or -1 if there is none.

    If the joint is fixed in the frame, the legs of one side share its pad.
    """
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
    """List the straight sides of links that have a pad at both ends, as sorted pairs of pads.

    Args:
        legs: Side and phase of each leg, see :func:`put_layout`.
        members: Joints of each body, shape (bodies, most joints); -1 where a body has fewer.
        pads: Joint and body of each pad of a leg, shape (pads, 2).
        layout: Records of all pads from :func:`put_layout`, shape (n,).
        leg_of: Index of each pad's leg from :func:`put_layout`, shape (n,).
        sides: Output, pairs of pads, shape (legs * bodies * most joints, 2).

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
    """Return the pad at a joint of a leg, or -1 if there is none."""
    fixed = False
    for k in range(members.shape[1]):
        fixed = fixed or members[FRAME, k] == joint
    return _pad_at(leg, joint, legs, pads, fixed, layout, leg_of)


@stage(inline=False)
def _insert(a, b, sides, count):
    """Insert a pair into sorted pairs unless they contain it, and return the number of pairs."""
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
