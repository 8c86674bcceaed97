"""The walking task of n robots: actions, observations, rewards and information."""

from __future__ import annotations

import math

from jansen_env.engine.collision import height_at
from jansen_env.engine.jit import compiled
from jansen_env.engine.records import row_dtype

FALLEN_PITCH = 1.2  # rad
TRACKING_WIDTH = 0.75  # of the command: speed error at which tracking has fallen to 1/e ...
WIDEST_TRACKING = 0.25  # m/s ... but no wider than this
NARROWEST_TRACKING = 0.002  # m/s ... nor narrower, so that a command of 0 can be tracked

# The reward's terms, and likewise their weights.
REWARD = row_dtype([(name, float) for name in ("tracking", "slip", "energy", "posture", "fall")])
# What the environment's information has of a robot, but for arrays; its units are listed there.
INFORMATION = row_dtype(
    [
        ("x_position", float),
        ("x_velocity", float),
        ("pitch", float),
        ("crank_angle", float),
        ("crank_speed", float),
        ("crank_torque", float),
        ("speed_command", float),
        ("fallen", bool),
        ("joint_gap", float),
        ("diverged", bool),
    ]
)
ENERGIES = row_dtype(
    [
        ("motor_work", float),
        ("joint_loss", float),
        ("slip_loss", float),
        ("impact_loss", float),
        ("mechanical_energy_change", float),
        ("residual", float),
    ]
)
# A robot's row: what is kept of its episode, and what its last step was. The last action; the
# farthest point reached in the commanded direction, m; where the step began, m; its weight, N.
ROW = row_dtype(
    [
        ("action", float),
        ("farthest", float),
        ("x_before", float),
        ("weight", float),
        ("info", INFORMATION),
        ("energy", ENERGIES),
        ("reward", REWARD),
    ]
)


@compiled
def finish_step(
    states, slip, force, robots, period, weights, rows, loads, reward, surface, bounds,
    ground, out,
):  # fmt: skip
    """Reward the step of ``period`` seconds that led to ``states`` (n, 8), and :func:`describe` it.

    Args:
        slip: (n, toes) m. force: (n, toes, 2) N. robots: (n,) ROBOT of the plant.
        weights: (1,) of :data:`REWARD`. rows: (n,) of :data:`ROW`.
        loads: (n, toes) normal forces / weight. reward: (n,).
        surface, bounds, ground, out: see :func:`describe`.
    """
    for r in range(len(states)):
        row, total = rows[r], robots[r].accumulators
        slipped = 0.0
        for j in range(slip.shape[1]):
            slipped += slip[r, j]
            loads[r, j] = force[r, j, 1] / row.weight
        toes_only = total.non_toe_impulse <= 0.0
        compute_reward(states[r], total.motor_work, slipped, toes_only, period, weights[0], row)
        term = row.reward
        reward[r] = term.tracking + term.slip + term.energy + term.posture + term.fall
    describe(states, robots, rows, loads, surface, bounds, ground, out)


@compiled
def compute_reward(state, work, slipped, toes_only, period, weight, row):
    """The reward's terms of a robot, into its row.

    Args:
        state: (8,). work: of the motor, J. slipped: by all toes, m. toes_only: whether nothing else
            touched the ground. weight: of :data:`REWARD`.
    """
    info, term = row.info, row.reward
    x, pitch = state[0], state[2]
    info.x_velocity = (x - row.x_before) / period
    falls = (not toes_only or abs(pitch) > FALLEN_PITCH) and not info.fallen
    info.fallen = info.fallen or falls
    power = abs(work) / period
    gained = speed_gained(row, x, period)
    term.tracking = weight.tracking * tracking_score(gained, info.speed_command)
    term.slip = -weight.slip * (slipped / period)
    term.energy = -weight.energy * power / row.weight
    term.posture = -weight.posture * pitch**2
    term.fall = -weight.fall if falls else 0.0


@compiled
def speed_gained(row, x, period):
    """Mean speed onto new ground in the commanded direction; at most 0 on old ground, m/s."""
    command, speed = row.info.speed_command, row.info.x_velocity
    if command == 0.0:
        return speed
    direction = math.copysign(1.0, command)
    new = direction * x - row.farthest
    if new <= 0.0:
        return direction * min(direction * speed, 0.0)
    row.farthest += new
    return direction * new / period


@compiled
def tracking_score(speed, command):
    """Share of the tracking reward earned at ``speed`` for ``command`` (m/s), 0 to 1.

    A bell of width min(0.75 |command|, 0.25 m/s): standing still earns exp(-1 / 0.75^2) = 0.17 of
    it at slow commands and less at fast ones.
    """
    width = min(max(TRACKING_WIDTH * abs(command), NARROWEST_TRACKING), WIDEST_TRACKING)
    return math.exp(-(((speed - command) / width) ** 2))


@compiled
def describe(states, robots, rows, loads, surface, bounds, ground, out):
    """Observations (n, 12 + toes) into ``out``, and information into ``rows``.

    Args:
        states: (n, 8). robots: (n,) ROBOT of the plant. loads: (n, toes).
        surface, bounds, ground: see
            :func:`jansen_env.plants.detector.surfaces`.
    """
    for r in range(len(states)):
        begin, end = bounds[ground[r]], bounds[ground[r] + 1]
        height = states[r, 1] - height_at(surface, begin, end, states[r, 0])
        observe(states[r], height, rows[r], loads[r], out[r])
        inform(states[r], robots[r].accumulators, rows[r])


@compiled
def observe(state, height, row, loads, out):
    """What a robot observes, see ``JansenWalkerEnv``; height: over the ground, m."""
    theta, psi, command, toes = state[2], state[3], row.info.speed_command, len(loads)
    out[0], out[1], out[2] = math.cos(psi), math.sin(psi), state[7]
    out[3], out[4], out[5] = math.sin(theta), math.cos(theta), state[6]
    out[6], out[7] = state[4], state[5]
    out[8], out[9] = height, command
    for j in range(toes):
        out[10 + j] = loads[j]
    out[10 + toes] = row.action
    direction = math.copysign(1.0, command)
    out[11 + toes] = max(0.0, row.farthest - direction * state[0])


@compiled
def inform(state, total, row):
    """Information on a robot's state and on its last step's energies."""
    info, energy = row.info, row.energy
    info.x_position, info.pitch = state[0], state[2]
    info.crank_angle, info.crank_speed = state[3], state[7]
    energy.motor_work, energy.joint_loss = total.motor_work, total.joint_loss
    energy.slip_loss, energy.impact_loss = total.slip_loss, total.impact_loss
    energy.mechanical_energy_change = total.energy_change
    losses = energy.joint_loss + energy.slip_loss + energy.impact_loss
    energy.residual = energy.motor_work - losses - energy.mechanical_energy_change
