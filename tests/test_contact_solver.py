"""Contact impulses: Signorini and Coulomb, checked by the law itself.

Problems are random and consistent: 4 freedoms, contacts of any direction, q = J v. More than two
contacts have more unknowns than freedoms; W is then singular but for the compliance added to it.
"""

from __future__ import annotations

import numpy as np
import pytest

from jansen_env.engine.contact_solver import (
    COMPLIANCE,
    OPEN,
    SLIDE_BACKWARD,
    SLIDE_FORWARD,
    STICK,
    problem,
    regularise,
    solve,
)


def random_problem(rng, count, twins=False):
    """W (without compliance) and q of random contacts; with twins the last repeats the first."""
    root = rng.normal(size=(4, 4))
    J = rng.normal(size=(2 * count, 4))
    if twins:
        J[-2:] = J[:2]
    return J @ (root @ root.T + 0.1 * np.eye(4)) @ J.T, J @ rng.normal(size=4)


def impulses(W, q, mu, guess=STICK):
    """P, u and the modes; the solver's own residual must be the returned one."""
    count = len(mu)
    posed = problem(count)._replace(W=W, v_free=q, mu=mu, mode=np.full(count, guess, np.int64))
    solve(count, posed)
    P, u, mode = posed.P, posed.u, posed.mode
    assert np.abs(W @ P + q - u).max() <= 1e-12 * max(1.0, np.abs(W @ np.diag(P)).max())
    return P, u, mode


@pytest.mark.parametrize("mu", [0.1, 0.8, 2.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_stick_slip_threshold_is_exact(mu, sign):
    """One contact: it sticks up to mu times its load and slips beyond; told apart at 1e-9."""
    W, normal = np.diag([2.0, 0.5]), 3.0
    load = normal / W[0, 0]
    limit = W[1, 1] * mu * load  # m/s that friction can just stop
    P, u, mode = impulses(W, np.array([-normal, sign * limit * (1.0 - 1e-9)]), np.array([mu]))
    assert mode[0] == STICK and abs(u[1]) <= 1e-15 and P[0] == load
    P, u, mode = impulses(W, np.array([-normal, sign * limit * (1.0 + 1e-9)]), np.array([mu]))
    assert mode[0] == (SLIDE_FORWARD if sign > 0.0 else SLIDE_BACKWARD)
    assert P[1] == -sign * mu * load
    assert u[1] == pytest.approx(sign * 1e-9 * limit, rel=1e-5)


def test_a_leaving_contact_gets_no_impulse(rng):
    """u_n > 0 without impulse stays so: P is exactly 0 and u exactly q."""
    for _ in range(20):
        W, q = random_problem(rng, 1)
        q[0] = abs(q[0])
        P, u, mode = impulses(W, q, np.array([0.8]))
        assert mode[0] == OPEN and (P == 0.0).all() and (u == q).all()


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_frictionless(count, rng):
    """mu = 0: no tangential impulse, and u_n, P_n solve the linear complementarity problem."""
    for _ in range(100):
        W, q = random_problem(rng, count)
        regularise(count, W, COMPLIANCE)
        P, u, _ = impulses(W, q, np.zeros(count))
        assert (P[1::2] == 0.0).all() and P[0::2].min() >= 0.0 and u[0::2].min() >= -1e-9
        assert np.abs(P[0::2] * u[0::2]).max() <= 1e-9 * np.abs(P * q).max() + 1e-30


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_large_friction_stays_finite(count, rng):
    """mu = 5, where several or no mode combinations may be near: no NaN, nothing pulls."""
    for k in range(300):
        W, q = random_problem(rng, count, twins=k % 3 == 0)
        regularise(count, W, COMPLIANCE)
        P, u, _ = impulses(W, q, np.full(count, 5.0))
        assert np.isfinite(P).all() and np.isfinite(u).all()
        assert P[0::2].min() >= -1e-9 * np.abs(P).max()
        assert (np.abs(P[1::2]) <= 5.0 * P[0::2] + 1e-9 * np.abs(P).max()).all()


def test_twins_share_their_load():
    """Two equal contacts carry half each: the compliance makes redundant loads unique, to 1e-4."""
    J = np.array([[0.0, 1.0, 0.3, 0.0], [1.0, 0.0, 0.5, 0.0]] * 2)
    W = J @ J.T
    q = np.array([-1.0, 0.1] * 2)
    regularise(2, W, COMPLIANCE)
    P, u, _ = impulses(W, q, np.array([0.8, 0.8]))
    assert np.abs(u).max() <= 1e-10
    assert P[0] == pytest.approx(P[2], rel=1e-4) and P[1] == pytest.approx(P[3], rel=1e-4)
