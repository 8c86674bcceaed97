"""Compile a robot to periodic tables: the projected equations as functions of the crank angle.

The mechanism has one internal degree of freedom, the crank angle psi. All functions in the
projected equations are therefore periodic in psi. :func:`compile_robot` closes the linkage over one
turn of a fore leg, computes Fourier series, sums them over the legs with their phases and sides,
and converts them to short polynomials that the engine reads.

The series converge geometrically, but more slowly if the linkage comes close to a dead point, at
which two links that meet in a joint lie on one line. There the position of the joint has a branch
point (a square root) at a complex crank angle with the imaginary part d, and the magnitude of
harmonic n is proportional to exp(-n d). The speeds of the joints grow as the sine s of the angle
between the links decreases. The function k contains the squares of these speeds, and so converges
last.

The holy numbers (s = 0.150) have a tail of 1e-13. With a level frame (l = 0 instead of 7.8) they
reach s = 0.087. Their tail is then 1e-6, the error of k is below 5e-7 of its largest value, and the
error of the pads' positions is below 1e-9 m. For any tail up to :data:`TAIL_TOLERANCE`, the error
of k is below 1e-5 and that of the pads is below 1e-8 m (``tests/dynamics/test_reduced.py``). Energy
is conserved in any case, because the equations of motion are those of the tables.

In the chassis frame, with the crank axis at the origin, let r_i(psi) be the centre of mass and
a_i(psi) the angle of body i, and let ' denote d/dpsi. The sums over all bodies of all legs are:

    c = sum m r        I = sum (m |r|^2 + J)      b = sum (m r x r' + J a')
    k = sum (m |r'|^2 + J a'^2)                   f = sum over joint pairs of C (a_j' - a_i')^2

With the frame at rest, r' and a' are the last column of the projection's D (before equation (5) of
the paper).

With q = (x, y, theta, psi), the rotation R = R(theta), the rotation S by 90 degrees
counter-clockwise, and the total mass m, the equations of motion are:

    M(q) = [ m 1,  S R c,  R c' ;  .,  I,  b ;  .,  .,  k ]
    M(q) q_ddot + velocity terms = (0, -m g, -g e_y.SRc, -g e_y.Rc' + tau - f psi_dot - V')

V(psi) is the energy of the springs of all legs.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jansen_env.arrays import Array
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.dynamics.pads import Pads, pad_layout
from jansen_env.engine.closure import put_turn_angles
from jansen_env.engine.reduction import (
    BEARING_SAMPLES,
    HARMONICS,
    INTERVALS,
    ORDER,
    SAMPLES,
    compile_tables,
    put_turn,
    put_work_shapes,
)
from jansen_env.robot import RIGID, Payload, Robot
from jansen_env.robot.kinematics import coordinates, joint_positions, nearest_dead_point
from jansen_env.robot.motor import IDEAL
from jansen_env.robot.robot_arrays import leg_links, leg_rows, spring_rows
from jansen_env.robot.spring import TorsionSpring

TAIL_TOLERANCE = 1e-5  # largest tail (see Tables) with which a robot is accepted
CONVERGED = 1e-10  # tail below which the tables are in practice as exact as for built-in robots
TERMS = 12  # number of terms of the Taylor polynomials from which the tables are made
ECONOMY = np.array([-0.0078125, 0.0, 0.25, 0.0, -1.25, 0.0, 2.0, 0.0])  # t^8 - T_8(t) / 128
MASS_SAMPLES = 32  # number of crank angles at which effective masses of pads are computed
WORK_ARRAYS = 18

# The last two functions are the contributions of the links' own inertias J to b and k. Their
# contribution to I is constant.
BODY_FUNCTIONS = ("c_x", "c_y", "I", "b", "k", "f", "own_b", "own_k")
PAD_FUNCTIONS = ("p_x", "p_y", "a")


@dataclass(frozen=True)
class Tables:
    """Tables of a compiled robot.

    Attributes:
        robot: The robot.
        body: Coefficients of :data:`BODY_FUNCTIONS`, without the payload, shape (INTERVALS, ORDER,
            8). In each interval, the functions are polynomials in the distance from the middle of
            the interval, in rad.
        pads: Coefficients of :data:`PAD_FUNCTIONS` for the pads of a fore leg of phase 0, shape
            (pads of a leg, INTERVALS, ORDER, 3). For a back leg, the functions are evaluated at
            pi - psi, and x and a are mirrored. The angle a is known up to a constant.
        layout: Pads of all legs.
        bearings: Coulomb friction torque of all bearings on the crank, the sum of
            tau_i |a_j' - a_i'|, in N m, at evenly spaced crank angles, shape (BEARING_SAMPLES,).
        springs: Coefficients of the energy of all springs, shape (INTERVALS, ORDER, 1).
        tail: Largest Fourier coefficient among the last eighth of the harmonics, relative to the
            largest of all coefficients.
    """

    robot: Robot
    body: Array
    pads: Array
    layout: Pads
    bearings: Array
    springs: Array
    tail: float


def compile_robot(robot: Robot) -> Tables:
    """Compile a robot to periodic tables.

    Results are cached, so that equal robots are compiled only once.

    Raises:
        LinkageError: If the linkage does not close at every crank angle.
        ValueError: If the tables have not converged, because the linkage passes too near a dead
            point.
    """
    return replace(_compile(design_of(robot)), robot=robot)


def design_of(robot: Robot) -> Robot:
    """Return the robot for which the tables of a robot are compiled.

    It has no payload, an ideal motor, and rigid pads with a radius of 1 m.
    """
    return replace(robot, payload=Payload(), pad_radius=1.0, motor=IDEAL, pad_compliance=RIGID)


@functools.lru_cache(maxsize=128)  # 0.64 MB each
def _compile(robot: Robot) -> Tables:
    psi = np.empty(SAMPLES)
    put_turn_angles(0.0, psi)
    joints = joint_positions(robot, "fore", psi)
    x = coordinates(robot, "fore", psi, joints).reshape(SAMPLES, -1, 3)
    leg = leg_data(robot)
    space = tuple(map(np.empty, work_shapes(leg)))
    body = np.empty((1, INTERVALS, ORDER, len(BODY_FUNCTIONS)))
    pads = np.empty((len(leg["pads"]), INTERVALS, ORDER, 3))
    bearings = np.empty(BEARING_SAMPLES)
    springs = np.empty((1, INTERVALS, ORDER, 1))
    half_steps = _turn(2 * INTERVALS)
    constants = _expansion(), _turn(SAMPLES), _turn(INTERVALS), half_steps, _turn(BEARING_SAMPLES)
    tail = compile_tables(
        psi, x, joints, tuple(leg.values()), constants, space, body, pads, bearings, springs
    )
    if tail == math.inf:
        raise _turning_spring(robot, x[..., 0])
    if not tail <= TAIL_TOLERANCE:
        sine, joint, angle = nearest_dead_point(robot)
        raise ValueError(
            f"robot's tables have not converged: harmonics beyond {HARMONICS * 7 // 8} must be at "
            f"most {TAIL_TOLERANCE:.0e} of the largest, got {tail:.1e}; the linkage passes too "
            f"near a dead point: at crank angle {angle:.3f} rad the links that meet in {joint} are "
            f"within {math.asin(min(sine, 1.0)):.3f} rad of one line"
        )
    for table in (body, pads, bearings, springs):
        table.setflags(write=False)
    return Tables(robot, body[0], pads, pad_layout(robot), bearings, springs[0], tail)


def _turning_spring(robot: Robot, angles: Array) -> ValueError:
    """Return the error for a torsion spring between two links that make whole turns.

    Args:
        robot: The robot.
        angles: Angles of the bodies of a fore leg over a turn, in rad, shape (SAMPLES, bodies).
    """
    turned = np.unwrap(np.concatenate([angles, angles[:1]]), axis=0)
    turns = np.round((turned[-1] - turned[0]) / (2.0 * math.pi))
    of_body = dict(zip(robot.linkage.names, turns.tolist(), strict=True))
    k, spring = next(
        (k, each)
        for k, each in enumerate(robot.springs)
        if isinstance(each, TorsionSpring) and of_body[each.first] != of_body[each.second]
    )
    return ValueError(
        f"Robot.springs[{k}] must be between two links that do not make whole turns relative to "
        f"each other, got {spring.first!r} and {spring.second!r}"
    )


def leg_data(robot: Robot) -> dict[str, NDArray[Any]]:
    """Return the arrays of a robot that the kernel ``compile_tables`` reads, by name.

    See :func:`jansen_env.engine.reduction.compile_tables`.
    """
    linkage = robot.linkage
    return {
        "links": leg_links(robot).links,
        "damped": np.array(linkage.damped) - 1,
        "damping": np.array(robot.damping),
        "bearings": np.array(linkage.bearings) - 1,
        "friction": np.array(robot.bearing_friction),
        **spring_rows(robot)._asdict(),
        "legs": leg_rows(robot),
        "pads": np.array(linkage.all_pads),
    }


def work_shapes(leg: dict[str, NDArray[Any]]) -> list[tuple[int, ...]]:
    """Return the shapes of the work arrays of ``compile_tables``, in their order.

    Args:
        leg: Result of :func:`leg_data`.
    """
    counts = (len(leg[name]) for name in ("links", "pads", "bearings"))
    shapes = np.empty((WORK_ARRAYS, 3), np.int64)
    put_work_shapes(*counts, shapes)
    return [tuple(length for length in shape if length) for shape in shapes.tolist()]


@functools.cache
def _turn(count: int) -> Array:
    """Return cosines and sines of the angles that divide a turn evenly, shape (2, count)."""
    turn = np.empty((2, count))
    put_turn(turn)
    return turn


@functools.cache
def _expansion() -> Array:
    """Return the economised polynomial coefficients of exp(i n t) for |t| <= pi / INTERVALS.

    The coefficient of t^k is divided by i^k, so that it is real. The shape is (ORDER, HARMONICS).
    """
    half = math.pi / INTERVALS
    n = np.arange(HARMONICS)
    term = np.ones(HARMONICS)
    weights = np.zeros((ORDER, HARMONICS))
    order = np.arange(ORDER)
    economy = ECONOMY  # t^k at Chebyshev's nodes, with t in units of half
    for k in range(TERMS):
        if k < ORDER:
            weights[k] += term
        else:
            sign = np.where((k - order) % 4 < 2, 1.0, -1.0)  # sign of i^k relative to i^order
            weights += (economy * sign)[:, None] * term
            economy = np.append(0.0, economy[:-1]) + economy[-1] * ECONOMY
        term = term * (n * half) / (k + 1)
    return weights / np.cumprod([1.0] + (ORDER - 1) * [half])[:, None]


@dataclass(frozen=True)
class BodySums:
    """Sums over all bodies at crank angles, and their derivatives with respect to the crank angle.

    The module defines the sums. The crank angles have any shape (...).

    Attributes:
        c: Sum c, shape (..., 2).
        dc: First derivative of c, shape (..., 2).
        ddc: Second derivative of c, shape (..., 2).
        I: Sum I, shape (...).
        dI: First derivative of I, shape (...).
        b: Sum b, shape (...).
        db: First derivative of b, shape (...).
        k: Sum k, shape (...).
        dk: First derivative of k, shape (...).
        f: Sum f, shape (...).
        V: Energy of the springs, shape (...).
        dV: First derivative of V, shape (...).
    """

    c: Array
    dc: Array
    ddc: Array
    I: Array  # noqa: E741 - the symbol of the sum
    dI: Array
    b: Array
    db: Array
    k: Array
    dk: Array
    f: Array
    V: Array
    dV: Array


def body_sums(tables: Tables, psi: ArrayLike) -> BodySums:
    """Return the sums over all bodies, including the payload and the motor.

    Args:
        tables: Tables of the robot.
        psi: Crank angles, in rad, any shape.
    """
    value, slope, curve = _evaluate(tables.body, np.asarray(psi, dtype=float))
    elastic, elastic_slope, _ = _evaluate(tables.springs, np.asarray(psi, dtype=float))
    load: Payload = tables.robot.payload
    place = np.array(load.position)
    motor = tables.robot.motor
    J = motor.rotor_inertia
    G = motor.gear_ratio  # the speed of the rotor is theta' + G psi'
    return BodySums(
        c=value[..., :2] + load.mass * place,
        dc=slope[..., :2],
        ddc=curve[..., :2],
        I=value[..., 2] + load.mass * place @ place + load.inertia + J,
        dI=slope[..., 2],
        b=value[..., 3] + G * J,
        db=slope[..., 3],
        k=value[..., 4] + G * G * J,
        dk=slope[..., 4],
        f=value[..., 5] + motor.viscous_friction,
        V=elastic[..., 0],
        dV=elastic_slope[..., 0],
    )


def _evaluate(table: Array, psi: Array) -> tuple[Array, Array, Array]:
    """Return values, first and second derivatives of the functions of a table.

    Args:
        table: Coefficients, shape (INTERVALS, ORDER, functions).
        psi: Crank angles, in rad, any shape.

    Returns:
        Three arrays, shape (..., functions).
    """
    width = 2.0 * math.pi / INTERVALS
    angle = psi % (2.0 * math.pi)
    row = np.minimum((angle / width).astype(int), INTERVALS - 1)
    t = angle - (row + 0.5) * width
    n = np.arange(ORDER)
    power = t[..., None] ** n
    first = n[1:] * power[..., :-1]
    second = n[2:] * n[1:-1] * power[..., :-2]
    rows = table[row]
    return (
        (power[..., None, :] @ rows)[..., 0, :],
        (first[..., None, :] @ rows[..., 1:, :])[..., 0, :],
        (second[..., None, :] @ rows[..., 2:, :])[..., 0, :],
    )


def mass_matrix(tables: Tables, q: Array) -> Array:
    """Return the mass matrix M(q), the paper's D^T M D of equation (12) with a free frame.

    Args:
        tables: Tables of the robot.
        q: Coordinates (x, y, theta, psi), in m and rad, shape (4,).

    Returns:
        Mass matrix in SI units, shape (4, 4).
    """
    s = body_sums(tables, q[3])
    R = _rotation(q[2])
    M = np.diag([tables.robot.mass, tables.robot.mass, s.I, s.k])
    M[0:2, 2] = M[2, 0:2] = _left(R @ s.c)
    M[0:2, 3] = M[3, 0:2] = R @ s.dc
    M[2, 3] = M[3, 2] = s.b
    return M


@functools.lru_cache(maxsize=128)
def lightest_mass(robot: Robot) -> float:
    """Return the smallest effective mass at a pad over a turn, in kg.

    The result is the minimum over all pads and all directions. The payload and the rotor are left
    out, because they can only increase the effective mass.
    """
    tables = compile_robot(design_of(robot))
    legs = robot.legs
    layout = tables.layout
    turn = 2.0 * math.pi * np.arange(MASS_SAMPLES) / MASS_SAMPLES
    # The tables describe the pads of a fore leg of phase 0. These are the crank angles of the robot
    # at which the pads of each leg are at the entries ``turn`` of the tables.
    angles = [
        turn - leg.phase if leg.side == "fore" else math.pi - turn - leg.phase for leg in legs
    ]
    sums = body_sums(tables, np.array(angles))
    M = np.zeros((*sums.I.shape, 4, 4))
    M[..., 0, 0] = M[..., 1, 1] = tables.robot.mass
    M[..., 2, 2] = sums.I
    M[..., 3, 3] = sums.k
    M[..., 2, 3] = sums.b
    M[..., 0, 2] = -sums.c[..., 1]
    M[..., 1, 2] = sums.c[..., 0]
    M[..., :2, 3] = sums.dc
    inverse = np.linalg.inv(np.triu(M) + np.triu(M, 1).swapaxes(-1, -2))[layout.leg]
    fore = np.array([legs[leg].side == "fore" for leg in layout.leg])[:, None]
    places = [_evaluate(table, turn)[:2] for table in tables.pads]
    value = np.array([value for value, _ in places])[layout.joint]
    slope = np.array([slope for _, slope in places])[layout.joint]
    x = np.where(fore, value[..., 0], -value[..., 0])
    dx, dy, turned = np.moveaxis(slope, -1, 0)
    dy = np.where(fore, dy, -dy)
    J = np.zeros((*x.shape, 2, 4))  # Jacobian of the point that touches level ground
    J[..., 0, 0] = J[..., 1, 1] = 1.0
    J[..., 0, 2] = robot.pad_radius - value[..., 1]
    J[..., 1, 2] = x
    J[..., 0, 3] = dx + robot.pad_radius * turned
    J[..., 1, 3] = dy
    W = J @ inverse @ J.swapaxes(-1, -2)
    mean = 0.5 * (W[..., 0, 0] + W[..., 1, 1])
    difference = 0.5 * (W[..., 0, 0] - W[..., 1, 1])
    return float(1.0 / (mean + np.hypot(difference, W[..., 0, 1])).max())


def velocity_terms(tables: Tables, q: Array, v: Array) -> Array:
    """Return the velocity terms, the paper's D^T M D_dot q_dot of equation (12).

    Args:
        tables: Tables of the robot.
        q: Coordinates (x, y, theta, psi), in m and rad, shape (4,).
        v: Rates of the coordinates, in m/s and rad/s, shape (4,).

    Returns:
        Generalised forces in N and N m, shape (4,).
    """
    s = body_sums(tables, q[3])
    R = _rotation(q[2])
    w = v[2]
    n = v[3]
    terms = np.empty(4)
    terms[:2] = -w * w * (R @ s.c) + 2.0 * w * n * _left(R @ s.dc) + n * n * (R @ s.ddc)
    terms[2] = w * n * s.dI + n * n * s.db
    terms[3] = -0.5 * w * w * s.dI + 0.5 * n * n * s.dk
    return terms


def generalised_forces(
    tables: Tables, q: Array, v: Array, torque: float, gravity: float = GRAVITY
) -> Array:
    """Return the forces of weight, motor, viscous joints and springs, D^T h of equation (12).

    Args:
        tables: Tables of the robot.
        q: Coordinates (x, y, theta, psi), in m and rad, shape (4,).
        v: Rates of the coordinates, in m/s and rad/s, shape (4,).
        torque: Torque of the motor, in N m.
        gravity: Acceleration of gravity, downwards, in m/s^2.

    Returns:
        Generalised forces in N and N m, shape (4,).
    """
    s = body_sums(tables, q[3])
    R = _rotation(q[2])
    pitch = -gravity * _left(R @ s.c)[1]
    crank = -gravity * (R @ s.dc)[1]
    return np.array([0.0, -tables.robot.mass * gravity, pitch, crank + torque - s.f * v[3] - s.dV])


def energy(tables: Tables, q: Array, v: Array, gravity: float = GRAVITY) -> float:
    """Return the sum of kinetic and potential energy, in J.

    The potential energy of gravity is 0 if the centre of mass is at y = 0. That of a spring is 0 at
    its rest length.

    Args:
        tables: Tables of the robot.
        q: Coordinates (x, y, theta, psi), in m and rad, shape (4,).
        v: Rates of the coordinates, in m/s and rad/s, shape (4,).
        gravity: Acceleration of gravity, downwards, in m/s^2.
    """
    s = body_sums(tables, q[3])
    height = tables.robot.mass * q[1] + (_rotation(q[2]) @ s.c)[1]
    return float(0.5 * v @ mass_matrix(tables, q) @ v + gravity * height + s.V)


def _rotation(angle: float) -> Array:
    """Return the matrix of a counter-clockwise rotation by an angle in rad, shape (2, 2)."""
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def _left(vector: Array) -> Array:
    """Return a vector turned by 90 degrees counter-clockwise, shape (2,)."""
    return np.array([-vector[1], vector[0]])
