"""Velocities at the end of a time step, with as much restitution as creates no energy.

Newton's law of restitution, combined with friction, may create energy (Kane and Levinson, J. Appl.
Mech. 52, 1985). In this case the coefficient of restitution is reduced: the toes bounce as much as
they can without creating energy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jansen_env.engine.contact_solver import STICK, WEDGE_COMPLIANCE, regularise, solve
from jansen_env.engine.contacts import add_dry_friction, can_wedge, impulse_ratio, rate
from jansen_env.engine.kernel import stage
from jansen_env.engine.motor_torque import motor_torque
from jansen_env.engine.records import Velocity

PASSES = 2  # evaluations of the speed-dependent terms in a step
BOUNCE_TRIES = 11  # smaller coefficients of restitution to try if the full one creates energy
ROUNDING = 1e-9  # energy gain that counts as rounding, relative to impulse times old velocity

# Phases of the search for velocities at which the contacts create no energy. The search tries them
# in this order, skips phases that do not apply, and ends with the first one that succeeds:
#
# - FULL_BOUNCE: the restitution of the terrain.
# - WITHOUT_BOUNCE: no restitution.
# - LENIENT: the restitution of the terrain again, if energy comes from other forces even without
#   restitution. Energy that these forces explain is then allowed.
# - SEARCH, LENIENT_SEARCH: the largest restitution that creates no energy, either strictly or apart
#   from the energy that other forces explain.
# - WITHOUT_CURVATURE: neither restitution nor the curvature of the pads' paths.
# - YIELDING: contacts that yield like wedged contacts. This phase is also entered at once if the
#   impulses are larger than the motion explains.
FULL_BOUNCE, WITHOUT_BOUNCE, LENIENT, SEARCH, LENIENT_SEARCH, WITHOUT_CURVATURE, YIELDING = range(7)


class Trial(NamedTuple):
    """Requirements on the velocities of the contacts, and the state of the search for them.

    Attributes:
        phase: Phase of the search, ``FULL_BOUNCE`` to ``YIELDING``.
        bounce: Coefficient of restitution.
        curved: Whether the curvature of the pads' paths is taken into account.
        least: Largest coefficient of restitution known to create no energy.
        most: Smallest coefficient of restitution known to create energy.
        tries: Number of coefficients tried by bisection.
        over: Whether the search is over, so that the last velocities are the result.
    """

    phase: int
    bounce: float
    curved: bool
    least: float
    most: float
    tries: int
    over: bool


class Outcome(NamedTuple):
    """Result of a time step.

    Attributes:
        end: Velocity at the end of the step.
        free: Velocity at the end of the step without contact impulses.
        torque: Torque of the motor, in N m.
        dry: Impulse of the crank's Coulomb friction, in N m s.
        residual: Residual of the contact law, in N s.
        may_gain: Whether the contacts may have created energy, because this was not ruled out.
        impulse_ratio: Impulses of the contacts, as a fraction of the largest possible ones.
    """

    end: Velocity
    free: Velocity
    torque: float
    dry: float
    residual: float
    may_gain: bool
    impulse_ratio: float


@stage
def solve_velocities(
    h,
    torque,
    friction,
    weight,
    push,
    velocity,
    inertia,
    properties,
    count,
    impact,
    sided,
    wedged,
    contacts,
):
    """Compute the velocities at the end of a time step, and the impulses and modes of the contacts.

    The crank's Coulomb friction is a known force while the crank keeps turning. If the crank would
    stop or reverse, the friction becomes an additional contact of the contact problem, see
    :func:`jansen_env.engine.contacts.add_dry_friction`.

    Args:
        h: Time step, in s.
        torque: Commanded torque of the motor, in N m.
        friction: Coulomb friction torque on the crank, in N m.
        weight: Gravity and springs as a generalised force, a
            :class:`jansen_env.engine.records.Push`.
        push: Load on the chassis, likewise.
        velocity: Velocity at the beginning of the step.
        inertia: Inertia at the middle of the step.
        properties: Physical properties of the robot.
        count: Number of contacts.
        impact: Whether a contact was open when the step began.
        sided: Whether a side of a link touches the ground.
        wedged: Whether contacts are wedged.
        contacts: The contacts, whose impulses and modes are set.

    Returns:
        The :class:`Outcome` of the step.
    """
    sliding = friction * np.sign(velocity.crank)
    dry = friction > 0.0 and not properties.prescribed_speed
    rigid = not properties.compliant
    restitution = 0.0 if wedged else properties.restitution
    checked = rigid and count > 0 and (restitution > 0.0 or sided or can_wedge(properties))
    curved = not (rigid and (impact or wedged))
    trial = Trial(FULL_BOUNCE, restitution, curved, 0.0, restitution, 0, False)
    while True:
        stuck = dry and sliding == 0.0
        end, free, residual, used = _solve_step(
            h,
            torque,
            sliding,
            stuck,
            friction,
            weight,
            push,
            velocity,
            inertia,
            properties,
            count,
            trial,
            contacts,
        )
        if dry and not stuck and end.crank * velocity.crank <= 0.0:
            sliding = 0.0
            continue
        ratio = impulse_ratio(count, free, inertia, properties, contacts) if rigid else 0.0
        if trial.phase == YIELDING:
            break
        if ratio > 1.0:
            regularise(count, contacts.problem.W, WEDGE_COMPLIANCE)
            contacts.problem.factored[0] = 0  # W has changed, so its factors are invalid
            trial = Trial(YIELDING, 0.0, False, 0.0, 0.0, 0, False)
            continue
        if not checked or trial.phase == WITHOUT_CURVATURE:
            break
        creates = contact_gain(count, velocity, end, contacts) > 0.0
        # Compare with the energy that the other forces alone would leave. If there is no excess
        # over it, these forces account for the gain.
        excess = creates and contact_gain(count, free, end, contacts) > 0.0
        trial = _next_trial(trial, restitution, creates, excess)
        if trial.over:
            break
    may_gain = rigid and count > 0 and (trial.phase >= WITHOUT_CURVATURE or not checked)
    impulse = contacts.problem.P[2 * count + 1] if stuck else -h * sliding
    return Outcome(end, free, used, impulse, residual, may_gain, ratio)


@stage
def _next_trial(trial, restitution, creates, excess):
    """Choose the next phase of the search from the energy that the last velocities created.

    Args:
        trial: The last phase.
        restitution: Coefficient of restitution of the terrain, or 0 if contacts are wedged.
        creates: Whether the contacts created energy.
        excess: Whether they created more energy than the other forces account for.
    """
    phase, bounce, curved, least, most, tries, _ = trial
    lenient = phase in (LENIENT, LENIENT_SEARCH)
    over = False
    if creates and excess and bounce == 0.0:
        # Restitution is not the cause, so it is the curvature of the pads' paths.
        return Trial(WITHOUT_CURVATURE, bounce, False, least, most, tries, not curved)
    if creates and lenient:
        creates = excess
    if phase == FULL_BOUNCE:
        over = not creates or restitution == 0.0
        if not over:
            phase, bounce = WITHOUT_BOUNCE, 0.0
    elif phase == WITHOUT_BOUNCE and creates:
        phase, bounce = LENIENT, restitution
    elif phase == LENIENT and not creates:
        over = True
    elif tries > BOUNCE_TRIES:  # the last coefficient was the largest one found
        over = not creates
        if not over:
            phase, bounce, curved = WITHOUT_CURVATURE, 0.0, False
    else:
        if creates:
            most = bounce
        else:
            least = bounce
        phase = LENIENT_SEARCH if lenient else SEARCH
        bounce = least if tries == BOUNCE_TRIES else 0.5 * (least + most)
        tries += 1
    return Trial(phase, bounce, curved, least, most, tries, over)


@stage
def _solve_step(
    h,
    torque,
    sliding,
    stuck,
    friction,
    weight,
    push,
    velocity,
    inertia,
    properties,
    count,
    trial,
    contacts,
):
    """Solve a time step for the requirements of a trial.

    The speed-dependent terms use the mean of the old and the new velocity.

    Most arguments are those of :func:`solve_velocities`. In addition, ``sliding`` is the Coulomb
    friction torque on the crank with the sign of the crank speed, in N m. ``stuck`` tells whether
    this friction is an additional contact instead. ``trial`` holds the requirements on the
    velocities of the contacts.

    Returns:
        The velocity at the end of the step, the velocity without contacts, the residual of the
        contact law in N s, and the torque of the motor in N m.
    """
    w, n = velocity.pitch, velocity.crank
    used = torque
    constraints = count
    if stuck:
        constraints += 1
        add_dry_friction(h, count, friction, inertia, contacts)
    problem, MJ = contacts.problem, contacts.MJ
    nw, nn, residual, from_contacts = w, n, 0.0, 0.0
    ax, ay = weight.x + push.x, weight.y + push.y
    nx, ny = velocity.x + h * ax, velocity.y + h * ay
    free = Velocity(nx, ny, nw, nn)
    for _ in range(PASSES):
        mw, mn = 0.5 * (w + nw), 0.5 * (n + nn)
        pitch_force = -(mw * mn * inertia.pitch_slope + mn * mn * inertia.coupling_slope)
        crank_force = 0.5 * mw * mw * inertia.pitch_slope - 0.5 * mn * mn * inertia.crank_slope
        pitch_force += push.pitch
        crank_force += weight.crank + push.crank - sliding
        if properties.limited:
            used = motor_torque(
                h, torque, n, from_contacts, pitch_force, crank_force, inertia, properties
            )
        crank_force += used - inertia.damping * n
        nx, ny = velocity.x + h * ax, velocity.y + h * ay
        nw = w + h * (inertia.m11 * pitch_force + inertia.m12 * crank_force)
        nn = n + h * (inertia.m12 * pitch_force + inertia.m22 * crank_force)
        free = Velocity(nx, ny, nw, nn)
        if constraints == 0:
            continue
        _fill_velocities(count, velocity, free, trial, contacts)
        if stuck:
            problem.v_free[2 * count + 1] = free.crank
        residual = solve(constraints, problem)
        for i in range(2 * constraints):
            nx += MJ[i, 0] * problem.P[i]
            ny += MJ[i, 1] * problem.P[i]
            nw += MJ[i, 2] * problem.P[i]
            nn += MJ[i, 3] * problem.P[i]
        if stuck and problem.mode[count] == STICK:
            nn = 0.0  # exactly, without rounding errors
        from_contacts = nn - free.crank
    return Velocity(nx, ny, nw, nn), free, residual, used


@stage
def _fill_velocities(count, velocity, free, trial, contacts):
    """Set the velocities of the contacts without impulses.

    They include restitution, and the curvature of the pads' paths or the springs of compliant pads.
    """
    J, v_free = contacts.J, contacts.problem.v_free
    for i in range(2 * count):
        v_free[i] = rate(J, i, free)
        if trial.curved:
            v_free[i] += contacts.offset[i]
        if i % 2 == 0 and trial.bounce > 0.0:
            v_free[i] += trial.bounce * min(rate(J, i, velocity), 0.0)


@stage
def contact_gain(count, before, after, contacts):
    """Return the energy that the impulses of the contacts add between two velocities, in J.

    The energy is impulse times mean velocity. Values within rounding errors are returned as 0.

    Args:
        count: Number of contacts.
        before: Velocity before the impulses.
        after: Velocity after the impulses.
        contacts: The contacts.
    """
    J, P = contacts.J, contacts.problem.P
    gained, brought = 0.0, 0.0
    for i in range(2 * count):
        old, new = rate(J, i, before), rate(J, i, after)
        gained += 0.5 * P[i] * (old + new)
        brought += abs(P[i] * old)
    return gained if gained > ROUNDING * brought else 0.0
