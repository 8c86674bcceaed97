"""The contact solver against every one of the 4^n combinations of contact modes.

Each of n contacts is open, sticks, or slides one way; with its mode given the law is linear:
trying all modes finds every solution there is (Glocker, Set-Valued Force Laws, 2001).
"""

import itertools

import numpy as np
import pytest

from jansen_env.engine.contact_solver import COMPLIANCE as SOLVERS_OWN
from jansen_env.engine.contact_solver import (
    OPEN,
    SLIDE_BACKWARD,
    SLIDE_FORWARD,
    STICK,
    allocate_problem,
    regularise,
    solve,
)

COMPLIANCE = 1e-6  # of W's mean diagonal, so that the trials' systems are well conditioned
SLACK = 1e-8  # of the speeds and impulses at play, by which a trial's inequalities may be missed


def random_problems(rng, problems, count, dof=4, twins="none"):
    """Jacobians of random directions (problems, 2 count, dof), W and q = J v.

    ``twins``: the last contact is the first again, "equal" or "near" by 1e-6.
    """
    root = rng.normal(size=(problems, dof, dof))
    mobility = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(dof)
    J = rng.normal(size=(problems, 2 * count, dof))
    if twins != "none" and count > 1:
        J[:, -2:] = J[:, :2] + (1e-6 * rng.normal(size=J[:, :2].shape) if twins == "near" else 0.0)
    q = (J @ rng.normal(size=(problems, dof, 1)))[..., 0]
    return J @ mobility @ J.transpose(0, 2, 1), q


def solved(W, q, mu, guess=STICK):
    """The solver's P and u for each problem, (problems, 2 n)."""
    n = mu.shape[1]
    P, u = np.zeros_like(q), np.zeros_like(q)
    memory = allocate_problem(n)
    for k in range(len(q)):
        memory.mode[:], memory.factored[:] = guess, 0
        solve(n, memory._replace(W=W[k], v_free=q[k], mu=mu[k], P=P[k], u=u[k]))
    return P, u


def violations(W, q, mu, P):
    """|P - its projection of P - u / W_ii on the friction cone|, over |q / W_ii|, (problems,)."""
    diagonal = np.diagonal(W, axis1=1, axis2=2)
    u = (W @ P[..., None])[..., 0] + q
    ahead = P - u / diagonal
    bound = mu * np.maximum(P[:, 0::2], 0.0)
    projected = np.empty_like(P)
    projected[:, 0::2] = np.maximum(ahead[:, 0::2], 0.0)
    projected[:, 1::2] = np.clip(ahead[:, 1::2], -bound, bound)
    return np.abs(P - projected).max(axis=1) / np.abs(q / diagonal).max(axis=1)


def nearest_solution(W, q, mu, u):
    """How far ``u`` is from the nearest that fits, how far those are apart, and how many fit."""
    problems, n = mu.shape
    speed = np.abs(q).max(axis=1)
    impulse = np.abs(q / np.diagonal(W, axis1=1, axis2=2)).max(axis=1)
    nearest = np.full(problems, np.inf)
    fitting = np.zeros(problems, int)
    low, high = np.full(u.shape, np.inf), np.full(u.shape, -np.inf)
    for modes in itertools.product((OPEN, STICK, SLIDE_FORWARD, SLIDE_BACKWARD), repeat=n):
        A, b = np.zeros_like(W), np.zeros_like(q)
        for c, mode in enumerate(modes):
            i = 2 * c
            t = 2 * c + 1
            if mode == OPEN:
                A[:, i, i] = A[:, t, t] = 1.0
                continue
            A[:, i] = W[:, i]
            b[:, i] = -q[:, i]
            if mode == STICK:
                A[:, t] = W[:, t]
                b[:, t] = -q[:, t]
            else:
                A[:, t, t] = 1.0
                A[:, t, i] = mu[:, c] if mode == SLIDE_FORWARD else -mu[:, c]
        P = np.linalg.solve(A, b[..., None])[..., 0]
        w = (W @ P[..., None])[..., 0] + q
        fits = np.isfinite(P).all(axis=1)
        p_slack = SLACK * np.maximum(impulse, np.abs(P).max(axis=1))
        u_slack = SLACK * speed
        for c, mode in enumerate(modes):
            p_n = P[:, 2 * c]
            p_t = P[:, 2 * c + 1]
            u_n = w[:, 2 * c]
            u_t = w[:, 2 * c + 1]
            fits &= (p_n >= -p_slack) & (u_n >= -u_slack)
            fits &= np.abs(p_t) <= mu[:, c] * p_n + p_slack
            if mode == SLIDE_FORWARD:
                fits &= u_t >= -u_slack
            elif mode == SLIDE_BACKWARD:
                fits &= u_t <= u_slack
        fitting += fits
        distance = np.abs(w - u).max(axis=1) / speed
        nearest[fits] = np.minimum(nearest[fits], distance[fits])
        low[fits] = np.minimum(low[fits], w[fits])
        high[fits] = np.maximum(high[fits], w[fits])
    apart = np.where(fitting > 0, (high - low).max(axis=1) / speed, np.inf)
    return nearest, apart, fitting


MANY = pytest.mark.parametrize("problems", [20, pytest.param(625, marks=pytest.mark.slow)])
"""Few random problems in every run, and many in the slow tests."""
KINDS = {  # dof, twins
    "four degrees of freedom": (4, "none"),
    "three degrees of freedom, crank locked": (3, "none"),
    "twins": (4, "equal"),
    "near twins": (4, "near"),
}


def draw(kind, count, problems):
    """W, q and mu of random problems: mu from 0 to 5, an eighth of them 0."""
    rng = np.random.default_rng([20240229, list(KINDS).index(kind), count])
    dof, twins = KINDS[kind]
    W, q = random_problems(rng, problems, count, dof, twins)
    mu = rng.uniform(0.0, 5.0, (problems, count)) * (rng.random((problems, count)) > 0.125)
    return W, q, mu


@MANY
@pytest.mark.parametrize("count", [1, 2, 3, 4])
@pytest.mark.parametrize("kind", KINDS)
def test_solver_finds_one_of_all_solutions(kind, count, problems, measured):
    """P obeys the law, u is that of a combination that fits: of the only one where all agree."""
    W, q, mu = draw(kind, count, problems)
    mean = np.trace(W, axis1=1, axis2=2) / (2 * count)
    W += COMPLIANCE * mean[:, None, None] * np.eye(2 * count)
    P, u = solved(W, q, mu)
    nearest, apart, fitting = nearest_solution(W, q, mu, u)
    assert (fitting > 0).all()
    unique = apart <= 1e-6
    assert unique.mean() > 0.6
    where = f"{problems} problems, {count} contacts, {kind}"
    measured(f"contact law violated, {where}", violations(W, q, mu, P).max(), 2e-12)
    measured(f"velocity off the nearest of 4^n trials, {where}", nearest.max(), 1e-9)
    measured(f"velocity off the only answer, {where}", nearest[unique].max(), 1e-9)


@MANY
@pytest.mark.parametrize("count", [1, 2, 3, 4])
@pytest.mark.parametrize("kind", KINDS)
def test_singular_problems_obey_the_law(kind, count, problems, measured):
    """With the kernels' own compliance, 1e-11: W as singular as a robot's on many toes."""
    W, q, mu = draw(kind, count, problems)
    for w in W:
        regularise(count, w, SOLVERS_OWN)
    P, _ = solved(W, q, mu)
    wrong = violations(W, q, mu, P).max()
    measured(f"contact law violated, {problems} singular, {count} contacts, {kind}", wrong, 3e-8)


def test_a_standing_robot_may_have_three_answers(measured):
    """At crank angle 0.3 under 11 N m: the fore toe slides, or the back toe, or both.

    The solver returns one of them whatever its first guess, and all three obey the law.
    """
    W = np.array([
        [0.3492, -0.0592, 0.2909, -0.0582], [-0.0592, 0.5130, 0.0369, 0.4791],
        [0.2909, 0.0369, 0.3253, 0.0357], [-0.0582, 0.4791, 0.0357, 0.4551],
    ])[None]  # fmt: skip
    q = np.array([[-0.009688, -0.008158, -0.009959, -0.002974]])
    mu = np.full((1, 2), 0.8)
    for guess in (OPEN, STICK, SLIDE_FORWARD, SLIDE_BACKWARD):
        _, u = solved(W, q, mu, guess)
        nearest, apart, fitting = nearest_solution(W, q, mu, u)
        assert fitting[0] == 3 and apart[0] > 0.1
        measured("standing robot: velocity off the nearest of three answers", nearest[0], 1e-10)
