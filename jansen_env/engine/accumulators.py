"""Sums over a control step: work, losses, slip and impulses."""

from __future__ import annotations

from jansen_env.engine.contact_solver import OPEN, STICK
from jansen_env.engine.contacts import rate
from jansen_env.engine.kernel import stage
from jansen_env.engine.restitution import contact_gain, drawn_power
from jansen_env.engine.tables import mechanical_energy


@stage
def begin(robot, state, statistics, body, sums):
    """Begin new sums, in a crank-axis state."""
    total = robot.accumulators
    clear(total)
    robot.status.step, robot.status.lost = 0, False
    for j in range(len(statistics)):
        statistics[j].slip = 0.0
        statistics[j].impulse[0] = statistics[j].impulse[1] = 0.0
    total.initial_energy = mechanical_energy(body, robot.params, state, sums)


@stage
def clear(total):
    """Set all sums to 0."""
    total.motor_work = total.joint_loss = total.slip_loss = total.impact_loss = 0.0
    total.worst_residual = total.contact_gain = total.initial_energy = 0.0
    total.impulse_share = 0.0
    total.non_toe_impulse = total.energy_change = total.elastic_energy = 0.0
    total.torque_impulse = total.electrical_work = total.push_work = 0.0
    total.correction_work, total.links_in_ground = 0.0, 0


@stage
def end(robot, state, statistics, elapsed, slip, force, body, sums):
    """Complete the sums, in a crank-axis state; slip: (toes,) m and force: (toes, 2) N, out."""
    total, toes = robot.accumulators, len(slip)
    for j in range(toes):
        slip[j] = statistics[j].slip
        force[j, 0] = statistics[j].impulse[0] / elapsed
        force[j, 1] = statistics[j].impulse[1] / elapsed
    total.non_toe_impulse = 0.0
    for j in range(toes, len(statistics)):
        total.non_toe_impulse += statistics[j].impulse[1]
    # Where contacts act on each other, for instance in a groove, one may give back a part of what
    # friction takes at another. Their sum is exact, so that part is no slip loss.
    total.slip_loss = max(0.0, total.slip_loss + min(0.0, total.impact_loss))
    # What contacts and dry friction add beyond that is the time step's error, in the residual.
    total.impact_loss = max(0.0, total.impact_loss)
    total.joint_loss = max(0.0, total.joint_loss)
    energy = mechanical_energy(body, robot.params, state, sums) + total.elastic_energy
    total.energy_change = energy - total.initial_energy


@stage
def accumulate_step(
    h, torque, asked, dry, push, velocity, outcome, inertia, count, params, contacts, total
):
    """Add a time step's work, joint loss and worst figures; arguments: see ``_time_step``."""
    end = outcome.end
    mean = 0.5 * (velocity.crank + end.crank)
    total.motor_work += h * torque * mean
    total.joint_loss += h * inertia.damping * mean * mean
    total.joint_loss -= dry * mean
    if push.x != 0.0 or push.y != 0.0:
        shifted = push.x * (velocity.x + end.x) + push.y * (velocity.y + end.y)
        turned = push.pitch * (velocity.pitch + end.pitch)
        turned += push.crank * (velocity.crank + end.crank)
        total.push_work += 0.5 * h * (params.mass * shifted + turned)
    total.torque_impulse += h * (torque - asked)
    total.electrical_work += h * drawn_power(torque, mean, params)
    total.worst_residual = max(total.worst_residual, outcome.residual)
    total.impulse_share = max(total.impulse_share, outcome.impulse_share)
    if outcome.may_gain:
        gain = min(
            contact_gain(count, velocity, end, contacts),
            contact_gain(count, outcome.free, end, contacts),
        )
        total.contact_gain = max(total.contact_gain, gain)


@stage
def accumulate_contacts(h, count, velocity, after, contacts, planes, total, statistics):
    """Add a time step's slip, impulses and contact losses; keep the modes with the planes.

    A contact's work is impulse times mean velocity, which is exact for the step. Work of friction
    while sliding is slip loss, all else impact loss: of touchdowns, tangential stops, and steps in
    which sliding turns back, so that the mean velocity is not the one that friction opposes. A toe
    that touches down in the step slides from its middle on, with its new velocity alone.
    """
    J, P, mode = contacts.J, contacts.problem.P, contacts.problem.mode
    for c in range(count):
        i, plane = 2 * c, planes[contacts.plane[c]]
        plane.mode = mode[c]
        if mode[c] == OPEN:
            continue
        old_n, new_n = rate(J, i, velocity), rate(J, i, after)
        old_t, new_t = rate(J, i + 1, velocity), rate(J, i + 1, after)
        touchdown = contacts.gap[c] - 0.5 * h * old_n > 0.0
        friction_loss = -0.5 * P[i + 1] * (old_t + new_t)
        if touchdown or mode[c] == STICK or friction_loss < 0.0:
            total.impact_loss += friction_loss
        else:
            total.slip_loss += friction_loss
        total.impact_loss -= 0.5 * P[i] * (old_n + new_n)
        if plane.far_pad >= 0:  # a link's side, not a pad
            continue
        pad = statistics[plane.pad]
        if mode[c] != STICK:
            slid = new_t if touchdown else old_t + new_t
            pad.slip += 0.5 * h * abs(slid)
        pad.impulse[0] += P[i + 1]
        pad.impulse[1] += P[i]
