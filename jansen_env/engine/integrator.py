"""The time step of the free robot, in stages. Numba, no allocation.

State: (x, y, theta, psi, x_dot, y_dot, theta_dot, psi_dot), x, y the crank axis. Inside a step the
translation is the centre of mass's, Y = X + R s(psi) with s = c / m: then M is block diagonal,

    kinetic energy = m |Y_dot|^2 / 2 + (I_s w^2 + 2 b_s w n + k_s n^2) / 2
    I_s = I - m |s|^2,  b_s = b - m s x s',  k_s = k - m |s'|^2         (w = theta_dot, n = psi_dot)

gravity acts on Y alone, and momentum is conserved to the last bit in flight.

Time step (Moreau and Jean): everything is evaluated at the middle, q + h v / 2; the speed-dependent
terms use the mean of the old and the new velocity (two passes), the viscous joint torque too
(implicit midpoint); pads that touch at the middle get impulses P so that the velocity at the end of
the step obeys Signorini's and Coulomb's laws. Second order while the contacts stay as they are.

Of a held chassis the crank's equation alone remains, equation (12) of the paper, about the crank
axis: k psi'' + k' psi'^2 / 2 = torque - f psi' + gravity . R c'. Nothing touches it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine import mathematics
from jansen_env.engine.accumulators import accumulate_contacts, accumulate_step, begin, end
from jansen_env.engine.collision import MARGIN, detect, links_in_ground
from jansen_env.engine.compliance import (
    accumulate_compliant,
    add_compliance,
    attach_bristles,
    keep_deflection,
    limit_springs,
)
from jansen_env.engine.contact_solver import OPEN, index_size, spare_space
from jansen_env.engine.contacts import TRAVEL, assemble, correct_penetration, find_contacts, outruns
from jansen_env.engine.kernel import (
    Bools1,
    Floats1,
    Floats2,
    Floats3,
    Floats4,
    Floats5,
    Ints1,
    Ints2,
    fetch_add,
    kernel,
    stage,
)
from jansen_env.engine.records import (
    Contacts,
    Ground,
    Inertia,
    Layouts,
    Model,
    Planes,
    Problem,
    Push,
    Robots,
    Statistics,
    Velocity,
    Work,
    World,
)
from jansen_env.engine.restitution import solve_velocities
from jansen_env.engine.tables import (
    C_X,
    C_Y,
    COUPLING,
    CRANK,
    DAMPING,
    FIRST,
    INERTIA,
    SECOND,
    VALUE,
    bearing_friction,
    read_sums,
    to_centroid,
)

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

DIVERGED = 1e4  # a speed (m/s, rad/s) beyond which a state has diverged


def work_space(capacity: int) -> tuple[Array, Array, Array, Array, Array, Ints]:
    """Memory for up to ``capacity`` contacts of a robot at once, for :func:`advance`."""
    rows = capacity + 1  # the last one for the crank's Coulomb friction
    n = 2 * rows
    return (
        np.zeros((2, n, 4)), np.zeros((2, n, n)), np.zeros((12, n)), np.zeros((3, 3, 6)),
        spare_space(rows), np.zeros(2 * rows + index_size(rows), np.int64),
    )  # fmt: skip


def trace_dtype(pads: int) -> np.dtype[np.void]:
    """A time step as :func:`advance` traces it, numbers only.

    Pose at the middle of the step; velocities of the centre of mass; the motor's torque, N m, and
    the Coulomb friction's on the crank; x, y and moment impulse on each pad about its centre.
    """
    return np.dtype(
        [
            ("pose", "f8", 4),
            ("velocity_before", "f8", 4),
            ("velocity_after", "f8", 4),
            ("torque", "f8"),
            ("dry_torque", "f8"),
            ("impulses", "f8", (pads, 3)),
        ]
    )


POSE, VELOCITY_BEFORE, VELOCITY_AFTER, TORQUE, DRY_TORQUE, IMPULSES = (
    trace_dtype(1).fields[name][1] // 8  # type: ignore[index]
    for name in ("pose", "velocity_before", "velocity_after", "torque", "dry_torque", "impulses")
)


@kernel(nogil=True)
def advance(
    thread: int, shares: Ints2, most: int, rows: Ints1, steps: int, torque: Floats1,
    earlier: Floats1, switch: Ints1, pushes: Floats3, trace: Floats2, jacobians: Floats3,
    matrices: Floats3, vectors: Floats2, readings: Floats3, spare: Floats2, ints: Ints1,
    moved: Ints1, flags: Bools1, states: Floats2, body: Floats4, pads: Floats5, layout: Layouts,
    bearings: Floats2, sides: Ints2, surface: Floats2, depths: Floats2, world: World,
    robots: Robots, planes: Planes, statistics: Statistics, slip: Floats2, force: Floats3,
) -> int:  # fmt: skip
    """Advance robots by a control step, finding the ground as they go: a thread's, then others'.

    Args:
        thread: number of the one that calls. shares: (threads + 1, 2) the next of ``rows`` in each
            thread's share, and its end; the last one is for thread 0, when nothing else is left.
        most: robots to advance, no more.
        rows: (k,) of the robots. steps: time steps of the control step.
        torque: (robots,) crank torque asked for, N m. earlier: (robots,) the one before, which
            still holds in the first ``switch`` (robots,) time steps.
        pushes: (robots, steps, 2) N s on the chassis at the crank axis; without rows for none.
        trace: (steps, numbers) :func:`trace_dtype` of the first robot; without rows for none.
        jacobians ... ints: memory of :func:`work_space`. moved: (robots,) out: those that have
            taken all their steps. flags: (2,) out: whether a robot has moved by
            :data:`jansen_env.engine.collision.MARGIN`, and whether one has diverged.
        states: (robots, 8) crank-axis states, changed in place.
        body, pads, bearings: (designs, ...) of a :class:`jansen_env.engine.records.Model`.
        surface, depths: of a :class:`jansen_env.engine.records.Ground`, depths (designs, ...).
        layout: (designs, pads) PAD; sides: (sides, 2) pads at the ends of links' sides;
            world: (1,) WORLD; robots: (robots,) ROBOT; planes: (planes,) PLANE, of all robots;
            statistics: (robots, pads) CONTACT_STATISTICS. A robot faster than :data:`DIVERGED`,
            not finite, off its stretch of the ground or too deep in it stops, ``lost``.
        slip, force: out: (robots, toes) m, (robots, toes, 2) N, as CONTACT_STATISTICS has them.

    Returns how many are in ``moved``.
    """
    world_row = world[0]
    work = split(jacobians, matrices, vectors, readings, spare, ints)
    count, far, diverged = 0, False, False
    known = len(shares) if thread == 0 else len(shares) - 1
    for offset in range(known):
        share = shares[(thread + offset) % known]
        while count < most:
            k = fetch_add(share)
            if k >= share[1]:
                break
            r = rows[k]
            robot, state = robots[r], states[r]
            design = robot.params.design
            model = Model(body[design], pads[design], layout[design], bearings[design])
            ground = Ground(surface, depths[design])
            begin(robot, state, statistics[r], model.body, work.sums)
            asked = torque[r], earlier[r], switch[r], pushes[r : r + 1]
            traced, status = trace if r == 0 else trace[:0], robot.status
            while status.step < steps:
                if not robot.params.held:
                    on_stretch = detect(state, robot, model, ground, world_row, sides, planes)
                    status.lost = not on_stretch or status.too_deep
                if status.lost:
                    break
                to_centroid(model.body, robot.params, state, 1.0, work.sums)
                _advance_robot(
                    world_row, steps, asked, state, robot, model, planes, statistics[r], work,
                    traced,
                )  # fmt: skip
                to_centroid(model.body, robot.params, state, -1.0, work.sums)
            if status.lost:
                diverged = True
            else:
                elapsed = steps * world_row.time_step
                end(robot, state, statistics[r], elapsed, slip[r], force[r], model.body, work.sums)
                if not robot.params.held:
                    robot.accumulators.links_in_ground = links_in_ground(
                        state, robot.status, model, ground, world_row.toes, sides, work.bound
                    )
                moved[count] = r
                count += 1
            if not robot.params.held:
                far = far or not abs(state[0] - status.asked_x) <= MARGIN
    flags[0], flags[1] = far, diverged
    return count


@stage
def split(jacobians, matrices, vectors, readings, spare, ints):
    """The arrays in the memory of :func:`work_space`."""
    n = vectors.shape[1] // 2
    problem = Problem(
        matrices[0], vectors[0], vectors[1], ints[:n], vectors[2], vectors[3], matrices[1],
        vectors[4], ints[2 * n :], spare,
    )  # fmt: skip
    contacts = Contacts(
        jacobians[0], jacobians[1], vectors[5], vectors[6], vectors[8], vectors[9], vectors[10],
        vectors[11], ints[n : 2 * n], problem,
    )  # fmt: skip
    poses = readings[2]
    return Work(contacts, vectors[7], readings[0], readings[1], poses[0], poses[1])


@stage
def _advance_robot(world, steps, asked, state, robot, model, planes, statistics, work, trace):
    """Take a robot's steps, as far as its planes go; ``state`` is that of the centre of mass."""
    torque, earlier, switch, pushes = asked
    status, h = robot.status, world.time_step
    begun, k = status.step, status.step
    stop = min(steps, begun + world.stride - begun % world.stride)
    for i in range(4):
        work.pose[i] = work.listed[i] = state[i]
    work.pose[TRAVEL] = 0.0
    for plane in range(status.end_plane - status.first_plane):
        work.bound[plane] = 0.0
    if robot.params.compliant:
        attach_bristles(status, planes, statistics)
    while k < stop:
        if k > begun and outruns(status.margin, h, state, robot.params, model, work):
            break
        if len(trace) > 0:
            for i in range(4):
                trace[k, POSE + i] = state[i] + 0.5 * h * state[4 + i]
                trace[k, VELOCITY_BEFORE + i] = state[4 + i]
        now = earlier if k < switch else torque
        count, used, dry = _time_step(
            h, torque, now, pushes, k == begun, state, robot, model, planes, statistics, work
        )
        if len(trace) > 0:
            trace[k, TORQUE], trace[k, DRY_TORQUE] = used, dry / h
            _trace(trace[k], state, robot.params.pad_radius, count, planes, work.contacts)
        k += 1
        status.step = k
        if not _bounded(state):
            status.lost, status.step = True, steps
            break
    if robot.params.compliant:
        keep_deflection(status, planes, statistics)


@stage
def _bounded(state):
    """Whether all speeds of a state (8,) are below :data:`DIVERGED`, m/s and rad/s."""
    slow = abs(state[4]) < DIVERGED and abs(state[5]) < DIVERGED
    return slow and abs(state[6]) < DIVERGED and abs(state[7]) < DIVERGED


@stage
def _time_step(h, asked, torque, pushes, renewed, state, robot, model, planes, statistics, work):
    """One time step of one robot with a ``torque``, while ``asked`` is the latest.

    Returns (pads that touched, torque of the motor, impulse of the crank's dry friction, N m s).
    """
    params, contacts = robot.params, work.contacts
    velocity = Velocity(state[4], state[5], state[6], state[7])
    x, y = state[0] + 0.5 * h * velocity.x, state[1] + 0.5 * h * velocity.y
    theta, psi = state[2] + 0.5 * h * velocity.pitch, state[3] + 0.5 * h * velocity.crank
    inertia = _read_inertia(h, params, model.body, psi, work.sums)
    weight, push = _weight(theta, inertia, params), Push(0.0, 0.0, 0.0, 0.0)
    if len(pushes) > 0 and not params.held:
        push = _push(h, pushes[0, robot.status.step], theta, inertia, params)
    count, impact = find_contacts(
        h, (x, y, theta, psi), velocity, inertia, robot, model, planes, work
    )
    wedged = assemble(count, params, inertia, planes, contacts)
    if params.compliant:
        if renewed:
            limit_springs(h, count, velocity, params, planes, contacts, statistics)
        add_compliance(h, count, velocity, params, planes, contacts)
    friction = 0.0
    if params.dry:
        friction = params.gear_friction + bearing_friction(model.bearings, psi)
    outcome = solve_velocities(
        h, torque, friction, weight, push, velocity, inertia, params, count, impact, wedged,
        contacts,
    )  # fmt: skip
    after, torque, dry = outcome.end, outcome.torque, outcome.dry
    if params.prescribed_speed:
        dry = -h * np.sign(velocity.crank) * friction
        torque = _crank_torque(h, weight, push, velocity, after, inertia, count, contacts) - dry / h
    accumulate_step(
        h, torque, asked, dry, push, velocity, outcome, inertia, count, params, contacts,
        robot.accumulators,
    )  # fmt: skip
    state[0], state[1] = x + 0.5 * h * after.x, y + 0.5 * h * after.y
    state[2], state[3] = theta + 0.5 * h * after.pitch, psi + 0.5 * h * after.crank
    state[4], state[5], state[6], state[7] = after
    if params.compliant:
        accumulate_compliant(
            h, renewed, count, velocity, after, params, contacts, planes, robot, statistics
        )
    elif count > 0:
        total = robot.accumulators
        accumulate_contacts(h, count, velocity, after, contacts, planes, total, statistics)
        moved_x, moved_y = correct_penetration(h, count, state, after, contacts)
        lifted = params.gravity_x * moved_x + params.gravity_y * moved_y
        total.correction_work -= params.mass * lifted
    return count, torque, dry


@stage
def _read_inertia(h, params, body, psi, sums):
    """The inertia about the centre of mass, and its slopes, at a crank angle."""
    read_sums(body, params, psi, sums)
    m, load, px, py = params.mass, params.load_mass, params.load_x, params.load_y
    sx, sy = (sums[VALUE, C_X] + load * px) / m, (sums[VALUE, C_Y] + load * py) / m
    dx, dy = sums[FIRST, C_X] / m, sums[FIRST, C_Y] / m
    ddx, ddy = sums[SECOND, C_X] / m, sums[SECOND, C_Y] / m
    pitch = sums[VALUE, INERTIA] + load * (px * px + py * py) + params.load_inertia
    pitch -= m * (sx * sx + sy * sy)
    pitch_slope = sums[FIRST, INERTIA] - 2.0 * m * (sx * dx + sy * dy)
    coupling = sums[VALUE, COUPLING] - m * (sx * dy - sy * dx)
    coupling_slope = sums[FIRST, COUPLING] - m * (sx * ddy - sy * ddx)
    crank, crank_slope = sums[VALUE, CRANK], sums[FIRST, CRANK]
    if not params.held:
        crank -= m * (dx * dx + dy * dy)
        crank_slope -= 2.0 * m * (dx * ddx + dy * ddy)
    damping = sums[VALUE, DAMPING] + params.viscous_friction
    pitch += params.rotor_pitch
    coupling += params.rotor_coupling
    crank += params.rotor_crank
    crank_implicit = crank + 0.5 * h * damping
    determinant = pitch * crank_implicit - coupling * coupling
    m11, m12, m22 = crank_implicit / determinant, -coupling / determinant, pitch / determinant
    if params.prescribed_speed:  # nothing that acts on the robot changes the crank's speed
        m11, m12, m22 = 1.0 / pitch, 0.0, 0.0
    if params.held:  # nothing changes the chassis' speed
        m11, m12 = 0.0, 0.0
        m22 = 0.0 if params.prescribed_speed else 1.0 / crank_implicit
    return Inertia(
        (sx, sy), (dx, dy), (ddx, ddy), pitch, pitch_slope, coupling, coupling_slope, crank,
        crank_slope, damping, m11, m12, m22,
    )  # fmt: skip


@stage
def _weight(theta, inertia, params):
    """Gravity's force: on the centre of mass, or on the crank of a held chassis."""
    gx, gy = params.gravity_x, params.gravity_y
    if not params.held:
        return Push(gx, gy, 0.0, 0.0)
    cos, sin = mathematics.cos(theta), mathematics.sin(theta)
    dx, dy = inertia.ds
    torque = params.mass * (gx * (cos * dx - sin * dy) + gy * (sin * dx + cos * dy))
    return Push(0.0, 0.0, 0.0, torque)


@stage
def _push(h, impulse, theta, inertia, params):
    """An impulse (2,), N s, on the crank axis, whose velocity is V - w S R s - n R s'."""
    jx, jy = impulse[0] / h, impulse[1] / h
    cos, sin = mathematics.cos(theta), mathematics.sin(theta)
    (sx, sy), (dx, dy) = inertia.s, inertia.ds
    rx, ry = cos * sx - sin * sy, sin * sx + cos * sy
    pitch = ry * jx - rx * jy
    crank = -jx * (cos * dx - sin * dy) - jy * (sin * dx + cos * dy)
    return Push(jx / params.mass, jy / params.mass, pitch, crank)


@stage
def _crank_torque(h, weight, push, velocity, after, inertia, count, contacts):
    """The torque that a prescribed crank speed takes: what is left over in the crank's equation."""
    mean, mw = 0.5 * (velocity.crank + after.crank), 0.5 * (velocity.pitch + after.pitch)
    coupled = inertia.coupling * (after.pitch - velocity.pitch)
    torque = (coupled + inertia.crank * (after.crank - velocity.crank)) / h
    torque = torque + inertia.damping * mean - push.crank - weight.crank
    torque -= 0.5 * mw * mw * inertia.pitch_slope - 0.5 * mean * mean * inertia.crank_slope
    for i in range(2 * count):
        torque -= contacts.J[i, 3] * contacts.problem.P[i] / h
    return torque


@stage
def _trace(row, state, radius, count, planes, contacts):
    """Complete a row of the trace after a step."""
    for i in range(4):
        row[VELOCITY_AFTER + i] = state[4 + i]
    for i in range(IMPULSES, len(row)):
        row[i] = 0.0
    P = contacts.problem.P
    for c in range(count):
        if contacts.problem.mode[c] == OPEN:
            continue
        plane = planes[contacts.plane[c]]
        at = IMPULSES + 3 * plane.pad
        normal, tangential = P[2 * c], P[2 * c + 1]
        row[at] += normal * plane.normal_x + tangential * plane.normal_y
        row[at + 1] += normal * plane.normal_y - tangential * plane.normal_x
        row[at + 2] += tangential * radius
