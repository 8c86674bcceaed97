"""Contact impulses of one time step: planar Coulomb contacts solved exactly.

The contacts i have normal and tangential impulses P = (n_0, t_0, n_1, t_1, ...). After the
impulses, the contacts have the velocities u = W P + v_free. W is the Delassus matrix J M^-1 J^T,
and v_free contains the velocities without contact impulses, including restitution. The solver finds

    0 <= P_n  perpendicular to  u_n >= 0                          (Signorini)
    |P_t| <= mu P_n,   P_t = -mu P_n sign(u_t) where u_t != 0     (Coulomb, maximum dissipation)

Each contact is open, sticks, or slides in one of two directions. For given modes, the problem is
linear. The solver guesses the modes (those of the last time step), solves the linear problem,
checks the solution and updates the modes. This nearly always ends after one or two rounds. If it
does not, the solver applies Lemke's method to the complementarity problem of Stewart and Trinkle
(IJNME 39, 1996). Anitescu and Potra (Nonlinear Dynamics 14, 1997) prove that a solution exists and
that Lemke's method finds it.

In this module, ``problem`` is a :class:`jansen_env.engine.records.Problem`, and ``count`` is the
number of contacts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine.kernel import stage
from jansen_env.engine.lemke import lemke
from jansen_env.engine.records import Problem

OPEN, STICK, SLIDE_FORWARD, SLIDE_BACKWARD = 0, 1, 2, 3
"""Contact modes. "Forward" means a tangential velocity u_t > 0, so that friction is negative."""

ACCURACY = 1e-11
"""Largest residual of an accepted solution, relative to the largest impulse in the problem."""
COMPLIANCE = 1e-11
"""Value added to the diagonal of W, relative to the mean of the diagonal.

It makes redundant contacts share their load.
"""
WEDGE_COMPLIANCE = 1e-3
"""Value that replaces :data:`COMPLIANCE` if pads are wedged; it limits the force between them."""
MODE_ROUNDS = 12
"""Number of times that the modes are guessed before Lemke's method is applied."""
LEMKE_COMPLIANCES = (1e-9, 1e-6, 1e-4)
"""Increasing compliances that are tried with Lemke's method, because they improve its pivots.

The modes that the method finds are checked without this compliance.
"""
PROXIMITY = 1e-4
"""Step parameter of the proximal-point iteration, relative to the mean of the diagonal of W.

This iteration is the last resort.
"""
PROXIMAL_ROUNDS = 200
"""Largest number of proximal-point iterations."""


def index_size(count: int) -> int:
    """Return the number of integers that :func:`solve` needs as work space.

    Args:
        count: Largest number of contacts.
    """
    return 10 * count + 1


def spare_space(count: int) -> NDArray[np.float64]:
    """Return work space for the search for modes: four vectors, and the tableau of Lemke's method.

    Args:
        count: Largest number of contacts.
    """
    return np.zeros((4 * count + 4, 8 * count + 2))


def allocate_problem(count: int) -> Problem:
    """Return memory for the contact law of some contacts, with all values 0.

    Args:
        count: Largest number of contacts.
    """
    n = 2 * count
    return Problem(
        W=np.zeros((n, n)),
        v_free=np.zeros(n),
        mu=np.zeros(count),
        mode=np.zeros(count, np.int64),
        P=np.zeros(n),
        u=np.zeros(n),
        A=np.zeros((n, n)),
        rhs=np.zeros(n),
        factored=np.zeros(1, np.int64),
        factored_modes=np.zeros(count, np.int64),
        unknowns=np.zeros(n, np.int64),
        exchanges=np.zeros(n, np.int64),
        search=np.zeros(5 * count, np.int64),
        spare=spare_space(count),
    )


@stage
def residual(count, problem):
    """Return the largest violation of the contact law, in N s, and store u = W P + v_free.

    The violation is measured with the natural map of Alart and Curnier, whose step is the diagonal
    of W: |P - proj(P - u / W_ii)|.
    """
    W, P, u = problem.W, problem.P, problem.u
    worst = 0.0
    for i in range(2 * count):
        total = problem.v_free[i]
        for j in range(2 * count):
            total += W[i, j] * P[j]
        u[i] = total
    for c in range(count):
        n, t = 2 * c, 2 * c + 1
        normal = max(0.0, P[n] - u[n] / W[n, n])
        worst = max(worst, abs(P[n] - normal))
        bound = problem.mu[c] * max(P[n], 0.0)
        friction = min(bound, max(-bound, P[t] - u[t] / W[t, t]))
        worst = max(worst, abs(P[t] - friction))
    return worst


@stage
def _factored(count, problem):
    """Return whether A already contains the factors for the present modes, from the last call."""
    same = problem.factored[0] > 0
    for c in range(count):
        same = same and problem.factored_modes[c] == problem.mode[c]
    return same


@stage
def _assemble(count, problem):
    """Store the matrix of the linear problem for the present modes in A.

    Returns:
        The number of unknowns.
    """
    W, A, unknowns = problem.W, problem.A, problem.unknowns
    k = 0
    for c in range(count):
        problem.factored_modes[c] = problem.mode[c]
        if problem.mode[c] != OPEN:
            unknowns[k] = 2 * c
            k += 1
            if problem.mode[c] == STICK:
                unknowns[k] = 2 * c + 1
                k += 1
    for r in range(k):
        i = unknowns[r]
        for s in range(k):
            j = unknowns[s]
            A[r, s] = W[i, j]
            if j % 2 == 0:
                kind = problem.mode[j // 2]
                if kind == SLIDE_FORWARD:
                    A[r, s] -= problem.mu[j // 2] * W[i, j + 1]
                elif kind == SLIDE_BACKWARD:
                    A[r, s] += problem.mu[j // 2] * W[i, j + 1]
    return k


@stage
def _factor(count, problem):
    """Store the LU factors of the linear problem for the present modes in A.

    The function also stores what the factors belong to: ``unknowns``, ``exchanges``,
    ``factored_modes`` and ``factored``.

    Returns:
        False if the linear problem is singular.
    """
    if _factored(count, problem):
        return True
    k = _assemble(count, problem)
    A, unknowns = problem.A, problem.unknowns
    problem.factored[0] = 0
    for r in range(k):
        best = r
        for s in range(r + 1, k):
            if abs(A[s, r]) > abs(A[best, r]):
                best = s
        if abs(A[best, r]) < 1e-14 * problem.W[unknowns[r], unknowns[r]]:
            return False
        problem.exchanges[r] = best
        if best != r:
            for s in range(r, k):
                A[r, s], A[best, s] = A[best, s], A[r, s]
        for s in range(r + 1, k):
            A[s, r] /= A[r, r]
            if A[s, r] != 0.0:
                for j in range(r + 1, k):
                    A[s, j] -= A[s, r] * A[r, j]
    problem.factored[0] = k
    return True


@stage
def _solve_modes(count, problem):
    """Compute the impulses for the present modes by Gaussian elimination.

    Returns:
        False if the linear problem is singular.
    """
    if not _factor(count, problem):
        return False
    P, A, rhs, unknowns = problem.P, problem.A, problem.rhs, problem.unknowns
    k = problem.factored[0]
    for r in range(k):
        rhs[r] = -problem.v_free[unknowns[r]]
    for r in range(k):
        best = problem.exchanges[r]
        if best != r:
            rhs[r], rhs[best] = rhs[best], rhs[r]
        for s in range(r + 1, k):
            if A[s, r] != 0.0:
                rhs[s] -= A[s, r] * rhs[r]
    for i in range(2 * count):
        P[i] = 0.0
    for r in range(k - 1, -1, -1):
        total = rhs[r]
        for s in range(r + 1, k):
            total -= A[r, s] * rhs[s]
        rhs[r] = total / A[r, r]
    for r in range(k):
        P[unknowns[r]] = rhs[r]
    for c in range(count):
        if problem.mode[c] == SLIDE_FORWARD:
            P[2 * c + 1] = -problem.mu[c] * P[2 * c]
        elif problem.mode[c] == SLIDE_BACKWARD:
            P[2 * c + 1] = problem.mu[c] * P[2 * c]
    return True


@stage
def _update_modes(count, problem, one_only):
    """Change the mode of each contact whose impulse or velocity contradicts it.

    If ``one_only`` is true, only the first such contact changes.
    """
    mu, mode, P, u = problem.mu, problem.mode, problem.P, problem.u
    for c in range(count):
        n, t = P[2 * c], P[2 * c + 1]
        before = mode[c]
        if mode[c] == OPEN:
            if u[2 * c] < 0.0:
                mode[c] = STICK
        elif n < 0.0:
            mode[c] = OPEN
        elif mode[c] == STICK:
            if t > mu[c] * n:
                mode[c] = SLIDE_BACKWARD
            elif t < -mu[c] * n:
                mode[c] = SLIDE_FORWARD
        elif mode[c] == SLIDE_FORWARD:
            if u[2 * c + 1] < 0.0:
                mode[c] = STICK
        elif u[2 * c + 1] > 0.0:
            mode[c] = STICK
        if one_only and mode[c] != before:
            return


@stage
def _solve_from_guess(count, problem, tolerance):
    """Solve the problem, check the solution and update the modes, for several rounds.

    P then holds the solution, or the result of the last round. If the modes are singular, P is 0.

    Returns:
        The residual for P, in N s.
    """
    for attempt in range(MODE_ROUNDS):
        if not _solve_modes(count, problem):
            break
        error = residual(count, problem)
        if error <= tolerance or attempt == MODE_ROUNDS - 1:
            return error
        _update_modes(count, problem, attempt >= MODE_ROUNDS // 2)
    for i in range(2 * count):
        problem.P[i] = 0.0
    return residual(count, problem)


@stage(inline=False)
def _solve_again(count, problem, tolerance):
    """Call :func:`_solve_from_guess` in code that is rarely needed.

    This function is not inlined, so the machine code for the rare cases contains the solver only
    once.
    """
    return _solve_from_guess(count, problem, tolerance)


@stage
def solve(count, problem):
    """Solve the contact law, and return the :func:`residual` of the solution, in N s.

    Args:
        count: Number of contacts.
        problem: Contact law: W after :func:`regularise`, v_free, mu, and a first guess of the
            modes. The function stores P, u and mode. If factored[0] is 0, nothing is reused
            from the last call. Otherwise, W, mu and ``count`` must be the same as in the last call.
    """
    scale = 0.0
    for i in range(2 * count):
        scale = max(scale, abs(problem.v_free[i]) / problem.W[i, i])
    tolerance = ACCURACY * scale
    error = _solve_from_guess(count, problem, tolerance)
    if error <= tolerance:
        return error
    return search(count, problem, tolerance, error)


@stage(inline=False)
def search(count, problem, tolerance, error):
    """Solve the contact law by Lemke's method, and then by the proximal-point iteration.

    P then holds the best solution that was found.

    Args:
        count: Number of contacts.
        problem: Contact law, see :func:`solve`.
        tolerance: Largest residual of an accepted solution, in N s.
        error: Residual of the present solution, in N s.

    Returns:
        The residual for P, in N s.
    """
    kept, best, modes = problem.spare[0], problem.spare[1], problem.search
    _keep(count, problem.P, problem.mode, best, modes)
    for compliance in LEMKE_COMPLIANCES:
        if not lemke(count, problem, compliance, problem.spare[4:], modes[count:]):
            continue
        # Candidates are the solution itself and the solution for the modes that it suggests.
        last = _check(count, problem)
        for i in range(2 * count):
            kept[i] = problem.P[i]
        _modes_of(count, problem)
        polished = _solve_again(count, problem, tolerance)
        if polished <= tolerance:
            return polished
        if last < polished:
            for i in range(2 * count):
                problem.P[i] = kept[i]
        if min(last, polished) < error:
            error = min(last, polished)
            _keep(count, problem.P, problem.mode, best, modes)
    _keep(count, best, modes, problem.P, problem.mode)
    return _proximal_point(count, problem, tolerance, error)


@stage(inline=False)
def _check(count, problem):
    """Call :func:`residual` in code that is rarely needed.

    This function is not inlined, so the machine code for the rare cases contains it only once.
    """
    return residual(count, problem)


@stage(inline=False)
def _keep(count, P, mode, kept_P, kept_mode):
    """Copy the impulses and modes of the contacts."""
    for i in range(2 * count):
        kept_P[i] = P[i]
    for c in range(count):
        kept_mode[c] = mode[c]


@stage
def _modes_of(count, problem):
    """Store the modes that an approximate solution suggests."""
    P, mode = problem.P, problem.mode
    negligible = 0.0
    for i in range(2 * count):
        negligible = max(negligible, abs(P[i]))
    negligible *= 1e-8
    for c in range(count):
        n, t = P[2 * c], P[2 * c + 1]
        if n <= negligible:
            mode[c] = OPEN
        elif abs(t) < problem.mu[c] * n * (1.0 - 1e-9):
            mode[c] = STICK
        else:
            mode[c] = SLIDE_BACKWARD if t > 0.0 else SLIDE_FORWARD


@stage
def _proximal_point(count, problem, tolerance, error):
    """Solve the contact law by a proximal-point iteration, as a last resort.

    Each iteration solves the better conditioned problem with W + rho 1 and v_free - rho P, where P
    is the solution of the iteration before.

    Returns:
        The residual of the best solution, in N s.
    """
    n, P, W, v_free = 2 * count, problem.P, problem.W, problem.v_free
    best, diagonal, free = problem.spare[1], problem.spare[2], problem.spare[3]
    modes = problem.search
    trace = 0.0
    for i in range(n):
        diagonal[i], free[i] = W[i, i], v_free[i]
        trace += W[i, i]
    rho = PROXIMITY * trace / n
    problem.factored[0] = 0  # W changes, so the factors in A are invalid.
    _keep(count, P, problem.mode, best, modes)
    for _ in range(PROXIMAL_ROUNDS):
        for i in range(n):
            W[i, i], v_free[i] = diagonal[i] + rho, free[i] - rho * P[i]
        _solve_again(count, problem, tolerance)
        for i in range(n):
            W[i, i], v_free[i] = diagonal[i], free[i]
        last = _check(count, problem)
        if last < error:
            error = last
            _keep(count, P, problem.mode, best, modes)
        if error <= tolerance:
            break
    _keep(count, best, modes, P, problem.mode)
    problem.factored[0] = 0
    return _check(count, problem)


@stage
def regularise(count, W, compliance):
    """Add a compliance to the diagonal of W, so that redundant contacts share their load.

    Args:
        count: Number of contacts.
        W: Delassus matrix, changed in place, shape (2 count, 2 count) or larger.
        compliance: Value to add, relative to the mean of the diagonal.
    """
    trace = 0.0
    for i in range(2 * count):
        trace += W[i, i]
    for i in range(2 * count):
        W[i, i] += compliance * trace / (2 * count)
