"""The contact impulses of one time step: planar Coulomb contacts solved exactly.

For contacts i with normal and tangential impulses P = (n_0, t_0, n_1, t_1, ...) and the velocities
u = W P + v_free they leave behind (W the Delassus matrix J M^-1 J^T, v_free the velocities without
contact, restitution included), find

    0 <= P_n  perpendicular to  u_n >= 0                          (Signorini)
    |P_t| <= mu P_n,   P_t = -mu P_n sign(u_t) where u_t != 0     (Coulomb, maximum dissipation)

Each contact is open, sticks, or slides one way, and for given modes the problem is linear. Modes
are guessed (the last step's), solved, checked and updated, which nearly always ends after one or
two rounds. Where it does not, Lemke's method on the complementarity problem of Stewart and Trinkle
(IJNME 39, 1996) gives a solution; Anitescu and Potra (Nonlinear Dynamics 14, 1997) prove that it
exists and that Lemke finds it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine.kernel import stage
from jansen_env.engine.lemke import lemke
from jansen_env.engine.records import Problem

OPEN, STICK, SLIDE_FORWARD, SLIDE_BACKWARD = 0, 1, 2, 3
"""Contact modes; forward: tangential velocity u_t > 0, so friction is negative."""

ACCURACY = 1e-11  # of the accepted solution's residual, relative to the largest impulse at play
COMPLIANCE = 1e-11  # added to W, relative to its mean diagonal: redundant contacts share load
WEDGE_COMPLIANCE = 1e-3  # the same where pads are wedged, which bounds the force they hold
MODE_ROUNDS = 12  # guesses of the modes before Lemke's method is called
LEMKE_COMPLIANCES = (1e-9, 1e-6, 1e-4)  # softer and softer, for its pivots' sake; modes are checked
PROXIMITY = 1e-4  # of the last resort, relative to W's mean diagonal
PROXIMAL_ROUNDS = 200


def index_size(count: int) -> int:
    """Integers that :func:`solve` needs as work space for ``count`` contacts."""
    return 10 * count + 1


def spare_space(count: int) -> NDArray[np.float64]:
    """Work space to search for modes: four vectors, Lemke's tableau."""
    return np.zeros((4 * count + 4, 8 * count + 2))


def problem(count: int) -> Problem:
    """Memory for the contact law of ``count`` contacts, all 0."""
    n = 2 * count
    return Problem(
        W=np.zeros((n, n)), v_free=np.zeros(n), mu=np.zeros(count), mode=np.zeros(count, np.int64),
        P=np.zeros(n), u=np.zeros(n), A=np.zeros((n, n)), rhs=np.zeros(n),
        indices=np.zeros(index_size(count), np.int64), spare=spare_space(count),
    )  # fmt: skip


@stage
def residual(count, problem):
    """Largest violation of the contact law, N s; fills ``u`` = W P + v_free.

    The natural map of Alart and Curnier with W's diagonal as step: |P - proj(P - u / W_ii)|.
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
    """Whether A has the factors of these modes already, from the last call."""
    same = problem.indices[5 * count] > 0
    for c in range(count):
        same = same and problem.indices[4 * count + c] == problem.mode[c]
    return same


@stage
def _assemble(count, problem):
    """The linear problem that the modes pose, into A; returns how many unknowns it has."""
    W, A, indices = problem.W, problem.A, problem.indices
    k = 0
    for c in range(count):
        indices[4 * count + c] = problem.mode[c]
        if problem.mode[c] != OPEN:
            indices[k] = 2 * c
            k += 1
            if problem.mode[c] == STICK:
                indices[k] = 2 * c + 1
                k += 1
    for r in range(k):
        i = indices[r]
        for s in range(k):
            j = indices[s]
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
    """LU factors, into A, of the linear problem that the modes pose; False where it is singular.

    ``indices``: which unknowns take part, which rows change places, the modes, how many unknowns.
    """
    if _factored(count, problem):
        return True
    k = _assemble(count, problem)
    A, indices = problem.A, problem.indices
    indices[5 * count] = 0
    for r in range(k):
        best = r
        for s in range(r + 1, k):
            if abs(A[s, r]) > abs(A[best, r]):
                best = s
        if abs(A[best, r]) < 1e-14 * problem.W[indices[r], indices[r]]:
            return False
        indices[2 * count + r] = best
        if best != r:
            for s in range(r, k):
                A[r, s], A[best, s] = A[best, s], A[r, s]
        for s in range(r + 1, k):
            A[s, r] /= A[r, r]
            if A[s, r] != 0.0:
                for j in range(r + 1, k):
                    A[s, j] -= A[s, r] * A[r, j]
    indices[5 * count] = k
    return True


@stage
def _solve_modes(count, problem):
    """Impulses for given modes by Gaussian elimination; False where the modes are singular."""
    if not _factor(count, problem):
        return False
    P, A, rhs, indices = problem.P, problem.A, problem.rhs, problem.indices
    k = indices[5 * count]
    for r in range(k):
        rhs[r] = -problem.v_free[indices[r]]
    for r in range(k):
        best = indices[2 * count + r]
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
        P[indices[r]] = rhs[r]
    for c in range(count):
        if problem.mode[c] == SLIDE_FORWARD:
            P[2 * c + 1] = -problem.mu[c] * P[2 * c]
        elif problem.mode[c] == SLIDE_BACKWARD:
            P[2 * c + 1] = problem.mu[c] * P[2 * c]
    return True


@stage
def _update_modes(count, problem, one_only):
    """Change the mode of every (or the first) contact whose impulse or velocity contradicts it."""
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
    """Solve, check and update the modes; leaves the solution, or the least wrong try, in P."""
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
    """:func:`_solve_from_guess`, once in the machine code of what is rarely needed."""
    return _solve_from_guess(count, problem, tolerance)


@stage
def solve(count, problem):
    """Solve the contact law for ``count`` contacts; returns the solution's :func:`residual`.

    Args:
        problem: W with :func:`regularise` applied, v_free, mu and mode; P, u and mode are filled.
            With indices[5 count] = 0 nothing is kept from the call before; else W, mu and count
            must be the same as there.
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
    """Solve by Lemke's method, then by the proximal-point iteration; P holds the best try."""
    kept, best, modes = problem.spare[0], problem.spare[1], problem.indices[5 * count + 1 :]
    _keep(count, problem.P, problem.mode, best, modes)
    for compliance in LEMKE_COMPLIANCES:
        if not lemke(count, problem, compliance, problem.spare[4:], modes[count:]):
            continue
        last = _check(count, problem)  # itself a candidate, and so are the modes it points to
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
    """:func:`residual`, once in the machine code of what is rarely needed."""
    return residual(count, problem)


@stage(inline=False)
def _keep(count, P, mode, kept_P, kept_mode):
    """Copy impulses and modes."""
    for i in range(2 * count):
        kept_P[i] = P[i]
    for c in range(count):
        kept_mode[c] = mode[c]


@stage
def _modes_of(count, problem):
    """Modes that an approximate solution points to."""
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
    """Last resort: solve W + rho 1 with v_free - rho P, from the last P on: better conditioned."""
    n, P, W, v_free = 2 * count, problem.P, problem.W, problem.v_free
    best, diagonal, free = problem.spare[1], problem.spare[2], problem.spare[3]
    modes = problem.indices[5 * count + 1 :]
    trace = 0.0
    for i in range(n):
        diagonal[i], free[i] = W[i, i], v_free[i]
        trace += W[i, i]
    rho = PROXIMITY * trace / n
    problem.indices[5 * count] = 0  # another W
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
    problem.indices[5 * count] = 0
    return _check(count, problem)


@stage
def regularise(count, W, compliance):
    """Add ``compliance`` to W's diagonal, relative to its mean: redundant contacts share load."""
    trace = 0.0
    for i in range(2 * count):
        trace += W[i, i]
    for i in range(2 * count):
        W[i, i] += compliance * trace / (2 * count)
