"""The walking task of n robots: rewards, observations and information.

The reward is a product of factors, each 1 where a step is as asked for, so that none can be bought
with another. What they mean is documented in :class:`jansen_env.envs.walker.JansenWalkerEnv`.
"""

from __future__ import annotations

import math

from jansen_env.engine.collision import height_at
from jansen_env.engine.jit import compiled
from jansen_env.engine.records import row_dtype

FALLEN_PITCH = 1.2  # rad

FURTHEST_TARGET = 0.5  # m, the target waits when it is so far away
LONGEST_MEAN = 3.4  # s, over which means are taken at most ...
SHORTEST_MEAN = 0.2  # s, ... and at least
FLOOR = 0.3  # of tracking: who has lost the target shall still learn what walking pays
CATCHING_UP = 2.0  # times the command: up to this mean speed progress is not less
STANDING = 0.05  # m/s: mean speed at which progress is 0 when the command is to stand
SLOWEST = 0.1  # m/s: slip and power are rated by the commanded speed, but by no slower one

# Where each factor has fallen to a half.
HALF_LAG = 0.2  # m, of tracking without its floor
HALF_SLIP = 0.2  # m slid by all toes per metre
HALF_ENERGY = 4.0  # cost of transport: motor power / (weight * speed)
HALF_EFFORT = 0.3  # m, RMS torque / weight
HALF_CHANGE = 0.8  # change of the action
HALF_PITCH = 0.4  # rad

# The reward's factors; all but the first two have an exponent, their weight.
REWARD = row_dtype(
    [
        (name, float)
        for name in ("tracking", "progress", "slip", "energy", "effort", "smoothness", "posture")
    ]
)
# What is asked for: the weights, and what a fall is.
SETTINGS = row_dtype(
    [
        ("period", float),  # s, of an action
        ("slip", float),
        ("energy", float),
        ("effort", float),
        ("smoothness", float),
        ("posture", float),
        ("fall_pitch", float),  # rad
        ("fall_contact", bool),  # whether a joint on the ground is a fall
    ]
)
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
        ("lag", float),
        ("mean_speed", float),
        ("mean_slip", float),
        ("mean_power", float),
        ("rms_torque", float),
        ("fallen", bool),
        ("joint_gap", float),
        ("diverged", bool),
    ]
)
ENERGIES = row_dtype(
    [
        ("motor_work", float),
        ("push_work", float),
        ("electrical_work", float),
        ("joint_loss", float),
        ("slip_loss", float),
        ("impact_loss", float),
        ("mechanical_energy_change", float),
        ("residual", float),
    ]
)
# What is kept from step to step: exact in the information, and as measured behind noisy sensors.
ACCOUNTS = row_dtype(
    [
        ("lag", float),
        ("mean_speed", float),
        ("mean_slip", float),
        ("mean_power", float),
        ("rms_torque", float),
    ]
)
# A robot's row: what is kept of its episode, and what its last step was.
ROW = row_dtype(
    [
        ("action", float),  # the last one
        ("action_before", float),
        ("x_before", float),  # m, where the step began
        ("next_command", float),  # m/s, from the next step on
        ("weight", float),  # N
        ("direction", float),  # 1 or -1: which way the crank turns to walk towards +x
        ("mean_path", float),  # m, over which means are taken
        ("info", INFORMATION),
        ("energy", ENERGIES),
        ("reward", REWARD),
    ]
)


@compiled
def finish_step(
    active, states, slip, force, robots, settings, rows, loads, reward, error, measured,
    surface, scan, out,
):  # fmt: skip
    """Reward the step that led to ``states`` (n, 8), and :func:`describe` it.

    Args:
        active: (n,) whether a robot has taken it.
        slip: (n, toes) m. force: (n, toes, 2) N. robots: (n,) ROBOT of the plant.
        settings: (1,) of :data:`SETTINGS`. rows: (n,) of :data:`ROW`.
        loads: (n, toes) normal forces / weight. reward: (n,).
        error: (n, 2) of the measured mean speeds: m/s in x; rad/s of the crank, counted as the
            action is. measured: (n,) of :data:`ACCOUNTS`. Without noise (0, 2) and (0,).
        surface, scan, out: see :func:`describe`.
    """
    for r in range(len(states)):
        if not active[r]:
            continue
        row, total, state = rows[r], robots[r].accumulators, states[r]
        period = settings[0].period
        row.info.crank_torque += total.torque_impulse / period
        slipped = 0.0
        for j in range(slip.shape[1]):
            slipped += slip[r, j]
            loads[r, j] = force[r, j, 1] / row.weight
        row.info.x_velocity = (state[0] - row.x_before) / period
        velocity, power = row.info.x_velocity, total.motor_work / period
        keep_accounts(velocity, slipped / period, power, period, row, row.info)
        if len(measured) > 0:
            velocity += error[r, 0]
            power += row.info.crank_torque * row.direction * error[r, 1]
            keep_accounts(velocity, 0.0, power, period, row, measured[r])  # no sensor tells slip
        falls = settings[0].fall_contact and total.non_toe_impulse > 0.0
        falls = falls or abs(state[2]) > settings[0].fall_pitch
        row.info.fallen = row.info.fallen or falls
        compute_reward(state[2], settings[0], row)
        term = row.reward
        reward[r] = term.tracking * term.progress * term.slip * term.energy
        reward[r] *= term.effort * term.smoothness * term.posture
        row.info.speed_command = row.next_command
        row.action_before, row.x_before = row.action, state[0]  # of the next step
        _describe(r, states, robots, rows, loads, surface, scan, out)


@compiled
def keep_accounts(velocity, slip_speed, power, period, row, kept):
    """Update the lag, and exponential means over a quarter turn at the commanded speed.

    Args:
        velocity, slip_speed: of the crank axis and of all toes together, m/s, means over the step.
        power: of the motor, W, likewise. period: s, of the step.
        row: of :data:`ROW`. kept: any row that has the fields of :data:`ACCOUNTS`; 0 at first.
    """
    command = row.info.speed_command
    lag = kept.lag + (command - velocity) * period
    kept.lag = min(FURTHEST_TARGET, max(-FURTHEST_TARGET, lag))
    share = -math.expm1(-period / mean_time(command, row.mean_path))
    kept.mean_speed += share * (velocity - kept.mean_speed)
    kept.mean_slip += share * (slip_speed - kept.mean_slip)
    kept.mean_power += share * (abs(power) - kept.mean_power)
    square = kept.rms_torque**2
    kept.rms_torque = math.sqrt(square + share * (row.info.crank_torque**2 - square))


@compiled
def mean_time(command, path):
    """The time constant of means, s: what ``path`` (m) takes at the commanded speed (m/s)."""
    return min(LONGEST_MEAN, max(SHORTEST_MEAN, path / max(abs(command), 1e-9)))


@compiled
def compute_reward(pitch, settings, row):
    """The reward's factors of a robot, into its row; pitch: rad, settings: of :data:`SETTINGS`."""
    info, term = row.info, row.reward
    speed = max(abs(info.speed_command), SLOWEST)
    cost_of_transport = info.mean_power / (row.weight * speed)
    change = row.action - row.action_before
    term.tracking = tracking_score(info.lag)
    term.progress = progress_score(info.mean_speed, info.speed_command)
    term.slip = factor(info.mean_slip / speed / HALF_SLIP, settings.slip)
    term.energy = factor(cost_of_transport / HALF_ENERGY, settings.energy)
    term.effort = factor((info.rms_torque / row.weight / HALF_EFFORT) ** 2, settings.effort)
    term.smoothness = factor((change / HALF_CHANGE) ** 2, settings.smoothness)
    term.posture = factor((pitch / HALF_PITCH) ** 2, settings.posture)


@compiled
def tracking_score(lag):
    """1 on the target, with a slope everywhere; lag: m."""
    return FLOOR + (1.0 - FLOOR) / (1.0 + (lag / HALF_LAG) ** 2)


@compiled
def progress_score(mean_speed, command):
    """1 at a mean speed of once to twice the command (m/s), less in proportion on both sides."""
    if command == 0.0:
        return max(0.0, 1.0 - abs(mean_speed) / STANDING)
    ratio = mean_speed / command
    return min(1.0, max(0.0, ratio)) if ratio < CATCHING_UP else CATCHING_UP / ratio


@compiled
def factor(cost, weight):
    """1 / (1 + cost), to the power of ``weight``."""
    return 1.0 / (1.0 + cost) if weight == 1.0 else (1.0 + cost) ** -weight


@compiled
def describe(which, states, robots, rows, loads, surface, scan, out):
    """Observations (n, 16 + toes + count) into ``out``, information into ``rows``, of some robots.

    Args:
        which: (k,) of the robots.
        states: (n, 8). robots: (n,) ROBOT of the plant. loads: (n, toes).
        surface: (vertices, 2) m, of all terrains.
        scan: (count,) m, places from the crank axis at which the ground is looked at.
    """
    for r in which:
        _describe(r, states, robots, rows, loads, surface, scan, out)


@compiled
def _describe(r, states, robots, rows, loads, surface, scan, out):
    status = robots[r].status
    ground = height_at(surface, status.first_vertex, status.end_vertex, states[r, 0])
    height = states[r, 1] - ground
    observe(states[r], height, rows[r], loads[r], out[r])
    seen = out.shape[1] - len(scan)
    for i in range(len(scan)):
        x = states[r, 0] + scan[i]
        out[r, seen + i] = states[r, 1] - height_at(
            surface, status.first_vertex, status.end_vertex, x
        )
    inform(states[r], robots[r].accumulators, rows[r])


@compiled
def observe(state, height, row, loads, out):
    """What a robot observes, see ``JansenWalkerEnv``; height: over the ground, m."""
    theta, psi, info, toes = state[2], state[3], row.info, len(loads)
    out[0], out[1] = math.cos(psi), row.direction * math.sin(psi)
    out[2] = row.direction * state[7]
    out[3], out[4], out[5] = math.sin(theta), math.cos(theta), state[6]
    out[6], out[7] = state[4], state[5]
    out[8], out[9] = height, info.speed_command
    for j in range(toes):
        out[10 + j] = loads[j]
    out[10 + toes] = row.action
    show_accounts(info, 11 + toes, out)


@compiled
def show_accounts(kept, first, out):
    """Put lag and means into an observation, from place ``first`` on; kept: :data:`ACCOUNTS`."""
    out[first], out[first + 1], out[first + 2] = kept.lag, kept.mean_speed, kept.mean_slip
    out[first + 3], out[first + 4] = kept.mean_power, kept.rms_torque


@compiled
def inform(state, total, row):
    """Information on a robot's state and on its last step's energies."""
    info, energy = row.info, row.energy
    info.x_position, info.pitch = state[0], state[2]
    info.crank_angle, info.crank_speed = state[3], state[7]
    energy.motor_work, energy.push_work = total.motor_work, total.push_work
    energy.joint_loss = total.joint_loss
    energy.electrical_work = total.electrical_work
    energy.slip_loss, energy.impact_loss = total.slip_loss, total.impact_loss
    energy.mechanical_energy_change = total.energy_change
    losses = energy.joint_loss + energy.slip_loss + energy.impact_loss
    work = energy.motor_work + energy.push_work
    energy.residual = work - losses - energy.mechanical_energy_change
