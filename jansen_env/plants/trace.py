"""Joint forces and touchdowns in every time step of a trace."""

from __future__ import annotations

import numpy as np

from jansen_env.arrays import Array, Bools, Rows
from jansen_env.dynamics.gravity import GRAVITY, Gravity
from jansen_env.dynamics.joint_forces import JointForces, joint_forces
from jansen_env.dynamics.reduced import Tables, body_sums


def trace_forces(
    tables: Tables, trace: Rows, time_step: float, gravity: Gravity = GRAVITY
) -> JointForces:
    """Return the mean joint forces in each time step of a trace of the projection backend.

    They are computed from the quantities that the time step itself balances: the positions at the
    middle of the time step, the change of the velocities over the time step, and the contact
    impulses divided by ``time_step``.

    Args:
        tables: Tables of the robot.
        trace: Traced time steps, shape (steps,); see
            :func:`jansen_env.engine.integrator.trace_dtype`.
        time_step: Time step of the integration, in s.
        gravity: Gravitational acceleration, in m/s^2: a number that acts downwards, or a vector
            (x, y).

    Raises:
        ValueError: If the trace has no rows.
    """
    if len(trace) == 0:
        raise ValueError("a trace must have rows, got none; set tracing to True before the step")
    pose = trace["pose"]
    before = trace["velocity_before"]
    after = trace["velocity_after"]
    speed = 0.5 * (before + after)
    acceleration = (after - before) / time_step
    q = pose.copy()
    q_dot = speed.copy()
    q_ddot = acceleration.copy()
    # Convert from the centre of mass Y to the crank axis X: Y = X + R s(psi), differentiated twice.
    sums = body_sums(tables, pose[:, 3])
    mass = tables.robot.mass
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])

    def turned(vector: Array) -> Array:
        x, y = vector[:, 0] / mass, vector[:, 1] / mass
        return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)

    def left(vector: Array) -> Array:
        return np.stack([-vector[:, 1], vector[:, 0]], axis=-1)

    s = turned(sums.c)
    ds = turned(sums.dc)
    dds = turned(sums.ddc)
    w = speed[:, 2:3]
    n = speed[:, 3:4]
    w_dot = acceleration[:, 2:3]
    n_dot = acceleration[:, 3:4]
    q[:, :2] -= s
    q_dot[:, :2] -= w * left(s) + n * ds
    q_ddot[:, :2] -= w_dot * left(s) - w * w * s + n_dot * ds + n * n * dds + 2 * w * n * left(ds)
    contact = trace["impulses"] / time_step
    dry = trace["dry_torque"] if "dry_torque" in (trace.dtype.names or ()) else 0.0
    return joint_forces(
        tables.robot, q, q_dot, contact=contact, q_ddot=q_ddot, dry=dry, gravity=gravity
    )


def find_touchdowns(trace: Rows, in_contact: Bools | None) -> Bools:
    """Return whether a pad touches down in each time step of a trace.

    A pad touches down if it is on the ground and was not on the ground one time step before.

    Args:
        trace: Traced time steps, shape (steps,).
        in_contact: Whether each pad was on the ground just before the trace, shape (pads,). If
            None, that is not known, and every pad on the ground in the first time step counts as
            touching down.

    Returns:
        The flags, shape (steps,).
    """
    now = pads_in_contact(trace)
    first = np.zeros_like(now[:1]) if in_contact is None else in_contact[None]
    return np.asarray((now & ~np.concatenate([first, now[:-1]])).any(axis=1))


def pads_in_contact(trace: Rows) -> Bools:
    """Return whether the ground pushed each pad in each time step, shape (steps, pads).

    Args:
        trace: Traced time steps, shape (steps,).
    """
    return np.asarray((trace["impulses"] != 0.0).any(axis=2))
