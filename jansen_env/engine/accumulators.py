"""Sums over a control step: work, losses, slip and impulses.

In this module, ``total`` is the record of sums of one robot (``ACCUMULATORS`` of
:mod:`jansen_env.engine.records`), and ``statistics`` holds the sums of each of its pads
(``CONTACT_STATISTICS``), shape (pads,).
"""

from __future__ import annotations

from jansen_env.engine.contact_solver import OPEN, STICK
from jansen_env.engine.contacts import rate
from jansen_env.engine.kernel import stage
from jansen_env.engine.motor_torque import drawn_power
from jansen_env.engine.tables import mechanical_energy
from jansen_env.engine.velocities import contact_gain


@stage
def begin(robot, state, statistics, model, sums):
    """Reset the sums of a robot, and store its energy at the beginning of the control step.

    Args:
        robot: The robot's record.
        state: State of the robot relative to the crank axis, shape (8,).
        statistics: Sums of each pad, shape (pads,).
        model: Tables of the robot, a :class:`jansen_env.engine.records.Model`.
        sums: Work space, shape (3, 6).
    """
    total = robot.accumulators
    clear(total)
    robot.status.step, robot.status.lost = 0, False
    for j in range(len(statistics)):
        statistics[j].slip = 0.0
        statistics[j].impulse[0] = statistics[j].impulse[1] = 0.0
    total.initial_energy = mechanical_energy(
        model.body, model.springs, robot.properties, state, sums
    )


@stage
def clear(total):
    """Set all sums of a robot to 0."""
    total.motor_work = total.joint_loss = total.slip_loss = total.impact_loss = 0.0
    total.worst_residual = total.contact_gain = total.initial_energy = 0.0
    total.impulse_ratio = 0.0
    total.non_toe_impulse = total.energy_change = total.elastic_energy = 0.0
    total.torque_impulse = total.electrical_work = total.push_work = 0.0
    total.correction_work, total.links_in_ground = 0.0, 0


@stage
def end(robot, state, statistics, elapsed, slip, force, model, sums):
    """Complete the sums of a control step.

    Args:
        robot: The robot's record.
        state: State of the robot relative to the crank axis, shape (8,).
        statistics: Sums of each pad, shape (pads,).
        elapsed: Duration of the control step, in s.
        slip: Output, distance that each toe slid under load, in m, shape (toes,).
        force: Output, mean tangential and normal force on each toe, in N, shape (toes, 2).
        model: Tables of the robot, a :class:`jansen_env.engine.records.Model`.
        sums: Work space, shape (3, 6).
    """
    total, toes = robot.accumulators, len(slip)
    for j in range(toes):
        slip[j] = statistics[j].slip
        force[j, 0] = statistics[j].impulse[0] / elapsed
        force[j, 1] = statistics[j].impulse[1] / elapsed
    total.non_toe_impulse = 0.0
    for j in range(toes, len(statistics)):
        total.non_toe_impulse += statistics[j].impulse[1]
    # If contacts act on each other, for instance in a groove, one contact may return a part of the
    # energy that friction takes at another contact. The sum over all contacts is exact, so the
    # returned part is subtracted from the slip loss.
    total.slip_loss = max(0.0, total.slip_loss + min(0.0, total.impact_loss))
    # If contacts or dry friction still seem to add energy, this is the discretisation error of the
    # time step. It is part of the residual.
    total.impact_loss = max(0.0, total.impact_loss)
    total.joint_loss = max(0.0, total.joint_loss)
    energy = mechanical_energy(model.body, model.springs, robot.properties, state, sums)
    energy += total.elastic_energy
    total.energy_change = energy - total.initial_energy


@stage
def accumulate_step(
    h,
    torque,
    final_torque,
    dry,
    push,
    velocity,
    outcome,
    inertia,
    count,
    properties,
    contacts,
    total,
):
    """Add the work, the joint loss and the largest errors of a time step to the sums.

    Args:
        h: Time step, in s.
        torque: Torque of the motor in this time step, in N m.
        final_torque: Commanded torque that holds at the end of the control step, in N m.
        dry: Impulse of the Coulomb friction on the crank, in N m s.
        push: Load on the chassis, a :class:`jansen_env.engine.records.Push`.
        velocity: Generalised velocity at the beginning of the time step.
        outcome: Result of :func:`jansen_env.engine.velocities.solve_velocities`.
        inertia: Inertia at the middle of the time step.
        count: Number of contacts.
        properties: Physical properties of the robot.
        contacts: The contacts.
        total: Sums of the robot, changed in place.
    """
    end = outcome.end
    mean = 0.5 * (velocity.crank + end.crank)
    total.motor_work += h * torque * mean
    total.joint_loss += h * inertia.damping * mean * mean
    total.joint_loss -= dry * mean
    if push.x != 0.0 or push.y != 0.0:
        shifted = push.x * (velocity.x + end.x) + push.y * (velocity.y + end.y)
        turned = push.pitch * (velocity.pitch + end.pitch)
        turned += push.crank * (velocity.crank + end.crank)
        total.push_work += 0.5 * h * (properties.mass * shifted + turned)
    total.torque_impulse += h * (torque - final_torque)
    total.electrical_work += h * drawn_power(torque, mean, properties)
    total.worst_residual = max(total.worst_residual, outcome.residual)
    total.impulse_ratio = max(total.impulse_ratio, outcome.impulse_ratio)
    if outcome.may_gain:
        gain = min(
            contact_gain(count, velocity, end, contacts),
            contact_gain(count, outcome.free, end, contacts),
        )
        total.contact_gain = max(total.contact_gain, gain)


@stage
def accumulate_contacts(h, count, velocity, after, contacts, planes, total, statistics):
    """Add slip, impulses and contact losses of a time step, and store the contact modes.

    The work of a contact is its impulse times its mean velocity, which is exact for the time step.
    The work of friction at a sliding contact counts as slip loss. Everything else counts as impact
    loss: touchdowns, tangential stops, and time steps in which the sliding direction reverses, so
    that the mean velocity is not the velocity that friction opposes. A toe that touches down during
    the time step slides from the middle of the step on, at its new velocity.

    Args:
        h: Time step, in s.
        count: Number of contacts.
        velocity: Generalised velocity at the beginning of the time step.
        after: Generalised velocity at the end of the time step.
        contacts: The contacts and their impulses.
        planes: Contact planes, whose modes are updated.
        total: Sums of the robot, changed in place.
        statistics: Sums of each pad, changed in place, shape (pads,).
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
        if plane.far_pad >= 0:  # The contact is on the side of a link, not on a pad.
            continue
        pad = statistics[plane.pad]
        if mode[c] != STICK:
            slid = new_t if touchdown else old_t + new_t
            pad.slip += 0.5 * h * abs(slid)
        pad.impulse[0] += P[i + 1]
        pad.impulse[1] += P[i]
