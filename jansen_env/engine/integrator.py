"""The compiled inner loop: tables, equations of motion, contacts, time step. Numba, no allocation.

State: (x, y, theta, psi, x_dot, y_dot, theta_dot, psi_dot), x, y the crank axis. Inside a step the
translation is the centre of mass's, Y = X + R s(psi) with s = c / m: then M is block diagonal,

    kinetic energy = m |Y_dot|^2 / 2 + (I_s w^2 + 2 b_s w n + k_s n^2) / 2
    I_s = I - m |s|^2,  b_s = b - m s x s',  k_s = k - m |s'|^2         (w = theta_dot, n = psi_dot)

gravity acts on Y alone, and momentum is conserved to the last bit in flight.

Time step (Moreau and Jean): everything is evaluated at the middle, q + h v / 2; the speed-dependent
terms use the mean of the old and the new velocity (two passes), the viscous joint torque too
(implicit midpoint); pads that touch at the middle get impulses P so that the velocity at the end of
the step obeys Signorini's and Coulomb's laws. Second order while the contacts stay as they are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine.collision import MODE, PAD, SPECULATIVE_MARGIN, STEPS_LEFT
from jansen_env.engine.contact_solver import (
    COMPLIANCE,
    OPEN,
    STICK,
    WEDGE_COMPLIANCE,
    soften,
    solve,
)
from jansen_env.engine.jit import compiled
from jansen_env.engine.tables import (
    C_X,
    C_Y,
    COUPLING,
    CRANK,
    CURVE,
    DAMPING,
    DRIVEN,
    FRICTION,
    GRAVITY_X,
    GRAVITY_Y,
    INERTIA,
    LOAD_INERTIA,
    LOAD_MASS,
    LOAD_X,
    LOAD_Y,
    LONGEST,
    MASS,
    PAD_ANGLE,
    PAD_RADIUS,
    PAD_X,
    PAD_Y,
    PHASE,
    RESTITUTION,
    SLOPE,
    STEEPEST,
    TABLE,
    VALUE,
    WIDEST,
    centre_of_mass,
    mechanical_energy,
    pad_place,
    read_body,
    read_pad,
    read_pad_motion,
    to_centroid,
)

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

PENETRATION_ALLOWED = 2e-5  # m, left uncorrected so that a resting contact does not flicker
CORRECTION_RATE = 0.2  # share of the rest that is taken back in every step
CORRECTION_SWEEPS = 4
PASSES = 2  # evaluations of the speed-dependent terms in a step
BOUNCE_TRIES = 11  # of smaller coefficients of restitution, where it would create energy
PUSH_OUT_SPEED = 1.0  # m/s, the fastest that a pad is taken out of the ground
DIVERGED = 1e4  # a speed (m/s, rad/s) beyond which a state is no longer believed
ROUNDING = 1e-9  # share of the energy that a blow brings by which it may seem to gain

# Columns of the totals that a step adds to.
MOTOR_WORK, JOINT_LOSS, SLIP_LOSS, IMPACT_LOSS, WORST_RESIDUAL, BUMPS, BEFORE_IT, ENERGY = range(8)
CONTACT_GAIN = 8  # the largest of a time step, not a sum
TOTALS = 9
# Columns of a pad's record: slip (m), then tangential and normal impulse (N s).
SLIP, IMPULSE_T, IMPULSE_N = range(3)
RECORD = 3
# What a step's contacts are asked for in turn, until they create no energy: the terrain's
# restitution; none; as much again, if without it energy comes from other forces; the largest that
# creates none, judged strictly or with these forces; neither bounce nor the path's curvature.
AS_ASKED, WITHOUT_BOUNCE, LENIENT, SEARCH, LENIENT_SEARCH, WITHOUT_CURVATURE = range(6)
TRAVEL = 4  # where, after the last pose, a robot's travel is
SCRATCH = 36  # numbers: readings of the tables, 18 and 9, last pose and travel, 5, first pose, 4
# Where what is in a row of a trace: pose at the middle of the step and velocity before and after it
# (of the centre of mass), torque, then x, y and moment impulse on each pad.
POSE, BEFORE, AFTER, TORQUE, IMPULSES = 0, 4, 8, 12, 13


def work_space(capacity: int) -> tuple[Array, Ints]:
    """Memory for up to ``capacity`` contacts of a robot at once, for :func:`advance`.

    Two flat arrays, which pass into a kernel faster than many.
    """
    n = 2 * capacity
    return np.zeros(16 * n + 2 * n * n + SCRATCH), np.zeros(7 * capacity + 1, np.int64)


@compiled(nogil=True)
def advance(
    first, last, fresh, steps, h, torque, states, parameters, body, pads, layout,
    spans, planes, contacts, status, floats, ints, totals, record, toes, trace,
):  # fmt: skip
    """Advance robots ``first`` to ``last - 1`` with fixed contact planes, as far as these go.

    Args:
        fresh: whether to begin new sums in ``totals`` and ``record``.
        steps: time steps to take from here; 0 to go on with those that are left of an earlier call.
        h: length of a time step, s. torque: (robots,) crank torque, N m.
        states: (robots, 8) crank-axis states, changed in place.
        parameters: (robots, 14), body, pads, layout: see :mod:`jansen_env.engine.tables`.
        spans, planes, contacts, status: see :class:`jansen_env.plants.detector.ContactDetector`.
            STEPS_LEFT is counted down. A robot whose pad gets farther than its SPECULATIVE_MARGIN
            from where its planes were found stops before that; one faster than :data:`DIVERGED`
            or not finite stops at once, with -1 steps left, and takes no more.
        floats, ints: memory of :func:`work_space`.
        totals: (robots, 9) sums of energies (J), worst contact residual (N s), impulse on bumpers
            (N s), mechanical energy when the sums were begun, and its change since, J, and the most
            energy that the contact impulses of one time step added to what they found, J.
        record: (robots, pads, 3) sums of slip and impulses.
        toes: the first so many pads are toes.
        trace: (steps, :func:`trace_width`) of the first robot, filled step by step, its last row in
            its last step; or without rows for no trace.

    Returns:
        Whether no robot has steps left, and none has diverged.
    """
    finished = True
    n = 2 * (len(ints) // 7)
    J, MJ = floats[: 4 * n].reshape(n, 4), floats[4 * n : 8 * n].reshape(n, 4)
    W = floats[8 * n : 8 * n + n * n].reshape(n, n)
    A = floats[8 * n + n * n : 8 * n + 2 * n * n].reshape(n, n)
    vectors = floats[8 * n + 2 * n * n : 16 * n + 2 * n * n].reshape(8, n)
    scratch = floats[16 * n + 2 * n * n :]
    bend, q, P, u = vectors[0], vectors[1], vectors[2], vectors[3]
    rhs, mu, gap, clear = vectors[4], vectors[5], vectors[6], vectors[7]
    sums, place, pose = scratch[:18].reshape(3, 6), scratch[18:27].reshape(3, 3), scratch[27:32]
    found_at = scratch[32:]  # pose at which the planes were found
    mode, which, index = ints[: n // 2], ints[n // 2 : n], ints[n:]
    for r in range(first, last):
        tracing = r == 0 and len(trace) > 0
        state, own, total, records = states[r], parameters[r], totals[r], record[r]
        if fresh:
            for i in range(TOTALS):
                total[i] = 0.0
            for j in range(records.shape[0]):
                records[j, SLIP] = records[j, IMPULSE_T] = records[j, IMPULSE_N] = 0.0
            kinetic, potential = mechanical_energy(body, own, state, sums)
            total[BEFORE_IT] = kinetic + potential
        if steps > 0 and status[r, STEPS_LEFT] >= 0.0:
            status[r, STEPS_LEFT] = steps
        left, done = int(status[r, STEPS_LEFT]), 0
        if left <= 0:
            continue
        to_centroid(body, own, state, 1.0, sums)
        for i in range(4):
            pose[i] = found_at[i] = state[i]
        pose[TRAVEL] = 0.0
        for k in range(spans[r, 1] - spans[r, 0]):
            clear[k] = 0.0
        while done < left:
            margin = status[r, SPECULATIVE_MARGIN]
            if done > 0 and _outruns(margin, h, state, pose, found_at, own, body, pads, layout):
                break
            k = len(trace) - left + done
            if tracing:
                for i in range(4):
                    trace[k, POSE + i] = state[i] + 0.5 * h * state[4 + i]
                    trace[k, BEFORE + i] = state[4 + i]
            count, used = _step(
                h, torque[r], state, own, body, pads, layout, spans[r, 0], spans[r, 1], planes,
                contacts, J, MJ, W, A, bend, q, P, u, rhs, mu, gap, clear, pose,
                index, mode, which, sums, place, total, records,
            )  # fmt: skip
            if tracing:
                _trace(trace[k], state, used, count, own, planes, contacts, P, mode, which)
            done += 1
            if not _believable(state):
                done = left + 1
        status[r, STEPS_LEFT] = left - done
        finished = finished and done == left
        total[BUMPS] = 0.0
        for j in range(toes, records.shape[0]):
            total[BUMPS] += records[j, IMPULSE_N]
        to_centroid(body, own, state, -1.0, sums)
        kinetic, potential = mechanical_energy(body, own, state, sums)
        total[ENERGY] = kinetic + potential - total[BEFORE_IT]
    return finished


@compiled(forceinline=True)
def _believable(state):
    """Whether all speeds of a state (8,) are below :data:`DIVERGED`, m/s and rad/s."""
    slow = abs(state[4]) < DIVERGED and abs(state[5]) < DIVERGED
    return slow and abs(state[6]) < DIVERGED and abs(state[7]) < DIVERGED


@compiled(forceinline=True)
def _outruns(margin, h, state, pose, found_at, own, body, pads, layout):
    """Whether the next step's middle has a pad more than ``margin`` from where planes were found.

    The bound on what pads have travelled nearly always shows that none has. It leaves out how far a
    step lifts sunken pads, at most PUSH_OUT_SPEED h.
    """
    travel = pose[TRAVEL] + h * (abs(state[4]) + abs(state[5]))
    travel += h * (own[LONGEST] * abs(state[6]) + own[WIDEST] * abs(state[7]))
    if travel <= margin:
        return False
    x, y = state[0] + 0.5 * h * state[4], state[1] + 0.5 * h * state[5]
    theta, psi = state[2] + 0.5 * h * state[6], state[3] + 0.5 * h * state[7]
    cos, sin = np.cos(theta), np.sin(theta)
    old_cos, old_sin = np.cos(found_at[2]), np.sin(found_at[2])
    sx, sy = centre_of_mass(body, own, psi)
    old_sx, old_sy = centre_of_mass(body, own, found_at[3])
    for j in range(len(layout)):
        table, phase = int(layout[j, TABLE]), layout[j, PHASE]
        px, py = pad_place(pads, table, psi + phase)
        old_px, old_py = pad_place(pads, table, found_at[3] + phase)
        px, py, old_px, old_py = px - sx, py - sy, old_px - old_sx, old_py - old_sy
        far_x = x + cos * px - sin * py - found_at[0] - old_cos * old_px + old_sin * old_py
        far_y = y + sin * px + cos * py - found_at[1] - old_sin * old_px - old_cos * old_py
        if not far_x * far_x + far_y * far_y <= margin * margin:
            return True
    return False


def trace_width(pads: int) -> int:
    """Columns of a trace for a robot with so many pads."""
    return IMPULSES + 3 * pads


@compiled
def _trace(row, state, torque, count, own, planes, contacts, P, mode, which):
    """Complete a row of the trace after a step; moments are about the pads' centres."""
    for i in range(4):
        row[AFTER + i] = state[4 + i]
    row[TORQUE] = torque
    row[IMPULSES:] = 0.0
    for c in range(count):
        if mode[c] == OPEN:
            continue
        k = which[c]
        at = IMPULSES + 3 * contacts[k, PAD]
        normal, tangential = P[2 * c], P[2 * c + 1]
        nx, ny = planes[k, 0], planes[k, 1]
        row[at] += normal * nx + tangential * ny
        row[at + 1] += normal * ny - tangential * nx
        row[at + 2] += tangential * own[PAD_RADIUS]


@compiled(forceinline=True)
def _step(
    h, torque, state, own, body, pads, layout, begin, end, planes,
    contacts, J, MJ, W, A, bend, q, P, u, rhs, mu, gap, clear, pose,
    index, mode, which, sums, place, totals, record,
):  # fmt: skip
    """One time step of one robot; returns how many pads touched, and the torque that was used."""
    m, gx, gy = own[MASS], own[GRAVITY_X], own[GRAVITY_Y]
    driven = own[DRIVEN] != 0.0
    vx, vy, w, n = state[4], state[5], state[6], state[7]
    x, y = state[0] + 0.5 * h * vx, state[1] + 0.5 * h * vy
    theta, psi = state[2] + 0.5 * h * w, state[3] + 0.5 * h * n
    cos, sin = np.cos(theta), np.sin(theta)

    # Inertia about the centre of mass and its slopes.
    read_body(body, psi, sums)
    load, px, py = own[LOAD_MASS], own[LOAD_X], own[LOAD_Y]
    sx, sy = (sums[VALUE, C_X] + load * px) / m, (sums[VALUE, C_Y] + load * py) / m
    dx, dy = sums[SLOPE, C_X] / m, sums[SLOPE, C_Y] / m
    ddx, ddy = sums[CURVE, C_X] / m, sums[CURVE, C_Y] / m
    inertia = sums[VALUE, INERTIA] + load * (px * px + py * py) + own[LOAD_INERTIA]
    inertia -= m * (sx * sx + sy * sy)
    inertia_slope = sums[SLOPE, INERTIA] - 2.0 * m * (sx * dx + sy * dy)
    coupling = sums[VALUE, COUPLING] - m * (sx * dy - sy * dx)
    coupling_slope = sums[SLOPE, COUPLING] - m * (sx * ddy - sy * ddx)
    crank = sums[VALUE, CRANK] - m * (dx * dx + dy * dy)
    crank_slope = sums[SLOPE, CRANK] - 2.0 * m * (dx * ddx + dy * ddy)
    damping = sums[VALUE, DAMPING]
    crank_implicit = crank + 0.5 * h * damping
    determinant = inertia * crank_implicit - coupling * coupling
    m11, m12, m22 = crank_implicit / determinant, -coupling / determinant, inertia / determinant
    if driven:  # nothing that acts on the robot changes the crank's speed
        m11, m12, m22 = 1.0 / inertia, 0.0, 0.0

    # The pads that touch: rows of J, path curvature; and whether one of them is landing. In a step
    # without landings the contact law is asked of the velocity at the end of the step,
    # J v + (h / 2) J_dot v, which keeps a rolling or pivoting toe where it is to second order.
    radius = own[PAD_RADIUS]
    count = 0
    impact = False
    can_wedge = own[FRICTION] * own[STEEPEST] >= 1.0  # slope + atan(friction) reaches 90 degrees
    travel = _travel(pose, x, y, theta, psi, own)
    for k in range(begin, end):
        if clear[k - begin] > travel:
            continue
        j = contacts[k, PAD]
        table = int(layout[j, TABLE])
        row, t = read_pad(pads, table, psi + layout[j, PHASE], place)
        rx, ry = place[VALUE, PAD_X] - sx, place[VALUE, PAD_Y] - sy
        ox, oy = cos * rx - sin * ry, sin * rx + cos * ry  # R r
        normal_x, normal_y = planes[k, 0], planes[k, 1]
        distance = normal_x * (x + ox) + normal_y * (y + oy) - planes[k, 2] - radius
        clear[k - begin] = travel + distance
        if distance > 0.0:
            continue
        read_pad_motion(pads, table, row, t, place)
        rdx, rdy = place[SLOPE, PAD_X] - dx, place[SLOPE, PAD_Y] - dy
        odx, ody = cos * rdx - sin * rdy, sin * rdx + cos * rdy  # R r'
        rddx, rddy = place[CURVE, PAD_X] - ddx, place[CURVE, PAD_Y] - ddy
        oddx, oddy = cos * rddx - sin * rddy, sin * rddx + cos * rddy  # R r''
        tx, ty = normal_y, -normal_x
        i = 2 * count
        J[i, 0], J[i, 1] = normal_x, normal_y
        J[i, 2] = -normal_x * oy + normal_y * ox
        J[i, 3] = normal_x * odx + normal_y * ody
        J[i + 1, 0], J[i + 1, 1] = tx, ty
        J[i + 1, 2] = -tx * oy + ty * ox + radius
        J[i + 1, 3] = tx * odx + ty * ody + radius * place[SLOPE, PAD_ANGLE]
        ax = -w * w * ox - 2.0 * w * n * ody + n * n * oddx
        ay = -w * w * oy + 2.0 * w * n * odx + n * n * oddy
        bend[i] = 0.5 * h * (normal_x * ax + normal_y * ay)
        bend[i + 1] = 0.5 * h * (tx * ax + ty * ay + radius * place[CURVE, PAD_ANGLE] * n * n)
        approach = J[i, 0] * vx + J[i, 1] * vy + J[i, 2] * w + J[i, 3] * n
        if distance - 0.5 * h * approach > 0.0:
            impact = True  # it was open when the step began
        mu[count] = own[FRICTION]
        mode[count] = contacts[k, MODE]
        which[count] = k
        gap[count] = distance
        count += 1
    for i in range(2 * count):
        MJ[i, 0], MJ[i, 1] = J[i, 0] / m, J[i, 1] / m
        MJ[i, 2] = m11 * J[i, 2] + m12 * J[i, 3]
        MJ[i, 3] = m12 * J[i, 2] + m22 * J[i, 3]
        for j in range(i + 1):
            W[i, j] = (
                MJ[i, 0] * J[j, 0] + MJ[i, 1] * J[j, 1] + MJ[i, 2] * J[j, 2] + MJ[i, 3] * J[j, 3]
            )
            W[j, i] = W[i, j]
    wedged = can_wedge and _wedged(count, which, planes, own[FRICTION])
    if count > 0:
        soften(count, W, WEDGE_COMPLIANCE if wedged else COMPLIANCE)

    residual = 0.0
    asked = 0.0 if wedged else own[RESTITUTION]
    stage, bounce, least, most, tries = AS_ASKED, asked, 0.0, asked, 0
    curved = not (impact or wedged)
    checked = count > 0 and (asked > 0.0 or can_wedge)
    index[5 * count] = 0  # W is new
    while True:
        nw, nn = w, n  # new velocities
        for _ in range(PASSES):
            mw, mn = 0.5 * (w + nw), 0.5 * (n + nn)
            pitch_force = -(mw * mn * inertia_slope + mn * mn * coupling_slope)
            crank_force = 0.5 * mw * mw * inertia_slope - 0.5 * mn * mn * crank_slope
            crank_force += torque - damping * n
            nx, ny = vx + h * gx, vy + h * gy
            nw = w + h * (m11 * pitch_force + m12 * crank_force)
            nn = n + h * (m12 * pitch_force + m22 * crank_force)
            fx, fy, fw, fn = nx, ny, nw, nn  # without contact
            if count == 0:
                continue
            for i in range(2 * count):
                free = J[i, 0] * nx + J[i, 1] * ny + J[i, 2] * nw + J[i, 3] * nn
                q[i] = free + bend[i] if curved else free
                if i % 2 == 0 and bounce > 0.0:
                    before = J[i, 0] * vx + J[i, 1] * vy + J[i, 2] * w + J[i, 3] * n
                    q[i] += bounce * min(before, 0.0)
            residual = solve(count, W, q, mu, mode, P, u, A, rhs, index)
            for i in range(2 * count):
                nx += MJ[i, 0] * P[i]
                ny += MJ[i, 1] * P[i]
                nw += MJ[i, 2] * P[i]
                nn += MJ[i, 3] * P[i]
        # Newton's law with friction may create energy (Kane and Levinson, J. Appl. Mech. 52, 1985):
        # then the toes bounce as much as they can without that.
        if not checked or stage == WITHOUT_CURVATURE:
            break
        creates = _gain(count, vx, vy, w, n, nx, ny, nw, nn, J, P) > 0.0
        lenient = stage in (LENIENT, LENIENT_SEARCH)
        if creates and (lenient or bounce == 0.0):
            # More than the other forces alone would leave, too? If not, it is their doing.
            excess = _gain(count, fx, fy, fw, fn, nx, ny, nw, nn, J, P) > 0.0
            if excess and bounce == 0.0:  # nor the bounce's: what else asks for more is curvature
                stage = WITHOUT_CURVATURE
                if not curved:
                    break
                curved = False
                continue
            creates = excess or not lenient
        if stage == AS_ASKED:
            if not creates or asked == 0.0:
                break
            stage, bounce = WITHOUT_BOUNCE, 0.0
        elif stage == WITHOUT_BOUNCE and creates:
            stage, bounce = LENIENT, asked
        elif stage == LENIENT and not creates:
            break
        elif tries > BOUNCE_TRIES:  # that was the largest found
            if not creates:
                break
            stage, bounce, curved = WITHOUT_CURVATURE, 0.0, False
        else:
            if creates:
                most = bounce
            else:
                least = bounce
            stage = LENIENT_SEARCH if lenient else SEARCH
            bounce = least if tries == BOUNCE_TRIES else 0.5 * (least + most)
            tries += 1

    mean = 0.5 * (n + nn)
    if driven:  # what is left over in the crank's equation of motion
        mw = 0.5 * (w + nw)
        torque = (coupling * (nw - w) + crank * (nn - n)) / h + damping * mean
        torque -= 0.5 * mw * mw * inertia_slope - 0.5 * mean * mean * crank_slope
        for i in range(2 * count):
            torque -= J[i, 3] * P[i] / h
    totals[MOTOR_WORK] += h * torque * mean
    totals[JOINT_LOSS] += h * damping * mean * mean
    totals[WORST_RESIDUAL] = max(totals[WORST_RESIDUAL], residual)
    if count > 0 and (stage == WITHOUT_CURVATURE or not checked):  # else it is known to be 0
        gain = min(
            _gain(count, vx, vy, w, n, nx, ny, nw, nn, J, P),
            _gain(count, fx, fy, fw, fn, nx, ny, nw, nn, J, P),
        )
        totals[CONTACT_GAIN] = max(totals[CONTACT_GAIN], gain)
    state[0], state[1] = x + 0.5 * h * nx, y + 0.5 * h * ny
    state[2], state[3] = theta + 0.5 * h * nw, psi + 0.5 * h * nn
    for k in range(begin, end):
        contacts[k, MODE] = STICK  # the guess for a contact that closes
    if count > 0:
        _book(
            h, count, vx, vy, w, n, nx, ny, nw, nn, J, P, gap, mode, which, contacts, totals, record
        )
        moved_x, moved_y = _correct(h, count, state, nx, ny, nw, nn, J, MJ, W, gap, mode, q, rhs)
        totals[IMPACT_LOSS] += m * (gx * moved_x + gy * moved_y)
    state[4], state[5], state[6], state[7] = nx, ny, nw, nn
    return count, torque


@compiled(forceinline=True)
def _travel(pose, x, y, theta, psi, own):
    """How far, at most, any pad has come since ``pose`` was new, m; takes the robot's pose there.

    A pad that was farther from its plane need not be looked at.
    """
    far = abs(x - pose[0]) + abs(y - pose[1])
    far += own[LONGEST] * abs(theta - pose[2]) + own[WIDEST] * abs(psi - pose[3])
    pose[0], pose[1], pose[2], pose[3] = x, y, theta, psi
    pose[TRAVEL] += (1.0 + 1e-6) * far
    return pose[TRAVEL]


@compiled(forceinline=True)
def _wedged(count, which, planes, friction):
    """Whether two contacts' friction cones hold opposite forces: n . n' <= -cos(2 atan(friction)).

    Only then can the pads push on the ground with any force and no effect on the motion. Velocities
    that no motion of the robot has, as bounces and the path's curvature ask for, would make
    that force as large as the arithmetic allows, so a wedged step goes without both.
    """
    limit = (friction * friction - 1.0) / (friction * friction + 1.0)
    for c in range(count):
        for d in range(c):
            i, j = which[c], which[d]
            if planes[i, 0] * planes[j, 0] + planes[i, 1] * planes[j, 1] <= limit:
                return True
    return False


@compiled(forceinline=True)
def _gain(count, vx, vy, w, n, nx, ny, nw, nn, J, P):
    """Energy that the contacts' impulses add between two velocities, J; 0 within rounding.

    It is impulse times mean velocity.
    """
    gained, brought = 0.0, 0.0
    for i in range(2 * count):
        old = J[i, 0] * vx + J[i, 1] * vy + J[i, 2] * w + J[i, 3] * n
        new = J[i, 0] * nx + J[i, 1] * ny + J[i, 2] * nw + J[i, 3] * nn
        gained += 0.5 * P[i] * (old + new)
        brought += abs(P[i] * old)
    return gained if gained > ROUNDING * brought else 0.0


@compiled(forceinline=True)
def _book(h, count, vx, vy, w, n, nx, ny, nw, nn, J, P, gap, mode, which, contacts, totals, record):
    """Book the step's slip, impulses and contact losses.

    A contact's work is impulse times mean velocity, which is exact for the step. What friction
    takes while sliding is slip loss, all else (landing, tangential stops) impact loss. A toe that
    lands in the step slides from its middle on, with its new velocity alone.
    """
    for c in range(count):
        k, i = which[c], 2 * c
        contacts[k, MODE] = mode[c]
        if mode[c] == OPEN:
            continue
        j = contacts[k, PAD]
        old_n = J[i, 0] * vx + J[i, 1] * vy + J[i, 2] * w + J[i, 3] * n
        new_n = J[i, 0] * nx + J[i, 1] * ny + J[i, 2] * nw + J[i, 3] * nn
        old_t = J[i + 1, 0] * vx + J[i + 1, 1] * vy + J[i + 1, 2] * w + J[i + 1, 3] * n
        new_t = J[i + 1, 0] * nx + J[i + 1, 1] * ny + J[i + 1, 2] * nw + J[i + 1, 3] * nn
        landing = gap[c] - 0.5 * h * old_n > 0.0
        friction_loss = -0.5 * P[i + 1] * (old_t + new_t)
        if landing or mode[c] == STICK:
            totals[IMPACT_LOSS] += friction_loss
        else:
            totals[SLIP_LOSS] += friction_loss
        totals[IMPACT_LOSS] -= 0.5 * P[i] * (old_n + new_n)
        if mode[c] != STICK:
            slid = new_t if landing else old_t + new_t
            record[j, SLIP] += 0.5 * h * abs(slid)
        record[j, IMPULSE_T] += P[i + 1]
        record[j, IMPULSE_N] += P[i]


@compiled(forceinline=True)
def _correct(h, count, state, nx, ny, nw, nn, J, MJ, W, gap, mode, q, push):
    """Push penetrating pads out, moving positions only; returns the centre of mass's way (x, y).

    The smallest move in the metric of M (a few Gauss-Seidel sweeps), so nothing is sped up.
    """
    needed = False
    for c in range(count):
        i = 2 * c
        rate = J[i, 0] * nx + J[i, 1] * ny + J[i, 2] * nw + J[i, 3] * nn
        depth = -(gap[c] + 0.5 * h * rate) - PENETRATION_ALLOWED
        q[i] = min(CORRECTION_RATE * depth, PUSH_OUT_SPEED * h) if mode[c] != OPEN else -1.0
        needed = needed or q[i] > 0.0
        push[c] = 0.0
    if not needed:
        return 0.0, 0.0
    for _ in range(CORRECTION_SWEEPS):
        for c in range(count):
            missing = q[2 * c]
            for d in range(count):
                missing -= W[2 * c, 2 * d] * push[d]
            push[c] = max(0.0, push[c] + missing / W[2 * c, 2 * c])
    moved_x, moved_y = 0.0, 0.0
    for c in range(count):
        for i in range(4):
            state[i] += MJ[2 * c, i] * push[c]
        moved_x += MJ[2 * c, 0] * push[c]
        moved_y += MJ[2 * c, 1] * push[c]
    return moved_x, moved_y
