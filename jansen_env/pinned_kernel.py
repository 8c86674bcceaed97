"""The compiled inner loop with the frame held: equation (12) of the paper, one freedom, psi.

    k psi'' + k' psi'^2 / 2 = torque - f psi' - g c_y'

with the sums of :mod:`jansen_env.reduced`. There are no impacts, so classical Runge-Kutta of fourth
order does.
"""

from __future__ import annotations

from jansen_env.compiling import compiled
from jansen_env.model import locate, taylor_slope, taylor_value

# Entries of a pinned state: crank angle, its rate, and what the joints have taken since the start.
ANGLE, SPEED, LOSS = range(3)


@compiled(inline="always")
def _rates(psi, n, torque, model):
    """Crank acceleration (rad/s^2) and the joints' loss of power (W)."""
    row, t = locate(model.body.shape[0], psi)
    c = model.body[row]
    inertia, inertia_slope = taylor_value(c[4], t), taylor_slope(c[4], t)
    friction = taylor_value(c[5], t) * n
    force = torque - friction + model.gravity[1] * taylor_slope(c[1], t)
    return (force - 0.5 * inertia_slope * n * n) / inertia, friction * n


@compiled
def turn(steps, h, torque, state, model):
    """Advance a state (3,) by ``steps`` steps of ``h`` seconds under a constant torque (N m)."""
    psi, n, loss = state[ANGLE], state[SPEED], state[LOSS]
    for _ in range(steps):
        a1, p1 = _rates(psi, n, torque, model)
        n2 = n + 0.5 * h * a1
        a2, p2 = _rates(psi + 0.5 * h * n, n2, torque, model)
        n3 = n + 0.5 * h * a2
        a3, p3 = _rates(psi + 0.5 * h * n2, n3, torque, model)
        n4 = n + h * a3
        a4, p4 = _rates(psi + h * n3, n4, torque, model)
        psi += h * (n + 2.0 * n2 + 2.0 * n3 + n4) / 6.0
        n += h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
        loss += h * (p1 + 2.0 * p2 + 2.0 * p3 + p4) / 6.0
    state[ANGLE], state[SPEED], state[LOSS] = psi, n, loss


@compiled
def pinned_energy(model, psi, n):
    """Kinetic and potential energy, J; potential is 0 with the centre of mass at the axis."""
    row, t = locate(model.body.shape[0], psi)
    c = model.body[row]
    kinetic = 0.5 * taylor_value(c[4], t) * n * n
    height = taylor_value(c[1], t) + model.load[0] * model.load[3]
    return kinetic, -model.gravity[1] * height
