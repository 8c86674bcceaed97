"""The paper's dynamics, equation by equation: the reference for all other implementations.

The paper is *Dynamic Analysis and Modeling of Jansen Mechanism*, which uses the projection method.
Equation numbers are those of the paper. Where an equation cannot be meant as it is printed, it is
read as explained in ``docs/paper.md``. A leg has 24 coordinates (1), three per body: theta_i, x_i
and y_i. The subscript f stands for the forepaw and b for the backpaw. The equations of the backpaw
differ from those of the forepaw only in the signs of alpha_4, gamma_4 and alpha_8.

The shapes for Jansen's leg are x and x_dot (24,), Phi (20,), C (20, 24) and D (24, 4). Another
linkage has three coordinates per body and two constraints per pin. All arrays may have any number
of leading axes, such as legs and instants. The coordinates of n legs are stacked to X, shape
(..., 24 n).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.arrays import Array, Ints
from jansen_env.dynamics.gravity import GRAVITY, Gravity, gravity_vector
from jansen_env.dynamics.spring_forces import spring_forces
from jansen_env.engine.mathematics import directions
from jansen_env.robot import Robot, Side
from jansen_env.robot.kinematics import coordinates
from jansen_env.robot.linkage import FRAME, INDEPENDENT

DOF = INDEPENDENT  # number of tangent speeds in (5): those of theta_1, x_1, y_1 and theta_2
PINNING_ROWS = [1, 2, 0]  # axis x, axis y and theta_1 of the first leg, in the paper's order


Sides = Side | tuple[Side, ...]
"""One side for all legs, or a tuple with one side per leg of x, shape (..., legs, 24)."""


class _Rows(NamedTuple):
    """The vector equations of Phi_hf (forepaw) or Phi_hb (backpaw), one per pin, in their order.

    The equation of a pin states that its joint has the same position on both bodies. The position
    on a body is x_body + c (cos, sin)(theta_body + o); see :data:`jansen_env.robot.links.Corners`.
    The equation is the position on one body minus that on the other. Each of the m terms of a leg
    occurs in two rows, ``row`` for x and ``row + 1`` for y.

    Attributes:
        row: Row of each term, shape (m,).
        column: Column of the angle of each term, shape (m,).
        coefficient: Distance c of each term with the sign of the term, in m, shape (m,).
        offset: Angle o of each term, in rad, shape (m,) or (legs, m). It is the only difference
            between the two sides.
        translations: Constant part of C, shape (20, 24).
    """

    row: Ints
    column: Ints
    coefficient: Array
    offset: Array
    translations: Array


@functools.lru_cache(maxsize=64)
def _rows(robot: Robot, side: Sides) -> _Rows:
    """Return the vector equations of the constraints of a leg, or of several legs."""
    if isinstance(side, tuple):
        legs = [_rows(robot, each) for each in side]
        return legs[0]._replace(offset=np.stack([leg.offset for leg in legs]))
    mirror = 1.0 if side == "fore" else -1.0
    pins = robot.linkage.pins
    terms = []
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
    """Return the holonomic constraints Phi_hf or Phi_hb, which precede equation (3).

    Args:
        robot: The robot.
        side: Side of the legs.
        x: Coordinates (1), in rad and m, shape (..., 24).

    Returns:
        Residuals of the constraints in m, shape (..., 20).
    """
    rows = _rows(robot, side)
    angle = x[..., rows.column] + rows.offset
    turning = np.zeros((len(rows.row), len(rows.translations) // 2))
    turning[np.arange(len(rows.row)), rows.row // 2] = rows.coefficient
    phi = x @ rows.translations.T
    phi[..., 0::2] += np.cos(angle) @ turning
    phi[..., 1::2] += np.sin(angle) @ turning
    return phi


def constraint_matrix(robot: Robot, side: Sides, x: Array) -> Array:
    """Return C = dPhi/dx of equation (3).

    The paper prints the derivative with respect to x_dot, which contradicts C x_dot = 0.

    Args:
        robot: The robot.
        side: Side of the legs.
        x: Coordinates (1), in rad and m, shape (..., 24).

    Returns:
        Constraint matrix, shape (..., 20, 24).
    """
    rows = _rows(robot, side)
    angle = x[..., rows.column] + rows.offset
    C = np.empty((*x.shape[:-1], *rows.translations.shape))
    C[...] = rows.translations
    C[..., rows.row, rows.column] = -rows.coefficient * np.sin(angle)
    C[..., rows.row + 1, rows.column] = rows.coefficient * np.cos(angle)
    return C


def constraint_matrix_rate(robot: Robot, side: Sides, x: Array, x_dot: Array) -> Array:
    """Return C_dot, the time derivative of :func:`constraint_matrix`.

    Args:
        robot: The robot.
        side: Side of the legs.
        x: Coordinates (1), in rad and m, shape (..., 24).
        x_dot: Rates of the coordinates, in rad/s and m/s, shape (..., 24).

    Returns:
        Matrix of shape (..., 20, 24).
    """
    rows = _rows(robot, side)
    angle = x[..., rows.column] + rows.offset
    rate = x_dot[..., rows.column]
    C_dot = np.zeros((*x.shape[:-1], *rows.translations.shape))
    C_dot[..., rows.row, rows.column] = -rows.coefficient * np.cos(angle) * rate
    C_dot[..., rows.row + 1, rows.column] = -rows.coefficient * np.sin(angle) * rate
    return C_dot


def orthogonal_complement(C: Array, dof: int) -> Array:
    """Return D = [1; -C_2^-1 C_1], with the paper's partition of C before equation (5).

    Args:
        C: Constraint matrix, shape (..., r, n).
        dof: Number of independent coordinates, which come first.

    Returns:
        Orthogonal complement, shape (..., n, dof).
    """
    return _below(np.eye(dof), -np.linalg.solve(C[..., dof:], C[..., :dof]))


def orthogonal_complement_rate(C: Array, C_dot: Array, D: Array) -> Array:
    """Return D_dot from C_dot D + C D_dot = 0. Its independent rows are 0.

    Args:
        C: Constraint matrix, shape (..., r, n).
        C_dot: Time derivative of ``C``, shape (..., r, n).
        D: Orthogonal complement, shape (..., n, dof).

    Returns:
        Time derivative of ``D``, shape (..., n, dof).
    """
    dof = D.shape[-1]
    return _below(np.zeros((dof, dof)), -np.linalg.solve(C[..., dof:], C_dot @ D))


def _below(head: Array, lower: NDArray[Any]) -> Array:
    """Return matrices that consist of the rows of ``head`` above those of each matrix ``lower``."""
    return np.concatenate([np.broadcast_to(head, (*lower.shape[:-2], *head.shape)), lower], axis=-2)


def times(A: Array, v: Array) -> Array:
    """Return the products A v.

    Args:
        A: Matrices, shape (..., m, n).
        v: Vectors, shape (..., n).

    Returns:
        Vectors, shape (..., m).
    """
    return (A @ v[..., None])[..., 0]


def masses(robot: Robot) -> Array:
    """Return the diagonal of M_f of equation (2): J_1, m_1, m_1, ..., shape (24,)."""
    return np.array([v for body in robot.bodies for v in (body.inertia, body.mass, body.mass)])


def forces(robot: Robot, x_dot: Array, torque: float | Array, gravity: Gravity = GRAVITY) -> Array:
    """Return h_f of equation (2): motor torque, weights and viscous torques of the joints.

    The forces of springs are those of :func:`jansen_env.dynamics.spring_forces.spring_forces`.

    Args:
        robot: The robot.
        x_dot: Rates of the coordinates, in rad/s and m/s, shape (..., 24).
        torque: Torque of the motor, positive on the crank and negative on the frame, in N m, a
            number or an array of shape (...). As one motor drives the shaft, it must act on one leg
            only.
        gravity: Acceleration of gravity, in m/s^2: a number (downwards) or a vector (x, y).

    Returns:
        Forces in N m and N, shape (..., 24).
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


# The system consists of n legs on one crank shaft. Its coordinates Q, shape (..., 4 n), are
# theta_1, x_1, y_1 and theta_2 of each leg. The coordinates of each leg determine a pose of the
# chassis, g = (theta_1 - its value with a level chassis, crank axis x, y, theta_2 - phase of the
# leg). The tying rows require the same g for all legs. The pinning rows require g = (0, 0, 0, any).


def system_constraints(robot: Robot, Q: Array, fixed_base: bool = True) -> Array:
    """Return the constraints Phi_h of the system.

    If the chassis is fixed, three rows pin the frame of the first leg. Four rows tie each other leg
    to the first leg. The paper ties lb to lf instead, which spans the same rows. Rows 9 and 10 of
    the paper are read as rf relative to lf (``docs/paper.md``).

    Args:
        robot: The robot.
        Q: Coordinates of the system, in rad and m, shape (..., 4 n).
        fixed_base: Whether the chassis is fixed.

    Returns:
        Residuals in rad and m, shape (..., 4 n - 1) with a fixed chassis, else (..., 4 n - 4).
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
    """Return C of the system.

    Args:
        robot: The robot.
        Q: Coordinates of the system, in rad and m, shape (..., 4 n).
        fixed_base: Whether the chassis is fixed.

    Returns:
        Matrix of shape (..., 4 n - 1, 4 n) with a fixed chassis, else (..., 4 n - 4, 4 n).
    """
    q = _by_leg(Q)
    G = np.zeros((*q.shape, DOF))  # dg/dq of each leg
    G[...] = np.eye(DOF)
    reach, turn = axis_on_frame(robot)
    G[..., 1:3, 0] = reach * directions(q[..., 0] + turn + 0.5 * np.pi)
    return _system_rows(G, fixed_base)


def system_constraint_matrix_rate(
    robot: Robot, Q: Array, Q_dot: Array, fixed_base: bool = True
) -> Array:
    """Return C_dot of the system.

    Args:
        robot: The robot.
        Q: Coordinates of the system, in rad and m, shape (..., 4 n).
        Q_dot: Rates of the coordinates, in rad/s and m/s, shape (..., 4 n).
        fixed_base: Whether the chassis is fixed.

    Returns:
        Matrix of the same shape as the result of :func:`system_constraint_matrix`.
    """
    q = _by_leg(Q)
    q_dot = _by_leg(Q_dot)
    G_dot = np.zeros((*q.shape, DOF))
    reach, turn = axis_on_frame(robot)
    G_dot[..., 1:3, 0] = reach * directions(q[..., 0] + turn + np.pi) * q_dot[..., :1]
    return _system_rows(G_dot, fixed_base)


def _by_leg(Q: Array) -> Array:
    """Return the coordinates of the system leg by leg, shape (..., legs, 4)."""
    return Q.reshape(*Q.shape[:-1], -1, DOF)


def _system_rows(G: Array, fixed_base: bool) -> Array:
    """Return C from G = dg/dq of each leg, shape (..., legs, 4, 4), or C_dot from the rate of G."""
    *shape, legs, _, _ = G.shape
    rows = np.zeros((*shape, legs, DOF, legs, DOF))
    rows[..., 0, :, 0, :] = first = G[..., 0, :, :]
    for leg in range(1, legs):
        rows[..., leg, :, leg, :] = G[..., leg, :, :]
        rows[..., leg, :, 0, :] = -first
    C = rows.reshape(*shape, DOF * legs, DOF * legs)
    pins = C[..., PINNING_ROWS, :]
    ties = C[..., DOF:, :]
    return np.concatenate([pins, ties], axis=-2) if fixed_base else ties


def frame_angle(robot: Robot, side: Side) -> float:
    """Return theta_1 of a level chassis, in rad.

    It is atan(h_0/l_0) for a fore leg, and pi minus this angle for a back leg.
    """
    return robot.frame_angle if side == "fore" else np.pi - robot.frame_angle


def axis_on_frame(robot: Robot) -> tuple[float, Array]:
    """Return the polar coordinates of the crank axis on the frame of each leg.

    See :data:`jansen_env.robot.links.Corners`.

    Returns:
        Distance c in m, and angles o in rad, shape (legs,).
    """
    linkage = robot.linkage
    reach, offset = robot.bodies[FRAME - 1].corners[linkage.members[FRAME - 1].index(linkage.axis)]
    return reach, np.array([offset if leg.side == "fore" else -offset for leg in robot.legs])


def system_coordinates(robot: Robot, q: Array) -> Array:
    """Return the coordinates (1) of every leg from the pose of the robot.

    Args:
        robot: The robot.
        q: Position x, y of the crank axis (m), chassis pitch theta, and crank angle psi relative to
            the chassis (rad), shape (..., 4).

    Returns:
        Coordinates in rad and m, shape (..., legs, 24).
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
    """The system projected to its k independent speeds, at one or several states (...).

    With a fixed chassis k is 1, and otherwise it is 4.

    Attributes:
        D: Matrix from the independent speeds to X_dot, shape (..., 24 n, k).
        bias: D_dot times the independent speeds, that is, the accelerations if the independent
            accelerations are 0, shape (..., 24 n).
        mass: Mass matrix D^T M D of equation (12), shape (..., k, k).
        velocity_terms: D^T M D_dot q_dot, shape (..., k).
        generalised_forces: D^T h, shape (..., k).
        M: Diagonal of the mass matrix of all bodies, shape (24 n,).
        h: Forces on all bodies, shape (..., 24 n).
    """

    D: Array
    bias: Array
    mass: Array
    velocity_terms: Array
    generalised_forces: Array
    M: Array
    h: Array

    def acceleration(self) -> Array:
        """Return the independent accelerations of equation (12), shape (..., k)."""
        force = self.generalised_forces - self.velocity_terms
        return np.asarray(np.linalg.solve(self.mass, force[..., None])[..., 0], np.float64)

    def constraint_forces(self, q_ddot: Array | None = None) -> Array:
        """Return the forces of the joints on each body, C^T lambda = M x_ddot - h of equation (4).

        Args:
            q_ddot: Independent accelerations, shape (..., k). None for :meth:`acceleration`.

        Returns:
            Forces in N m and N, shape (..., 24 n).
        """
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
    """Evaluate equations (2) to (12) at one or several states.

    The payload is ignored, because it is not part of the paper.

    Args:
        robot: The robot.
        q: Position x, y of the crank axis (m), pitch theta and crank angle psi (rad), shape (...,
            4).
        q_dot: Rates of ``q``, in m/s and rad/s, shape (..., 4).
        torque: Torque on the crank, in N m, a number or an array of shape (...).
        fixed_base: Whether the chassis is fixed. The first three entries of ``q_dot`` must then be
            0.
        gravity: Acceleration of gravity, in m/s^2: a number (downwards) or a vector (x, y).

    Returns:
        The projection to the paper's independent speeds, which are those of theta_1, x_1, y_1 and
        theta_2 of the first leg, or of theta_2 alone with a fixed chassis.
    """
    legs = len(robot.legs)
    X = system_coordinates(robot, q)
    shape = X.shape[:-2]
    Q = X[..., :DOF].reshape(*shape, -1)
    speeds = times(tangent_matrix(robot, q)[..., 0, :, :], q_dot)  # those of the first leg
    # With a fixed chassis the only tangent speed is that of theta_2 (after (11)). Move it to the
    # front.
    order = np.arange(DOF * legs)
    if fixed_base:
        order[:DOF] = [3, 0, 1, 2]
        speeds = speeds[..., 3:]
    back = np.argsort(order)
    k = speeds.shape[-1]
    C = system_constraint_matrix(robot, Q, fixed_base)[..., order]
    D = orthogonal_complement(C, k)
    Q_dot = times(D, speeds)[..., back]
    C_dot = system_constraint_matrix_rate(robot, Q, Q_dot, fixed_base)[..., order]
    D_dot = orthogonal_complement_rate(C, C_dot, D)
    # Convert from the coordinates of the system to those of each leg, equation (11).
    x_dot, D_leg, bias = leg_motion(robot, leg_sides(robot), X, _by_leg(Q_dot))
    D_all = (D_leg @ D[..., back, :].reshape(*shape, legs, DOF, k)).reshape(*shape, -1, k)
    bias = bias + times(D_leg, _by_leg(times(D_dot, speeds)[..., back]))
    bias = bias.reshape(*shape, -1)
    motor = np.zeros((*shape, legs))
    motor[..., 0] = torque
    h = forces(robot, x_dot, motor, gravity) + spring_forces(robot, leg_sides(robot), X)
    h = h.reshape(*shape, -1)
    M = np.tile(masses(robot), legs)
    D_T = np.swapaxes(D_all, -1, -2)
    return Projection(
        D_all, bias, D_T @ (M[:, None] * D_all), times(D_T, M * bias), times(D_T, h), M, h
    )


def leg_sides(robot: Robot) -> tuple[Side, ...]:
    """Return the side of each leg."""
    return tuple(leg.side for leg in robot.legs)


def leg_motion(robot: Robot, side: Sides, x: Array, q_dot: Array) -> tuple[Array, Array, Array]:
    """Return x_dot, D and D_dot q_dot of legs, which precede equation (5).

    Args:
        robot: The robot.
        side: Side of the legs.
        x: Coordinates (1), in rad and m, shape (..., 24).
        q_dot: Tangent speeds, which are the rates of theta_1, x_1, y_1 and theta_2, shape (..., 4).

    Returns:
        x_dot = D q_dot, shape (..., 24); D, shape (..., 24, 4); and D_dot q_dot, shape (..., 24).
    """
    C = constraint_matrix(robot, side, x)
    D = orthogonal_complement(C, DOF)
    x_dot = times(D, q_dot)
    C_dot = constraint_matrix_rate(robot, side, x, x_dot)
    D_dot = orthogonal_complement_rate(C, C_dot, D)
    return x_dot, D, times(D_dot, q_dot)


def tangent_matrix(robot: Robot, q: Array) -> Array:
    """Return the matrix T from the rates of the robot's pose to the tangent speeds of each leg.

    The tangent speeds T q_dot are the rates of theta_1, x_1, y_1 and theta_2.

    Args:
        robot: The robot.
        q: Pose (x, y, theta, psi), in m and rad, shape (..., 4).

    Returns:
        Matrix T of each leg, shape (..., legs, 4, 4).
    """
    angle = q[..., None, 2] + np.array([frame_angle(robot, side) for side in leg_sides(robot)])
    T = np.zeros((*angle.shape, DOF, 4))
    T[..., 0, 2] = T[..., 1, 0] = T[..., 2, 1] = T[..., 3, 2] = T[..., 3, 3] = 1.0
    reach, turn = axis_on_frame(robot)
    T[..., 1, 2] = reach * np.sin(angle + turn)
    T[..., 2, 2] = -reach * np.cos(angle + turn)
    return T


def tangent_bias(robot: Robot, q: Array, q_dot: Array) -> Array:
    """Return T_dot q_dot, where T is :func:`tangent_matrix`.

    Args:
        robot: The robot.
        q: Pose (x, y, theta, psi), in m and rad, shape (..., 4).
        q_dot: Rates of ``q``, in m/s and rad/s, shape (..., 4).

    Returns:
        Accelerations in rad/s^2 and m/s^2, shape (..., legs, 4).
    """
    angle = q[..., None, 2] + np.array([frame_angle(robot, side) for side in leg_sides(robot)])
    bias = np.zeros((*angle.shape, DOF))
    reach, turn = axis_on_frame(robot)
    spin = reach * q_dot[..., None, 2] ** 2
    bias[..., 1] = spin * np.cos(angle + turn)
    bias[..., 2] = spin * np.sin(angle + turn)
    return bias
