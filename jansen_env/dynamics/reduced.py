"""Robot -> periodic tables: the projected equations as functions of the crank angle alone.

The mechanism has one internal degree of freedom, the crank angle psi, so all that the projected
equations need is periodic in psi. :func:`compile_robot` runs the dense projection over one turn of
one fore and one back leg, takes Fourier series (they converge geometrically), sums them over the
legs with their phases, and cuts them into short Taylor polynomials that the engine reads.

Chassis frame, crank axis at the origin, r_i(psi) centre of mass and a_i(psi) angle of body i,
' = d/dpsi, sums over all bodies of all legs:

    c = sum m r        I = sum (m |r|^2 + J)      b = sum (m r x r' + J a')
    k = sum (m |r'|^2 + J a'^2)                   f = sum over joint pairs of C (a_j' - a_i')^2

With q = (x, y, theta, psi), R = R(theta), S = 90 degrees counter-clockwise, m the total mass:

    M(q) = [ m 1,  S R c,  R c' ;  .,  I,  b ;  .,  .,  k ]
    M(q) q_ddot + velocity terms = (0, -m g, -g e_y.SRc, -g e_y.Rc' + tau - f psi_dot)
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jansen_env.dynamics.pads import PAD_BODIES, PAD_JOINTS, Pads, pad_layout
from jansen_env.dynamics.projection import DOF, constraint_matrix, orthogonal_complement
from jansen_env.gravity import GRAVITY
from jansen_env.robot import BEARINGS, BODIES_PER_LEG, JOINT_PAIRS, RIGID, Leg, Payload, Robot, Side
from jansen_env.robot.kinematics import check_closure, coordinates, joint_positions
from jansen_env.robot.motor import IDEAL

Array = NDArray[np.float64]
Series = NDArray[np.complex128]  # one-sided Fourier coefficients, harmonics along the first axis

SAMPLES = 512  # crank angles at which the dense projection is run
HARMONICS = 128  # kept; the paper's linkage needs about 40 for 1e-14
TAIL_TOLERANCE = 1e-10  # largest coefficient allowed in the last eighth, relative to the largest
INTERVALS = 512  # Taylor polynomials a turn
ORDER = 8  # coefficients of each (the engine's polynomials are written out for eight)

BODY_FUNCTIONS = ("c_x", "c_y", "I", "b", "k", "f")
PAD_FUNCTIONS = ("p_x", "p_y", "a")


@dataclass(frozen=True)
class Tables:
    """A compiled robot."""

    robot: Robot
    #: (INTERVALS, 6, ORDER) Taylor coefficients of :data:`BODY_FUNCTIONS` about the middle of each
    #: interval, without the payload; and what of it is by the links' own inertias: the terms in J.
    body: Array
    own: Array
    #: (12, INTERVALS, 3, ORDER) those of :data:`PAD_FUNCTIONS`; row ``side * 6 + joint`` with side
    #: 0 fore, 1 back, for a leg of phase 0.
    pads: Array
    layout: Pads
    #: (SAMPLES,) Coulomb friction torque of all bearings on the crank, N m, at crank angles evenly
    #: over a turn: sum of tau_i |a_j' - a_i'|.
    bearings: Array
    tail: float  #: largest Fourier coefficient cut off, relative to the largest kept


def compile_robot(robot: Robot) -> Tables:
    """Compile a robot to periodic tables; equal robots are compiled once.

    Raises:
        LinkageError: the linkage does not close all the way round.
        ValueError: the tables have not converged (the linkage passes too near a singularity).
    """
    # Load, motor and pads are no part of the tables.
    bare = _compile(
        replace(robot, payload=Payload(), pad_radius=1.0, motor=IDEAL, pad_compliance=RIGID)
    )
    return replace(bare, robot=robot)


@functools.lru_cache(maxsize=32)
def _compile(robot: Robot) -> Tables:
    check_closure(robot)
    linkage = replace(robot, legs=(Leg("fore"),))  # the legs do not change what one of them does
    sides: tuple[Side, Side] = ("fore", "back")
    series = {side: _series(linkage, side) for side in sides}
    tail = max(_tail(part) for body, _, pads in series.values() for part in (body, pads))
    if tail > TAIL_TOLERANCE:
        raise ValueError(
            f"robot's tables have not converged: harmonics beyond {HARMONICS * 7 // 8} still reach "
            f"{tail:.1e} of the largest, allowed is {TAIL_TOLERANCE:.0e}; its linkage passes too "
            "near a singular position"
        )
    body, own = (
        _taylor(np.sum([_advance(series[leg.side][k], leg.phase) for leg in robot.legs], axis=0))
        for k in range(2)
    )
    pads = np.stack(
        [_taylor(series[side][2][:, joint]) for side in sides for joint in range(len(PAD_JOINTS))]
    )
    bearings = _bearing_friction(robot)
    for table in (body, own, pads, bearings):
        table.setflags(write=False)
    return Tables(robot, body, own, pads, pad_layout(robot), bearings, tail)


@functools.lru_cache(maxsize=32)
def _series(robot: Robot, side: Side) -> tuple[Series, ...]:
    """Fourier series of a leg's share of the body sums, their part in J, and its pads' motion."""
    psi = 2.0 * math.pi * np.arange(SAMPLES) / SAMPLES
    sampled = *_leg_sums(robot, side, psi), _pad_motion(robot, side, psi)
    return tuple(np.fft.rfft(values, axis=0) / SAMPLES for values in sampled)


def _bearing_friction(robot: Robot) -> Array:
    """(SAMPLES,) see :class:`Tables`."""
    total = np.zeros(SAMPLES)
    if not any(robot.bearing_friction):
        return total
    psi = 2.0 * math.pi * np.arange(SAMPLES) / SAMPLES
    first, second = np.array(BEARINGS).T - 1
    for leg in robot.legs:
        rates = _slope(robot, leg.side, psi + leg.phase)[1][:, 0::3]
        total += np.abs(rates[:, second] - rates[:, first]) @ np.array(robot.bearing_friction)
    return total


def _slope(robot: Robot, side: Side, psi: Array) -> tuple[Array, Array]:
    """(n, 24) coordinates of a leg, and their change per crank angle with the frame at rest."""
    x = coordinates(robot, side, psi)
    return x, orthogonal_complement(constraint_matrix(robot, side, x), DOF)[..., 3]


def _leg_sums(robot: Robot, side: Side, psi: Array) -> tuple[Array, Array]:
    """(n, 6) the leg's share of :data:`BODY_FUNCTIONS`, and of their part in J."""
    mass = np.array([body.mass for body in robot.bodies])
    inertia = np.array([body.inertia for body in robot.bodies])
    first, second = np.array(JOINT_PAIRS).T - 1
    x, slope = _slope(robot, side, psi)
    r, dr = (v.reshape(-1, BODIES_PER_LEG, 3)[..., 1:] for v in (x, slope))
    da = slope[:, 0::3]
    joint_rate = np.take(da, second, axis=1) - np.take(da, first, axis=1)

    def total(weight: ArrayLike, value: Array) -> Array:  # over bodies or joints: (n, m) to (n,)
        return (np.asarray(weight) @ value[..., None])[..., 0]

    c = mass @ r
    own = np.zeros((len(psi), len(BODY_FUNCTIONS)))
    own[:, 2], own[:, 3], own[:, 4] = inertia.sum(), total(inertia, da), total(inertia, da**2)
    I = total(mass, (r**2).sum(axis=-1)) + own[:, 2]  # noqa: E741 - the sum's symbol
    b = total(mass, r[..., 0] * dr[..., 1] - r[..., 1] * dr[..., 0]) + own[:, 3]
    k = total(mass, (dr**2).sum(axis=-1)) + own[:, 4]
    f = total(robot.damping, joint_rate**2)
    return np.column_stack([c, I, b, k, f]), own


def _pad_motion(robot: Robot, side: Side, psi: Array) -> Array:
    """(n, 6, 3) p_x, p_y of each pad joint and the (unwrapped) angle of the body it is on."""
    joints = joint_positions(robot, side, psi)
    angles = coordinates(robot, side, psi)[:, 0::3]
    motion = np.empty((len(psi), len(PAD_JOINTS), len(PAD_FUNCTIONS)))
    for k, (joint, body) in enumerate(zip(PAD_JOINTS, PAD_BODIES, strict=True)):
        motion[:, k, :2] = joints[:, joint]
        motion[:, k, 2] = np.unwrap(angles[:, body - 1])
    return motion


def _tail(series: Series) -> float:
    """Largest coefficient among the last harmonics, relative to the largest of its function."""
    size = np.abs(series).reshape(series.shape[0], -1)
    last = size[HARMONICS * 7 // 8 :].max(axis=0)
    return float((last / np.maximum(size.max(axis=0), 1e-12)).max())


def _advance(series: Series, phase: float) -> Series:
    """Series of g(psi + phase) from that of g(psi)."""
    turn = np.exp(1j * np.arange(series.shape[0]) * phase)
    return series * turn.reshape((-1,) + (1,) * (series.ndim - 1))


def _taylor(series: Series) -> Array:
    """(INTERVALS, functions, ORDER) Taylor coefficients about the middle of every interval."""
    n = np.arange(HARMONICS)
    series = series[:HARMONICS].copy()
    series[1:] *= 2.0  # one-sided series of a real function
    table = np.empty((INTERVALS, series.shape[1], ORDER))
    for order in range(ORDER):
        derivative = _waves() @ (series * ((1j * n) ** order)[:, None])
        table[:, :, order] = derivative.real.reshape(INTERVALS, -1) / math.factorial(order)
    return table


@functools.cache
def _waves() -> Series:
    """exp(i n psi) of all harmonics in the middle of every interval (8, INTERVALS / 8, HARMONICS).

    So small that BLAS does not share products out to threads, which is slower.
    """
    middle = 2.0 * math.pi * (np.arange(INTERVALS) + 0.5) / INTERVALS
    return np.exp(1j * np.outer(middle, np.arange(HARMONICS))).reshape(8, -1, HARMONICS)


@dataclass(frozen=True)
class BodySums:
    """The sums c (..., 2), I, b, k, f (...) at crank angles (...), and derivatives by the angle."""

    c: Array
    dc: Array
    ddc: Array
    I: Array  # noqa: E741 - the sum's symbol
    dI: Array
    b: Array
    db: Array
    k: Array
    dk: Array
    f: Array


def body_sums(tables: Tables, psi: ArrayLike) -> BodySums:
    """The body sums at crank angles ``psi`` (...), rad, payload and motor included."""
    value, slope, curve = _evaluate(tables.body, np.asarray(psi, dtype=float))
    load: Payload = tables.robot.payload
    place = np.array(load.position)
    motor = tables.robot.motor
    J, G = motor.rotor_inertia, motor.gear_ratio  # the rotor spins with theta' + G psi'
    return BodySums(
        c=value[..., :2] + load.mass * place, dc=slope[..., :2], ddc=curve[..., :2],
        I=value[..., 2] + load.mass * place @ place + load.inertia + J, dI=slope[..., 2],
        b=value[..., 3] + G * J, db=slope[..., 3],
        k=value[..., 4] + G * G * J, dk=slope[..., 4],
        f=value[..., 5] + motor.viscous_friction,
    )  # fmt: skip


def _evaluate(table: Array, psi: Array) -> tuple[Array, Array, Array]:
    """Value, first and second derivative (..., functions) of a table's functions at ``psi``."""
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
        (rows @ power[..., None])[..., 0],
        (rows[..., 1:] @ first[..., None])[..., 0],
        (rows[..., 2:] @ second[..., None])[..., 0],
    )


def mass_matrix(tables: Tables, q: Array) -> Array:
    """M(q) (4, 4) in q = (x, y, theta, psi): the paper's D^T M D (12) with the frame let go."""
    s = body_sums(tables, q[3])
    R = _rotation(q[2])
    M = np.diag([tables.robot.mass, tables.robot.mass, s.I, s.k])
    M[0:2, 2] = M[2, 0:2] = _left(R @ s.c)
    M[0:2, 3] = M[3, 0:2] = R @ s.dc
    M[2, 3] = M[3, 2] = s.b
    return M


def velocity_terms(tables: Tables, q: Array, v: Array) -> Array:
    """(4,) the paper's D^T M D_dot q_dot (12) in q = (x, y, theta, psi), N and N m."""
    s = body_sums(tables, q[3])
    R = _rotation(q[2])
    w, n = v[2], v[3]
    terms = np.empty(4)
    terms[:2] = -w * w * (R @ s.c) + 2.0 * w * n * _left(R @ s.dc) + n * n * (R @ s.ddc)
    terms[2] = w * n * s.dI + n * n * s.db
    terms[3] = -0.5 * w * w * s.dI + 0.5 * n * n * s.dk
    return terms


def generalised_forces(
    tables: Tables, q: Array, v: Array, torque: float, gravity: float = GRAVITY
) -> Array:
    """(4,) the paper's D^T h (12): weight, motor and viscous joints, N and N m."""
    s = body_sums(tables, q[3])
    R = _rotation(q[2])
    pitch, crank = -gravity * _left(R @ s.c)[1], -gravity * (R @ s.dc)[1]
    return np.array([0.0, -tables.robot.mass * gravity, pitch, crank + torque - s.f * v[3]])


def energy(tables: Tables, q: Array, v: Array, gravity: float = GRAVITY) -> float:
    """Kinetic plus potential energy (zero with the centre of mass at y = 0), J."""
    s = body_sums(tables, q[3])
    height = tables.robot.mass * q[1] + (_rotation(q[2]) @ s.c)[1]
    return float(0.5 * v @ mass_matrix(tables, q) @ v + gravity * height)


def _rotation(angle: float) -> Array:
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def _left(vector: Array) -> Array:
    return np.array([-vector[1], vector[0]])
