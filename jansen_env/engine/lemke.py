"""Lemke's method for the contact law as a linear complementarity problem.

The formulation is that of Stewart and Trinkle (IJNME 39, 1996). Each contact has the unknowns
(P_n, P_t+, P_t-, bound). The columns of the tableau are w | z | artificial | right-hand side.
"""

from __future__ import annotations

from jansen_env.engine.kernel import stage
from jansen_env.engine.mathematics import floor

PIVOT = 1e-11  # smallest pivot, after scaling
PERTURBATION = 1e-9  # perturbation of the right-hand side, after scaling


@stage(inline=False)
def lemke(count, problem, compliance, T, basis):
    """Solve the contact law by Lemke's method.

    The diagonal of W is multiplied by 1 + ``compliance``, and v_free is perturbed. The solution is
    therefore approximate, but good enough to determine the contact modes.

    Args:
        count: Number of contacts.
        problem: Contact law, a :class:`jansen_env.engine.records.Problem`. Its P is the output.
        compliance: Relative increase of the diagonal of W.
        T: Work space for the tableau, shape (4 count, 8 count + 2).
        basis: Work space for the variables in the basis, shape (4 count,).

    Returns:
        Whether the method found a solution.
    """
    size = 4 * count
    mass, speed = 0.0, 0.0  # scales that make the numbers of the tableau dimensionless
    for i in range(2 * count):
        mass = max(mass, problem.W[i, i])
        speed = max(speed, abs(problem.v_free[i]))
    mass = 1.0 / mass
    _fill(count, problem, compliance, mass, speed, T, basis)
    if not _pivot(size, T, basis):
        return False
    P = problem.P
    for i in range(2 * count):
        P[i] = 0.0
    for r in range(size):
        variable = basis[r] - size
        if variable >= size:
            return False  # the artificial variable is still in the basis
        if variable >= 0:
            c, kind = variable // 4, variable % 4
            impulse = T[r, 2 * size + 1] * mass * speed
            if kind == 0:
                P[2 * c] += impulse
            elif kind == 1:
                P[2 * c + 1] += impulse
            elif kind == 2:
                P[2 * c + 1] -= impulse
    return True


@stage
def _fill(count, problem, compliance, mass, speed, T, basis):
    """Fill Lemke's tableau, w | z | artificial | right-hand side, and its first basis.

    ``mass`` and ``speed`` are the scales of the inertia and of the velocities. The other arguments
    are those of :func:`lemke`.
    """
    size, W = 4 * count, problem.W
    right = 2 * size + 1
    for r in range(size):
        for j in range(right + 1):
            T[r, j] = 0.0
        T[r, r], T[r, 2 * size] = 1.0, -1.0
        basis[r] = r
    for c in range(count):
        row = 4 * c
        for k in range(3):  # normal, forward, backward
            side, sign = (0 if k == 0 else 1), (-1.0 if k == 2 else 1.0)
            i = 2 * c + side
            for d in range(count):
                z = size + 4 * d
                T[row + k, z] = -sign * mass * W[i, 2 * d]
                T[row + k, z + 1] = -sign * mass * W[i, 2 * d + 1]
                T[row + k, z + 2] = sign * mass * W[i, 2 * d + 1]
            extra = sign * compliance * mass * W[i, i]
            T[row + k, size + 4 * c + side] -= extra
            if k > 0:
                T[row + k, size + 4 * c + 2] += extra
                T[row + k, size + 4 * c + 3] = -1.0
            T[row + k, right] = sign * problem.v_free[i] / speed
        T[row + 3, size + 4 * c] = -problem.mu[c]
        T[row + 3, size + 4 * c + 1] = T[row + 3, size + 4 * c + 2] = 1.0
    # Perturb each row differently, so that no cycle can form: the fractions of multiples of the
    # golden ratio are spread evenly, and no two are the same.
    for r in range(size):
        turns = 0.618033988749895 * r
        T[r, right] += PERTURBATION * (1.0 + (turns - floor(turns)))


@stage
def _pivot(size, T, basis):
    """Pivot the tableau by Lemke's rule; return False if the pivots end on a ray."""
    right, entering, pivot_row = 2 * size + 1, 2 * size, basis[0]
    for r in range(1, size):
        if T[r, right] < T[pivot_row, right]:
            pivot_row = r
    if not T[pivot_row, right] < 0.0:
        return True
    for _ in range(50 * size):
        leaving = basis[pivot_row]
        _eliminate(size, T, pivot_row, entering)
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
    return True


@stage
def _eliminate(size, T, pivot_row, entering):
    """Make column ``entering`` of the tableau a unit vector, with its 1 in row ``pivot_row``."""
    pivot = T[pivot_row, entering]
    for j in range(2 * size + 2):
        T[pivot_row, j] /= pivot
    for r in range(size):
        factor = T[r, entering]
        if r != pivot_row and factor != 0.0:
            for j in range(2 * size + 2):
                T[r, j] -= factor * T[pivot_row, j]
