"""The pads that touch in a time step: their Jacobian, the Delassus matrix, and what penetrates."""

from __future__ import annotations

import numpy as np

from jansen_env.engine import mathematics
from jansen_env.engine.contact_solver import COMPLIANCE, OPEN, STICK, WEDGE_COMPLIANCE, regularise
from jansen_env.engine.kernel import stage
from jansen_env.engine.tables import (
    FIRST,
    PAD_ANGLE,
    PAD_X,
    PAD_Y,
    SECOND,
    VALUE,
    centre_of_mass,
    pad_place,
    read_pad,
    read_pad_motion,
)

PENETRATION_ALLOWED = 2e-5  # m, left uncorrected so that a resting contact does not flicker
CORRECTION_RATE = 0.2  # share of the rest that is taken back in every step
CORRECTION_SWEEPS = 4
PUSH_OUT_SPEED = 1.0  # m/s, the fastest that a pad is taken out of the ground
TRAVEL = 4  # where, after the last pose, a robot's travel is


@stage
def find_contacts(h, middle, velocity, inertia, robot, model, planes, work):
    """The pads that touch at the middle of a step: rows of J, curvature of their paths.

    But in an impact the contact law is asked of the velocity at the end of the step,
    J v + (h / 2) J_dot v, which keeps a rolling or pivoting toe where it is to second order.

    A compliant pad touches if it does so where the step begins, or would in the middle of the next
    one at this velocity: that far ahead its law may look.

    Returns (contacts, whether one of them was open when the step began: an impact, whether one is
    that of a link's side).
    """
    x, y, theta, psi = middle
    turn = mathematics.cos(theta), mathematics.sin(theta)
    params, contacts, place = robot.params, work.contacts, work.place
    first = robot.status.first_plane
    travel = _travel(work.pose, middle, params)
    count, impact, sided = 0, False, False
    reach = farthest_way(h, velocity, params) if params.compliant else 0.0
    for k in range(first, robot.status.end_plane):
        if work.bound[k - first] > travel + reach:
            continue
        plane = planes[k]
        pad = model.layout[plane.pad]
        row, t = read_pad(model.pads, pad, psi, place)
        if plane.far_pad >= 0:
            read_pad_motion(model.pads, pad, row, t, place)
            far = model.layout[plane.far_pad]
            row, t = read_pad(model.pads, far, psi, work.sums)
            read_pad_motion(model.pads, far, row, t, work.sums)
            if not _move_along_side(plane, turn, (x, y), inertia, place, work.sums):
                continue
        ox, oy = _turned(
            turn, place[VALUE, PAD_X] - inertia.s[0], place[VALUE, PAD_Y] - inertia.s[1]
        )
        distance = plane.normal_x * (x + ox - plane.vertex_x)
        distance += plane.normal_y * (y + oy - plane.vertex_y)
        distance = distance - plane.offset - params.pad_radius
        work.bound[k - first] = travel + distance
        mode, plane.mode = plane.mode, STICK  # the guess for a contact that closes
        if distance > reach:
            continue
        if plane.far_pad < 0:
            read_pad_motion(model.pads, pad, row, t, place)
        _fill_rows(h, count, plane, turn, (ox, oy), velocity, inertia, params.pad_radius, work)
        half = 0.5 * h * rate(contacts.J, 2 * count, velocity)
        if params.compliant and distance - half > 0.0 and distance + 2.0 * half > 0.0:
            continue
        if distance - half > 0.0:
            impact = True
        contacts.problem.mu[count] = params.friction
        contacts.problem.mode[count] = mode
        contacts.plane[count], contacts.gap[count] = k, distance
        sided = sided or plane.far_pad >= 0
        count += 1
    return count, impact, sided


@stage(inline=False)
def _move_along_side(plane, turn, centroid, inertia, place, far):
    """Move the reading ``place`` of a side's end to its point over the plane's vertex.

    ``far`` is that of its other end. The plane's normal turns with the side. Returns whether the
    point lies between the ends.
    """
    ex, ey = far[VALUE, PAD_X] - place[VALUE, PAD_X], far[VALUE, PAD_Y] - place[VALUE, PAD_Y]
    square = ex * ex + ey * ey
    along_x, along_y = _turned(turn, ex, ey)
    ox, oy = _turned(turn, place[VALUE, PAD_X] - inertia.s[0], place[VALUE, PAD_Y] - inertia.s[1])
    x, y = plane.vertex_x - centroid[0] - ox, plane.vertex_y - centroid[1] - oy
    share = (along_x * x + along_y * y) / square
    scale = 1.0 / np.sqrt(square)
    if along_x * plane.normal_y < along_y * plane.normal_x:
        scale = -scale
    plane.normal_x, plane.normal_y = -scale * along_y, scale * along_x
    for i in (FIRST, SECOND):
        across = ex * (far[i, PAD_Y] - place[i, PAD_Y]) - ey * (far[i, PAD_X] - place[i, PAD_X])
        place[i, PAD_ANGLE] = across / square
    for i in (VALUE, FIRST, SECOND):
        place[i, PAD_X] += share * (far[i, PAD_X] - place[i, PAD_X])
        place[i, PAD_Y] += share * (far[i, PAD_Y] - place[i, PAD_Y])
    return 0.0 < share < 1.0


@stage
def _turned(turn, x, y):
    """A vector of the chassis frame in the world."""
    cos, sin = turn
    return cos * x - sin * y, sin * x + cos * y


@stage
def farthest_way(h, velocity, params):
    """Return the farthest that any pad gets in a step, m, at the centre of mass's velocity."""
    way = abs(velocity.x) + abs(velocity.y)
    way += params.pitch_arm * abs(velocity.pitch) + params.crank_arm * abs(velocity.crank)
    return (1.0 + 1e-6) * h * way


@stage
def rate(J, i, velocity):
    """Row ``i`` of J v."""
    return (
        J[i, 0] * velocity.x + J[i, 1] * velocity.y + J[i, 2] * velocity.pitch
        + J[i, 3] * velocity.crank
    )  # fmt: skip


@stage
def _fill_rows(h, count, plane, turn, arm, velocity, inertia, radius, work):
    """A contact's rows of J and (h / 2) J_dot v; ``arm`` points from centre of mass to pad."""
    J, Jdot_v, place = work.contacts.J, work.contacts.offset, work.place
    ox, oy = arm
    w, n = velocity.pitch, velocity.crank
    dx, dy = inertia.ds
    ddx, ddy = inertia.dds
    odx, ody = _turned(turn, place[FIRST, PAD_X] - dx, place[FIRST, PAD_Y] - dy)
    oddx, oddy = _turned(turn, place[SECOND, PAD_X] - ddx, place[SECOND, PAD_Y] - ddy)
    normal_x, normal_y = plane.normal_x, plane.normal_y
    tx, ty = normal_y, -normal_x
    i = 2 * count
    J[i, 0], J[i, 1] = normal_x, normal_y
    J[i, 2] = -normal_x * oy + normal_y * ox
    J[i, 3] = normal_x * odx + normal_y * ody
    J[i + 1, 0], J[i + 1, 1] = tx, ty
    J[i + 1, 2] = -tx * oy + ty * ox + radius
    J[i + 1, 3] = tx * odx + ty * ody + radius * place[FIRST, PAD_ANGLE]
    ax = -w * w * ox - 2.0 * w * n * ody + n * n * oddx
    ay = -w * w * oy + 2.0 * w * n * odx + n * n * oddy
    Jdot_v[i] = 0.5 * h * (normal_x * ax + normal_y * ay)
    Jdot_v[i + 1] = 0.5 * h * (tx * ax + ty * ay + radius * place[SECOND, PAD_ANGLE] * n * n)


@stage
def _travel(pose, middle, params):
    """Return the farthest that any pad has come since ``pose``, m, and update ``pose``.

    Conservative advancement: a pad that was farther from its plane cannot touch it yet.
    """
    x, y, theta, psi = middle
    far = abs(x - pose[0]) + abs(y - pose[1])
    far += params.pitch_arm * abs(theta - pose[2]) + params.crank_arm * abs(psi - pose[3])
    pose[0], pose[1], pose[2], pose[3] = x, y, theta, psi
    pose[TRAVEL] += (1.0 + 1e-6) * far
    return pose[TRAVEL]


@stage
def outruns(margin, h, state, params, model, work):
    """Whether the next step's middle has a pad more than ``margin`` from where planes were found.

    The bound on what pads have travelled nearly always shows that none has. It leaves out how far a
    step lifts sunken pads, at most PUSH_OUT_SPEED h.
    """
    travel = work.pose[TRAVEL] + h * (abs(state[4]) + abs(state[5]))
    travel += h * (params.pitch_arm * abs(state[6]) + params.crank_arm * abs(state[7]))
    if travel <= margin:
        return False
    listed, layout = work.listed, model.layout
    x, y = state[0] + 0.5 * h * state[4], state[1] + 0.5 * h * state[5]
    theta, psi = state[2] + 0.5 * h * state[6], state[3] + 0.5 * h * state[7]
    cos, sin = mathematics.cos(theta), mathematics.sin(theta)
    old_cos, old_sin = mathematics.cos(listed[2]), mathematics.sin(listed[2])
    sx, sy = centre_of_mass(model.body, params, psi)
    old_sx, old_sy = centre_of_mass(model.body, params, listed[3])
    for j in range(len(layout)):
        px, py = pad_place(model.pads, layout[j], psi)
        old_px, old_py = pad_place(model.pads, layout[j], listed[3])
        px, py, old_px, old_py = px - sx, py - sy, old_px - old_sx, old_py - old_sy
        far_x = x + cos * px - sin * py - listed[0] - old_cos * old_px + old_sin * old_py
        far_y = y + sin * px + cos * py - listed[1] - old_sin * old_px - old_cos * old_py
        if not far_x * far_x + far_y * far_y <= margin * margin:
            return True
    return False


@stage
def assemble(count, sided, params, inertia, planes, contacts):
    """J M^-1 and the Delassus matrix J M^-1 J^T, regularised; returns whether contacts are wedged.

    Pads that give are neither regularised nor wedged. ``sided``: whether a link's side touches,
    whose normal may point any way.
    """
    J, MJ, W = contacts.J, contacts.MJ, contacts.problem.W
    m = params.mass
    for i in range(2 * count):
        MJ[i, 0], MJ[i, 1] = J[i, 0] / m, J[i, 1] / m
        MJ[i, 2] = inertia.m11 * J[i, 2] + inertia.m12 * J[i, 3]
        MJ[i, 3] = inertia.m12 * J[i, 2] + inertia.m22 * J[i, 3]
        for j in range(i + 1):
            W[i, j] = (
                MJ[i, 0] * J[j, 0] + MJ[i, 1] * J[j, 1] + MJ[i, 2] * J[j, 2] + MJ[i, 3] * J[j, 3]
            )
            W[j, i] = W[i, j]
    wedged = False
    if count > 0 and not params.compliant:
        if sided or can_wedge(params):
            wedged = _wedged(count, contacts.plane, planes, params.friction)
        regularise(count, W, WEDGE_COMPLIANCE if wedged else COMPLIANCE)
    contacts.problem.indices[5 * count] = 0  # W is new
    return wedged


@stage
def add_dry_friction(h, count, torque, inertia, contacts):
    """Coulomb friction on the crank as one more contact, exact at standstill.

    Its tangential velocity is the crank's speed, its friction 1, and its normal row says that the
    normal impulse is ``h torque``, whatever else happens: u_n = W_nn (P_n - h torque) = 0.
    """
    J, MJ, problem = contacts.J, contacts.MJ, contacts.problem
    n, t = 2 * count, 2 * count + 1
    for i in range(4):
        J[n, i] = J[t, i] = MJ[n, i] = MJ[t, i] = 0.0
    J[t, 3], MJ[t, 2], MJ[t, 3] = 1.0, inertia.m12, inertia.m22
    for j in range(n):
        problem.W[n, j] = problem.W[j, n] = 0.0
        problem.W[t, j] = problem.W[j, t] = inertia.m12 * J[j, 2] + inertia.m22 * J[j, 3]
    problem.W[n, n] = problem.W[t, t] = inertia.m22
    problem.W[n, t] = problem.W[t, n] = 0.0
    problem.v_free[n] = -inertia.m22 * h * torque
    problem.mu[count], problem.mode[count] = 1.0, STICK
    problem.indices[5 * (count + 1)] = 0  # W is new


@stage
def can_wedge(params):
    """Whether slope + atan(friction) reaches 90 degrees somewhere."""
    return params.friction * params.steepest >= 1.0


@stage
def _wedged(count, plane, planes, friction):
    """Whether two contacts' friction cones hold opposite forces: n . n' <= -cos(2 atan(friction)).

    Then contacts can push on the ground with any force and no effect on the motion: bounces and
    the path's curvature would make it as large as the arithmetic allows, so they are left out.
    Contacts that hold opposite forces only through the linkage, or three at a time, are not seen
    here but by :func:`impulse_share`.
    """
    limit = (friction * friction - 1.0) / (friction * friction + 1.0)
    for c in range(count):
        for d in range(c):
            a, b = planes[plane[c]], planes[plane[d]]
            if a.normal_x * b.normal_x + a.normal_y * b.normal_y <= limit:
                return True
    return False


@stage
def impulse_share(count, free, inertia, params, contacts):
    """Return the contacts' impulses as a share of the largest that the step's motion explains.

    Impulses P of contacts that yield by a compliance s, and that neither bounce nor follow a curve,
    cannot add energy: P (W P + s P + J v) <= 0, v the velocity without contacts. With G = J^T P

        s |P|^2 <= -G v - G M^-1 G <= v M v / 4

    for any P, any W and any friction. Here s is that of wedged contacts, WEDGE_COMPLIANCE of W's
    mean diagonal; v holds the momentum before the step, weight and the motor's torque. The bound is
    infinite where the crank's speed is prescribed, as that is an unlimited momentum.
    """
    if count == 0 or params.prescribed_speed:
        return 0.0
    W, P = contacts.problem.W, contacts.problem.P
    trace, square = 0.0, 0.0
    for i in range(2 * count):
        trace += W[i, i]
        square += P[i] * P[i]
    determinant = inertia.m11 * inertia.m22 - inertia.m12 * inertia.m12
    w, n = free.pitch, free.crank
    turning = inertia.m22 * w * w - 2.0 * inertia.m12 * w * n + inertia.m11 * n * n
    momentum = params.mass * (free.x * free.x + free.y * free.y) + turning / determinant
    most = momentum * count / (2.0 * WEDGE_COMPLIANCE * trace)
    return np.sqrt(square / most) if square > 0.0 else 0.0


@stage
def correct_penetration(h, count, state, velocity, contacts):
    """Push penetrating pads out, moving positions only; returns the centre of mass's way (x, y).

    The smallest move in the metric of M (a few Gauss-Seidel sweeps), so nothing is sped up.
    """
    W, MJ, mode = contacts.problem.W, contacts.MJ, contacts.problem.mode
    wanted, push = contacts.problem.v_free, contacts.problem.rhs  # m, kg m: as work space
    needed = False
    for c in range(count):
        i = 2 * c
        depth = -(contacts.gap[c] + 0.5 * h * rate(contacts.J, i, velocity)) - PENETRATION_ALLOWED
        wanted[i] = min(CORRECTION_RATE * depth, PUSH_OUT_SPEED * h) if mode[c] != OPEN else -1.0
        needed = needed or wanted[i] > 0.0
        push[c] = 0.0
    if not needed:
        return 0.0, 0.0
    for _ in range(CORRECTION_SWEEPS):
        for c in range(count):
            missing = wanted[2 * c]
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
