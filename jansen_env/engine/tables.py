"""A compiled robot as the kernels see it: its tables, how they are read, and what a state means.

The tables are those of :class:`jansen_env.dynamics.reduced.Tables`. All other numbers of a robot
are its :data:`jansen_env.engine.records.PARAMS`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.reduced import Tables
from jansen_env.engine.jit import compiled, stage
from jansen_env.engine.records import PAD, PARAMS, Model
from jansen_env.robot import Compliance, Robot
from jansen_env.robot.links import plain_sum

# Rows of what :func:`read_body` and :func:`read_pad` fill: value, first and second derivative.
VALUE, FIRST, SECOND = range(3)
# Columns of the same: functions of the body's sums, and of a pad.
C_X, C_Y, INERTIA, COUPLING, CRANK, DAMPING, OWN_COUPLING, OWN_CRANK = range(8)
PAD_X, PAD_Y, PAD_ANGLE = range(3)
BOUND = 1.1  # what lies between the angles of the tables is less than so much larger


def kernel_model(tables: Tables) -> Model:
    """The kernels' view of one design, along a first axis of length 1."""
    layout = np.zeros(len(tables.layout.joint), PAD)
    legs = [tables.robot.legs[i] for i in tables.layout.leg]
    layout["table"] = tables.layout.joint
    layout["phase"] = [one.phase if one.side == "fore" else math.pi - one.phase for one in legs]
    layout["mirror"] = [1.0 if one.side == "fore" else -1.0 for one in legs]
    views = tables.body, tables.pads, layout, tables.bearings
    return Model(*(np.array([table]) for table in views))


def parameters(robot: Robot, gravity: tuple[float, float]) -> NDArray[np.void]:
    """(1,) PARAMS of a robot, its crank free, on level slippery ground.

    How far its pads get is not known yet, see :func:`set_arms`.
    """
    load = robot.payload
    row = np.zeros(1, PARAMS)
    row["mass"], row["load_mass"], row["load_inertia"] = robot.mass, load.mass, load.inertia
    row["own_inertia"] = len(robot.legs) * plain_sum(body.inertia for body in robot.bodies)
    row["mass_scale"] = row["inertia_scale"] = row["damping_scale"] = 1.0
    row["load_x"], row["load_y"] = load.position
    row["gravity_x"], row["gravity_y"] = gravity
    row["pad_radius"] = robot.pad_radius
    set_motor(row, robot)
    set_compliance(row, robot.pad_compliance)
    return row


def farthest(tables: Tables) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(2,) largest |c| and |c'|, kg m, of a robot without its load; (2,) of its pads' p, m."""
    centre, pads = tables.body[:, :2], tables.pads[:, :, :2]
    return (
        np.hypot(centre[..., 0], centre[..., 1]).max(axis=0),
        np.hypot(pads[..., 0], pads[..., 1]).max(axis=(0, 1)),
    )


def set_arms(rows: NDArray[np.void], centre: NDArray[np.float64], pad: NDArray[np.float64]) -> None:
    """Put how far pads get into PARAMS (k,) whose masses are known; (..., 2) :func:`farthest`."""
    scale, mass = rows["mass_scale"], rows["mass"]
    for k, name in enumerate(("pitch_arm", "crank_arm")):
        rows[name] = BOUND * (scale * centre[..., k] / mass + pad[..., k])
    rows["pitch_arm"] += rows["load_mass"] * np.hypot(rows["load_x"], rows["load_y"]) / mass


def set_motor(row: NDArray[np.void], robot: Robot) -> None:
    """Put a robot's motor, and whether there is dry friction, into its PARAMS (1,)."""
    motor = robot.motor
    J, G = motor.rotor_inertia, motor.gear_ratio
    row["rotor_pitch"], row["rotor_coupling"], row["rotor_crank"] = J, G * J, G * G * J
    row["stall_torque"], row["torque_slope"] = motor.stall_torque, motor.slope
    row["most_torque"] = motor.most_torque
    row["winding"], row["limited"] = motor.winding, motor.stall_torque < np.inf
    row["driving"], row["driven"] = 1.0 / motor.efficiency, motor.efficiency
    row["viscous_friction"], row["gear_friction"] = motor.viscous_friction, motor.friction
    row["dry"] = motor.friction > 0.0 or any(robot.bearing_friction)


def set_compliance(row: NDArray[np.void], pads: Compliance) -> None:
    """Put how the pads give into a robot's PARAMS (1,)."""
    row["compliant"] = not pads.rigid
    row["stiffness"] = pads.stiffness, pads.tangential_stiffness
    row["pad_damping"] = pads.damping, pads.tangential_damping


@stage
def locate(intervals, angle):
    """Row of a table at ``angle``, and the distance from the middle of its interval, rad."""
    width = 2.0 * np.pi / intervals
    reduced = angle - 2.0 * np.pi * np.floor(angle / (2.0 * np.pi))
    row = max(0, min(int(reduced / width), intervals - 1))  # a NaN would index anywhere
    return row, reduced - (row + 0.5) * width


@stage
def _value(table, row, f, t):
    """Taylor polynomial of function ``f`` of a table (intervals, 8, functions)."""
    c0, c1, c2, c3 = table[row, 0, f], table[row, 1, f], table[row, 2, f], table[row, 3, f]
    c4, c5, c6, c7 = table[row, 4, f], table[row, 5, f], table[row, 6, f], table[row, 7, f]
    return c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * (c5 + t * (c6 + t * c7))))))


@stage
def _first_two(table, row, t):
    """The first two functions of a table: x and y."""
    x = y = 0.0
    for f in range(2):
        x, y = y, _value(table, row, f, t)
    return x, y


@stage
def _first(table, row, f, t):
    """Its first derivative."""
    c1, c2, c3 = table[row, 1, f], table[row, 2, f], table[row, 3, f]
    c4, c5, c6, c7 = table[row, 4, f], table[row, 5, f], table[row, 6, f], table[row, 7, f]
    return c1 + t * (
        2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * (5.0 * c5 + t * (6.0 * c6 + t * 7.0 * c7))))
    )


@stage
def _second(table, row, f, t):
    """Its second derivative."""
    c2, c3, c4 = table[row, 2, f], table[row, 3, f], table[row, 4, f]
    c5, c6, c7 = table[row, 5, f], table[row, 6, f], table[row, 7, f]
    return 2.0 * c2 + t * (
        6.0 * c3 + t * (12.0 * c4 + t * (20.0 * c5 + t * (30.0 * c6 + t * 42.0 * c7)))
    )


@stage(inline=False)
def read_body(body, psi, out):
    """Values, first and (of c alone) second derivatives of the sums at an angle, into (3, 6)."""
    row, t = locate(body.shape[0], psi)
    for f in range(6):
        out[VALUE, f] = _value(body, row, f, t)
        out[FIRST, f] = _first(body, row, f, t)
    for f in (C_X, C_Y):
        out[SECOND, f] = _second(body, row, f, t)


@stage
def read_sums(body, params, psi, out):
    """The body's sums at a crank angle, into (3, 6), as a robot's scales have them."""
    read_body(body, psi, out)
    if params.inertia_scale != 1.0:
        row, t = locate(body.shape[0], psi)
        more = params.inertia_scale - 1.0
        out[VALUE, INERTIA] += more * params.own_inertia
        for f in (COUPLING, CRANK):
            own = f + OWN_COUPLING - COUPLING
            out[VALUE, f] += more * _value(body, row, own, t)
            out[FIRST, f] += more * _first(body, row, own, t)
    if params.mass_scale != 1.0:
        for f in (C_X, C_Y, INERTIA, COUPLING, CRANK):
            out[VALUE, f] *= params.mass_scale
            out[FIRST, f] *= params.mass_scale
        for f in (C_X, C_Y):
            out[SECOND, f] *= params.mass_scale
    out[VALUE, DAMPING] *= params.damping_scale
    out[FIRST, DAMPING] *= params.damping_scale


@stage
def read_pad(pads, pad, psi, out):
    """Place of a pad (chassis frame, m) into out[VALUE]; returns (row, t) for its motion."""
    row, t = locate(pads.shape[1], pad.mirror * psi + pad.phase)
    for f in (PAD_X, PAD_Y):
        out[VALUE, f] = _value(pads[pad.table], row, f, t)
    out[VALUE, PAD_X] *= pad.mirror
    return row, t


@stage
def read_pad_motion(pads, pad, row, t, out):
    """Derivatives of a pad's place and angle where it was read, into out[FIRST], out[SECOND]."""
    for f in range(3):
        out[FIRST, f] = _first(pads[pad.table], row, f, t)
        out[SECOND, f] = _second(pads[pad.table], row, f, t)
    out[FIRST, PAD_Y] *= pad.mirror
    out[SECOND, PAD_X] *= pad.mirror
    out[SECOND, PAD_ANGLE] *= pad.mirror


@stage(inline=False)
def pad_place(pads, pad, psi):
    """(x, y) of a pad in the chassis frame at a crank angle, m."""
    row, t = locate(pads.shape[1], pad.mirror * psi + pad.phase)
    x, y = _first_two(pads[pad.table], row, t)
    return pad.mirror * x, y


@stage
def bearing_friction(bearings, psi):
    """Coulomb friction torque of all bearings on the crank at a crank angle, N m, interpolated."""
    place = psi / (2.0 * np.pi) * len(bearings)
    whole = np.floor(place)
    share = place - whole
    row = int(whole % len(bearings))
    following = row + 1 if row + 1 < len(bearings) else 0
    return (1.0 - share) * bearings[row] + share * bearings[following]


@stage
def centre_of_mass(body, params, psi):
    """(x, y) of the centre of mass in the chassis frame at a crank angle, m, load included."""
    row, t = locate(body.shape[0], psi)
    load, m = params.load_mass, params.mass
    x, y = _first_two(body, row, t)
    x, y = params.mass_scale * x, params.mass_scale * y
    return (x + load * params.load_x) / m, (y + load * params.load_y) / m


@stage(inline=False)
def to_centroid(body, params, state, sign, sums):
    """Shift a state (8,) from the crank axis to the centre of mass (sign 1), or back (-1)."""
    read_sums(body, params, state[3], sums)
    m = params.mass
    sx = (sums[VALUE, C_X] + params.load_mass * params.load_x) / m
    sy = (sums[VALUE, C_Y] + params.load_mass * params.load_y) / m
    dx, dy = sums[FIRST, C_X] / m, sums[FIRST, C_Y] / m
    cos, sin = np.cos(state[2]), np.sin(state[2])
    w, n = state[6], state[7]
    rx, ry = cos * sx - sin * sy, sin * sx + cos * sy
    state[0] += sign * rx
    state[1] += sign * ry
    state[4] += sign * (-w * ry + n * (cos * dx - sin * dy))
    state[5] += sign * (w * rx + n * (sin * dx + cos * dy))


@stage(inline=False, cached=True)
def mechanical_energy(body, params, state, sums):
    """Kinetic plus potential energy of a crank-axis state, J; potential is 0 at y = 0."""
    read_sums(body, params, state[3], sums)
    load, px, py = params.load_mass, params.load_x, params.load_y
    cx, cy = sums[VALUE, C_X] + load * px, sums[VALUE, C_Y] + load * py
    inertia = sums[VALUE, INERTIA] + load * (px * px + py * py) + params.load_inertia
    inertia += params.rotor_pitch
    coupling = sums[VALUE, COUPLING] + params.rotor_coupling
    crank = sums[VALUE, CRANK] + params.rotor_crank
    cos, sin = np.cos(state[2]), np.sin(state[2])
    rx, ry = cos * cx - sin * cy, sin * cx + cos * cy
    sx, sy = sums[FIRST, C_X], sums[FIRST, C_Y]
    dx, dy = cos * sx - sin * sy, sin * sx + cos * sy
    vx, vy, w, n = state[4], state[5], state[6], state[7]
    kinetic = 0.5 * params.mass * (vx * vx + vy * vy)
    kinetic += w * (-ry * vx + rx * vy) + n * (dx * vx + dy * vy)
    kinetic += 0.5 * inertia * w * w + coupling * w * n + 0.5 * crank * n * n
    gx, gy = params.gravity_x, params.gravity_y
    return kinetic + (-gx * (params.mass * state[0] + rx) - gy * (params.mass * state[1] + ry))


@compiled
def energy(r, states, robots, body, sums):
    """:func:`mechanical_energy` of robot ``r``; ``sums`` (3, 6) is work space."""
    return mechanical_energy(body[robots[r].params.design], robots[r].params, states[r], sums)
