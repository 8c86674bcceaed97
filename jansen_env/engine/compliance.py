"""Pads that give: a spring and a damper along the normal, a bristle with both along the ground.

Kelvin and Voigt's force, which never pulls, and friction behind a spring (as Dahl has it, but exact
at its threshold). For the normal, with g the gap at the middle of the step and u_0, u_1 the
velocities before and after it (tangentially the bristle's bend in place of g),

    P = -h k (g + (1 - c) h (u_1 - u_0) / 4 + c h u_1) - h d ((1 - c) (u_0 + u_1) / 2 + c u_1)

- c = 0 where the step resolves spring and damper: the trapezoidal rule, of second order; a spring
  gives back what it took to the last bit (implicit Euler would damp it by about omega h / 2).
- c towards 1 where it does not: implicit Euler in u and in g, which is where the pads are half a
  step from u. That brakes a pad before it is in the ground, so that it neither bounces nor
  rings however stiff spring or damper are: the limit is a rigid pad.

With P = -B (u_1 + offset) a compliant contact is a rigid one with 1 / B more on W's diagonal and
``offset`` in the free velocity: the complementarity problem, its solver and its guesses stay as
they are. Its velocity is then the one at which the pad slides, or takes off. A touchdown
counts only the way below the ground: never more energy comes back than went in.

Near an edge of the ground, a pad that is deep in it may be far below a plane that is just found.
Compression is therefore part of the state: a pad's springs on new planes together hold no more than
its springs held on the old ones. Planes on which they would hold more are moved into the ground.
Springs of a link's side that ends in the pad count with the pad's, which come first. A vertex may
also come to lie under a side that is already below it: then the side's spring begins there.
"""

from __future__ import annotations

import numpy as np

from jansen_env.engine import mathematics
from jansen_env.engine.contact_solver import COMPLIANCE, OPEN, STICK
from jansen_env.engine.contacts import rate
from jansen_env.engine.kernel import stage

RESOLVED = 2.0  # of a free pad's phase or decay in a time step: up to there c is 0
NORMAL, TANGENTIAL = 0, 1


@stage
def _implicit_share(h, k, d, weight):
    """c, of a contact's row with ``weight`` on W's diagonal."""
    phase, decay = h * np.sqrt(k * weight), h * d * weight  # of free motion, in a step
    return 1.0 - 1.0 / max(1.0, phase / RESOLVED, decay / RESOLVED)


@stage
def _start_length(h, middle, ahead, old):
    """Length of a normal spring at the start of a step, m: negative, or 0 off the ground."""
    return min(middle - (h - ahead) * old, 0.0)


@stage(inline=False)
def limit_springs(h, count, velocity, params, planes, contacts, statistics):
    """Limit the springs on planes just found to the energy that the pad's springs held before.

    Contacts are in the order of their pads. Sides that end in a pad share what it leaves.
    """
    first, last = 0, 0
    for j in range(len(statistics)):
        square, side_square = 0.0, 0.0
        while last < count and planes[contacts.plane[last]].pad == j:
            start, stored = _start(h, last, velocity, params, contacts)
            contacts.middle[2 * last] = start
            if planes[contacts.plane[last]].far_pad < 0:
                square += (stored * start) ** 2
            else:
                side_square += (stored * start) ** 2
            last += 1
        held = statistics[j].deflection[NORMAL]
        if np.isinf(held):
            statistics[j].deflection[NORMAL] = np.sqrt(square + side_square)
        else:
            left = max(0.0, held * held - square)
            excess = 1.0 - held / np.sqrt(square) if square > held * held else 0.0
            side_excess = 1.0 - np.sqrt(left / side_square) if side_square > left else 0.0
            for c in range(first, last):
                plane = planes[contacts.plane[c]]
                _move_plane(c, excess if plane.far_pad < 0 else side_excess, plane, contacts)
        first = last


@stage(inline=False)
def begin_sides(h, count, velocity, params, planes, contacts):
    """Let springs of sides begin where they are, if a vertex is under them that was not before."""
    for c in range(count):
        plane = planes[contacts.plane[c]]
        if plane.far_pad >= 0 and plane.compression == 0.0:
            contacts.middle[2 * c], _ = _start(h, c, velocity, params, contacts)
            _move_plane(c, 1.0, plane, contacts)


@stage
def _start(h, c, velocity, params, contacts):
    """Length of a contact's normal spring at the start of a step, m, and the share that counts."""
    weight = contacts.problem.W[2 * c, 2 * c]
    share = _implicit_share(h, params.stiffness[NORMAL], params.pad_damping[NORMAL], weight)
    old = rate(contacts.J, 2 * c, velocity)
    return _start_length(h, contacts.gap[c], 0.5 * h * (1.0 + share), old), 1.0 - share


@stage
def _move_plane(c, share, plane, contacts):
    """Move a contact's plane into the ground by a share of its spring, whose start is known."""
    if share > 0.0:
        contacts.gap[c] -= share * contacts.middle[2 * c]
        plane.offset += share * contacts.middle[2 * c]


@stage(inline=False)
def add_compliance(h, count, velocity, params, planes, contacts):
    """Put springs and dampers into W's diagonal and into ``offset``, the path's curvature there."""
    W, offset = contacts.problem.W, contacts.offset
    for c in range(count):
        for side in (NORMAL, TANGENTIAL):
            i = 2 * c + side
            k, d = params.stiffness[side], params.pad_damping[side]
            old = rate(contacts.J, i, velocity)
            share = _implicit_share(h, k, d, W[i, i])
            ahead = 0.5 * h * (1.0 + share)
            give = h * h * k * (0.25 + 0.75 * share) + d * ahead
            touchdown = False
            middle = contacts.gap[c]
            if side == NORMAL:
                touchdown = middle - 0.5 * h * old > 0.0
            else:
                middle = planes[contacts.plane[c]].deflection + (h - ahead) * old
            contacts.curve[i] = share * offset[i]
            if touchdown:
                offset[i] = middle / ahead
            else:
                before = (1.0 - share) * (0.5 * h * d - 0.25 * h * h * k)
                offset[i] = (h * k * middle + before * old) / give
            offset[i] += contacts.curve[i]
            contacts.middle[i], contacts.ahead[i], contacts.give[i] = middle, ahead, give
            W[i, i] += max(1.0 / give, COMPLIANCE * W[i, i])


@stage
def attach_bristles(status, planes, statistics):
    """Put the bristles of pads on new planes: a pad's on its nearest one."""
    pad = -1
    for k in range(status.first_plane, status.end_plane):
        nearest, pad = planes[k].pad != pad, planes[k].pad
        planes[k].deflection = statistics[pad].deflection[TANGENTIAL] if nearest else 0.0


@stage
def keep_deflection(status, planes, statistics):
    """Save pads' compression and bend while their planes are found again."""
    for pad in statistics:
        pad.deflection[NORMAL] = pad.deflection[TANGENTIAL] = 0.0
    for k in range(status.end_plane - 1, status.first_plane - 1, -1):  # a pad's nearest comes last
        deflection = statistics[planes[k].pad].deflection
        deflection[NORMAL] = mathematics.hypot(deflection[NORMAL], planes[k].compression)
        deflection[TANGENTIAL] = planes[k].deflection


@stage
def accumulate_compliant(
    h, renewed, count, velocity, after, params, contacts, planes, robot, statistics
):
    """Add a time step's slip, impulses and losses of compliant pads; bend the bristles.

    All that is not slip loss is impact loss: of dampers, of springs let go, and what springs hold
    less on planes that were ``renewed`` than on the old ones, or lose with a plane that is gone.
    Springs are as long as they are where the law looks, at the step's ends or up to half a step
    ahead. Where c = 0, springs and dampers of a step lose h d times the mean velocity squared, so
    no loss is negative. Of normal springs with c > 0 the share (1 - c)^2 of the energy counts as
    stored, the rest as lost: what they hold is less than the place of the ground is known by.
    """
    J, P, mode = contacts.J, contacts.problem.P, contacts.problem.mode
    middle, ahead, curve = contacts.middle, contacts.ahead, contacts.curve
    total, status = robot.accumulators, robot.status
    k, kt = params.stiffness[NORMAL], params.stiffness[TANGENTIAL]
    if status.step == 0:
        for pad in statistics:
            total.elastic_energy += 0.5 * k * pad.deflection[NORMAL] ** 2
            total.elastic_energy += 0.5 * kt * pad.deflection[TANGENTIAL] ** 2
        total.initial_energy += total.elastic_energy
    before, stored, lost = 0.0, 0.0, 0.0  # J: in the springs, and what contacts took of the robot
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
        if plane.far_pad >= 0:  # a link's side, not a pad
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
    """Energy of the springs on planes that are no contacts any more, J."""
    square = 0.0
    for j in range(status.first_plane, status.end_plane):
        square += planes[j].compression * planes[j].compression
    for c in range(count):
        compression = planes[contacts.plane[c]].compression
        square -= compression * compression
    return half_stiffness * max(0.0, square)
