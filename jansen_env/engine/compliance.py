"""Pads that give: a spring and a damper along the normal, a bristle with both along the ground.

Kelvin and Voigt's force, which never pulls, and friction behind a spring (as Dahl has it, but exact
at its threshold): for the normal, g the gap, and tangentially the bristle's bend s in place of g,

    P = -h k (g_0 + theta D) - d D,       D = h (u_0 + u_1) / 2

with D the way in the step, theta = 1/2 where the step resolves the vibration (the trapezoidal
rule: second order, and a spring gives back what it took to the last bit) and towards 1 where it
does not (stable however stiff). Solved for u_1 that is

    u_1 + 2 P / (h (theta h k + d)) + u_0 + 2 k g_0 / (theta h k + d) = 0

so that a compliant contact is a rigid one with more on W's diagonal and in the free velocity: the
complementarity problem, its solver and its guesses stay as they are. What it calls velocity is then
the one at which the pad slides, or takes off. In the step of a touchdown only the way below the
ground counts, with theta = 1: never more energy comes back than went in. Of normal springs that the
step does not resolve (2 - 2 theta)^2 of the energy is accounted for as stored, the rest as lost.
"""

from __future__ import annotations

import numpy as np

from jansen_env.engine.contact_solver import OPEN, STICK
from jansen_env.engine.contacts import rate
from jansen_env.engine.jit import stage

RESOLVED = 2.0  # rad, of a vibration in a time step, up to which theta is 1/2
NORMAL, TANGENTIAL = 0, 1


@stage(inline=False)
def add_compliance(h, count, velocity, params, planes, contacts):
    """Put springs and dampers into W's diagonal and into ``offset``; fills ``give``."""
    W, give, offset = contacts.problem.W, contacts.give, contacts.offset
    for c in range(count):
        for side in (NORMAL, TANGENTIAL):
            i = 2 * c + side
            k, d = params.stiffness[side], params.pad_damping[side]
            speed = rate(contacts.J, i, velocity)
            squared, theta = h * h * k * W[i, i], 0.5  # of the vibration's phase in a step
            if squared > RESOLVED * RESOLVED:
                theta = 1.0 - 1.0 / np.sqrt(squared)
            give[i] = theta * h * k + d
            stretch = planes[contacts.plane[c]].stretch
            if side == NORMAL:
                stretch = contacts.gap[c] - 0.5 * h * speed
            if side == NORMAL and stretch > 0.0:
                offset[i] = speed + 2.0 * stretch / h
            else:
                offset[i] = speed + 2.0 * k * stretch / give[i]
            W[i, i] += 2.0 / (h * give[i])


@stage
def attach_bristles(status, planes, statistics):
    """Put the bristles of pads on new planes: a pad's on its nearest one."""
    pad = -1
    for k in range(status.first_plane, status.end_plane):
        nearest, pad = planes[k].pad != pad, planes[k].pad
        planes[k].stretch = statistics[pad].stretch if nearest else 0.0


@stage
def keep_bristles(status, planes, statistics):
    """Keep pads' bristles while their planes are found again."""
    for pad in statistics:
        pad.stretch = 0.0
    for k in range(status.end_plane - 1, status.first_plane - 1, -1):  # a pad's nearest comes last
        statistics[planes[k].pad].stretch = planes[k].stretch


@stage(inline=False)
def accumulate_compliant(h, count, velocity, after, params, contacts, planes, robot, statistics):
    """Add a time step's slip, impulses and losses of compliant pads; bend the bristles.

    What friction takes while sliding is slip loss, all else (dampers, springs let go) impact loss.
    """
    J, P, mode = contacts.J, contacts.problem.P, contacts.problem.mode
    total, status = robot.accumulators, robot.status
    k, kt = params.stiffness[NORMAL], params.stiffness[TANGENTIAL]
    before, stored, lost = 0.0, 0.0, 0.0  # J: in the springs, and what contacts took of the robot
    slip_loss = 0.0
    for c in range(count):
        contacts.bent[c] = planes[contacts.plane[c]].stretch
    for j in range(status.first_plane, status.end_plane):
        before += 0.5 * kt * planes[j].stretch ** 2
        planes[j].stretch = 0.0
    for c in range(count):
        i, plane = 2 * c, planes[contacts.plane[c]]
        plane.mode = mode[c]
        old, old_t = rate(J, i, velocity), rate(J, i + 1, velocity)
        way = 0.5 * h * (old + rate(J, i, after))
        along = 0.5 * h * (old_t + rate(J, i + 1, after))
        gap = contacts.gap[c] - 0.5 * h * old
        start, end = min(gap, 0.0), min(gap + way, 0.0)
        theta = (contacts.give[i] - params.pad_damping[NORMAL]) / (h * k)
        share = 0.5 * k * (2.0 - 2.0 * theta) ** 2
        before += share * start * start
        stored += share * end * end
        if mode[c] == OPEN:
            continue
        bent = along
        if mode[c] != STICK:
            bent = -(P[i + 1] + h * kt * contacts.bent[c]) / contacts.give[i + 1]
        plane.stretch = contacts.bent[c] + bent
        stored += 0.5 * kt * plane.stretch**2
        lost -= (P[i] * way + P[i + 1] * along) / h
        slip_loss -= P[i + 1] * (along - bent) / h
        pad = statistics[plane.pad]
        pad.slip += abs(along - bent)
        pad.impulse[0] += P[i + 1]
        pad.impulse[1] += P[i]
    total.slip_loss += slip_loss
    total.impact_loss += lost + before - stored - slip_loss
    total.elastic_energy = stored
    if status.step == 0:
        total.initial_energy += before
