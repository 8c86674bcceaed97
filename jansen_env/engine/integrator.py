"""Time step of a robot, divided into stages that Numba compiles and that allocate no memory.

The state of a robot is (x, y, theta, psi, x_dot, y_dot, theta_dot, psi_dot), where x and y are the
position of the crank axis. Within a time step, the position is that of the centre of mass,
Y = X + R s(psi) with s = c / m. The mass matrix M is then block diagonal,

    kinetic energy = m |Y_dot|^2 / 2 + (I_s w^2 + 2 b_s w n + k_s n^2) / 2
    I_s = I - m |s|^2,  b_s = b - m s x s',  k_s = k - m |s'|^2         (w = theta_dot, n = psi_dot)

gravity acts on Y only, and in flight momentum is conserved to the last bit.

The time step is that of Moreau and Jean. All forces are evaluated at the middle of the step,
q + h v / 2. The speed-dependent terms use the mean of the old and the new velocity, in two passes.
The viscous joint torque uses this mean, too (implicit midpoint rule). Pads that touch the ground at
the middle of the step receive impulses P, such that the velocity at the end of the step obeys the
contact laws of Signorini and Coulomb. The method is of second order while the contacts do not
change.

If the chassis is fixed, only the equation of the crank remains, equation (12) of the paper, about
the crank axis: k psi'' + k' psi'^2 / 2 = torque - f psi' + gravity . R c' - V'. Such a robot
touches nothing.

The springs of the legs have the energy V(psi). Their torque -V' acts on the crank alone.
"""

from __future__ import annotations

import numpy as np

from jansen_env.engine import mathematics
from jansen_env.engine.accumulators import (
    accumulate_contacts,
    accumulate_step,
    begin,
    clear,
    end,
)
from jansen_env.engine.collision import (
    MARGIN,
    detect,
    links_in_ground,
    set_margin,
    sort_planes,
)
from jansen_env.engine.compliance import (
    accumulate_compliant,
    add_compliance,
    attach_bristles,
    begin_sides,
    keep_deflection,
    limit_springs,
)
from jansen_env.engine.contact_solver import OPEN, index_size, spare_space
from jansen_env.engine.contacts import TRAVEL, assemble, correct_penetration, find_contacts, outruns
from jansen_env.engine.kernel import (
    Floats1,
    Floats2,
    Floats3,
    Ints1,
    Ints2,
    fetch_add,
    kernel,
    stage,
)
from jansen_env.engine.records import (
    PLANE,
    Contacts,
    Designs,
    Ground,
    Inertia,
    Model,
    Motions,
    Problem,
    Push,
    Scratch,
    Velocity,
    Work,
)
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
    spring_torque,
    to_centroid,
)
from jansen_env.engine.velocities import solve_velocities

DIVERGED = 1e4
"""Speed, in m/s or rad/s, above which a state counts as diverged."""


def work_space(capacity: int, pads: int, steps: int) -> Scratch:
    """Return the memory that one thread needs to move robots.

    Args:
        capacity: Largest number of contacts that a robot may have at once.
        pads: Number of pads of a robot.
        steps: Number of time steps in a control step.
    """
    rows = capacity + 1  # The last row is for the Coulomb friction on the crank.
    n = 2 * rows
    return Scratch(
        jacobians=np.zeros((2, n, 4)),
        matrices=np.zeros((2, n, n)),
        vectors=np.zeros((12, n)),
        readings=np.zeros((3, 3, 6)),
        spare=spare_space(rows),
        ints=np.zeros(2 * rows + index_size(rows), np.int64),
        planes=np.zeros(capacity, PLANE),
        pushes=np.zeros((1, steps, 2)),
        pressed=np.zeros(steps),
        state=np.zeros(8),
        deflection=np.zeros((pads, 2)),
        flags=np.zeros(2, bool),
    )


def trace_dtype(pads: int) -> np.dtype[np.void]:
    """Return the record that :func:`advance` traces for each time step.

    The record consists of floats only. Its fields are the pose at the middle of the step; the
    velocities of the centre of mass before and after the step; the torque of the motor in N m; the
    torque of the Coulomb friction on the crank in N m; and, for each pad, the impulse in x and y
    and the angular impulse about the centre of the pad.

    Args:
        pads: Number of pads of the robot.
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
"""Positions of the fields of :func:`trace_dtype` in a row of the trace, counted in values."""


@kernel(nogil=True)
def advance(
    thread: int,
    queues: Ints2,
    most: int,
    rows: Ints1,
    steps: int,
    ahead: bool,
    torque: Floats1,
    earlier: Floats1,
    switch: Ints1,
    pushes: Floats3,
    trace: Floats2,
    scratch: Scratch,
    designs: Designs,
    motions: Motions,
) -> None:
    """Advance robots by some time steps, and find the ground below them on the way.

    The thread first advances the robots of its own queue, and then robots of other threads' queues.

    Args:
        thread: Number of the calling thread.
        queues: Robots of each thread, shape (threads + 1, 2): position in ``rows`` of the next
            robot, and of the end of the queue. The last row is for thread 0, after all other
            queues.
        most: Largest number of robots to advance in this call.
        rows: Indices of the robots, shape (k,).
        steps: Number of time steps.
        ahead: Whether to restore the states afterwards, so that the call only looks ahead.
        torque: Commanded crank torque, in N m, shape (robots,).
        earlier: Torque that still holds in the first time steps, in N m, shape (robots,).
        switch: Number of these first time steps, shape (robots,).
        pushes: Impulses on the chassis at the crank axis, in N s, shape (robots, steps, 2); without
            rows if there are none.
        trace: Trace of robot 0 with the values of :func:`trace_dtype`, shape (steps, values);
            without rows if there is none.
        scratch: Memory of the thread.
        designs: Tables of the designs, and grounds.
        motions: Records of the robots, changed in place.
    """
    work = split(scratch)
    far, diverged = False, False
    taken = 0
    known = len(queues) if thread == 0 else len(queues) - 1
    for offset in range(known):
        queue = queues[(thread + offset) % known]
        while taken < most:
            k = fetch_add(queue)
            if k >= queue[1]:
                break
            r = rows[k]
            commanded = torque[r], earlier[r], switch[r], pushes[r : r + 1]
            traced = trace if r == 0 else trace[:0]
            take_steps(r, steps, commanded, traced, work, scratch, designs, motions)
            robot = motions.robots[r]
            if ahead and not robot.status.waits:
                _go_back(robot, motions.statistics[r], scratch)
            far = far or has_moved(robot)
            diverged = diverged or robot.diverged
            taken += 1
    scratch.flags[0], scratch.flags[1] = far, diverged


@stage
def has_moved(robot):
    """Return whether a robot has moved by MARGIN since its part of the ground was determined.

    Args:
        robot: The robot's record.
    """
    return (
        not robot.properties.fixed_chassis
        and not abs(robot.state[0] - robot.status.ground_x) <= MARGIN
    )


@stage
def take_steps(r, steps, commanded, trace, work, scratch, designs, motions):
    """Advance robot ``r`` by time steps under commanded torques and pushes.

    The robot keeps its state, is marked as ``diverged``, and has no sums if it becomes faster than
    :data:`DIVERGED` or its state is no longer finite, if it leaves the part of the ground that is
    known, or if it sinks too deep into the ground.

    If the robot stands on shapes of pymunk, the function returns and sets ``waits`` whenever
    contact planes must be listed. The caller lists the planes in ``scratch.planes`` and stores
    their range in the status of the robot. The same call then continues the step.

    Args:
        r: Index of the robot.
        steps: Number of time steps.
        commanded: Torque, earlier torque, number of time steps with the earlier torque, and pushes;
            see :func:`advance`.
        trace: Trace, see :func:`advance`.
        work: Memory of the robot, see :func:`split`.
        scratch: Memory of the thread.
        designs: Tables of the designs, and grounds.
        motions: Records of the robots, changed in place.
    """
    robot, statistics, slip = motions.robots[r], motions.statistics[r], motions.slip[r]
    force, properties, status, state = (
        motions.contact_force[r],
        robot.properties,
        robot.status,
        robot.state,
    )
    design, world, planes = properties.design, designs.world[0], scratch.planes
    model = Model(
        designs.body[design],
        designs.pads[design],
        designs.layout[design],
        designs.bearings[design],
        designs.springs[design],
    )
    ground = Ground(designs.surface, designs.depths[design])
    if not status.waits:
        for i in range(8):
            scratch.state[i] = state[i]
        if properties.compliant:
            for j in range(len(statistics)):
                for i in range(2):
                    scratch.deflection[j, i] = statistics[j].deflection[i]
        begin(robot, state, statistics, model, work.sums)
    while status.step < steps:
        if status.on_shapes:
            if not status.waits:
                set_margin(state, robot, world.time_step)
                status.waits = True
                return
            status.waits = False
            sort_planes(status.first_plane, status.end_plane, planes)
            status.lost = status.too_deep
        elif not properties.fixed_chassis:
            on_stretch = detect(state, robot, model, ground, world, designs.sides, planes)
            status.lost = not on_stretch or status.too_deep
        if status.lost:
            break
        to_centroid(model.body, properties, state, 1.0, work.sums)
        _advance_robot(
            world,
            steps,
            commanded,
            state,
            robot,
            model,
            planes,
            statistics,
            work,
            trace,
            scratch.pressed,
        )
        to_centroid(model.body, properties, state, -1.0, work.sums)
    robot.diverged = status.lost
    if status.lost:
        _refuse(robot, statistics, slip, force, scratch)
        return
    end(robot, state, statistics, steps * world.time_step, slip, force, model, work.sums)
    if not properties.fixed_chassis and not status.on_shapes:
        robot.accumulators.links_in_ground = links_in_ground(
            state, status, model, ground, world.toes, designs.sides, work.bound
        )


@stage(inline=False)
def _refuse(robot, statistics, slip, force, scratch):
    """Restore a robot to its state before the control step, and clear its sums."""
    clear(robot.accumulators)
    _go_back(robot, statistics, scratch)
    for j in range(len(statistics)):
        pad = statistics[j]
        pad.slip = pad.impulse[0] = pad.impulse[1] = 0.0
    for j in range(len(slip)):
        slip[j] = force[j, 0] = force[j, 1] = 0.0
    for k in range(len(scratch.pressed)):
        scratch.pressed[k] = 0.0


@stage(inline=False)
def _go_back(robot, statistics, scratch):
    """Restore the state that a robot had at the beginning of the control step."""
    for i in range(8):
        robot.state[i] = scratch.state[i]
    if robot.properties.compliant:
        for j in range(len(statistics)):
            for i in range(2):
                statistics[j].deflection[i] = scratch.deflection[j, i]


@stage
def split(scratch):
    """Return the arrays of a :class:`jansen_env.engine.records.Work` within a thread's memory.

    Args:
        scratch: Memory of the thread from :func:`work_space`.
    """
    jacobians, matrices, vectors = scratch.jacobians, scratch.matrices, scratch.vectors
    readings, spare, ints = scratch.readings, scratch.spare, scratch.ints
    n = vectors.shape[1] // 2
    problem = Problem(
        matrices[0],
        vectors[0],
        vectors[1],
        ints[:n],
        vectors[2],
        vectors[3],
        matrices[1],
        vectors[4],
        ints[2 * n : 2 * n + 1],
        ints[2 * n + 1 : 3 * n + 1],
        ints[3 * n + 1 : 5 * n + 1],
        ints[5 * n + 1 : 7 * n + 1],
        ints[7 * n + 1 :],
        spare,
    )
    contacts = Contacts(
        jacobians[0],
        jacobians[1],
        vectors[5],
        vectors[6],
        vectors[8],
        vectors[9],
        vectors[10],
        vectors[11],
        ints[n : 2 * n],
        problem,
    )
    poses = readings[2]
    return Work(contacts, vectors[7], readings[0], readings[1], poses[0], poses[1])


@stage
def _advance_robot(
    world, steps, commanded, state, robot, model, planes, statistics, work, trace, pressed
):
    """Advance a robot by time steps for as long as its contact planes are valid.

    Args:
        world: Data that the robots have in common.
        steps: Number of time steps in the control step.
        commanded: Torques and pushes, see :func:`take_steps`.
        state: State of the robot relative to the centre of mass, changed in place, shape (8,).
        robot: The robot's record.
        model: Tables of the robot.
        planes: Contact planes.
        statistics: Sums of each pad, shape (pads,).
        work: Memory of the robot.
        trace: Trace, see :func:`advance`.
        pressed: Output, sum of the normal impulses of all contacts in each time step, in N s.
    """
    torque, earlier, switch, pushes = commanded
    status, h = robot.status, world.time_step
    begun, k = status.step, status.step
    stop = min(steps, begun + world.stride - begun % world.stride)
    for i in range(4):
        work.pose[i] = work.listed[i] = state[i]
    work.pose[TRAVEL] = 0.0
    for plane in range(status.end_plane - status.first_plane):
        work.bound[plane] = 0.0
    if robot.properties.compliant:
        attach_bristles(status, planes, statistics)
    while k < stop:
        if k > begun and outruns(status.margin, h, state, robot.properties, model, work):
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
            _trace(trace[k], state, robot.properties.pad_radius, count, planes, work.contacts)
        if k < len(pressed):  # A backend may be stepped for longer than a control step.
            pressed[k] = normal_impulse(count, work.contacts.problem)
        k += 1
        status.step = k
        if not _bounded(state):
            status.lost, status.step = True, steps
            break
    if robot.properties.compliant:
        keep_deflection(status, planes, statistics)


@stage
def normal_impulse(count, problem):
    """Return the sum of the normal impulses of all contacts in a time step, in N s.

    Args:
        count: Number of contacts.
        problem: Solved contact law of the time step.
    """
    total = 0.0
    for c in range(count):
        if problem.mode[c] != OPEN:
            total += problem.P[2 * c]
    return total


@stage
def _bounded(state):
    """Return whether all speeds of a state, shape (8,), are below :data:`DIVERGED`."""
    slow = abs(state[4]) < DIVERGED and abs(state[5]) < DIVERGED
    return slow and abs(state[6]) < DIVERGED and abs(state[7]) < DIVERGED


@stage
def _time_step(
    h, final_torque, torque, pushes, renewed, state, robot, model, planes, statistics, work
):
    """Advance one robot by one time step.

    Args:
        h: Time step, in s.
        final_torque: Commanded torque that holds at the end of the control step, in N m.
        torque: Commanded torque that holds in this time step, in N m.
        pushes: Impulses on the chassis, see :func:`advance`.
        renewed: Whether the contact planes have been found again since the last time step.
        state: State of the robot relative to the centre of mass, changed in place, shape (8,).
        robot: The robot's record.
        model: Tables of the robot.
        planes: Contact planes.
        statistics: Sums of each pad, shape (pads,).
        work: Memory of the robot.

    Returns:
        The number of contacts, the torque of the motor in N m, and the impulse of the Coulomb
        friction on the crank in N m s.
    """
    properties, contacts = robot.properties, work.contacts
    velocity = Velocity(state[4], state[5], state[6], state[7])
    x, y = state[0] + 0.5 * h * velocity.x, state[1] + 0.5 * h * velocity.y
    theta, psi = state[2] + 0.5 * h * velocity.pitch, state[3] + 0.5 * h * velocity.crank
    inertia = _read_inertia(h, properties, model.body, psi, work.sums)
    springs = spring_torque(model.springs, psi) if properties.sprung else 0.0
    weight, push = _weight(theta, springs, inertia, properties), Push(0.0, 0.0, 0.0, 0.0)
    if len(pushes) > 0 and not properties.fixed_chassis:
        push = _push(h, pushes[0, robot.status.step], theta, inertia, properties)
    count, impact, sided = find_contacts(
        h, (x, y, theta, psi), velocity, inertia, robot, model, planes, work
    )
    wedged = assemble(count, sided, properties, inertia, planes, contacts)
    if properties.compliant:
        if renewed:
            limit_springs(h, count, velocity, properties, planes, contacts, statistics)
        elif sided:
            begin_sides(h, count, velocity, properties, planes, contacts)
        add_compliance(h, count, velocity, properties, planes, contacts)
    friction = 0.0
    if properties.dry:
        friction = properties.gear_friction + bearing_friction(model.bearings, psi)
    outcome = solve_velocities(
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
    )
    after, torque, dry = outcome.end, outcome.torque, outcome.dry
    if properties.prescribed_speed:
        dry = -h * np.sign(velocity.crank) * friction
        torque = _crank_torque(h, weight, push, velocity, after, inertia, count, contacts) - dry / h
    accumulate_step(
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
        robot.accumulators,
    )
    state[0], state[1] = x + 0.5 * h * after.x, y + 0.5 * h * after.y
    state[2], state[3] = theta + 0.5 * h * after.pitch, psi + 0.5 * h * after.crank
    state[4], state[5], state[6], state[7] = after
    if properties.compliant:
        accumulate_compliant(
            h, renewed, count, velocity, after, properties, contacts, planes, robot, statistics
        )
    elif count > 0:
        total = robot.accumulators
        accumulate_contacts(h, count, velocity, after, contacts, planes, total, statistics)
        moved_x, moved_y = correct_penetration(h, count, state, after, contacts)
        lifted = properties.gravity_x * moved_x + properties.gravity_y * moved_y
        total.correction_work -= properties.mass * lifted
    return count, torque, dry


@stage
def _read_inertia(h, properties, body, psi, sums):
    """Return the inertia about the centre of mass, and its derivatives, at crank angle ``psi``."""
    read_sums(body, properties, psi, sums)
    m, load, px, py = properties.mass, properties.load_mass, properties.load_x, properties.load_y
    sx, sy = (sums[VALUE, C_X] + load * px) / m, (sums[VALUE, C_Y] + load * py) / m
    dx, dy = sums[FIRST, C_X] / m, sums[FIRST, C_Y] / m
    ddx, ddy = sums[SECOND, C_X] / m, sums[SECOND, C_Y] / m
    pitch = sums[VALUE, INERTIA] + load * (px * px + py * py) + properties.load_inertia
    pitch -= m * (sx * sx + sy * sy)
    pitch_slope = sums[FIRST, INERTIA] - 2.0 * m * (sx * dx + sy * dy)
    coupling = sums[VALUE, COUPLING] - m * (sx * dy - sy * dx)
    coupling_slope = sums[FIRST, COUPLING] - m * (sx * ddy - sy * ddx)
    crank, crank_slope = sums[VALUE, CRANK], sums[FIRST, CRANK]
    if not properties.fixed_chassis:
        crank -= m * (dx * dx + dy * dy)
        crank_slope -= 2.0 * m * (dx * ddx + dy * ddy)
    damping = sums[VALUE, DAMPING] + properties.viscous_friction
    pitch += properties.rotor_pitch
    coupling += properties.rotor_coupling
    crank += properties.rotor_crank
    crank_implicit = crank + 0.5 * h * damping
    determinant = pitch * crank_implicit - coupling * coupling
    m11, m12, m22 = crank_implicit / determinant, -coupling / determinant, pitch / determinant
    if properties.prescribed_speed:  # No force changes the crank speed.
        m11, m12, m22 = 1.0 / pitch, 0.0, 0.0
    if properties.fixed_chassis:  # No force changes the velocity of the chassis.
        m11, m12 = 0.0, 0.0
        m22 = 0.0 if properties.prescribed_speed else 1.0 / crank_implicit
    return Inertia(
        (sx, sy),
        (dx, dy),
        (ddx, ddy),
        pitch,
        pitch_slope,
        coupling,
        coupling_slope,
        crank,
        crank_slope,
        damping,
        m11,
        m12,
        m22,
    )


@stage
def _weight(theta, springs, inertia, properties):
    """Return gravity and the torque of the springs as a generalised force.

    Gravity acts on the centre of mass, or on the crank if the chassis is fixed.

    Args:
        theta: Pitch, in rad.
        springs: Torque of the springs on the crank, in N m.
        inertia: Inertia at the middle of the step.
        properties: Physical properties of the robot.
    """
    gx, gy = properties.gravity_x, properties.gravity_y
    if not properties.fixed_chassis:
        return Push(gx, gy, 0.0, springs)
    cos, sin = mathematics.cos(theta), mathematics.sin(theta)
    dx, dy = inertia.ds
    torque = properties.mass * (gx * (cos * dx - sin * dy) + gy * (sin * dx + cos * dy))
    return Push(0.0, 0.0, 0.0, torque + springs)


@stage
def _push(h, impulse, theta, inertia, properties):
    """Return the load of an impulse on the crank axis, in N s, shape (2,), during a time step.

    The velocity of the crank axis is V - w S R s - n R s'.
    """
    jx, jy = impulse[0] / h, impulse[1] / h
    cos, sin = mathematics.cos(theta), mathematics.sin(theta)
    (sx, sy), (dx, dy) = inertia.s, inertia.ds
    rx, ry = cos * sx - sin * sy, sin * sx + cos * sy
    pitch = ry * jx - rx * jy
    crank = -jx * (cos * dx - sin * dy) - jy * (sin * dx + cos * dy)
    return Push(jx / properties.mass, jy / properties.mass, pitch, crank)


@stage
def _crank_torque(h, weight, push, velocity, after, inertia, count, contacts):
    """Return the motor torque that a prescribed crank speed needs, in N m.

    This is the residual of the equation of motion of the crank.
    """
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
    """Complete a row of the trace after a time step."""
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
