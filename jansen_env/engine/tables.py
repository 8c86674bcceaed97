"""Tables of a compiled robot: how they are read, and the centre of mass and energy of a state.

The tables are those of :class:`jansen_env.dynamics.reduced.Tables`. All other values of a robot are
in its record :data:`jansen_env.engine.records.PROPERTIES`.
"""

from __future__ import annotations

import numpy as np

from jansen_env.engine import mathematics
from jansen_env.engine.kernel import Floats2, Floats4, kernel, stage
from jansen_env.engine.records import Robots

# Rows of the arrays that :func:`read_body` and :func:`read_pad` fill: value, first and second
# derivative with respect to the crank angle.
VALUE, FIRST, SECOND = range(3)
# Columns of these arrays: the sums over the bodies, and the functions of a pad.
C_X, C_Y, INERTIA, COUPLING, CRANK, DAMPING, OWN_COUPLING, OWN_CRANK = range(8)
PAD_X, PAD_Y, PAD_ANGLE = range(3)
POTENTIAL = 0  # the only function in the table of the springs


@stage
def locate(intervals, angle):
    """Find the interval of a table that contains an angle.

    Args:
        intervals: Number of intervals of the table.
        angle: Angle, in rad.

    Returns:
        The row of the interval, and the distance of the angle from its middle in rad.
    """
    width = 2.0 * np.pi / intervals
    reduced = angle - 2.0 * np.pi * mathematics.floor(angle / (2.0 * np.pi))
    # The limits keep the index inside the table even if the angle is NaN.
    row = max(0, min(int(reduced / width), intervals - 1))
    return row, reduced - (row + 0.5) * width


@stage
def _value(table, row, f, t):
    """Return the value of function ``f`` of a table of shape (intervals, 8, functions).

    ``row`` and ``t`` are the results of :func:`locate`.
    """
    c0, c1, c2, c3 = table[row, 0, f], table[row, 1, f], table[row, 2, f], table[row, 3, f]
    c4, c5, c6, c7 = table[row, 4, f], table[row, 5, f], table[row, 6, f], table[row, 7, f]
    return c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * (c5 + t * (c6 + t * c7))))))


@stage
def _first_two(table, row, t):
    """Return the values of the first two functions of a table, x and y."""
    x = y = 0.0
    for f in range(2):
        x, y = y, _value(table, row, f, t)
    return x, y


@stage
def _first(table, row, f, t):
    """Return the first derivative of function ``f`` of a table, see :func:`_value`."""
    c1, c2, c3 = table[row, 1, f], table[row, 2, f], table[row, 3, f]
    c4, c5, c6, c7 = table[row, 4, f], table[row, 5, f], table[row, 6, f], table[row, 7, f]
    return c1 + t * (
        2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * (5.0 * c5 + t * (6.0 * c6 + t * 7.0 * c7))))
    )


@stage
def _second(table, row, f, t):
    """Return the second derivative of function ``f`` of a table, see :func:`_value`."""
    c2, c3, c4 = table[row, 2, f], table[row, 3, f], table[row, 4, f]
    c5, c6, c7 = table[row, 5, f], table[row, 6, f], table[row, 7, f]
    return 2.0 * c2 + t * (
        6.0 * c3 + t * (12.0 * c4 + t * (20.0 * c5 + t * (30.0 * c6 + t * 42.0 * c7)))
    )


@stage(inline=False)
def read_body(body, psi, out):
    """Read the sums over the bodies and their derivatives at a crank angle.

    Args:
        body: Table of the body, shape (intervals, order, functions).
        psi: Crank angle, in rad.
        out: Output, shape (3, 6): values, first derivatives, and second derivatives. Only the
            second derivatives of c are set.
    """
    row, t = locate(body.shape[0], psi)
    for f in range(6):
        out[VALUE, f] = _value(body, row, f, t)
        out[FIRST, f] = _first(body, row, f, t)
    for f in (C_X, C_Y):
        out[SECOND, f] = _second(body, row, f, t)


@stage
def read_sums(body, properties, psi, out):
    """Read the sums over the bodies at a crank angle, scaled by the parameters of a robot.

    Args:
        body: Table of the body, shape (intervals, order, functions).
        properties: Physical properties of the robot.
        psi: Crank angle, in rad.
        out: Output, shape (3, 6), see :func:`read_body`.
    """
    read_body(body, psi, out)
    if properties.inertia_scale != 1.0:
        row, t = locate(body.shape[0], psi)
        more = properties.inertia_scale - 1.0
        out[VALUE, INERTIA] += more * properties.own_inertia
        for f in (COUPLING, CRANK):
            part = f + OWN_COUPLING - COUPLING
            out[VALUE, f] += more * _value(body, row, part, t)
            out[FIRST, f] += more * _first(body, row, part, t)
    if properties.mass_scale != 1.0:
        for f in (C_X, C_Y, INERTIA, COUPLING, CRANK):
            out[VALUE, f] *= properties.mass_scale
            out[FIRST, f] *= properties.mass_scale
        for f in (C_X, C_Y):
            out[SECOND, f] *= properties.mass_scale
    out[VALUE, DAMPING] *= properties.damping_scale
    out[FIRST, DAMPING] *= properties.damping_scale


@stage
def read_pad(pads, pad, psi, out):
    """Read the position of a pad in the chassis frame.

    Args:
        pads: Tables of the pads, shape (tables, intervals, order, 3).
        pad: The pad, a record of :data:`jansen_env.engine.records.PAD`.
        psi: Crank angle, in rad.
        out: Output, whose row ``VALUE`` gets the position in m.

    Returns:
        Row and distance for :func:`read_pad_motion`.
    """
    row, t = locate(pads.shape[1], pad.mirror * psi + pad.phase)
    for f in (PAD_X, PAD_Y):
        out[VALUE, f] = _value(pads[pad.table], row, f, t)
    out[VALUE, PAD_X] *= pad.mirror
    return row, t


@stage
def read_pad_motion(pads, pad, row, t, out):
    """Read the derivatives of the position and the angle of a pad.

    Args:
        pads: Tables of the pads, shape (tables, intervals, order, 3).
        pad: The pad, a record of :data:`jansen_env.engine.records.PAD`.
        row: Row that :func:`read_pad` returned.
        t: Distance that :func:`read_pad` returned, in rad.
        out: Output, whose rows ``FIRST`` and ``SECOND`` get the derivatives.
    """
    for f in range(3):
        out[FIRST, f] = _first(pads[pad.table], row, f, t)
        out[SECOND, f] = _second(pads[pad.table], row, f, t)
    out[FIRST, PAD_Y] *= pad.mirror
    out[SECOND, PAD_X] *= pad.mirror
    out[SECOND, PAD_ANGLE] *= pad.mirror


@stage(inline=False)
def pad_place(pads, pad, psi):
    """Return the position (x, y) of a pad in the chassis frame at a crank angle, in m."""
    row, t = locate(pads.shape[1], pad.mirror * psi + pad.phase)
    x, y = _first_two(pads[pad.table], row, t)
    return pad.mirror * x, y


@stage
def bearing_friction(bearings, psi):
    """Return the Coulomb friction torque of all bearings on the crank, in N m.

    Args:
        bearings: Torque at crank angles evenly spaced over a turn, in N m, shape (samples,). Values
            between the samples are interpolated linearly.
        psi: Crank angle, in rad.
    """
    count = len(bearings)
    place = psi / (2.0 * np.pi) * count
    whole = mathematics.floor(place)
    share = place - whole
    row = int(whole - count * mathematics.floor(whole / count))
    following = row + 1 if row + 1 < count else 0
    return (1.0 - share) * bearings[row] + share * bearings[following]


@stage
def spring_torque(springs, psi):
    """Return the torque of all springs on the crank, in N m.

    Args:
        springs: Table of the springs, shape (intervals, order, 1).
        psi: Crank angle, in rad.
    """
    row, t = locate(springs.shape[0], psi)
    return -_first(springs, row, POTENTIAL, t)


@stage
def spring_energy(springs, psi):
    """Return the energy of all springs, in J; see :func:`spring_torque`."""
    row, t = locate(springs.shape[0], psi)
    return _value(springs, row, POTENTIAL, t)


@stage
def centre_of_mass(body, properties, psi):
    """Return the centre of mass (x, y) of a robot, including its load, in m.

    Args:
        body: Table of the body, shape (intervals, order, functions).
        properties: Physical properties of the robot.
        psi: Crank angle, in rad.

    Returns:
        The position in the chassis frame.
    """
    row, t = locate(body.shape[0], psi)
    load, m = properties.load_mass, properties.mass
    x, y = _first_two(body, row, t)
    x, y = properties.mass_scale * x, properties.mass_scale * y
    return (x + load * properties.load_x) / m, (y + load * properties.load_y) / m


@stage(inline=False)
def to_centroid(body, properties, state, sign, sums):
    """Shift the reference point of a state between the crank axis and the centre of mass.

    The state of a robot with a fixed chassis does not change, because its equation of motion is
    about the crank axis.

    Args:
        body: Table of the body, shape (intervals, order, functions).
        properties: Physical properties of the robot.
        state: The state, shape (8,), changed in place.
        sign: 1 to shift the state to the centre of mass, -1 to shift it back to the crank axis.
        sums: Work space, shape (3, 6).
    """
    if properties.fixed_chassis:
        return
    read_sums(body, properties, state[3], sums)
    m = properties.mass
    sx = (sums[VALUE, C_X] + properties.load_mass * properties.load_x) / m
    sy = (sums[VALUE, C_Y] + properties.load_mass * properties.load_y) / m
    dx, dy = sums[FIRST, C_X] / m, sums[FIRST, C_Y] / m
    cos, sin = mathematics.cos(state[2]), mathematics.sin(state[2])
    w, n = state[6], state[7]
    rx, ry = cos * sx - sin * sy, sin * sx + cos * sy
    state[0] += sign * rx
    state[1] += sign * ry
    state[4] += sign * (-w * ry + n * (cos * dx - sin * dy))
    state[5] += sign * (w * rx + n * (sin * dx + cos * dy))


@stage(inline=False)
def mechanical_energy(body, springs, properties, state, sums):
    """Return the sum of kinetic and potential energy, in J.

    Args:
        body: Table of the body, shape (intervals, order, functions).
        springs: Table of the springs, shape (intervals, order, 1).
        properties: Physical properties of the robot.
        state: State of the crank axis, shape (8,). The potential energy of gravity is 0 at y = 0,
            and that of a spring is 0 at its rest length.
        sums: Work space, shape (3, 6).
    """
    read_sums(body, properties, state[3], sums)
    load, px, py = properties.load_mass, properties.load_x, properties.load_y
    cx, cy = sums[VALUE, C_X] + load * px, sums[VALUE, C_Y] + load * py
    inertia = sums[VALUE, INERTIA] + load * (px * px + py * py) + properties.load_inertia
    inertia += properties.rotor_pitch
    coupling = sums[VALUE, COUPLING] + properties.rotor_coupling
    crank = sums[VALUE, CRANK] + properties.rotor_crank
    cos, sin = mathematics.cos(state[2]), mathematics.sin(state[2])
    rx, ry = cos * cx - sin * cy, sin * cx + cos * cy
    sx, sy = sums[FIRST, C_X], sums[FIRST, C_Y]
    dx, dy = cos * sx - sin * sy, sin * sx + cos * sy
    vx, vy, w, n = state[4], state[5], state[6], state[7]
    kinetic = 0.5 * properties.mass * (vx * vx + vy * vy)
    kinetic += w * (-ry * vx + rx * vy) + n * (dx * vx + dy * vy)
    kinetic += 0.5 * inertia * w * w + coupling * w * n + 0.5 * crank * n * n
    if properties.sprung:
        kinetic += spring_energy(springs, state[3])
    gx, gy = properties.gravity_x, properties.gravity_y
    return kinetic + (
        -gx * (properties.mass * state[0] + rx) - gy * (properties.mass * state[1] + ry)
    )


@kernel
def energy(r: int, robots: Robots, body: Floats4, springs: Floats4, sums: Floats2) -> float:
    """Return the sum of kinetic and potential energy of a robot, in J.

    Args:
        r: Index of the robot.
        robots: Records of the robots.
        body: Tables of the body, shape (designs, intervals, order, functions).
        springs: Tables of the springs, shape (designs, intervals, order, 1).
        sums: Work space, shape (3, 6).
    """
    robot = robots[r]
    design = robot.properties.design
    return mechanical_energy(body[design], springs[design], robot.properties, robot.state, sums)
