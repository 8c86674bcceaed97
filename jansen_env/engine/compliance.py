"""Compliant pads: a spring and a damper along the normal, and a bristle with both along the ground.

The normal force is that of a Kelvin-Voigt element, and it never pulls. Friction acts through a
spring, as in Dahl's model, but with an exact threshold. For the normal direction, let g be the gap
at the middle of the time step, and u_0 and u_1 the velocities before and after the step. In the
tangential direction, the deflection of the bristle takes the place of g. The impulse is

    P = -h k (g + (1 - c) h (u_1 - u_0) / 4 + c h u_1) - h d ((1 - c) (u_0 + u_1) / 2 + c u_1)

- c = 0 if the time step resolves spring and damper. This is the trapezoidal rule, which is of
  second order. A spring returns the energy that it stored to the last bit, whereas implicit Euler
  would damp the motion by about omega h / 2.
- c approaches 1 if the time step does not resolve them. This is implicit Euler in u and in g, where
  g is evaluated half a time step after u_1. It slows a pad down before the pad enters the ground.
  The pad therefore neither bounces nor rings, however stiff spring and damper are, and in the limit
  it is rigid.

With P = -B (u_1 + offset), a compliant contact is a rigid contact with 1 / B added to the diagonal
of W and ``offset`` added to the free velocity. The complementarity problem, its solver and its
initial guesses stay the same. The velocity in this problem is the velocity at which the pad slides
or lifts off. A touchdown counts only the distance below the ground, so a spring never returns more
energy than it received.

Near an edge of the ground, a pad that is deep in the ground may be far below a plane that has just
been found. Compression is therefore part of the state: the springs of a pad on new planes together
hold no more energy than its springs on the old planes did. Planes on which they would hold more are
moved into the ground. The springs of link sides that end in a pad count together with the springs
of the pad itself, which come first. A vertex may also appear under a side that is already below the
vertex. The spring of the side then starts at this position.

In this module, ``implicitness`` is c, which :func:`_implicitness` computes. Contact c of the arrays
has rows 2 c (normal) and 2 c + 1 (tangential).
"""

from __future__ import annotations

import numpy as np

from jansen_env.engine import mathematics
from jansen_env.engine.contact_solver import COMPLIANCE, OPEN, STICK
from jansen_env.engine.contacts import rate
from jansen_env.engine.kernel import stage

RESOLVED = 2.0
"""Largest phase (rad) or decay of a free pad's motion in a time step for which c is 0."""
NORMAL, TANGENTIAL = 0, 1


@stage
def _implicitness(h, k, d, weight):
    """Return c for a row of a contact whose entry on the diagonal of W is ``weight``, in 1/kg.

    The spring has stiffness ``k`` in N/m, and the damper has damping ``d`` in N s/m.
    """
    # Phase and decay of the free motion in one time step.
    phase, decay = h * np.sqrt(k * weight), h * d * weight
    return 1.0 - 1.0 / max(1.0, phase / RESOLVED, decay / RESOLVED)


@stage
def _start_length(h, middle, ahead, old):
    """Return the length of a normal spring at the beginning of a time step, in m.

    The length is negative if the spring is compressed, and 0 if the pad is above the ground.
    """
    return min(middle - (h - ahead) * old, 0.0)


@stage(inline=False)
def limit_springs(h, count, velocity, properties, planes, contacts, statistics):
    """Limit the springs on new planes to the energy that the springs of each pad held before.

    Contacts are in the order of their pads. The springs of link sides that end in a pad share the
    energy that the pad's own springs leave.

    Args:
        h: Time step, in s.
        count: Number of contacts.
        velocity: Generalised velocity at the beginning of the time step.
        properties: Physical properties of the robot.
        planes: Contact planes, changed in place.
        contacts: The contacts, changed in place.
        statistics: Sums and deflections of each pad, shape (pads,). An infinite normal deflection
            means that the compression is unknown; the function replaces it by the present
            compression.
    """
    first, last = 0, 0
    for j in range(len(statistics)):
        square, side_square = 0.0, 0.0
        while last < count and planes[contacts.plane[last]].pad == j:
            start, stored = _start(h, last, velocity, properties, contacts)
            contacts.middle[2 * last] = start
            if planes[contacts.plane[last]].far_pad < 0:
                square += (stored * start) ** 2
            else:
                side_square += (stored * start) ** 2
            last += 1
        before = statistics[j].deflection[NORMAL]
        if np.isinf(before):
            statistics[j].deflection[NORMAL] = np.sqrt(square + side_square)
        else:
            left = max(0.0, before * before - square)
            excess = 1.0 - before / np.sqrt(square) if square > before * before else 0.0
            side_excess = 1.0 - np.sqrt(left / side_square) if side_square > left else 0.0
            for c in range(first, last):
                plane = planes[contacts.plane[c]]
                _move_plane(c, excess if plane.far_pad < 0 else side_excess, plane, contacts)
        first = last


@stage(inline=False)
def begin_sides(h, count, velocity, properties, planes, contacts):
    """Start the springs of link sides at their present length if the vertex under the side is new.

    Args:
        h: Time step, in s.
        count: Number of contacts.
        velocity: Generalised velocity at the beginning of the time step.
        properties: Physical properties of the robot.
        planes: Contact planes, changed in place.
        contacts: The contacts, changed in place.
    """
    for c in range(count):
        plane = planes[contacts.plane[c]]
        if plane.far_pad >= 0 and plane.compression == 0.0:
            contacts.middle[2 * c], _ = _start(h, c, velocity, properties, contacts)
            _move_plane(c, 1.0, plane, contacts)


@stage
def _start(h, c, velocity, properties, contacts):
    """Compute the normal spring of contact ``c`` at the beginning of a time step.

    Returns:
        The length of the spring, in m, and the fraction 1 - c of this length that counts as stored.
    """
    weight = contacts.problem.W[2 * c, 2 * c]
    implicitness = _implicitness(
        h, properties.stiffness[NORMAL], properties.pad_damping[NORMAL], weight
    )
    old = rate(contacts.J, 2 * c, velocity)
    return _start_length(
        h, contacts.gap[c], 0.5 * h * (1.0 + implicitness), old
    ), 1.0 - implicitness


@stage
def _move_plane(c, fraction, plane, contacts):
    """Move a contact's plane into the ground by a ``fraction`` of the spring's length.

    The length at the beginning of the step must be in ``contacts.middle``.
    """
    if fraction > 0.0:
        contacts.gap[c] -= fraction * contacts.middle[2 * c]
        plane.offset += fraction * contacts.middle[2 * c]


@stage(inline=False)
def add_compliance(h, count, velocity, properties, planes, contacts):
    """Add springs and dampers to the diagonal of W and to ``offset`` of the contacts.

    On input, ``offset`` holds the curvature of the pads' paths, see
    :class:`jansen_env.engine.records.Contacts`. The fraction c of the curvature remains in
    ``offset``.

    Args:
        h: Time step, in s.
        count: Number of contacts.
        velocity: Generalised velocity at the beginning of the time step.
        properties: Physical properties of the robot.
        planes: Contact planes.
        contacts: The contacts, changed in place.
    """
    W, offset = contacts.problem.W, contacts.offset
    for c in range(count):
        for side in (NORMAL, TANGENTIAL):
            i = 2 * c + side
            k, d = properties.stiffness[side], properties.pad_damping[side]
            old = rate(contacts.J, i, velocity)
            implicitness = _implicitness(h, k, d, W[i, i])
            ahead = 0.5 * h * (1.0 + implicitness)
            give = h * h * k * (0.25 + 0.75 * implicitness) + d * ahead
            touchdown = False
            middle = contacts.gap[c]
            if side == NORMAL:
                touchdown = middle - 0.5 * h * old > 0.0
            else:
                middle = planes[contacts.plane[c]].deflection + (h - ahead) * old
            contacts.curve[i] = implicitness * offset[i]
            if touchdown:
                offset[i] = middle / ahead
            else:
                before = (1.0 - implicitness) * (0.5 * h * d - 0.25 * h * h * k)
                offset[i] = (h * k * middle + before * old) / give
            offset[i] += contacts.curve[i]
            contacts.middle[i], contacts.ahead[i], contacts.give[i] = middle, ahead, give
            W[i, i] += max(1.0 / give, COMPLIANCE * W[i, i])


@stage
def attach_bristles(status, planes, statistics):
    """Attach the bristle of each pad to the nearest plane of the pad.

    Args:
        status: The robot's status.
        planes: Contact planes, changed in place; those of a pad are sorted by distance.
        statistics: Sums and deflections of each pad, shape (pads,).
    """
    pad = -1
    for k in range(status.first_plane, status.end_plane):
        nearest, pad = planes[k].pad != pad, planes[k].pad
        planes[k].deflection = statistics[pad].deflection[TANGENTIAL] if nearest else 0.0


@stage
def keep_deflection(status, planes, statistics):
    """Save the compression and the bristle deflection of each pad while its planes are found again.

    Args:
        status: The robot's status.
        planes: Contact planes.
        statistics: Sums and deflections of each pad, changed in place, shape (pads,).
    """
    for pad in statistics:
        pad.deflection[NORMAL] = pad.deflection[TANGENTIAL] = 0.0
    # In reverse order, the nearest plane of each pad comes last.
    for k in range(status.end_plane - 1, status.first_plane - 1, -1):
        deflection = statistics[planes[k].pad].deflection
        deflection[NORMAL] = mathematics.hypot(deflection[NORMAL], planes[k].compression)
        deflection[TANGENTIAL] = planes[k].deflection


@stage
def accumulate_compliant(
    h, renewed, count, velocity, after, properties, contacts, planes, robot, statistics
):
    """Add the slip, impulses and losses of compliant pads in a time step, and deflect the bristles.

    All losses that are not slip losses count as impact losses: those of dampers, of springs that
    are released, and of springs that hold less energy on renewed planes than on the old planes or
    whose plane has disappeared.

    The length of a spring is taken where the force law evaluates it: at the ends of the time step
    or up to half a time step later. If c = 0, the springs and dampers together lose h d times the
    square of the mean velocity in a time step, so no loss is negative. If c > 0, a fraction
    (1 - c)^2 of a normal spring's energy counts as stored and the rest as lost. The compression of
    such a spring is smaller than the uncertainty in the position of the ground.

    Args:
        h: Time step, in s.
        renewed: Whether the planes have been found again since the last time step.
        count: Number of contacts.
        velocity: Generalised velocity at the beginning of the time step.
        after: Generalised velocity at the end of the time step.
        properties: Physical properties of the robot.
        contacts: The contacts and their impulses.
        planes: Contact planes, changed in place.
        robot: The robot's record, whose sums are updated.
        statistics: Sums and deflections of each pad, changed in place, shape (pads,).
    """
    J, P, mode = contacts.J, contacts.problem.P, contacts.problem.mode
    middle, ahead, curve = contacts.middle, contacts.ahead, contacts.curve
    total, status = robot.accumulators, robot.status
    k, kt = properties.stiffness[NORMAL], properties.stiffness[TANGENTIAL]
    if status.step == 0:
        for pad in statistics:
            total.elastic_energy += 0.5 * k * pad.deflection[NORMAL] ** 2
            total.elastic_energy += 0.5 * kt * pad.deflection[TANGENTIAL] ** 2
        total.initial_energy += total.elastic_energy
    # Energies in J: in the springs before and after the step, and taken from the robot by contacts.
    before, stored, lost = 0.0, 0.0, 0.0
    slip_loss = 0.0
    if not renewed:
        lost += _released(0.5 * k, count, contacts, planes, status)
    for j in range(status.first_plane, status.end_plane):
        before += 0.5 * kt * planes[j].deflection ** 2
        planes[j].deflection = planes[j].compression = 0.0
    for c in range(count):
        i, t, plane = 2 * c, 2 * c + 1, planes[contacts.plane[c]]
        plane.mode = mode[c]
        old, new = rate(J, i, velocity), rate(J, i, after)
        old_t, new_t = rate(J, t, velocity), rate(J, t, after)
        resolved = 2.0 - 2.0 * ahead[i] / h  # 1 - c
        start = resolved * _start_length(h, middle[i], ahead[i], old)
        end = resolved * min(middle[i] + ahead[i] * new + h * curve[i], 0.0)
        plane.compression = -end
        before += 0.5 * k * start * start
        stored += 0.5 * k * end * end
        if mode[c] == OPEN:
            continue
        slid = 0.0
        if mode[c] != STICK:
            slid = ahead[t] * (new_t + contacts.offset[t] + P[t] / contacts.give[t])
        plane.deflection = middle[t] + ahead[t] * new_t + h * curve[t] - slid
        stored += 0.5 * kt * plane.deflection**2
        lost -= 0.5 * (P[i] * (old + new) + P[t] * (old_t + new_t))
        slip_loss -= P[t] * slid / h
        if plane.far_pad >= 0:  # The contact is on the side of a link, not on a pad.
            continue
        pad = statistics[plane.pad]
        pad.slip += abs(slid)
        pad.impulse[0] += P[t]
        pad.impulse[1] += P[i]
    if renewed:
        total.impact_loss += total.elastic_energy - before
    total.slip_loss += slip_loss
    total.impact_loss += lost + before - stored - slip_loss
    total.elastic_energy = stored


@stage
def _released(half_stiffness, count, contacts, planes, status):
    """Return the energy of the springs on planes that are no longer contacts, in J."""
    square = 0.0
    for j in range(status.first_plane, status.end_plane):
        square += planes[j].compression * planes[j].compression
    for c in range(count):
        compression = planes[contacts.plane[c]].compression
        square -= compression * compression
    return half_stiffness * max(0.0, square)
