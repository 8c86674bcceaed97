"""The time step with the chassis held: equation (12) of the paper, one degree of freedom, psi.

    k psi'' + k' psi'^2 / 2 = torque - f psi' - g c_y'

with the sums of :mod:`jansen_env.dynamics.reduced`. There are no impacts, so classical
Runge-Kutta of fourth order does.
"""

from __future__ import annotations

import numpy as np

from jansen_env.engine.jit import compiled, stage
from jansen_env.engine.tables import C_Y, CRANK, DAMPING, FIRST, VALUE, read_body

# Entries of a state: crank angle, its rate, and what the joints have taken since the start.
ANGLE, SPEED, LOSS = range(3)
DIVERGED = 1e4  # rad/s, beyond which a crank speed is taken for a simulation that diverged


@stage(inline=False)
def _rates(psi, n, torque, body, gravity_y, sums):
    """Crank acceleration (rad/s^2) and the joints' loss of power (W)."""
    read_body(body, psi, sums)
    inertia, inertia_slope = sums[VALUE, CRANK], sums[FIRST, CRANK]
    friction = sums[VALUE, DAMPING] * n
    force = torque - friction + gravity_y * sums[FIRST, C_Y]
    return (force - 0.5 * inertia_slope * n * n) / inertia, friction * n


@compiled(allocates=True)
def turn(steps, h, torque, state, body, params):
    """Advance a state (3,) by ``steps`` steps of ``h`` seconds under a constant torque (N m).

    ``body`` is the robot's table, see :mod:`jansen_env.engine.tables`, and ``params`` (1,) its
    :data:`jansen_env.engine.records.PARAMS`.
    """
    sums, gravity_y = np.empty((3, 6)), params[0].gravity_y
    psi, n, loss = state[ANGLE], state[SPEED], state[LOSS]
    for _ in range(steps):
        a1, p1 = _rates(psi, n, torque, body, gravity_y, sums)
        n2 = n + 0.5 * h * a1
        a2, p2 = _rates(psi + 0.5 * h * n, n2, torque, body, gravity_y, sums)
        n3 = n + 0.5 * h * a2
        a3, p3 = _rates(psi + 0.5 * h * n2, n3, torque, body, gravity_y, sums)
        n4 = n + h * a3
        a4, p4 = _rates(psi + h * n3, n4, torque, body, gravity_y, sums)
        psi += h * (n + 2.0 * n2 + 2.0 * n3 + n4) / 6.0
        n += h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
        loss += h * (p1 + 2.0 * p2 + 2.0 * p3 + p4) / 6.0
    state[ANGLE], state[SPEED], state[LOSS] = psi, n, loss


@compiled(allocates=True)
def turn_each(steps, h, torques, states, body, params, work, loss, change, diverged):
    """:func:`turn` for n robots with states (n, 3) and torques (n,).

    Args:
        work, loss, change: (n,) of the motor, the joints and in mechanical energy, J; out.
        diverged: (n,) whether a crank became faster than :data:`DIVERGED`: it stays as it was; out.

    Returns:
        Whether one has.
    """
    any_diverged = False
    for r in range(len(states)):
        state = states[r]
        angle, speed = state[ANGLE], state[SPEED]
        kinetic, potential = fixed_base_energy(body, params, angle, speed)
        before = kinetic + potential
        state[LOSS] = 0.0
        turn(steps, h, torques[r], state, body, params)
        diverged[r] = not abs(state[SPEED]) < DIVERGED
        if diverged[r]:
            state[ANGLE], state[SPEED], state[LOSS] = angle, speed, 0.0
            any_diverged = True
        kinetic, potential = fixed_base_energy(body, params, state[ANGLE], state[SPEED])
        work[r], loss[r] = torques[r] * (state[ANGLE] - angle), state[LOSS]
        change[r] = kinetic + potential - before
    return any_diverged


@compiled(allocates=True)
def fixed_base_energy(body, params, psi, n):
    """Kinetic and potential energy, J; potential is 0 with the centre of mass at the axis."""
    sums = np.empty((3, 6))
    read_body(body, psi, sums)
    kinetic = 0.5 * sums[VALUE, CRANK] * n * n
    height = sums[VALUE, C_Y] + params[0].load_mass * params[0].load_y
    return kinetic, -params[0].gravity_y * height
