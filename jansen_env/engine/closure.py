"""Closure of a leg: positions of its joints, and angles and centres of mass of its bodies.

All of these are computed at given crank angles. If the angle of a body is a, each of its joints
lies at the body's centre + c (cos, sin)(a + o). The array ``corners``, shape (bodies, most joints,
2), holds c in m and o in rad. The array ``members``, shape (bodies, most joints), holds the joints
of each body, and -1 where a body has fewer joints.
"""

from __future__ import annotations

import math

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import (
    Bools1,
    Floats1,
    Floats2,
    Floats3,
    Floats4,
    Ints1,
    Ints2,
    kernel,
    stage,
)
from jansen_env.engine.link_shapes import edge_turn
from jansen_env.engine.sums import pairwise_sum

FRAME, CRANK = range(2)  # positions of the two bodies that all legs share


@kernel
def put_turn_angles(begin: float, angles: Floats1) -> None:
    """Distribute angles evenly over one turn, excluding its end.

    Args:
        begin: First angle, in rad.
        angles: Output, in rad, shape (n,).
    """
    for i in range(len(angles)):
        angles[i] = 2.0 * math.pi / len(angles) * i + begin


@kernel
def put_angles_to_end(end: float, angles: Floats1) -> None:
    """Distribute angles evenly from 0 to ``end``, including ``end``, as ``numpy.linspace`` does.

    Args:
        end: Last angle, in rad.
        angles: Output, in rad, shape (n,).
    """
    last = len(angles) - 1
    for i in range(last):
        angles[i] = i * (end / last)
    angles[last] = end


@kernel
def put_joints(
    psi: Floats1,
    frame_angle: float,
    members: Ints2,
    corners: Floats3,
    dyads: Ints2,
    spans: Floats2,
    places: Floats3,
    fault: Floats1,
) -> int:
    """Compute the positions of a fore leg's joints at crank angles.

    Args:
        psi: Crank angles, in rad, shape (n,).
        frame_angle: Angle of the frame in the chassis, in rad.
        members: Joints of each body, shape (bodies, most joints); -1 where a body has fewer.
        corners: Joints of each body in polar coordinates, see
            :func:`jansen_env.engine.link_shapes.put_link_corners`, shape (bodies, most joints, 2).
        dyads: Six integers for each dyad, shape (dyads, 6): joint, start, end, branch, and the two
            bodies that connect start and end to the joint.
        spans: Distances from start and from end to the joint, in m, shape (dyads, 2).
        places: Output, positions of the joints in m, shape (n, joints, 2).
        fault: Output if a dyad does not close, shape (2,): index of the angle at which the gap is
            largest, and the distance that the dyad cannot span there, in m.

    Returns:
        The index of the first dyad that does not close, or -1.
    """
    return close_leg(psi, frame_angle, members, corners, dyads, spans, places, fault)


@stage(inline=False)
def close_leg(psi, frame_angle, members, corners, dyads, spans, places, fault):
    """Compute the positions of a fore leg's joints, see :func:`put_joints`."""
    for i in range(len(psi)):
        places[i] = math.nan  # NaN marks a joint whose position is not known yet.
        places[i, members[CRANK, 0]] = 0.0
        _add_joints(places[i], members[FRAME], corners[FRAME], frame_angle)
        _add_joints(places[i], members[CRANK], corners[CRANK], psi[i])
    for d in range(len(dyads)):
        worst = math.inf
        for i in range(len(psi)):
            across2, span = _add_dyad(places[i], dyads[d], spans[d])
            if not across2 > 0.0 and not across2 >= worst:
                worst, fault[0], fault[1] = across2, i, span
        if worst != math.inf:
            return d
        for k in range(4, 6):
            body = dyads[d, k]
            if members.shape[1] > 2 and members[body, 2] >= 0:
                a = _first_known(places[0], members[body], 0)
                b = _first_known(places[0], members[body], a + 1)
                half, turn = edge_turn(corners[body, a], corners[body, b])
                for i in range(len(psi)):
                    heading = _heading(places[i], members[body, a], members[body, b])
                    _add_joints(places[i], members[body], corners[body], heading + half + turn)
    return -1


@kernel
def put_open_joints(
    psi: Floats1,
    frame_angle: float,
    members: Ints2,
    corners: Floats3,
    dyads: Ints2,
    spans: Floats2,
    places: Floats3,
    open_dyads: Ints1,
    open_spans: Floats1,
    fault: Floats1,
) -> int:
    """Compute the joints at each crank angle, up to the first dyad that does not close there.

    In contrast to :func:`put_joints`, the leg need not close at every angle.

    Args:
        psi: Crank angles, in rad, shape (n,).
        frame_angle: Angle of the frame in the chassis, in rad.
        members: Joints of each body, see :func:`put_joints`.
        corners: Joints of each body in polar coordinates, see :func:`put_joints`.
        dyads: Dyads of the leg, see :func:`put_joints`.
        spans: Distances within each dyad, in m, see :func:`put_joints`.
        places: Output, positions of the joints in m, shape (n, joints, 2); NaN for joints that are
            not found.
        open_dyads: Output, index of the first dyad that does not close at each angle, or -1, shape
            (n,).
        open_spans: Output, distance that this dyad cannot span, in m, shape (n,).
        fault: Work space, shape (2,).

    Returns:
        The number of angles at which the leg closes.
    """
    closed = 0
    for i in range(len(psi)):
        open_dyads[i] = close_leg(
            psi[i : i + 1], frame_angle, members, corners, dyads, spans, places[i : i + 1], fault
        )
        if open_dyads[i] < 0:
            closed += 1
        else:
            joint = dyads[open_dyads[i], 0]
            places[i, joint, 0] = places[i, joint, 1] = math.nan
            open_spans[i] = fault[1]
    return closed


@kernel
def put_legs(
    psi: Floats1,
    legs: Floats2,
    frame_angle: float,
    members: Ints2,
    corners: Floats3,
    dyads: Ints2,
    spans: Floats2,
    angles: Floats2,
    places: Floats4,
    fault: Floats1,
) -> int:
    """Compute the positions of the joints of all legs at crank angles.

    Args:
        psi: Crank angles, in rad, shape (n,).
        legs: Side of each leg (1 for fore, -1 for back, its mirror image) and its phase in rad,
            shape (legs, 2).
        frame_angle: Angle of the frame in the chassis, in rad.
        members: Joints of each body, see :func:`put_joints`.
        corners: Joints of each body in polar coordinates, see :func:`put_joints`.
        dyads: Dyads of the leg, see :func:`put_joints`.
        spans: Distances within each dyad, in m, see :func:`put_joints`.
        angles: Output, crank angles at which a fore leg has the same shape as each leg, in rad,
            shape (legs, n).
        places: Output, positions of the joints in m, shape (legs, n, joints, 2).
        fault: Output if a dyad does not close, shape (3,): the two values of :func:`put_joints`,
            and the index of the leg. In this case, ``angles`` is complete up to this leg.

    Returns:
        The index of the first dyad that does not close, or -1.
    """
    for leg in range(len(legs)):
        side, phase = legs[leg]
        for i in range(len(psi)):
            ahead = psi[i] + phase
            angles[leg, i] = ahead if side > 0.0 else math.pi - ahead
        failed = close_leg(
            angles[leg], frame_angle, members, corners, dyads, spans, places[leg], fault
        )
        if failed >= 0:
            fault[2] = leg
            return failed
        if side < 0.0:
            for i in range(len(psi)):
                for j in range(places.shape[2]):
                    places[leg, i, j, 0] *= -1.0
    return -1


@kernel
def turn_legs(q: Floats1, places: Floats4) -> None:
    """Transform the joints of legs from the chassis frame to the world frame.

    Args:
        q: Position x and y of the crank axis in m, and pitch in rad, shape (3,).
        places: Positions of the joints, changed in place, in m, shape (legs, n, joints, 2).
    """
    cos, sin = mathematics.cos(q[2]), mathematics.sin(q[2])
    for leg in range(places.shape[0]):
        for i in range(places.shape[1]):
            for j in range(places.shape[2]):
                x, y = places[leg, i, j]
                places[leg, i, j, 0] = cos * x - sin * y + q[0]
                places[leg, i, j, 1] = sin * x + cos * y + q[1]


@kernel
def put_lowest_toes(places: Floats4, toes: Ints1, heights: Floats1) -> None:
    """Compute the height of the lowest toe above the crank axis at each crank angle.

    Args:
        places: Positions of the joints, in m, shape (legs, n, joints, 2).
        toes: Joints of a leg that are toes, shape (toes,).
        heights: Output, in m, shape (n,).
    """
    put_heights(places, toes, heights)


@stage(inline=False)
def put_heights(places, toes, heights):
    """Compute the height of the lowest toe at each crank angle, see :func:`put_lowest_toes`."""
    for i in range(len(heights)):
        heights[i] = math.inf
        for leg in range(len(places)):
            for k in range(len(toes)):
                heights[i] = min(heights[i], places[leg, i, toes[k], 1])


@kernel
def mean(values: Floats1) -> float:
    """Return the mean of values as ``numpy.mean`` computes it.

    Args:
        values: The values, shape (n,).
    """
    return pairwise_sum(values) / len(values)


@kernel
def advance_over_turn(places: Floats4, toes: Ints1, ways: Floats1) -> float:
    """Return the advance of a level robot on its lowest toe per turn of the crank, in m.

    The crank turns counter-clockwise.

    Args:
        places: Positions of the joints over one turn, including its end, in m, shape (legs, n + 1,
            joints, 2).
        toes: Joints of a leg that are toes, shape (toes,).
        ways: Work space, shape (n,).
    """
    for i in range(len(ways)):
        lowest = math.inf
        for leg in range(len(places)):
            for k in range(len(toes)):
                before, after = places[leg, i, toes[k]], places[leg, i + 1, toes[k]]
                if after[1] + before[1] < lowest:
                    lowest, ways[i] = after[1] + before[1], after[0] - before[0]
    return -pairwise_sum(ways)


@kernel
def measure_level(
    places: Floats4, toes: Ints1, near: float, heights: Floats1, grounded: Ints2, out: Floats1
) -> None:
    """Measure a robot over one turn of its crank, kept level and standing on its lowest toe.

    Args:
        places: Positions of the joints of all legs, in m, shape (legs, n, joints, 2).
        toes: Joints of a leg that are toes, shape (toes,).
        near: Largest height above the ground at which a toe is in stance, as a fraction of the
            standing height.
        heights: Work space, shape (n,).
        grounded: Output, whether each toe of the first leg is in stance, shape (toes, n).
        out: Output, shape (5,): mean height of the crank axis, in m; range of this height, in m;
            largest height of a toe above the lowest toe, in m; advance per counter-clockwise turn,
            in m; fraction of the turn in which a toe is in stance, averaged over all toes.
    """
    count, legs = len(heights), len(places)
    put_heights(places, toes, heights)
    standing = -pairwise_sum(heights) / count
    low = high = heights[0]
    lift = advance = 0.0
    stances = 0
    for i in range(count):
        low, high = min(low, heights[i]), max(high, heights[i])
        following = (i + 1) % count
        lowest, way = math.inf, 0.0
        for leg in range(legs):
            for k in range(len(toes)):
                before, after = places[leg, i, toes[k]], places[leg, following, toes[k]]
                lift = max(lift, before[1] - heights[i])
                if after[1] + before[1] < lowest:
                    lowest, way = after[1] + before[1], after[0] - before[0]
                stands = before[1] - heights[i] <= near * standing
                stances += int(stands)
                if leg == 0:
                    grounded[k, i] = int(stands)
        advance -= way
    out[0], out[1], out[2], out[3] = standing, high - low, lift, advance
    out[4] = stances / (count * legs * len(toes))


@kernel
def nearest_dead_point(places: Floats3, dyads: Ints2, out: Floats1) -> int:
    """Find the crank angle and the dyad whose two links come closest to being collinear.

    Args:
        places: Positions of the joints of a fore leg over one turn, in m, shape (n, joints, 2).
        dyads: Dyads of the leg, see :func:`put_joints`.
        out: Output, shape (2,): sine of the angle between the two links, and index of the crank
            angle.

    Returns:
        The index of the dyad.
    """
    nearest = 0
    out[0] = math.inf
    for d in range(len(dyads)):
        for i in range(len(places)):
            joint, start, end = (
                places[i, dyads[d, 0]],
                places[i, dyads[d, 1]],
                places[i, dyads[d, 2]],
            )
            ux, uy, vx, vy = (
                joint[0] - start[0],
                joint[1] - start[1],
                joint[0] - end[0],
                joint[1] - end[1],
            )
            sine = abs(ux * vy - uy * vx)
            sine /= mathematics.hypot(ux, uy) * mathematics.hypot(vx, vy)
            if sine < out[0]:
                nearest, out[0], out[1] = d, sine, i
    return nearest


@stage(inline=False)
def _add_dyad(place, dyad, spans):
    """Store the joint of a dyad, left (branch 1) or right (-1) of the line from start to end.

    Returns:
        The square of the joint's distance from this line, in m^2, which is not positive if the dyad
        does not close; and the distance from start to end, in m.
    """
    a, b, from_a, from_b = place[dyad[1]], place[dyad[2]], spans[0], spans[1]
    dx, dy = b[0] - a[0], b[1] - a[1]
    span = mathematics.hypot(dx, dy)
    along = (span * span + (from_a * from_a - from_b * from_b)) / (2.0 * span)
    across2 = from_a * from_a - along * along
    dx, dy, across = dx / span, dy / span, dyad[3] * math.sqrt(max(across2, 0.0))
    place[dyad[0], 0] = a[0] + along * dx + across * -dy
    place[dyad[0], 1] = a[1] + along * dy + across * dx
    return across2, span


@stage
def _first_known(place, joints, k):
    """Return the first index from ``k`` on in ``joints`` whose joint has a known position."""
    while math.isnan(place[joints[k], 0]):
        k += 1
    return k


@stage
def _heading(place, a, b):
    """Return the direction from joint ``a`` to joint ``b``, in rad."""
    return mathematics.atan2(place[b, 1] - place[a, 1], place[b, 0] - place[a, 0])


@stage(inline=False)
def _add_joints(place, joints, corners, angle):
    """Store all joints of a body of which the angle and at least one joint are known."""
    k = _first_known(place, joints, 0)
    reach, heading = corners[k, 0], angle + corners[k, 1]
    x = place[joints[k], 0] - reach * mathematics.cos(heading)
    y = place[joints[k], 1] - reach * mathematics.sin(heading)
    for k in range(len(joints)):
        if joints[k] >= 0 and math.isnan(place[joints[k], 0]):
            reach, heading = corners[k, 0], angle + corners[k, 1]
            place[joints[k], 0] = x + reach * mathematics.cos(heading)
            place[joints[k], 1] = y + reach * mathematics.sin(heading)


@kernel
def put_coordinates(
    psi: Floats1,
    mirror: float,
    members: Ints2,
    corners: Floats3,
    bars: Bools1,
    places: Floats3,
    x: Floats3,
) -> None:
    """Compute the angle and the centre of mass of each body of a leg.

    Args:
        psi: Crank angles, in rad, shape (n,).
        mirror: 1 for a fore leg, -1 for a back leg.
        members: Joints of each body, shape (bodies, most joints); -1 where a body has fewer.
        corners: Joints of each body in polar coordinates, see :func:`put_joints`.
        bars: Whether each body is a bar, whose centre lies halfway between its joints, shape
            (bodies,).
        places: Positions of the joints, in m, shape (n, joints, 2).
        x: Output, shape (n, bodies, 3): angle in rad, and position of the centre of mass in m.
    """
    for k in range(len(members)):
        half, turn = edge_turn(corners[k, 0], corners[k, 1])
        a, b, reach, offset = members[k, 0], members[k, 1], corners[k, 0, 0], corners[k, 0, 1]
        for i in range(len(psi)):
            heading = _heading(places[i], a, b)
            x[i, k, 1] = (places[i, a, 0] + places[i, b, 0]) / 2.0
            x[i, k, 2] = (places[i, a, 1] + places[i, b, 1]) / 2.0
            if not bars[k]:
                heading = heading + half + mirror * turn
                x[i, k, 1] = places[i, a, 0] - reach * mathematics.cos(heading + mirror * offset)
                x[i, k, 2] = places[i, a, 1] - reach * mathematics.sin(heading + mirror * offset)
            turns = mathematics.floor(0.5 - heading / (2.0 * math.pi))
            x[i, k, 0] = psi[i] if k == CRANK else heading + 2.0 * math.pi * turns
