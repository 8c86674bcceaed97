"""A leg closed: its joints, and the angles and centres of mass of its bodies, at crank angles.

A body's joint is at its centre + c (cos, sin)(angle + o); ``corners`` (bodies, most joints, 2) has
c, m, and o, rad. ``members`` (bodies, most joints) has the joints; -1 where a body has fewer.
"""

from __future__ import annotations

import math

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import Bools1, Floats1, Floats2, Floats3, Ints2, kernel, stage

FRAME, CRANK = range(2)  # the bodies that all legs share


@kernel
def put_joints(
    psi: Floats1, frame_angle: float, members: Ints2, corners: Floats3, dyads: Ints2,
    spans: Floats2, places: Floats3, fault: Floats1,
) -> int:  # fmt: skip
    """Put the joints of a fore leg whose crank stands at ``psi`` (n,) into (n, joints, 2), m.

    Args:
        dyads: (dyads, 6) joint, start, end, branch, and the bodies from start and end to the joint.
        spans: (dyads, 2) lengths of these, m. fault: (2,) out: of the dyad that does not close, the
            angle's number where that is worst, and the distance that it cannot span, m.

    Returns:
        The first dyad that does not close, or -1.
    """
    for i in range(len(psi)):
        places[i] = math.nan  # where a joint is not known yet
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
                half, turn = edge_to_angle(corners[body], a, b)
                for i in range(len(psi)):
                    heading = _heading(places[i], members[body, a], members[body, b])
                    _add_joints(places[i], members[body], corners[body], heading + half + turn)
    return -1


@stage(inline=False)
def _add_dyad(place, dyad, spans):
    """Put a dyad's joint left (branch 1) or right (-1) of the way from start to end.

    Returns the square of its distance from there, m^2: not above 0 where it does not close. And the
    distance from start to end, m.
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
    """The first of a body's joints from ``k`` on whose place is known, by its place in the body."""
    while math.isnan(place[joints[k], 0]):
        k += 1
    return k


@stage
def _heading(place, a, b):
    """Angle of the way from one joint to another, rad."""
    return mathematics.atan2(place[b, 1] - place[a, 1], place[b, 0] - place[a, 0])


@stage
def edge_to_angle(corners, a, b):
    """Turn from the edge between two joints of a body to its angle: half a turn or none, and more.

    For a body whose angle points to the first of them the edge is taken the other way round.
    """
    r, s, way = corners[a, 0], corners[b, 0], -1.0 if corners[a, 0] > 0.0 else 1.0
    x = way * (s * mathematics.cos(corners[b, 1]) - r * mathematics.cos(corners[a, 1]))
    y = way * (s * mathematics.sin(corners[b, 1]) - r * mathematics.sin(corners[a, 1]))
    return math.pi if r > 0.0 else 0.0, -mathematics.atan2(y, x)


@stage(inline=False)
def _add_joints(place, joints, corners, angle):
    """Add all joints of a body whose angle is known, and one of its joints."""
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
    psi: Floats1, mirror: float, members: Ints2, corners: Floats3, bars: Bools1, places: Floats3,
    x: Floats3,
) -> None:  # fmt: skip
    """Put angle and centre of mass of each body of a leg into (n, bodies, 3), rad and m.

    Args:
        mirror: 1 of a fore leg, -1 of a back leg. bars: (bodies,) whether each is one, with its
            centre half way. places: (n, joints, 2) m.
    """
    for k in range(len(members)):
        half, turn = edge_to_angle(corners[k], 0, 1)
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
