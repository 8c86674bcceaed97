"""The paper's equations, dense: constraints and their derivatives, the projection, the forces.

Functions of an angle in Phi and C are first harmonics, so (f(a + pi/2) - f(a - pi/2)) / 2 is exact.
"""

import math

import numpy as np
import pytest

from jansen_env.dynamics import projection as pr
from jansen_env.robot import paper_robot
from jansen_env.robot.kinematics import coordinates

TURN = np.linspace(0.0, 2.0 * math.pi, 120, endpoint=False)


def exact_derivatives(f, x):
    """(24, ...) derivatives of f by theta_i, x_i, y_i, for first harmonics and straight lines."""
    steps = np.where(np.arange(len(x)) % 3 == 0, 0.5 * math.pi, 1.0)
    rows = zip(np.diag(steps), steps, strict=True)
    return np.array([(f(x + e) - f(x - e)) / (2.0 if s > 1.0 else 2.0 * s) for e, s in rows])


def along(f, h=1e-3):
    """f'(0) by differences of fourth order; angles may wrap."""

    def step(t):
        return (f(t) - f(-t) + math.pi) % (2.0 * math.pi) - math.pi

    return (8.0 * step(h) - step(2.0 * h)) / (12.0 * h)


def full_constraints(robot, q, q_dot, fixed_base):
    """C (rows, columns) of all legs and of what ties them, C_dot, and X_dot by hand."""
    legs = len(robot.legs)
    X = pr.system_coordinates(robot, q)
    X_dot = along(lambda t: pr.system_coordinates(robot, q + t * q_dot))
    m = 2 * len(robot.linkage.pins)
    n = 3 * len(robot.bodies)
    independent = (n * np.arange(legs)[:, None] + np.arange(4)).ravel()
    count = 4 * legs - (1 if fixed_base else 4)
    C, C_dot = np.zeros((2, m * legs + count, n * legs))
    for i, leg in enumerate(robot.legs):
        block = slice(m * i, m * i + m), slice(n * i, n * i + n)
        C[block] = pr.constraint_matrix(robot, leg.side, X[i])
        C_dot[block] = pr.constraint_matrix_rate(robot, leg.side, X[i], X_dot[i])
    Q, Q_dot = X[:, :4].ravel(), X_dot[:, :4].ravel()
    C[m * legs :, independent] = pr.system_constraint_matrix(robot, Q, fixed_base)
    C_dot[m * legs :, independent] = pr.system_constraint_matrix_rate(robot, Q, Q_dot, fixed_base)
    return C, C_dot, X_dot.ravel()


@pytest.mark.parametrize("side", ["fore", "back"])
def test_closed_form_fulfils_the_constraints(robot, side):
    """Over a turn Phi is 0 to 1e-12 m, C has full rank (no singular value is below 0.005), and C D
    is 0.
    """
    for psi in TURN:
        x = coordinates(robot, side, psi)
        C = pr.constraint_matrix(robot, side, x)
        assert np.abs(pr.constraints(robot, side, x)).max() <= 1e-12
        assert np.linalg.svd(C, compute_uv=False)[-1] > 0.005
        assert np.abs(C @ pr.orthogonal_complement(C, 4)).max() <= 1e-13


@pytest.mark.parametrize("side", ["fore", "back"])
def test_C_is_the_derivative_of_Phi(robot, side, rng):
    """This holds at any x, whether the constraints are fulfilled or not; differences are exact to
    1e-13.
    """
    x = rng.uniform(-3.0, 3.0, 3 * len(robot.bodies))
    slopes = exact_derivatives(lambda y: pr.constraints(robot, side, y), x)
    assert np.abs(pr.constraint_matrix(robot, side, x) - slopes.T).max() <= 1e-13


@pytest.mark.parametrize("side", ["fore", "back"])
def test_C_dot_is_the_rate_of_C(robot, side, rng):
    """C_dot is the sum of dC/dx_i x_i_dot; differences are exact to 1e-12."""
    x, x_dot = rng.uniform(-3.0, 3.0, (2, 3 * len(robot.bodies)))
    slopes = exact_derivatives(lambda y: pr.constraint_matrix(robot, side, y), x)
    rate = np.tensordot(x_dot, slopes, 1)
    assert np.abs(pr.constraint_matrix_rate(robot, side, x, x_dot) - rate).max() <= 1e-12


@pytest.mark.parametrize("index", range(4))
def test_D_and_D_dot_against_differences(index, rng):
    """x_dot is D u along a random path, and so is D_dot; differences of 1e-3 err by about 1e-10."""
    robot = paper_robot()
    leg = robot.legs[index]

    def D_at(q):
        x = pr.system_coordinates(robot, q)[index]
        return pr.orthogonal_complement(pr.constraint_matrix(robot, leg.side, x), 4)

    for _ in range(10):
        q, q_dot = rng.uniform(-3.0, 3.0, 4), rng.uniform(-1.0, 1.0, 4)
        x = pr.system_coordinates(robot, q)[index]
        x_dot = along(lambda t, q=q, v=q_dot: pr.system_coordinates(robot, q + t * v)[index])
        D = D_at(q)
        assert np.abs(D @ x_dot[:4] - x_dot).max() <= 1e-8
        C = pr.constraint_matrix(robot, leg.side, x)
        C_dot = pr.constraint_matrix_rate(robot, leg.side, x, x_dot)
        D_dot = along(lambda t, q=q, v=q_dot: D_at(q + t * v))
        assert np.abs(pr.orthogonal_complement_rate(C, C_dot, D) - D_dot).max() <= 1e-8


@pytest.mark.parametrize("fixed_base, dof", [(True, 1), (False, 4)])
def test_degrees_of_freedom(robot, fixed_base, dof, rng):
    """A leg has 24 - 20 = 4; n legs have 4 n - (4 n - 1) = 1 on a fixed base and 4 n - (4 n - 4) =
    4 free.
    """
    q = rng.uniform(-3.0, 3.0, 4)
    if fixed_base:
        q[:3] = 0.0
    n = len(robot.legs)
    Q = pr.system_coordinates(robot, q)[:, :4].ravel()
    C = pr.system_constraint_matrix(robot, Q, fixed_base)
    assert C.shape == (4 * n - dof, 4 * n)  # the paper's 15 and 12 rows for four legs
    assert np.linalg.matrix_rank(C) == 4 * n - dof
    assert np.abs(pr.system_constraints(robot, Q, fixed_base)).max() <= 1e-12
    whole, _, X_dot = full_constraints(robot, q, np.array([0.0, 0.0, 0.0, 1.0]), fixed_base)
    assert 3 * len(robot.bodies) * n - np.linalg.matrix_rank(whole) == dof
    assert np.abs(whole @ X_dot).max() <= 1e-8  # the differences' error


def test_a_wrong_pose_violates_the_system_constraints():
    """Moving one leg's frame by 0.1 m, or its crank by 0.1 rad, shows in its rows by as much."""
    robot = paper_robot()
    Q = pr.system_coordinates(robot, np.zeros(4))[:, :4]
    for column, row in ((1, 1), (2, 2), (3, 3)):
        wrong = Q.copy()
        wrong[2, column] += 0.1
        rows = pr.system_constraints(robot, wrong.ravel(), fixed_base=False).reshape(3, 4)
        assert rows[1, row] == pytest.approx(0.1, abs=1e-12)
        assert np.abs(rows[[0, 2]]).max() <= 1e-12


@pytest.mark.parametrize("fixed_base", [True, False])
def test_projection_against_all_multipliers(robot, fixed_base, rng):
    """A dense solve of M a - C^T lambda = h with C a = -C_dot v agrees to 1e-7; speeds are
    differences.
    """
    q, q_dot = rng.uniform(-1.0, 1.0, (2, 4))
    if fixed_base:
        q[:3] = 0.0
        q_dot[:3] = 0.0
    p = pr.project(robot, q, q_dot, torque=2.0, fixed_base=fixed_base)
    C, C_dot, X_dot = full_constraints(robot, q, q_dot, fixed_base)
    rows, columns = C.shape
    system = np.block([[np.diag(p.M), -C.T], [C, np.zeros((rows, rows))]])
    solution = np.linalg.solve(system, np.concatenate([p.h, -C_dot @ X_dot]))
    acceleration = solution[:columns]
    multipliers = solution[columns:]
    assert p.D @ p.acceleration() + p.bias == pytest.approx(acceleration, abs=1e-7)
    assert p.constraint_forces() == pytest.approx(C.T @ multipliers, abs=1e-7)
    assert np.abs(p.D.T @ p.constraint_forces()).max() <= 1e-10  # they do no work
