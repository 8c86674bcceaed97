"""The time step with the chassis held: equation (12) of the paper, one degree of freedom, psi.

    k psi'' + k' psi'^2 / 2 = torque - f psi' - g c_y' - F sign(psi')

with the sums of :mod:`jansen_env.dynamics.reduced`, motor included, and the Coulomb friction F of
gear and bearings, which holds the crank at rest against any smaller torque. There are no impacts,
so classical Runge-Kutta of fourth order does; where friction stops the crank, the step is cut.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from jansen_env.engine.kernel import (
    Bools1,
    Floats1,
    Floats2,
    Floats3,
    Floats4,
    Ints1,
    kernel,
    stage,
)
from jansen_env.engine.motor_stages import drawn_power, limited_torque
from jansen_env.engine.records import Array, Params
from jansen_env.engine.tables import C_Y, CRANK, DAMPING, FIRST, VALUE, bearing_friction, read_body

# Entries of a state: crank angle, its rate, and since the start what joints and gear have taken, J,
# how much less the motor did than the torque last asked for would have, J and N m s, and what it
# drew, J.
ANGLE, SPEED, LOSS, WORK_LACKING, IMPULSE_LACKING, ELECTRICAL = range(6)
STATE = 6
DIVERGED = 1e4  # rad/s, beyond which a crank speed is taken for a simulation that diverged
STOPS = 4  # of the crank in a time step, at most
STOP_ROUNDS = 4  # secant steps towards the moment of one


class Crank(NamedTuple):
    """Data of the turning crank, and memory for it."""

    body: Array  # the robot's tables, see :mod:`jansen_env.engine.tables`
    bearings: Array
    params: Any  # PARAMS
    sums: Array  # (3, 6)
    rates: Array  # (4, 6) of a state, at the four stages
    stage: Array  # (6,) a state
    after: Array  # (6,) a state


@stage(inline=False)
def _rates(state, direction, asked, latest, crank, rates):
    """Fill ``rates`` (6,) of a state with the Coulomb friction against ``direction``, 1, 0 or -1.

    ``asked``: the motor's torque now, ``latest``: the one last asked for, N m.

    Returns (force on the crank without that friction, the friction), N m.
    """
    sums, params, n = crank.sums, crank.params, state[SPEED]
    read_body(crank.body, state[ANGLE], sums)
    inertia, inertia_slope = sums[VALUE, CRANK] + params.rotor_crank, sums[FIRST, CRANK]
    damping = (sums[VALUE, DAMPING] + params.viscous_friction) * n
    used = asked
    if params.limited:
        used = limited_torque(asked, params.torque_slope * n, 1.0, params)
    force = used - damping + params.gravity_y * sums[FIRST, C_Y]
    force = force - 0.5 * inertia_slope * n * n
    dry = 0.0
    if params.dry:
        dry = params.gear_friction + bearing_friction(crank.bearings, state[ANGLE])
    rates[ANGLE], rates[SPEED] = n, (force - direction * dry) / inertia
    rates[LOSS] = damping * n + dry * abs(n)
    rates[WORK_LACKING], rates[IMPULSE_LACKING] = (latest - used) * n, latest - used
    rates[ELECTRICAL] = drawn_power(used, n, params)
    return force, dry


@stage(inline=False)
def _step(h, direction, asked, latest, state, crank):
    """A step of Runge and Kutta from ``state`` (6,), into ``crank.after``."""
    rates, stage, after = crank.rates, crank.stage, crank.after
    for k in range(4):
        for i in range(STATE):
            stage[i] = state[i]
            if k > 0:
                stage[i] += (h if k == 3 else 0.5 * h) * rates[k - 1, i]
        _rates(stage, direction, asked, latest, crank, rates[k])
    for i in range(STATE):
        slope = rates[0, i] + 2.0 * rates[1, i] + 2.0 * rates[2, i] + rates[3, i]
        after[i] = state[i] + h * slope / 6.0


@stage(inline=False)
def _step_with_friction(h, asked, latest, state, crank):
    """A time step under Coulomb friction, into ``crank.after``: to where the crank stops, and on.

    A crank at rest stays there while the force on it is no larger than the friction: for all of the
    step, as nothing changes then.
    """
    left, after = h, crank.after
    for _ in range(STOPS):
        direction = np.sign(state[SPEED])
        if direction == 0.0:
            rates = crank.rates[0]
            force, dry = _rates(state, 0.0, asked, latest, crank, rates)
            if abs(force) <= dry:
                for i in range(STATE):
                    after[i] = state[i]
                after[IMPULSE_LACKING] += left * rates[IMPULSE_LACKING]
                after[ELECTRICAL] += left * rates[ELECTRICAL]
                return
            direction = np.sign(force)
        _step(left, direction, asked, latest, state, crank)
        if after[SPEED] * direction >= 0.0:
            return
        share = 1.0  # of what is left, after which it stops
        for _ in range(STOP_ROUNDS):
            share *= state[SPEED] / (state[SPEED] - after[SPEED])
            _step(share * left, direction, asked, latest, state, crank)
        for i in range(STATE):
            state[i] = after[i]
        state[SPEED] = 0.0
        left -= share * left


@stage(inline=False)
def turn(steps, switch, h, torque, earlier, state, crank):
    """Advance a state (6,) by ``steps`` steps of ``h`` seconds under a torque asked for (N m).

    In the first ``switch`` of them it is the ``earlier`` one.
    """
    for k in range(steps):
        asked = earlier if k < switch else torque
        if crank.params.dry:
            _step_with_friction(h, asked, torque, state, crank)
        else:
            _step(h, 0.0, asked, torque, state, crank)
        for i in range(STATE):
            state[i] = crank.after[i]


@kernel
def turn_each(
    steps: int, switch: Ints1, h: float, torques: Floats1, earlier: Floats1, states: Floats2,
    designs: Ints1, bodies: Floats4, friction: Floats2, params: Params, work: Floats3,
    sums: Floats2, diverged: Bools1,
) -> bool:  # fmt: skip
    """:func:`turn` for n robots with states (n, 6), torques (n,), earlier (n,) and switch (n,).

    Args:
        designs: (n,) rows of ``bodies`` and ``friction``, all of a Model. params: (n,) PARAMS.
        work: (3, 4, 6) memory.
        sums: (n, 5) work of the motor, loss of the joints, change of mechanical energy, electrical
            work, J, and the motor's mean torque, N m; out.
        diverged: (n,) whether a crank became faster than :data:`DIVERGED`: it stays as it was; out.

    Returns whether one has.
    """
    any_diverged = False
    for r in range(len(states)):
        state, body = states[r], bodies[designs[r]]
        crank = Crank(
            body, friction[designs[r]], params[r], work[0], work[1], work[2, 0], work[2, 1]
        )
        angle, speed = state[ANGLE], state[SPEED]
        before = held_energy(body, params[r], angle, speed, crank.sums)
        for i in range(LOSS, STATE):
            state[i] = 0.0
        turn(steps, switch[r], h, torques[r], earlier[r], state, crank)
        diverged[r] = not abs(state[SPEED]) < DIVERGED
        if diverged[r]:
            state[ANGLE], state[SPEED] = angle, speed
            for i in range(LOSS, STATE):
                state[i] = 0.0
            any_diverged = True
        after = held_energy(body, params[r], state[ANGLE], state[SPEED], crank.sums)
        sums[r, 0] = torques[r] * (state[ANGLE] - angle) - state[WORK_LACKING]
        sums[r, 1], sums[r, 2] = state[LOSS], after - before
        sums[r, 3] = state[ELECTRICAL]
        sums[r, 4] = torques[r] - state[IMPULSE_LACKING] / (max(steps, 1) * h)
    return any_diverged


@kernel
def fixed_base_energy(
    r: int, states: Floats2, designs: Ints1, bodies: Floats4, params: Params, work: Floats3
) -> float:
    """Kinetic plus potential energy of robot ``r``, J; arguments: see :func:`turn_each`."""
    state = states[r]
    return held_energy(bodies[designs[r]], params[r], state[ANGLE], state[SPEED], work[0])


@stage(inline=False)
def held_energy(body, params, psi, n, sums):
    """Kinetic plus potential energy, J; potential is 0 with the centre of mass at the axis."""
    read_body(body, psi, sums)
    kinetic = 0.5 * (sums[VALUE, CRANK] + params.rotor_crank) * n * n
    height = sums[VALUE, C_Y] + params.load_mass * params.load_y
    return kinetic - params.gravity_y * height
