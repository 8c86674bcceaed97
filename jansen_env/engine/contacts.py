"""Pads that touch the ground in a time step: Jacobian, Delassus matrix, and penetration.

Most stages share these arguments:

- ``h``: time step, in s.
- ``count``: number of contacts. Contact c has rows 2 c (normal) and 2 c + 1 (tangential).
- ``velocity``: generalised velocity, whose x and y are those of the centre of mass.
- ``properties``: parameters of the robot, see :data:`jansen_env.engine.records.PROPERTIES`.
- ``planes``: records ``PLANE`` of the contact planes.
- ``contacts``: a :class:`jansen_env.engine.records.Contacts`.
- ``turn``: cosine and sine of the pitch.
"""

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

PENETRATION_ALLOWED = 2e-5
"""Penetration, in m, that is not corrected, so that a resting contact does not flicker."""
CORRECTION_RATE = 0.2
"""Fraction of the remaining penetration that is corrected in each time step."""
CORRECTION_SWEEPS = 4
"""Number of Gauss-Seidel sweeps in a correction of the penetration."""
PUSH_OUT_SPEED = 1.0
"""Highest speed, in m/s, at which a pad is pushed out of the ground."""
TRAVEL = 4
"""Index in ``pose`` of the distance that the pads have travelled; the pose itself comes first."""


@stage
def find_contacts(h, middle, velocity, inertia, robot, model, planes, work):
    """Find the pads that touch the ground at the middle of a time step, and fill their rows.

    The rows hold the Jacobian J and the curvature of the pads' paths, (h / 2) J_dot v. Except in an
    impact, the contact law applies to the velocity at the end of the step including this curvature,
    J v + (h / 2) J_dot v. This keeps the position of a rolling or pivoting toe to second order.

    A compliant pad touches the ground if it does so at the beginning of the step, or would do so in
    the middle of the next step at this velocity. Its force law may look ahead up to this time.

    Args:
        h: Time step, in s.
        middle: Position (x, y) of the centre of mass in m, pitch and crank angle in rad, at the
            middle of the step.
        velocity: Generalised velocity at the beginning of the step.
        inertia: Inertia at the middle of the step.
        robot: The robot's record.
        model: Tables of the robot, a :class:`jansen_env.engine.records.Model`.
        planes: Contact planes of the robot.
        work: Memory of the robot, a :class:`jansen_env.engine.records.Work`; its contacts are
            filled.

    Returns:
        The number of contacts; whether a contact was open at the beginning of the step, which makes
        the step an impact; and whether a contact is on the side of a link.
    """
    x, y, theta, psi = middle
    turn = mathematics.cos(theta), mathematics.sin(theta)
    properties, contacts, place = robot.properties, work.contacts, work.place
    first = robot.status.first_plane
    travel = _travel(work.pose, middle, properties)
    count, impact, sided = 0, False, False
    reach = farthest_way(h, velocity, properties) if properties.compliant else 0.0
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
        distance = distance - plane.offset - properties.pad_radius
        work.bound[k - first] = travel + distance
        mode, plane.mode = plane.mode, STICK  # Guess that a contact which closes later will stick.
        if distance > reach:
            continue
        if plane.far_pad < 0:
            read_pad_motion(model.pads, pad, row, t, place)
        _fill_rows(h, count, plane, turn, (ox, oy), velocity, inertia, properties.pad_radius, work)
        half = 0.5 * h * rate(contacts.J, 2 * count, velocity)
        if properties.compliant and distance - half > 0.0 and distance + 2.0 * half > 0.0:
            continue
        if distance - half > 0.0:
            impact = True
        contacts.problem.mu[count] = properties.friction
        contacts.problem.mode[count] = mode
        contacts.plane[count], contacts.gap[count] = k, distance
        sided = sided or plane.far_pad >= 0
        count += 1
    return count, impact, sided


@stage(inline=False)
def _move_along_side(plane, turn, centroid, inertia, place, far):
    """Move a reading from the end of a side to the point of the side above the plane's vertex.

    The normal of the plane turns with the side.

    Args:
        plane: Contact plane of the side, changed in place.
        turn: Cosine and sine of the pitch.
        centroid: Position (x, y) of the centre of mass, in m.
        inertia: Inertia at the middle of the time step.
        place: Reading of the pad at one end of the side, changed in place, shape (3, 6).
        far: Reading of the pad at the other end, shape (3, 6).

    Returns:
        Whether the point lies between the ends of the side.
    """
    ex, ey = far[VALUE, PAD_X] - place[VALUE, PAD_X], far[VALUE, PAD_Y] - place[VALUE, PAD_Y]
    square = ex * ex + ey * ey
    along_x, along_y = _turned(turn, ex, ey)
    ox, oy = _turned(turn, place[VALUE, PAD_X] - inertia.s[0], place[VALUE, PAD_Y] - inertia.s[1])
    x, y = plane.vertex_x - centroid[0] - ox, plane.vertex_y - centroid[1] - oy
    fraction = (along_x * x + along_y * y) / square
    scale = 1.0 / np.sqrt(square)
    if along_x * plane.normal_y < along_y * plane.normal_x:
        scale = -scale
    plane.normal_x, plane.normal_y = -scale * along_y, scale * along_x
    for i in (FIRST, SECOND):
        across = ex * (far[i, PAD_Y] - place[i, PAD_Y]) - ey * (far[i, PAD_X] - place[i, PAD_X])
        place[i, PAD_ANGLE] = across / square
    for i in (VALUE, FIRST, SECOND):
        place[i, PAD_X] += fraction * (far[i, PAD_X] - place[i, PAD_X])
        place[i, PAD_Y] += fraction * (far[i, PAD_Y] - place[i, PAD_Y])
    return 0.0 < fraction < 1.0


@stage
def _turned(turn, x, y):
    """Return a vector of the chassis frame in the world frame."""
    cos, sin = turn
    return cos * x - sin * y, sin * x + cos * y


@stage
def farthest_way(h, velocity, properties):
    """Return an upper bound, in m, of the distance that any pad travels in a time step.

    Args:
        h: Time step, in s.
        velocity: Generalised velocity, whose x and y are those of the centre of mass.
        properties: Physical properties of the robot.
    """
    way = abs(velocity.x) + abs(velocity.y)
    way += properties.pitch_arm * abs(velocity.pitch) + properties.crank_arm * abs(velocity.crank)
    return (1.0 + 1e-6) * h * way


@stage
def rate(J, i, velocity):
    """Return the velocity along row ``i`` of the Jacobian: entry ``i`` of J v, in m/s."""
    return (
        J[i, 0] * velocity.x
        + J[i, 1] * velocity.y
        + J[i, 2] * velocity.pitch
        + J[i, 3] * velocity.crank
    )


@stage
def _fill_rows(h, count, plane, turn, arm, velocity, inertia, radius, work):
    """Fill the rows of a contact in J and (h / 2) J_dot v.

    ``arm`` is the vector from the centre of mass to the pad, in m.
    """
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
def _travel(pose, middle, properties):
    """Update ``pose``, and return an upper bound of the distance that any pad has travelled, in m.

    The distance counts from the first pose on. This is conservative advancement: a pad whose
    distance from a plane was larger cannot touch the plane yet.
    """
    x, y, theta, psi = middle
    far = abs(x - pose[0]) + abs(y - pose[1])
    far += properties.pitch_arm * abs(theta - pose[2]) + properties.crank_arm * abs(psi - pose[3])
    pose[0], pose[1], pose[2], pose[3] = x, y, theta, psi
    pose[TRAVEL] += (1.0 + 1e-6) * far
    return pose[TRAVEL]


@stage
def outruns(margin, h, state, properties, model, work):
    """Return whether a pad will be more than ``margin`` from where its planes were found.

    The position at the middle of the next time step counts. In most cases, the upper bound of the
    distance that the pads have travelled is sufficient to show that no pad is. The bound does
    not include the distance by which a time step lifts sunken pads, at most PUSH_OUT_SPEED h.

    Args:
        margin: Distance, in m.
        h: Time step, in s.
        state: State of the robot relative to the centre of mass, shape (8,).
        properties: Physical properties of the robot.
        model: Tables of the robot, a :class:`jansen_env.engine.records.Model`.
        work: Memory of the robot, a :class:`jansen_env.engine.records.Work`.
    """
    travel = work.pose[TRAVEL] + h * (abs(state[4]) + abs(state[5]))
    travel += h * (properties.pitch_arm * abs(state[6]) + properties.crank_arm * abs(state[7]))
    if travel <= margin:
        return False
    listed, layout = work.listed, model.layout
    x, y = state[0] + 0.5 * h * state[4], state[1] + 0.5 * h * state[5]
    theta, psi = state[2] + 0.5 * h * state[6], state[3] + 0.5 * h * state[7]
    cos, sin = mathematics.cos(theta), mathematics.sin(theta)
    old_cos, old_sin = mathematics.cos(listed[2]), mathematics.sin(listed[2])
    sx, sy = centre_of_mass(model.body, properties, psi)
    old_sx, old_sy = centre_of_mass(model.body, properties, listed[3])
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
def assemble(count, sided, properties, inertia, planes, contacts):
    """Compute J M^-1 and the Delassus matrix J M^-1 J^T, which is then regularised.

    Contacts of compliant pads are not regularised and never count as wedged.

    Args:
        count: Number of contacts.
        sided: Whether a contact is on the side of a link, whose normal can have any direction.
        properties: Physical properties of the robot.
        inertia: Inertia at the middle of the time step.
        planes: Contact planes.
        contacts: The contacts, changed in place.

    Returns:
        Whether contacts are wedged, see :func:`_wedged`.
    """
    J, MJ, W = contacts.J, contacts.MJ, contacts.problem.W
    m = properties.mass
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
    if count > 0 and not properties.compliant:
        if sided or can_wedge(properties):
            wedged = _wedged(count, contacts.plane, planes, properties.friction)
        regularise(count, W, WEDGE_COMPLIANCE if wedged else COMPLIANCE)
    contacts.problem.factored[0] = 0  # W is new, so the factors in A are invalid.
    return wedged


@stage
def add_dry_friction(h, count, torque, inertia, contacts):
    """Add the Coulomb friction on the crank as another contact, which is exact at standstill.

    The tangential velocity of this contact is the crank speed, and its friction coefficient is 1.
    Its normal row makes the normal impulse ``h torque`` in any case: u_n = W_nn (P_n - h torque) =
    0.

    Args:
        h: Time step, in s.
        count: Number of contacts with the ground.
        torque: Largest torque of the Coulomb friction, in N m.
        inertia: Inertia at the middle of the time step.
        contacts: The contacts, changed in place.
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
    problem.factored[0] = 0  # W is new, so the factors in A are invalid.


@stage
def can_wedge(properties):
    """Return whether slope + atan(friction) reaches 90 degrees anywhere on the terrain.

    Args:
        properties: Physical properties of the robot.
    """
    return properties.friction * properties.steepest >= 1.0


@stage
def _wedged(count, plane, planes, friction):
    """Return whether the friction cones of two contacts contain opposite forces.

    This is the case if n . n' <= -cos(2 atan(friction)). Such contacts can push against the ground
    with any force and without any effect on the motion. Bounces and the curvature of the path would
    make this force as large as the arithmetic allows, so both are left out. Contacts that hold
    opposite forces only through the linkage, or only three at a time, are not found here but by
    :func:`impulse_ratio`.
    """
    limit = (friction * friction - 1.0) / (friction * friction + 1.0)
    for c in range(count):
        for d in range(c):
            a, b = planes[plane[c]], planes[plane[d]]
            if a.normal_x * b.normal_x + a.normal_y * b.normal_y <= limit:
                return True
    return False


@stage
def impulse_ratio(count, free, inertia, properties, contacts):
    """Return the contact impulses as a fraction of the largest that the motion can explain.

    Consider impulses P of contacts that have a compliance s, do not bounce, and do not follow a
    curve. They cannot add energy: P (W P + s P + J v) <= 0, where v is the velocity without
    contacts. With G = J^T P, it follows that

        s |P|^2 <= -G v - G M^-1 G <= v M v / 4

    for any P, any W and any friction. Here s is the compliance of wedged contacts, WEDGE_COMPLIANCE
    times the mean of the diagonal of W. The velocity v contains the momentum before the step, the
    weight, and the torque of the motor. If the crank speed is prescribed, the bound is infinite,
    because the momentum is unlimited.

    Args:
        count: Number of contacts.
        free: Generalised velocity at the end of the step without contact impulses.
        inertia: Inertia at the middle of the time step.
        properties: Physical properties of the robot.
        contacts: The contacts and their impulses.
    """
    if count == 0 or properties.prescribed_speed:
        return 0.0
    W, P = contacts.problem.W, contacts.problem.P
    trace, square = 0.0, 0.0
    for i in range(2 * count):
        trace += W[i, i]
        square += P[i] * P[i]
    determinant = inertia.m11 * inertia.m22 - inertia.m12 * inertia.m12
    w, n = free.pitch, free.crank
    turning = inertia.m22 * w * w - 2.0 * inertia.m12 * w * n + inertia.m11 * n * n
    momentum = properties.mass * (free.x * free.x + free.y * free.y) + turning / determinant
    most = momentum * count / (2.0 * WEDGE_COMPLIANCE * trace)
    return np.sqrt(square / most) if square > 0.0 else 0.0


@stage
def correct_penetration(h, count, state, velocity, contacts):
    """Push penetrating pads out of the ground by changing positions only.

    The displacement is the smallest in the metric of M, found by a few Gauss-Seidel sweeps.
    Velocities do not change.

    Args:
        h: Time step, in s.
        count: Number of contacts.
        state: State of the robot relative to the centre of mass, changed in place, shape (8,).
        velocity: Generalised velocity at the end of the time step.
        contacts: The contacts.

    Returns:
        The displacement (x, y) of the centre of mass, in m.
    """
    W, MJ, mode = contacts.problem.W, contacts.MJ, contacts.problem.mode
    # Two arrays of the contact law serve as work space: for displacements in m, and for
    # displacements times mass in kg m.
    wanted, push = contacts.problem.v_free, contacts.problem.rhs
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
