"""The paper's dynamics, dense and equation by equation: the reference everything else is held to.

*Dynamic Analysis and Modeling of Jansen Mechanism* (projection method). Equation numbers are the
paper's; where its print cannot be meant, the reading is the one of ``docs/paper.md``. A leg has 24
coordinates (1), three a body: theta_i, x_i, y_i. Subscripts: f forepaw, b backpaw; the backpaw's
equations differ from the forepaw's in the sign of alpha_4, gamma_4 and alpha_8 alone.

Shapes, of Jansen's leg (another linkage has three coordinates a body and two constraints a pin):
x, x_dot (24,); Phi (20,); C (20, 24); D (24, 4), all with any number of leading axes (legs,
instants); n legs stacked: X (..., 24 n).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Array, Ints
from jansen_env.engine.mathematics import directions
from jansen_env.gravity import GRAVITY, Gravity, gravity_vector
from jansen_env.robot import Robot, Side
from jansen_env.robot.kinematics import coordinates
from jansen_env.robot.linkage import FRAME, INDEPENDENT

DOF = INDEPENDENT  # theta_1, x_1, y_1, theta_2: the tangent speed of (5)
PINNING_ROWS = [1, 2, 0]  # of the first leg: axis x, axis y, theta_1, in the paper's order


Sides = Side | tuple[Side, ...]
"""One side for all legs, or one for each along the last axis but one of x (..., legs, 24)."""


class _Rows(NamedTuple):
    """The vector equations of Phi_hf (forepaw) or Phi_hb (backpaw), one a pin, in its order.

    A pin is where its joint is by either body: x_body + c (cos, sin)(theta_body + o), see
    :data:`jansen_env.robot.links.Corners`, less the same of the other. Each of a leg's terms (m,)
    is in two rows, that of y being ``row + 1``.
    """

    row: Ints
    column: Ints
    coefficient: Array
    offset: Array  # (m,), or (legs, m): the only thing in which the sides differ
    translations: Array  # (20, 24) the constant part of C


@functools.lru_cache(maxsize=64)
def _rows(robot: Robot, side: Sides) -> _Rows:
    if isinstance(side, tuple):
        legs = [_rows(robot, each) for each in side]
        return legs[0]._replace(offset=np.stack([leg.offset for leg in legs]))
    mirror = 1.0 if side == "fore" else -1.0
    pins, terms = robot.linkage.pins, []
    translations = np.zeros((2 * len(pins), 3 * len(robot.bodies)))
    for i, (joint, body, other) in enumerate(pins):
        for each, sign in ((other, -1.0), (body, 1.0)):
            joints = robot.linkage.bodies[each - 1][1]
            reach, offset = robot.bodies[each - 1].corners[joints.index(joint)]
            terms.append((2 * i, 3 * (each - 1), sign * reach, mirror * offset))
            for axis in (0, 1):
                translations[2 * i + axis, 3 * (each - 1) + 1 + axis] = sign
    row, column, coefficient, offset = np.array(terms).T
    return _Rows(row.astype(int), column.astype(int), coefficient, offset, translations)


def constraints(robot: Robot, side: Sides, x: Array) -> Array:
    """Phi_hf or Phi_hb (..., 20), m: the holonomic constraints before (3), of x (..., 24)."""
    rows = _rows(robot, side)
    angle = x[..., rows.column] + rows.offset
    turning = np.zeros((len(rows.row), len(rows.translations) // 2))
    turning[np.arange(len(rows.row)), rows.row // 2] = rows.coefficient
    phi = x @ rows.translations.T
    phi[..., 0::2] += np.cos(angle) @ turning
    phi[..., 1::2] += np.sin(angle) @ turning
    return phi


def constraint_matrix(robot: Robot, side: Sides, x: Array) -> Array:
    """C = dPhi/dx (..., 20, 24), eq. (3); printed with d x_dot, which C x_dot = 0 rules out."""
    rows = _rows(robot, side)
    angle = x[..., rows.column] + rows.offset
    C = np.empty((*x.shape[:-1], *rows.translations.shape))
    C[...] = rows.translations
    C[..., rows.row, rows.column] = -rows.coefficient * np.sin(angle)
    C[..., rows.row + 1, rows.column] = rows.coefficient * np.cos(angle)
    return C


def constraint_matrix_rate(robot: Robot, side: Sides, x: Array, x_dot: Array) -> Array:
    """C_dot (..., 20, 24): the time derivative of :func:`constraint_matrix` along x_dot."""
    rows = _rows(robot, side)
    angle, rate = x[..., rows.column] + rows.offset, x_dot[..., rows.column]
    C_dot = np.zeros((*x.shape[:-1], *rows.translations.shape))
    C_dot[..., rows.row, rows.column] = -rows.coefficient * np.cos(angle) * rate
    C_dot[..., rows.row + 1, rows.column] = -rows.coefficient * np.sin(angle) * rate
    return C_dot


def orthogonal_complement(C: Array, dof: int) -> Array:
    """D = [1; -C_2^-1 C_1] (..., n, dof) of C (..., r, n): the paper's partition before (5)."""
    return _below(np.eye(dof), -np.linalg.solve(C[..., dof:], C[..., :dof]))


def orthogonal_complement_rate(C: Array, C_dot: Array, D: Array) -> Array:
    """D_dot (..., n, dof), from C_dot D + C D_dot = 0; its independent rows are constant."""
    dof = D.shape[-1]
    return _below(np.zeros((dof, dof)), -np.linalg.solve(C[..., dof:], C_dot @ D))


def _below(head: Array, lower: NDArray[Any]) -> Array:
    """The rows of ``head`` over those of each matrix ``lower``."""
    return np.concatenate([np.broadcast_to(head, (*lower.shape[:-2], *head.shape)), lower], axis=-2)


def times(A: Array, v: Array) -> Array:
    """A v for matrices (..., m, n) and vectors (..., n)."""
    return (A @ v[..., None])[..., 0]


def masses(robot: Robot) -> Array:
    """The diagonal of M_f: J_1, m_1, m_1, ... (24,), eq. (2)."""
    return np.array([v for body in robot.bodies for v in (body.inertia, body.mass, body.mass)])


def forces(robot: Robot, x_dot: Array, torque: float | Array, gravity: Gravity = GRAVITY) -> Array:
    """h_f (..., 24), eq. (2): motor torque (crank +, frame -), weights, viscous joint torques.

    ``torque`` (N m, a number or (...)): one motor drives the shaft, so it enters one leg only.
    """
    h = np.zeros(x_dot.shape)
    for axis, pull in enumerate(gravity_vector(gravity), start=1):
        h[..., axis::3] = [body.mass * pull for body in robot.bodies]
    h[..., 0] -= torque
    h[..., 3] += torque
    for (i, j), coefficient in zip(robot.linkage.damped, robot.damping, strict=True):
        moment = coefficient * (x_dot[..., 3 * (j - 1)] - x_dot[..., 3 * (i - 1)])
        h[..., 3 * (i - 1)] += moment
        h[..., 3 * (j - 1)] -= moment
    return h


# The system: n legs on one crank shaft. Coordinates Q (..., 4 n): theta_1, x_1, y_1, theta_2 a leg.
# By each leg the chassis has the pose g = (theta_1 - its level value, crank axis x, y, theta_2 -
# its phase). The tying rows demand the same g of all legs, the pinning rows g = (0, 0, 0, any).


def system_constraints(robot: Robot, Q: Array, fixed_base: bool = True) -> Array:
    """System Phi_h: 3 rows that pin the first frame (if ``fixed_base``), 4 that tie each other leg.

    Every leg is tied to the first one; the paper ties lb to lf, which spans the same rows. Rows 9
    and 10 are read as rf against lf (``docs/paper.md``).
    """
    q = _by_leg(Q)
    g = q.copy()
    g[..., 0] -= [frame_angle(robot, leg.side) for leg in robot.legs]
    reach, turn = axis_on_frame(robot)
    g[..., 1:3] += reach * directions(q[..., 0] + turn)
    g[..., 3] -= [leg.phase for leg in robot.legs]
    ties = (g[..., 1:, :] - g[..., :1, :]).reshape(*Q.shape[:-1], -1)
    return np.concatenate([g[..., 0, PINNING_ROWS], ties], axis=-1) if fixed_base else ties


def system_constraint_matrix(robot: Robot, Q: Array, fixed_base: bool = True) -> Array:
    """C of the system: (..., 4 n - 1, 4 n) with a fixed base, (..., 4 n - 4, 4 n) free."""
    q = _by_leg(Q)
    G = np.zeros((*q.shape, DOF))  # dg/dq of each leg
    G[...] = np.eye(DOF)
    reach, turn = axis_on_frame(robot)
    G[..., 1:3, 0] = reach * directions(q[..., 0] + turn + 0.5 * np.pi)
    return _system_rows(G, fixed_base)


def system_constraint_matrix_rate(
    robot: Robot, Q: Array, Q_dot: Array, fixed_base: bool = True
) -> Array:
    """C_dot of the system, shaped like :func:`system_constraint_matrix`."""
    q, q_dot = _by_leg(Q), _by_leg(Q_dot)
    G_dot = np.zeros((*q.shape, DOF))
    reach, turn = axis_on_frame(robot)
    G_dot[..., 1:3, 0] = reach * directions(q[..., 0] + turn + np.pi) * q_dot[..., :1]
    return _system_rows(G_dot, fixed_base)


def _by_leg(Q: Array) -> Array:
    """(..., legs, 4) of (..., 4 n)."""
    return Q.reshape(*Q.shape[:-1], -1, DOF)


def _system_rows(G: Array, fixed_base: bool) -> Array:
    """C from G = dg/dq (..., legs, 4, 4) of each leg, or C_dot from its rate."""
    *shape, legs, _, _ = G.shape
    rows = np.zeros((*shape, legs, DOF, legs, DOF))
    rows[..., 0, :, 0, :] = first = G[..., 0, :, :]
    for leg in range(1, legs):
        rows[..., leg, :, leg, :] = G[..., leg, :, :]
        rows[..., leg, :, 0, :] = -first
    C = rows.reshape(*shape, DOF * legs, DOF * legs)
    pins, ties = C[..., PINNING_ROWS, :], C[..., DOF:, :]
    return np.concatenate([pins, ties], axis=-2) if fixed_base else ties


def frame_angle(robot: Robot, side: Side) -> float:
    """theta_1 with the chassis level: atan(h_0/l_0), and pi minus that for a back leg."""
    return robot.frame_angle if side == "fore" else np.pi - robot.frame_angle


def axis_on_frame(robot: Robot) -> tuple[float, Array]:
    """Where the crank axis is on each leg's frame: c, and o (legs,), of its corner there."""
    linkage = robot.linkage
    reach, offset = robot.bodies[FRAME - 1].corners[linkage.members[FRAME - 1].index(linkage.axis)]
    return reach, np.array([offset if leg.side == "fore" else -offset for leg in robot.legs])


def system_coordinates(robot: Robot, q: Array) -> Array:
    """x of every leg (..., legs, 24) from q (..., 4) = (x, y, theta, psi), rad and m.

    x, y is the crank axis, theta the chassis pitch, psi the crank angle relative to the chassis.
    """
    q = np.asarray(q, dtype=float)
    x = np.empty((*q.shape[:-1], len(robot.legs), len(robot.bodies), 3))
    sides: tuple[Side, Side] = ("fore", "back")
    for side in sides:
        legs = [i for i, leg in enumerate(robot.legs) if leg.side == side]
        if legs:
            psi = q[..., 3, None] + np.array([robot.legs[i].phase for i in legs])
            x[..., legs, :, :] = coordinates(robot, side, psi).reshape(*psi.shape, -1, 3)
    turn = q[..., 2, None, None]
    cos, sin = np.cos(turn), np.sin(turn)
    local_x, local_y = x[..., 1].copy(), x[..., 2].copy()
    x[..., 0] += turn
    x[..., 1] = q[..., 0, None, None] + cos * local_x - sin * local_y
    x[..., 2] = q[..., 1, None, None] + sin * local_x + cos * local_y
    return x.reshape(*x.shape[:-2], 3 * len(robot.bodies))


@dataclass(frozen=True)
class Projection:
    """The system projected to its independent speeds, at one state or several (...)."""

    D: Array  #: (..., 24 n, k) from independent speeds to X_dot; k is 1 with a fixed base, else 4
    bias: Array  #: (..., 24 n) D_dot times the independent speeds: accelerations at zero q_ddot
    mass: Array  #: (..., k, k) D^T M D, eq. (12)
    velocity_terms: Array  #: (..., k) D^T M D_dot q_dot
    generalised_forces: Array  #: (..., k) D^T h
    M: Array  #: (24 n,) diagonal of the mass matrix
    h: Array  #: (..., 24 n) forces

    def acceleration(self) -> Array:
        """Independent accelerations (..., k), eq. (12)."""
        force = self.generalised_forces - self.velocity_terms
        return np.asarray(np.linalg.solve(self.mass, force[..., None])[..., 0], np.float64)

    def constraint_forces(self, q_ddot: Array | None = None) -> Array:
        """C^T lambda = M x_ddot - h (..., 24 n), eq. (4): what the joints add to each body."""
        q_ddot = self.acceleration() if q_ddot is None else q_ddot
        return self.M * (times(self.D, q_ddot) + self.bias) - self.h


def project(
    robot: Robot,
    q: Array,
    q_dot: Array,
    torque: float | Array = 0.0,
    fixed_base: bool = False,
    gravity: Gravity = GRAVITY,
) -> Projection:
    """Equations (2)-(12) at one state or several; the payload is no part of the paper and left out.

    Args:
        q, q_dot: (..., 4) crank axis x, y (m), pitch theta, crank angle psi (rad), and their rates.
        torque: (...) or a number, of the crank, N m.
        fixed_base: hold the chassis (the first three of q_dot must then be 0).

    Returns:
        :class:`Projection` in the paper's independent speeds: the first leg's (theta_1, x_1, y_1,
        theta_2), or its theta_2 alone with a fixed base.
    """
    legs = len(robot.legs)
    X = system_coordinates(robot, q)
    shape = X.shape[:-2]
    Q = X[..., :DOF].reshape(*shape, -1)
    speeds = times(tangent_matrix(robot, q)[..., 0, :, :], q_dot)  # of the first leg
    # The tangent speed is theta_2 alone with a fixed base (after (11)): bring it to the front.
    order = np.arange(DOF * legs)
    if fixed_base:
        order[:DOF] = [3, 0, 1, 2]
        speeds = speeds[..., 3:]
    back, k = np.argsort(order), speeds.shape[-1]
    C = system_constraint_matrix(robot, Q, fixed_base)[..., order]
    D = orthogonal_complement(C, k)
    Q_dot = times(D, speeds)[..., back]
    C_dot = system_constraint_matrix_rate(robot, Q, Q_dot, fixed_base)[..., order]
    D_dot = orthogonal_complement_rate(C, C_dot, D)
    # From the system's coordinates to those of each leg, (11).
    x_dot, D_leg, bias = leg_motion(robot, leg_sides(robot), X, _by_leg(Q_dot))
    D_all = (D_leg @ D[..., back, :].reshape(*shape, legs, DOF, k)).reshape(*shape, -1, k)
    bias = bias + times(D_leg, _by_leg(times(D_dot, speeds)[..., back]))
    bias = bias.reshape(*shape, -1)
    motor = np.zeros((*shape, legs))
    motor[..., 0] = torque
    h = forces(robot, x_dot, motor, gravity).reshape(*shape, -1)
    M = np.tile(masses(robot), legs)
    D_T = np.swapaxes(D_all, -1, -2)
    return Projection(
        D_all, bias, D_T @ (M[:, None] * D_all), times(D_T, M * bias), times(D_T, h), M, h
    )


def leg_sides(robot: Robot) -> tuple[Side, ...]:
    """The side of each leg."""
    return tuple(leg.side for leg in robot.legs)


def leg_motion(robot: Robot, side: Sides, x: Array, q_dot: Array) -> tuple[Array, Array, Array]:
    """x_dot = D q_dot (..., 24), D (..., 24, 4) and D_dot q_dot (..., 24) of legs, before (5).

    Args:
        x: (..., 24) coordinates (1). q_dot: (..., 4) tangent speeds theta_1, x_1, y_1, theta_2.
    """
    C = constraint_matrix(robot, side, x)
    D = orthogonal_complement(C, DOF)
    x_dot = times(D, q_dot)
    C_dot = constraint_matrix_rate(robot, side, x, x_dot)
    D_dot = orthogonal_complement_rate(C, C_dot, D)
    return x_dot, D, times(D_dot, q_dot)


def tangent_matrix(robot: Robot, q: Array) -> Array:
    """T (..., legs, 4, 4): a leg's tangent speeds theta_1, x_1, y_1, theta_2 = T q_dot."""
    angle = q[..., None, 2] + np.array([frame_angle(robot, side) for side in leg_sides(robot)])
    T = np.zeros((*angle.shape, DOF, 4))
    T[..., 0, 2] = T[..., 1, 0] = T[..., 2, 1] = T[..., 3, 2] = T[..., 3, 3] = 1.0
    reach, turn = axis_on_frame(robot)
    T[..., 1, 2] = reach * np.sin(angle + turn)
    T[..., 2, 2] = -reach * np.cos(angle + turn)
    return T


def tangent_bias(robot: Robot, q: Array, q_dot: Array) -> Array:
    """T_dot q_dot (..., legs, 4) of :func:`tangent_matrix`."""
    angle = q[..., None, 2] + np.array([frame_angle(robot, side) for side in leg_sides(robot)])
    bias = np.zeros((*angle.shape, DOF))
    reach, turn = axis_on_frame(robot)
    spin = reach * q_dot[..., None, 2] ** 2
    bias[..., 1], bias[..., 2] = spin * np.cos(angle + turn), spin * np.sin(angle + turn)
    return bias
