"""Velocities at the end of a time step: as much restitution as creates no energy.

Newton's law with friction may create energy (Kane and Levinson, J. Appl. Mech. 52, 1985): then the
toes bounce as much as they can without that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jansen_env.engine.contact_solver import STICK, WEDGE_COMPLIANCE, regularise, solve
from jansen_env.engine.contacts import add_dry_friction, can_wedge, impulse_share, rate
from jansen_env.engine.kernel import stage
from jansen_env.engine.records import Velocity

PASSES = 2  # evaluations of the speed-dependent terms in a step
BOUNCE_TRIES = 11  # of smaller coefficients of restitution, where it would create energy
ROUNDING = 1e-9  # share of the energy that an impact brings by which it may seem to gain

# Requests to a step's contacts, in turn, until they create no energy: the terrain's
# restitution; none; as much again, if without it energy comes from other forces; the largest that
# creates none, judged strictly or with these forces; neither bounce nor the path's curvature. Last,
# and at once where impulses are larger than the motion explains: contacts that yield, as wedged.
AS_ASKED, WITHOUT_BOUNCE, LENIENT, SEARCH, LENIENT_SEARCH, WITHOUT_CURVATURE, YIELDING = range(7)


class Trial(NamedTuple):
    """Velocities asked of the contacts, and the state of their search."""

    stage: int
    bounce: float  # coefficient of restitution
    curved: bool  # whether the curvature of the pads' paths counts
    least: float  # the largest bounce known to create no energy, and the smallest known to do
    most: float
    tries: int
    over: bool  # whether the last answer stands


class Outcome(NamedTuple):
    """The velocities that a step leads to."""

    end: Velocity
    free: Velocity  # without contact impulses
    torque: float  # N m, of the motor
    dry: float  # N m s, impulse of the crank's Coulomb friction
    residual: float  # N s, of the contact law
    may_gain: bool  # whether it was not made sure that the contacts create no energy
    impulse_share: float  # of the contacts' largest possible impulses


@stage
def solve_velocities(
    h, torque, friction, weight, push, velocity, inertia, params, count, impact, sided, wedged,
    contacts,
):  # fmt: skip
    """The velocities at the end of a step; ``contacts`` gets its impulses and modes.

    The crank's Coulomb friction, N m, is a known force while the crank goes on turning; where it
    would stop or turn back, another row of the contact problem, see ``add_dry_friction``.
    """
    sliding = friction * np.sign(velocity.crank)
    dry = friction > 0.0 and not params.prescribed_speed
    rigid = not params.compliant
    asked = 0.0 if wedged else params.restitution
    checked = rigid and count > 0 and (asked > 0.0 or sided or can_wedge(params))
    curved = not (rigid and (impact or wedged))
    trial = Trial(AS_ASKED, asked, curved, 0.0, asked, 0, False)
    while True:
        held = dry and sliding == 0.0
        end, free, residual, used = _solve_step(
            h, torque, sliding, held, friction, weight, push, velocity, inertia, params, count,
            trial, contacts,
        )  # fmt: skip
        if dry and not held and end.crank * velocity.crank <= 0.0:
            sliding = 0.0
            continue
        share = impulse_share(count, free, inertia, params, contacts) if rigid else 0.0
        if trial.stage == YIELDING:
            break
        if share > 1.0:
            regularise(count, contacts.problem.W, WEDGE_COMPLIANCE)
            contacts.problem.indices[5 * count] = 0  # W is new
            trial = Trial(YIELDING, 0.0, False, 0.0, 0.0, 0, False)
            continue
        if not checked or trial.stage == WITHOUT_CURVATURE:
            break
        creates = contact_gain(count, velocity, end, contacts) > 0.0
        # More than the other forces alone would leave, too? If not, it is their doing.
        excess = creates and contact_gain(count, free, end, contacts) > 0.0
        trial = _next_trial(trial, asked, creates, excess)
        if trial.over:
            break
    may_gain = rigid and count > 0 and (trial.stage >= WITHOUT_CURVATURE or not checked)
    impulse = contacts.problem.P[2 * count + 1] if held else -h * sliding
    return Outcome(end, free, used, impulse, residual, may_gain, share)


@stage
def _next_trial(trial, asked, creates, excess):
    """Choose velocities after an answer that ``creates`` energy, in ``excess`` of others."""
    stage, bounce, curved, least, most, tries, _ = trial
    lenient = stage in (LENIENT, LENIENT_SEARCH)
    over = False
    if creates and excess and bounce == 0.0:
        # Not the bounce's doing: what else asks for more is curvature.
        return Trial(WITHOUT_CURVATURE, bounce, False, least, most, tries, not curved)
    if creates and lenient:
        creates = excess
    if stage == AS_ASKED:
        over = not creates or asked == 0.0
        if not over:
            stage, bounce = WITHOUT_BOUNCE, 0.0
    elif stage == WITHOUT_BOUNCE and creates:
        stage, bounce = LENIENT, asked
    elif stage == LENIENT and not creates:
        over = True
    elif tries > BOUNCE_TRIES:  # that was the largest found
        over = not creates
        if not over:
            stage, bounce, curved = WITHOUT_CURVATURE, 0.0, False
    else:
        if creates:
            most = bounce
        else:
            least = bounce
        stage = LENIENT_SEARCH if lenient else SEARCH
        bounce = least if tries == BOUNCE_TRIES else 0.5 * (least + most)
        tries += 1
    return Trial(stage, bounce, curved, least, most, tries, over)


@stage
def _solve_step(
    h, torque, sliding, held, friction, weight, push, velocity, inertia, params, count, trial,
    contacts,
):  # fmt: skip
    """Velocities at the end of the step and without contacts, residual of the contact law, torque.

    The speed-dependent terms use the mean of the old and the new velocity.
    """
    w, n = velocity.pitch, velocity.crank
    used = torque
    constraints = count
    if held:
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
        if params.limited:
            used = motor_torque(
                h, torque, n, from_contacts, pitch_force, crank_force, inertia, params
            )
        crank_force += used - inertia.damping * n
        nx, ny = velocity.x + h * ax, velocity.y + h * ay
        nw = w + h * (inertia.m11 * pitch_force + inertia.m12 * crank_force)
        nn = n + h * (inertia.m12 * pitch_force + inertia.m22 * crank_force)
        free = Velocity(nx, ny, nw, nn)
        if constraints == 0:
            continue
        _fill_velocities(count, velocity, free, trial, contacts)
        if held:
            problem.v_free[2 * count + 1] = free.crank
        residual = solve(constraints, problem)
        for i in range(2 * constraints):
            nx += MJ[i, 0] * problem.P[i]
            ny += MJ[i, 1] * problem.P[i]
            nw += MJ[i, 2] * problem.P[i]
            nn += MJ[i, 3] * problem.P[i]
        if held and problem.mode[count] == STICK:
            nn = 0.0  # to the last bit
        from_contacts = nn - free.crank
    return Velocity(nx, ny, nw, nn), free, residual, used


@stage
def limited_torque(asked, lost, share, params):
    """Return the torque that a motor gives of one asked for, N m.

    Args:
        lost: what its speed takes of the stall torque, N m. share: of the torque-speed line that
            counts, where its own effect on the speed is solved for; else 1.
    """
    most = params.most_torque
    high = max(min(share * (params.stall_torque - lost), most), -most)
    low = min(max(-share * (params.stall_torque + lost), -most), most)
    return min(high, max(low, asked))


@stage
def drawn_power(torque, speed, params):
    """Return the power that a motor draws, W; nothing is fed back."""
    inner = torque * (params.driving if torque * speed >= 0.0 else params.driven)
    return max(inner * (speed + params.winding * inner), 0.0)


@stage
def motor_torque(h, asked, n, from_contacts, pitch_force, crank_force, inertia, params):
    """Return the motor's torque at the step's mean crank speed: implicit.

    Of contacts it knows how much crank speed they gave in the last pass, ``from_contacts``: they
    only make the crank feel heavier, so this stays stable however steep the motor's line.
    """
    crank_force -= inertia.damping * n
    rest = n + from_contacts + h * (inertia.m12 * pitch_force + inertia.m22 * crank_force)
    lost = 0.5 * params.torque_slope * (n + rest)
    share = 1.0 / (1.0 + 0.5 * h * params.torque_slope * inertia.m22)
    return limited_torque(asked, lost, share, params)


@stage
def _fill_velocities(count, velocity, free, trial, contacts):
    """The contacts' velocities without impulses, bounce and curvature (or springs) included."""
    J, v_free = contacts.J, contacts.problem.v_free
    for i in range(2 * count):
        v_free[i] = rate(J, i, free)
        if trial.curved:
            v_free[i] += contacts.offset[i]
        if i % 2 == 0 and trial.bounce > 0.0:
            v_free[i] += trial.bounce * min(rate(J, i, velocity), 0.0)


@stage
def contact_gain(count, before, after, contacts):
    """Energy that the contacts' impulses add between two velocities, J; 0 within rounding.

    It is impulse times mean velocity.
    """
    J, P = contacts.J, contacts.problem.P
    gained, brought = 0.0, 0.0
    for i in range(2 * count):
        old, new = rate(J, i, before), rate(J, i, after)
        gained += 0.5 * P[i] * (old + new)
        brought += abs(P[i] * old)
    return gained if gained > ROUNDING * brought else 0.0
