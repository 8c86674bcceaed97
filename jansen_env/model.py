"""A compiled robot as the kernels see it: its tables, how they are read, and what a state means."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.compiling import compiled
from jansen_env.reduced import Tables

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Model(NamedTuple):
    """What a robot is, for the kernels: see :class:`jansen_env.reduced.Tables`."""

    body: Array  # (intervals, 6, order) c_x, c_y, I, b, k, f
    pads: Array  # (tables, intervals, 3, order) p_x, p_y, a
    pad_table: Ints  # (pads,)
    pad_phase: Array  # (pads,)
    pad_radius: float
    mass: float  # kg, payload included
    load: Array  # (4,) payload: mass, inertia, position x, y
    gravity: tuple[float, float]  # x, y, m/s^2
    driven: bool  # the crank keeps its speed, whatever torque that takes


def kernel_model(tables: Tables, gravity: tuple[float, float]) -> Model:
    """The kernels' view of a compiled robot; its crank is not driven."""
    robot, layout = tables.robot, tables.layout
    load = robot.payload
    return Model(
        tables.body,
        tables.pads,
        layout.table,
        layout.phase,
        robot.pad_radius,
        robot.mass,
        np.array([load.mass, load.inertia, *load.position]),
        gravity,
        False,
    )


@compiled(inline="always")
def locate(intervals, angle):
    """Row of a table at ``angle``, and the distance from the middle of its interval, rad."""
    width = 2.0 * np.pi / intervals
    reduced = angle - 2.0 * np.pi * np.floor(angle / (2.0 * np.pi))
    row = max(0, min(int(reduced / width), intervals - 1))  # a NaN would index anywhere
    return row, reduced - (row + 0.5) * width


@compiled(inline="always")
def taylor_value(c, t):
    """Taylor polynomial of eight coefficients at t."""
    return c[0] + t * (
        c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * (c[5] + t * (c[6] + t * c[7])))))
    )


@compiled(inline="always")
def taylor_slope(c, t):
    """Its first derivative."""
    return c[1] + t * (
        2.0 * c[2]
        + t * (3.0 * c[3] + t * (4.0 * c[4] + t * (5.0 * c[5] + t * (6.0 * c[6] + t * 7.0 * c[7]))))
    )


@compiled(inline="always")
def taylor_curve(c, t):
    """Its second derivative."""
    return 2.0 * c[2] + t * (
        6.0 * c[3] + t * (12.0 * c[4] + t * (20.0 * c[5] + t * (30.0 * c[6] + t * 42.0 * c[7])))
    )


@compiled(inline="always")
def centroid(model, psi):
    """s (2,), s' (2,): centre of mass from the crank axis in the chassis frame, and d/dpsi."""
    row, t = locate(model.body.shape[0], psi)
    cx, cy = model.body[row, 0], model.body[row, 1]
    return (
        (taylor_value(cx, t) + model.load[0] * model.load[2]) / model.mass,
        (taylor_value(cy, t) + model.load[0] * model.load[3]) / model.mass,
        taylor_slope(cx, t) / model.mass,
        taylor_slope(cy, t) / model.mass,
    )


@compiled
def to_centroid(model, state, sign):
    """Shift a state in place from the crank axis to the centre of mass (sign 1), or back (-1)."""
    sx, sy, dx, dy = centroid(model, state[3])
    cos, sin = np.cos(state[2]), np.sin(state[2])
    w, n = state[6], state[7]
    rx, ry = cos * sx - sin * sy, sin * sx + cos * sy
    state[0] += sign * rx
    state[1] += sign * ry
    state[4] += sign * (-w * ry + n * (cos * dx - sin * dy))
    state[5] += sign * (w * rx + n * (sin * dx + cos * dy))


@compiled
def mechanical_energy(model, state):
    """Kinetic and potential energy of a crank-axis state, J; potential is 0 at y = 0."""
    row, t = locate(model.body.shape[0], state[3])
    c = model.body[row]
    load, px, py = model.load[0], model.load[2], model.load[3]
    cx, cy = taylor_value(c[0], t) + load * px, taylor_value(c[1], t) + load * py
    inertia = taylor_value(c[2], t) + load * (px * px + py * py) + model.load[1]
    cos, sin = np.cos(state[2]), np.sin(state[2])
    rx, ry = cos * cx - sin * cy, sin * cx + cos * cy
    sx, sy = taylor_slope(c[0], t), taylor_slope(c[1], t)
    dx, dy = cos * sx - sin * sy, sin * sx + cos * sy
    vx, vy, w, n = state[4], state[5], state[6], state[7]
    kinetic = 0.5 * model.mass * (vx * vx + vy * vy)
    kinetic += w * (-ry * vx + rx * vy) + n * (dx * vx + dy * vy)
    kinetic += (
        0.5 * inertia * w * w + taylor_value(c[3], t) * w * n + 0.5 * taylor_value(c[4], t) * n * n
    )
    gx, gy = model.gravity
    return kinetic, -gx * (model.mass * state[0] + rx) - gy * (model.mass * state[1] + ry)


@compiled
def pad_positions(model, state, count, positions):
    """Centres of the first ``count`` pads of a crank-axis state, (pads, 2) m."""
    cos, sin = np.cos(state[2]), np.sin(state[2])
    for j in range(count):
        row, t = locate(model.pads.shape[1], state[3] + model.pad_phase[j])
        c = model.pads[model.pad_table[j], row]
        px, py = taylor_value(c[0], t), taylor_value(c[1], t)
        positions[j, 0] = state[0] + cos * px - sin * py
        positions[j, 1] = state[1] + sin * px + cos * py
