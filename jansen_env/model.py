"""A compiled robot as the kernels see it, and how they read its tables."""

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
