"""The contact impulses of one time step: planar Coulomb contacts solved exactly.

For contacts i with normal and tangential impulses P = (n_0, t_0, n_1, t_1, ...) and the velocities
u = W P + q they leave behind (W the Delassus matrix J M^-1 J^T, q the velocities without contact,
restitution included), find

    0 <= P_n  perpendicular to  u_n >= 0                          (Signorini)
    |P_t| <= mu P_n,   P_t = -mu P_n sign(u_t) where u_t != 0     (Coulomb, maximum dissipation)

Each contact is open, sticks, or slides one way, and for given modes the problem is linear. Modes
are guessed (the last step's), solved, checked and mended, which nearly always ends after one or two
rounds. Where it does not, Lemke's method on the complementarity problem of Stewart and Trinkle
(IJNME 39, 1996) gives a solution; Anitescu and Potra (Nonlinear Dynamics 14, 1997) prove that it
exists and that Lemke finds it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine.jit import compiled

Array = NDArray[np.float64]

OPEN, STICK, SLIDE_FORWARD, SLIDE_BACKWARD = 0, 1, 2, 3
"""Contact modes; forward: tangential velocity u_t > 0, so friction is negative."""

ACCURACY = 1e-11  # of the accepted solution's residual, relative to the largest impulse at play
COMPLIANCE = 1e-11  # added to W, relative to its mean diagonal: redundant contacts share load
WEDGE_COMPLIANCE = 1e-3  # the same where pads are wedged, which bounds the force they hold
MODE_ROUNDS = 12  # guesses of the modes before Lemke's method is called
LEMKE_COMPLIANCES = (1e-9, 1e-6, 1e-4)  # softer and softer, for its pivots' sake; modes are checked
PIVOT = 1e-11  # smallest pivot Lemke's method takes, after scaling
PERTURBATION = 1e-9  # of its right-hand side, after scaling
PROXIMITY = 1e-4  # of the last resort, relative to W's mean diagonal
PROXIMAL_ROUNDS = 200


def index_space(count: int) -> NDArray[np.int64]:
    """Work space of :func:`solve` for ``count`` contacts, nothing kept from an earlier call."""
    return np.zeros(5 * count + 1, np.int64)


@compiled(forceinline=True)
def residual(count, W, q, mu, P, u):
    """Largest violation of the contact law, N s; fills ``u`` = W P + q.

    The natural map of Alart and Curnier with W's diagonal as step: |P - proj(P - u / W_ii)|.
    """
    worst = 0.0
    for i in range(2 * count):
        total = q[i]
        for j in range(2 * count):
            total += W[i, j] * P[j]
        u[i] = total
    for c in range(count):
        n, t = 2 * c, 2 * c + 1
        normal = max(0.0, P[n] - u[n] / W[n, n])
        worst = max(worst, abs(P[n] - normal))
        bound = mu[c] * max(P[n], 0.0)
        friction = min(bound, max(-bound, P[t] - u[t] / W[t, t]))
        worst = max(worst, abs(P[t] - friction))
    return worst


@compiled(forceinline=True)
def _factor(count, W, mu, mode, A, index):
    """LU factors, into A, of the linear problem that the modes pose; False where it is singular.

    ``index`` holds which unknowns take part, which rows change places, the modes, and how many
    unknowns there are. Factors of the same modes, from the last call, are kept.
    """
    size = index[5 * count]
    if size > 0:
        same = True
        for c in range(count):
            same = same and index[4 * count + c] == mode[c]
        if same:
            return True
    k = 0
    for c in range(count):
        index[4 * count + c] = mode[c]
        if mode[c] != OPEN:
            index[k] = 2 * c
            k += 1
            if mode[c] == STICK:
                index[k] = 2 * c + 1
                k += 1
    for r in range(k):
        i = index[r]
        for s in range(k):
            j = index[s]
            A[r, s] = W[i, j]
            if j % 2 == 0:
                kind = mode[j // 2]
                if kind == SLIDE_FORWARD:
                    A[r, s] -= mu[j // 2] * W[i, j + 1]
                elif kind == SLIDE_BACKWARD:
                    A[r, s] += mu[j // 2] * W[i, j + 1]
    index[5 * count] = 0
    for r in range(k):
        best = r
        for s in range(r + 1, k):
            if abs(A[s, r]) > abs(A[best, r]):
                best = s
        if abs(A[best, r]) < 1e-14 * W[index[r], index[r]]:
            return False
        index[2 * count + r] = best
        if best != r:
            for s in range(r, k):
                A[r, s], A[best, s] = A[best, s], A[r, s]
        for s in range(r + 1, k):
            A[s, r] /= A[r, r]
            if A[s, r] != 0.0:
                for j in range(r + 1, k):
                    A[s, j] -= A[s, r] * A[r, j]
    index[5 * count] = k
    return True


@compiled(forceinline=True)
def _solve_modes(count, W, q, mu, mode, P, A, rhs, index):
    """Impulses for given modes by Gaussian elimination; False where the modes are singular."""
    if not _factor(count, W, mu, mode, A, index):
        return False
    k = index[5 * count]
    for r in range(k):
        rhs[r] = -q[index[r]]
    for r in range(k):
        best = index[2 * count + r]
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
        P[index[r]] = rhs[r]
    for c in range(count):
        if mode[c] == SLIDE_FORWARD:
            P[2 * c + 1] = -mu[c] * P[2 * c]
        elif mode[c] == SLIDE_BACKWARD:
            P[2 * c + 1] = mu[c] * P[2 * c]
    return True


@compiled(forceinline=True)
def _mend_modes(count, mu, mode, P, u, one_only):
    """Change the mode of every (or the first) contact whose impulse or velocity contradicts it."""
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


@compiled(allocates=True)
def _lemke(count, W, q, mu, softening, P):
    """Lemke's method on (P_n, P_t+, P_t-, bound) of Stewart and Trinkle; True where it ends.

    W's diagonal is taken (1 + softening) times as large, and q is perturbed: good for the modes.
    """
    size = 4 * count
    mass = 1.0 / np.max(np.diag(W)[: 2 * count])  # work in scaled, dimensionless numbers
    speed = np.max(np.abs(q[: 2 * count]))
    right = 2 * size + 1
    T = np.zeros((size, 2 * size + 2))  # w | z | artificial | right-hand side
    for c in range(count):
        rows = (4 * c, 4 * c + 1, 4 * c + 2, 4 * c + 3)
        for r in rows:
            T[r, r] = 1.0
            T[r, 2 * size] = -1.0
        for d in range(count):
            z = size + 4 * d
            for r, i, sign in ((0, 2 * c, 1.0), (1, 2 * c + 1, 1.0), (2, 2 * c + 1, -1.0)):
                T[rows[r], z] = -sign * mass * W[i, 2 * d]
                T[rows[r], z + 1] = -sign * mass * W[i, 2 * d + 1]
                T[rows[r], z + 2] = sign * mass * W[i, 2 * d + 1]
                if c == d:
                    extra = sign * softening * mass * W[i, i]
                    T[rows[r], z + (0 if r == 0 else 1)] -= extra
                    T[rows[r], z + 2] += 0.0 if r == 0 else extra
        T[rows[1], size + 4 * c + 3] = -1.0
        T[rows[2], size + 4 * c + 3] = -1.0
        T[rows[3], size + 4 * c] = -mu[c]
        T[rows[3], size + 4 * c + 1] = 1.0
        T[rows[3], size + 4 * c + 2] = 1.0
        T[rows[0], right] = q[2 * c] / speed
        T[rows[1], right] = q[2 * c + 1] / speed
        T[rows[2], right] = -q[2 * c + 1] / speed
    basis = np.arange(size)
    for r in range(size):  # no two rows alike, so that no cycle can form
        T[r, right] += PERTURBATION * (1.0 + (0.618033988749895 * r) % 1.0)
    pivot_row = int(np.argmin(T[:, right]))
    entering = 2 * size
    if T[pivot_row, right] < 0.0:
        for _ in range(50 * size):
            leaving = basis[pivot_row]
            T[pivot_row] /= T[pivot_row, entering]
            for r in range(size):
                if r != pivot_row and T[r, entering] != 0.0:
                    T[r] -= T[r, entering] * T[pivot_row]
            basis[pivot_row] = entering
            if leaving == 2 * size:
                break
            entering = leaving + size if leaving < size else leaving - size
            pivot_row = -1
            for r in range(size):
                if T[r, entering] > PIVOT and (
                    pivot_row < 0
                    or T[r, right] * T[pivot_row, entering] < T[pivot_row, right] * T[r, entering]
                ):
                    pivot_row = r
            if pivot_row < 0:
                return False
    for i in range(2 * count):
        P[i] = 0.0
    for r in range(size):
        variable = basis[r] - size
        if variable >= size:
            return False  # the artificial variable is still in the basis
        if variable >= 0:
            c, kind = variable // 4, variable % 4
            if kind == 0:
                P[2 * c] += T[r, right] * mass * speed
            elif kind == 1:
                P[2 * c + 1] += T[r, right] * mass * speed
            elif kind == 2:
                P[2 * c + 1] -= T[r, right] * mass * speed
    return True


@compiled(allocates=True)
def _modes_of(count, mu, P, u, mode):
    """Modes that an approximate solution points to."""
    negligible = 1e-8 * np.max(np.abs(P[: 2 * count]))
    for c in range(count):
        n, t = P[2 * c], P[2 * c + 1]
        if n <= negligible:
            mode[c] = OPEN
        elif abs(t) < mu[c] * n * (1.0 - 1e-9):
            mode[c] = STICK
        else:
            mode[c] = SLIDE_BACKWARD if t > 0.0 else SLIDE_FORWARD


@compiled
def solve(count, W, q, mu, mode, P, u, A, rhs, index):
    """Solve the contact law for ``count`` contacts.

    Args:
        count: contacts in use; arrays may be longer.
        W: (2 count, 2 count) Delassus matrix, 1/kg, with :func:`soften` applied. q: (2 count,)
            velocities without contact impulses, m/s.
        mu: (count,) friction. mode: (count,) first guess, then the solution's modes.
        P, u: (2 count,) out: impulses N s, velocities m/s.
        A, rhs: work space, (2 count, 2 count), (2 count,). index: that of :func:`index_space`, also
            longer. With index[5 count] = 0 nothing is kept from the call before; else W, mu and
            count must be the same as there.

    Returns:
        The solution's :func:`residual`, N s.
    """
    scale = 0.0
    for i in range(2 * count):
        scale = max(scale, abs(q[i]) / W[i, i])
    tolerance = ACCURACY * scale
    error = _solve_from_guess(count, W, q, mu, mode, P, u, A, rhs, index, tolerance)
    if error <= tolerance:
        return error
    return _search(count, W, q, mu, mode, P, u, A, rhs, index, tolerance, error)


@compiled(allocates=True)
def _search(count, W, q, mu, mode, P, u, A, rhs, index, tolerance, error):
    """Solve by Lemke's method, or where that fails by :func:`_approach`; P holds the best try."""
    best, best_mode = P.copy(), mode.copy()
    for softening in LEMKE_COMPLIANCES:
        if not _lemke(count, W, q, mu, softening, P):
            continue
        answer = P.copy()  # itself a candidate, and so are the modes it points to
        last = residual(count, W, q, mu, answer, u)
        _modes_of(count, mu, P, u, mode)
        polished = _solve_from_guess(count, W, q, mu, mode, P, u, A, rhs, index, tolerance)
        if polished <= tolerance:
            return polished
        if last < polished:
            P[: 2 * count] = answer[: 2 * count]
        if min(last, polished) < error:
            error = min(last, polished)
            best[:] = P
            best_mode[:] = mode
    P[:] = best
    mode[:] = best_mode
    return _approach(count, W, q, mu, mode, P, u, A, rhs, index, tolerance, error)


@compiled(allocates=True)
def _approach(count, W, q, mu, mode, P, u, A, rhs, index, tolerance, error):
    """Last resort, the proximal point method: solve W + rho 1 with q - rho P, from the last P on.

    The shifted problem is far better conditioned, and at its fixed point it is the one asked for.
    """
    trace = 0.0
    for i in range(2 * count):
        trace += W[i, i]
    rho = PROXIMITY * trace / (2 * count)
    shifted, moved = W[: 2 * count, : 2 * count].copy(), q[: 2 * count].copy()
    for i in range(2 * count):
        shifted[i, i] += rho
    index[5 * count] = 0  # another W
    best, best_mode = P[: 2 * count].copy(), mode[:count].copy()
    for _ in range(PROXIMAL_ROUNDS):
        for i in range(2 * count):
            moved[i] = q[i] - rho * P[i]
        _solve_from_guess(count, shifted, moved, mu, mode, P, u, A, rhs, index, tolerance)
        last = residual(count, W, q, mu, P, u)
        if last < error:
            error = last
            best[:] = P[: 2 * count]
            best_mode[:] = mode[:count]
        if error <= tolerance:
            break
    P[: 2 * count] = best
    mode[:count] = best_mode
    index[5 * count] = 0
    return residual(count, W, q, mu, P, u)


@compiled
def _solve_from_guess(count, W, q, mu, mode, P, u, A, rhs, index, tolerance):
    """Solve, check and mend the modes; leaves the solution, or the least wrong try, in P."""
    for attempt in range(MODE_ROUNDS):
        if not _solve_modes(count, W, q, mu, mode, P, A, rhs, index):
            break
        error = residual(count, W, q, mu, P, u)
        if error <= tolerance or attempt == MODE_ROUNDS - 1:
            return error
        _mend_modes(count, mu, mode, P, u, attempt >= MODE_ROUNDS // 2)
    P[: 2 * count] = 0.0
    return residual(count, W, q, mu, P, u)


@compiled(forceinline=True)
def soften(count, W, compliance):
    """Add ``compliance`` to W's diagonal, relative to its mean: redundant contacts share load."""
    trace = 0.0
    for i in range(2 * count):
        trace += W[i, i]
    for i in range(2 * count):
        W[i, i] += compliance * trace / (2 * count)
