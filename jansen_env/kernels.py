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

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.compiling import compiled
from jansen_env.contact_solver import OPEN, STICK, soften, solve
from jansen_env.model import locate, taylor_curve, taylor_slope, taylor_value, to_centroid

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

PENETRATION_ALLOWED = 2e-5  # m, left uncorrected so that a resting contact does not flicker
CORRECTION_RATE = 0.2  # share of the rest that is taken back in every step
CORRECTION_SWEEPS = 4
PASSES = 2  # evaluations of the speed-dependent terms in a step
BOUNCE_ROUNDS = 14  # tries of smaller coefficients of restitution, where it would create energy
ROUNDING = 1e-9  # share of the energy that a blow brings by which it may seem to gain

# Columns of the totals that a step adds to.
MOTOR_WORK, JOINT_LOSS, SLIP_LOSS, IMPACT_LOSS, WORST_RESIDUAL, BUMPS = range(6)
TOTALS = 6
# Columns of a pad's record: slip (m), then tangential and normal impulse (N s).
SLIP, IMPULSE_T, IMPULSE_N = range(3)
RECORD = 3
# Where what is in a row of a trace: pose at the middle of the step and velocity before and after it
# (of the centre of mass), torque, then x, y and moment impulse on each pad.
POSE, BEFORE, AFTER, TORQUE, IMPULSES = 0, 4, 8, 12, 13


class Ground(NamedTuple):
    """Contact planes, as found by the detector."""

    plane: Array  # (capacity, 3) normal, offset
    pad: Ints  # (capacity,)
    mode: Ints  # (capacity,) the last step's contact mode, a first guess
    friction: float
    restitution: float


class Work(NamedTuple):
    """Work space for up to ``capacity`` contacts at once; made by :func:`_views` of flat arrays."""

    J: Array  # (2 capacity, 4) contact Jacobian: rows normal, tangential
    MJ: Array  # (2 capacity, 4) J M^-1
    W: Array  # (2 capacity, 2 capacity) Delassus matrix
    A: Array  # (2 capacity, 2 capacity) for the solver
    bend: Array  # (2 capacity,) velocity the contact point gains by path curvature in half a step
    q: Array  # (2 capacity,) velocity without contact impulses
    P: Array  # (2 capacity,) impulses
    u: Array  # (2 capacity,) velocity left behind
    rhs: Array  # (2 capacity,) for the solver
    mu: Array  # (capacity,)
    gap: Array  # (capacity,)
    order: Ints  # (2 capacity,) for the solver
    mode: Ints  # (capacity,)
    plane: Ints  # (capacity,) which plane each active contact belongs to


def work_space(capacity: int) -> tuple[Array, Ints]:
    """Memory for :class:`Work`: two flat arrays, which pass into a kernel faster than many."""
    n = 2 * capacity
    return np.zeros(8 * n + 2 * n * n + 6 * n), np.zeros(2 * n, np.int64)


@compiled(inline="always")
def _views(floats, ints, capacity):
    n = 2 * capacity
    v = 8 * n + 2 * n * n  # where the vectors begin
    return Work(
        floats[: 4 * n].reshape(n, 4),
        floats[4 * n : 8 * n].reshape(n, 4),
        floats[8 * n : 8 * n + n * n].reshape(n, n),
        floats[8 * n + n * n : v].reshape(n, n),
        floats[v : v + n],
        floats[v + n : v + 2 * n],
        floats[v + 2 * n : v + 3 * n],
        floats[v + 3 * n : v + 4 * n],
        floats[v + 4 * n : v + 5 * n],
        floats[v + 5 * n : v + 5 * n + capacity],
        floats[v + 5 * n + capacity : v + 6 * n],
        ints[:n],
        ints[n : n + capacity],
        ints[n + capacity :],
    )


@compiled
def advance(
    steps, h, torque, state, model, ground, planes, floats, ints, totals, record, toes, trace
):
    """Advance a state by ``steps`` time steps with fixed contact planes.

    Args:
        steps, h: number and length (s) of the steps. torque: crank torque, N m.
        state: (8,) crank-axis state, changed in place.
        model, ground: :class:`Model`, :class:`Ground`. planes: planes in use.
        floats, ints: memory of :func:`work_space`.
        totals: (6,) energies (J) added to, worst contact residual (N s), impulse on bumpers (N s).
        record: (pads, 3) slip and impulses added to. toes: the first so many pads are toes.
        trace: (steps, :func:`trace_width`) filled step by step, or without rows for no trace.
    """
    work = _views(floats, ints, len(ground.pad))
    to_centroid(model, state, 1.0)
    tracing = len(trace) > 0
    for k in range(steps):
        if tracing:
            for i in range(4):
                trace[k, POSE + i] = state[i] + 0.5 * h * state[4 + i]
                trace[k, BEFORE + i] = state[4 + i]
        count, used = _step(h, torque, state, model, ground, planes, work, totals, record)
        if tracing:
            _trace(trace[k], state, used, count, model, ground, work)
    totals[BUMPS] = record[toes:, IMPULSE_N].sum()
    to_centroid(model, state, -1.0)


def trace_width(pads: int) -> int:
    """Columns of a trace for a robot with so many pads."""
    return IMPULSES + 3 * pads


@compiled(inline="always")
def _trace(row, state, torque, count, model, ground, work):
    """Complete a row of the trace after a step; moments are about the pads' centres."""
    for i in range(4):
        row[AFTER + i] = state[4 + i]
    row[TORQUE] = torque
    row[IMPULSES:] = 0.0
    for c in range(count):
        if work.mode[c] == OPEN:
            continue
        k = work.plane[c]
        at = IMPULSES + 3 * ground.pad[k]
        normal, tangential = work.P[2 * c], work.P[2 * c + 1]
        nx, ny = ground.plane[k, 0], ground.plane[k, 1]
        row[at] += normal * nx + tangential * ny
        row[at + 1] += normal * ny - tangential * nx
        row[at + 2] += tangential * model.pad_radius


@compiled(inline="always")
def _step(h, torque, state, model, ground, planes, work, totals, record):
    m, (gx, gy) = model.mass, model.gravity
    vx, vy, w, n = state[4], state[5], state[6], state[7]
    x, y = state[0] + 0.5 * h * vx, state[1] + 0.5 * h * vy
    theta, psi = state[2] + 0.5 * h * w, state[3] + 0.5 * h * n
    cos, sin = np.cos(theta), np.sin(theta)

    # Inertia about the centre of mass and its slopes.
    row, t = locate(model.body.shape[0], psi)
    c = model.body[row]
    load, px, py = model.load[0], model.load[2], model.load[3]
    sx, sy = (taylor_value(c[0], t) + load * px) / m, (taylor_value(c[1], t) + load * py) / m
    dx, dy = taylor_slope(c[0], t) / m, taylor_slope(c[1], t) / m
    ddx, ddy = taylor_curve(c[0], t) / m, taylor_curve(c[1], t) / m
    inertia = taylor_value(c[2], t) + load * (px * px + py * py) + model.load[1]
    inertia -= m * (sx * sx + sy * sy)
    inertia_slope = taylor_slope(c[2], t) - 2.0 * m * (sx * dx + sy * dy)
    coupling = taylor_value(c[3], t) - m * (sx * dy - sy * dx)
    coupling_slope = taylor_slope(c[3], t) - m * (sx * ddy - sy * ddx)
    crank = taylor_value(c[4], t) - m * (dx * dx + dy * dy)
    crank_slope = taylor_slope(c[4], t) - 2.0 * m * (dx * ddx + dy * ddy)
    damping = taylor_value(c[5], t)
    crank_implicit = crank + 0.5 * h * damping
    determinant = inertia * crank_implicit - coupling * coupling
    m11, m12, m22 = crank_implicit / determinant, -coupling / determinant, inertia / determinant
    if model.driven:  # nothing that acts on the robot changes the crank's speed
        m11, m12, m22 = 1.0 / inertia, 0.0, 0.0

    count, impact = _active_contacts(
        h, x, y, cos, sin, psi, w, n, vx, vy, sx, sy, dx, dy, ddx, ddy, model, ground, planes, work
    )
    J, MJ, W = work.J, work.MJ, work.W
    for i in range(2 * count):
        MJ[i, 0], MJ[i, 1] = J[i, 0] / m, J[i, 1] / m
        MJ[i, 2] = m11 * J[i, 2] + m12 * J[i, 3]
        MJ[i, 3] = m12 * J[i, 2] + m22 * J[i, 3]
        for j in range(i + 1):
            W[i, j] = (
                MJ[i, 0] * J[j, 0] + MJ[i, 1] * J[j, 1] + MJ[i, 2] * J[j, 2] + MJ[i, 3] * J[j, 3]
            )
            W[j, i] = W[i, j]
    if count > 0:
        soften(count, W)

    residual = 0.0
    bounce, least, most = ground.restitution, 0.0, ground.restitution
    settled = count == 0 or bounce == 0.0
    for attempt in range(BOUNCE_ROUNDS):
        nw, nn = w, n  # new velocities
        for _ in range(PASSES):
            mw, mn = 0.5 * (w + nw), 0.5 * (n + nn)
            pitch_force = -(mw * mn * inertia_slope + mn * mn * coupling_slope)
            crank_force = 0.5 * mw * mw * inertia_slope - 0.5 * mn * mn * crank_slope
            crank_force += torque - damping * n
            nx, ny = vx + h * gx, vy + h * gy
            nw = w + h * (m11 * pitch_force + m12 * crank_force)
            nn = n + h * (m12 * pitch_force + m22 * crank_force)
            if count == 0:
                continue
            for i in range(2 * count):
                free = J[i, 0] * nx + J[i, 1] * ny + J[i, 2] * nw + J[i, 3] * nn
                work.q[i] = free if impact else free + work.bend[i]
                if i % 2 == 0 and bounce > 0.0:
                    before = J[i, 0] * vx + J[i, 1] * vy + J[i, 2] * w + J[i, 3] * n
                    work.q[i] += bounce * min(before, 0.0)
            residual = solve(
                count, W, work.q, work.mu, work.mode, work.P, work.u, work.A, work.rhs, work.order
            )
            for i in range(2 * count):
                nx += MJ[i, 0] * work.P[i]
                ny += MJ[i, 1] * work.P[i]
                nw += MJ[i, 2] * work.P[i]
                nn += MJ[i, 3] * work.P[i]
        # Newton's law with friction may create energy (Kane and Levinson, J. Appl. Mech. 52, 1985):
        # then the toes bounce as much as they can without that.
        if settled:
            break
        creates = _creates_energy(count, vx, vy, w, n, nx, ny, nw, nn, work)
        if attempt == 0:
            if not creates:
                break
            bounce = 0.0
        elif attempt == 1 and creates:  # without bounce, too: it is the step's error, as in rolling
            bounce, settled = ground.restitution, True
        else:
            if creates:
                most = bounce
            else:
                least = bounce
            settled = attempt == BOUNCE_ROUNDS - 2
            bounce = least if settled else 0.5 * (least + most)

    mean = 0.5 * (n + nn)
    if model.driven:  # what is left over in the crank's equation of motion
        mw = 0.5 * (w + nw)
        torque = (coupling * (nw - w) + crank * (nn - n)) / h + damping * mean
        torque -= 0.5 * mw * mw * inertia_slope - 0.5 * mean * mean * crank_slope
        for i in range(2 * count):
            torque -= J[i, 3] * work.P[i] / h
    totals[MOTOR_WORK] += h * torque * mean
    totals[JOINT_LOSS] += h * damping * mean * mean
    totals[WORST_RESIDUAL] = max(totals[WORST_RESIDUAL], residual)
    state[0], state[1] = x + 0.5 * h * nx, y + 0.5 * h * ny
    state[2], state[3] = theta + 0.5 * h * nw, psi + 0.5 * h * nn
    for k in range(planes):
        ground.mode[k] = STICK  # the guess for a contact that closes
    if count > 0:
        _record(h, count, vx, vy, w, n, nx, ny, nw, nn, ground, work, totals, record)
        moved_x, moved_y = _correct(h, count, state, nx, ny, nw, nn, work)
        totals[IMPACT_LOSS] += m * (gx * moved_x + gy * moved_y)
    state[4], state[5], state[6], state[7] = nx, ny, nw, nn
    return count, torque


@compiled(inline="always")
def _creates_energy(count, vx, vy, w, n, nx, ny, nw, nn, work):
    """Whether the contacts' impulses do more work on the robot than rounding makes."""
    J = work.J
    gained, brought = 0.0, 0.0
    for i in range(2 * count):
        old = J[i, 0] * vx + J[i, 1] * vy + J[i, 2] * w + J[i, 3] * n
        new = J[i, 0] * nx + J[i, 1] * ny + J[i, 2] * nw + J[i, 3] * nn
        gained += 0.5 * work.P[i] * (old + new)
        brought += abs(work.P[i] * old)
    return gained > ROUNDING * brought


@compiled(inline="always")
def _active_contacts(
    h, x, y, cos, sin, psi, w, n, vx, vy, sx, sy, dx, dy, ddx, ddy, model, ground, planes, work
):
    """Collect the pads that touch: rows of J, path curvature; and whether one of them is landing.

    In a step without landings the contact law is asked of the velocity at the end of the step,
    J v + (h / 2) J_dot v, which keeps a rolling or pivoting toe where it is to second order.
    """
    radius = model.pad_radius
    count = 0
    impact = False
    for k in range(planes):
        j = ground.pad[k]
        row, t = locate(model.pads.shape[1], psi + model.pad_phase[j])
        c = model.pads[model.pad_table[j], row]
        rx, ry = taylor_value(c[0], t) - sx, taylor_value(c[1], t) - sy
        ox, oy = cos * rx - sin * ry, sin * rx + cos * ry  # R r
        normal_x, normal_y = ground.plane[k, 0], ground.plane[k, 1]
        gap = normal_x * (x + ox) + normal_y * (y + oy) - ground.plane[k, 2] - radius
        if gap > 0.0:
            continue
        rdx, rdy = taylor_slope(c[0], t) - dx, taylor_slope(c[1], t) - dy
        odx, ody = cos * rdx - sin * rdy, sin * rdx + cos * rdy  # R r'
        rddx, rddy = taylor_curve(c[0], t) - ddx, taylor_curve(c[1], t) - ddy
        oddx, oddy = cos * rddx - sin * rddy, sin * rddx + cos * rddy  # R r''
        tx, ty = normal_y, -normal_x
        i = 2 * count
        J = work.J
        J[i, 0], J[i, 1] = normal_x, normal_y
        J[i, 2] = -normal_x * oy + normal_y * ox
        J[i, 3] = normal_x * odx + normal_y * ody
        J[i + 1, 0], J[i + 1, 1] = tx, ty
        J[i + 1, 2] = -tx * oy + ty * ox + radius
        J[i + 1, 3] = tx * odx + ty * ody + radius * taylor_slope(c[2], t)
        ax = -w * w * ox - 2.0 * w * n * ody + n * n * oddx
        ay = -w * w * oy + 2.0 * w * n * odx + n * n * oddy
        work.bend[i] = 0.5 * h * (normal_x * ax + normal_y * ay)
        work.bend[i + 1] = 0.5 * h * (tx * ax + ty * ay + radius * taylor_curve(c[2], t) * n * n)
        approach = J[i, 0] * vx + J[i, 1] * vy + J[i, 2] * w + J[i, 3] * n
        if gap - 0.5 * h * approach > 0.0:
            impact = True  # it was open when the step began
        work.mu[count] = ground.friction
        work.mode[count] = ground.mode[k]
        work.plane[count] = k
        work.gap[count] = gap
        count += 1
    return count, impact


@compiled(inline="always")
def _record(h, count, vx, vy, w, n, nx, ny, nw, nn, ground, work, totals, record):
    """Book the step's slip, impulses and contact losses.

    A contact's work is impulse times mean velocity, which is exact for the step. What friction
    takes while sliding is slip loss, all else (landing, tangential stops) impact loss. A toe that
    lands in the step slides from its middle on, with its new velocity alone.
    """
    J = work.J
    for c in range(count):
        k, i = work.plane[c], 2 * c
        ground.mode[k] = work.mode[c]
        if work.mode[c] == OPEN:
            continue
        j = ground.pad[k]
        old_n = J[i, 0] * vx + J[i, 1] * vy + J[i, 2] * w + J[i, 3] * n
        new_n = J[i, 0] * nx + J[i, 1] * ny + J[i, 2] * nw + J[i, 3] * nn
        old_t = J[i + 1, 0] * vx + J[i + 1, 1] * vy + J[i + 1, 2] * w + J[i + 1, 3] * n
        new_t = J[i + 1, 0] * nx + J[i + 1, 1] * ny + J[i + 1, 2] * nw + J[i + 1, 3] * nn
        landing = work.gap[c] - 0.5 * h * old_n > 0.0
        friction_loss = -0.5 * work.P[i + 1] * (old_t + new_t)
        if landing or work.mode[c] == STICK:
            totals[IMPACT_LOSS] += friction_loss
        else:
            totals[SLIP_LOSS] += friction_loss
        totals[IMPACT_LOSS] -= 0.5 * work.P[i] * (old_n + new_n)
        if work.mode[c] != STICK:
            slid = new_t if landing else old_t + new_t
            record[j, SLIP] += 0.5 * h * abs(slid)
        record[j, IMPULSE_T] += work.P[i + 1]
        record[j, IMPULSE_N] += work.P[i]


@compiled(inline="always")
def _correct(h, count, state, nx, ny, nw, nn, work):
    """Push penetrating pads out, moving positions only; returns the centre of mass's way (x, y).

    The smallest move in the metric of M (a few Gauss-Seidel sweeps), so nothing is sped up.
    """
    J, MJ, W, push = work.J, work.MJ, work.W, work.rhs
    needed = False
    for c in range(count):
        i = 2 * c
        rate = J[i, 0] * nx + J[i, 1] * ny + J[i, 2] * nw + J[i, 3] * nn
        depth = -(work.gap[c] + 0.5 * h * rate) - PENETRATION_ALLOWED
        work.q[i] = CORRECTION_RATE * depth if work.mode[c] != OPEN else -1.0
        needed = needed or work.q[i] > 0.0
        push[c] = 0.0
    if not needed:
        return 0.0, 0.0
    for _ in range(CORRECTION_SWEEPS):
        for c in range(count):
            missing = work.q[2 * c]
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
