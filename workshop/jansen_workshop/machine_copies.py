"""Simulated copies of a machine that repeat the walks of its logs.

The parameters of the copies are sampled, and so are errors of the measurement: the zeros of the
crank angle and of the IMU, the torque constant, filters, and the slope of the floor.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from jansen_env.arrays import Array
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.scoring.metrics import SETTLING
from jansen_env.scoring.rollout import Advance, no_progress
from jansen_env.terrain.ground import Terrain
from jansen_workshop import walking_copies
from jansen_workshop.measured_walks import Log, MeasuredWalk
from jansen_workshop.walking_copies import WITHIN

Limits: TypeAlias = dict[str, tuple[float, float]]
NAMES = {
    "friction": "of the feet on the ground",
    "bearings": "times the bearings' friction",
    "damping": "N m s/rad more, of the crank",
    "payload": "kg more, at the crank's axis",
    "feet": "times the feet's stiffness",
}
"""Parameters of the machine that are identified, with their meanings in the report."""
SETUP = {
    "crank_zero": "rad, in the angle of the crank",
    "pitch_zero": "rad, in pitch: the IMU's zero and how it is mounted",
    "torque_scale": "times the torque: the torque constant",
    "torque_filter": "s, time constant of the filter of torque or current",
    "pitch_delay": "s, by which pitch is later than the crank's angle",
    "slope": "rad, of the floor, which rises towards +x",
}
"""Errors of the measurement set-up that are identified as well."""
SETUP_LIMITS: Limits = {
    "crank_zero": (-0.12, 0.12),
    "pitch_zero": (-0.03, 0.03),
    "torque_scale": (0.8, 1.2),
    "torque_filter": (0.0, 0.06),
    "pitch_delay": (-0.02, 0.04),
    "slope": (-0.005, 0.005),
}
FILTERED = 0.7  # fraction of the copies whose torque is filtered
FROM_ZERO = "bearings", "damping", "payload", "torque_filter"  # parameters that are at least 0


class Copies(NamedTuple):
    """Simulated copies that repeated the walks of the logs, measured with errors of the set-up.

    Attributes:
        known: Parameters of the copies by name, shape (n,) each.
        walks: For each log, the walks of the copies, shape (n, steps), with the noise of the log.
        mass: Masses of the copies, in kg, shape (n,).
    """

    known: dict[str, Array]
    walks: list[MeasuredWalk]
    mass: Array


def limits(robot: Robot) -> Limits:
    """Return the range from which each parameter is sampled.

    The ranges are those of the predictions. Parameters that are identified have wider ranges.

    Args:
        robot: The robot as designed.
    """
    torque = GRAVITY * robot.mass * abs(advance_per_turn(robot)) / (2.0 * math.pi)
    return {
        **WITHIN,
        "friction": (0.1, 1.4),
        "bearings": (0.0, 3.0),
        "damping": (0.0, 0.04 * torque),
        "payload": (0.0, 0.4 * robot.mass),
        "feet": (0.3, 2.5),
        **SETUP_LIMITS,
    }


def noise(series: Array) -> float:
    """Return the standard deviation of the white noise of a series.

    The median of the third differences of the series yields the estimate.

    Args:
        series: Values at equal intervals, shape (steps,).
    """
    return float(np.median(np.abs(np.diff(series, 3)))) / (0.6745 * math.sqrt(20.0))


def filtered(series: Array, constants: Array, dt: float) -> Array:
    """Apply a first-order low-pass filter to each series.

    Args:
        series: The series, shape (steps, n).
        constants: Time constants, in s, shape (n,).
        dt: Time between two values of a series, in s.
    """
    decay = np.exp(-dt / np.maximum(constants, 1e-9))
    out = series.copy()
    for step in range(1, len(series)):
        out[step] = decay * out[step - 1] + (1.0 - decay) * series[step]
    return out


def delayed(series: Array, delays: Array, dt: float) -> Array:
    """Shift each series in time by its own delay.

    Args:
        series: The series, shape (steps, n).
        delays: Delays, in s, shape (n,). They may be negative.
        dt: Time between two values of a series, in s.
    """
    steps = np.arange(len(series), dtype=float)
    pairs = zip(delays.tolist(), series.T, strict=True)
    return np.stack([np.interp(steps - delay / dt, steps, column) for delay, column in pairs], 1)


def walk_copies(
    robot: Robot, logs: Sequence[Log], within: Limits, copies: int, advance: Advance = no_progress
) -> Copies:
    """Sample copies of a robot and simulate the walks of the logs with them.

    Copies that fall are left out. If the range of the torque filter includes 0, a fraction of the
    copies has no filter.

    Args:
        robot: The robot as designed.
        logs: Logs of the machine.
        within: Range from which each parameter is sampled.
        copies: Number of copies.
        advance: Function that reports the progress of the simulation.

    Raises:
        ValueError: If fewer than half of the copies remain standing.
    """
    least, most = within["torque_filter"]
    if least == 0.0:
        within = {**within, "torque_filter": (most - most / FILTERED, most)}
    robots, known, _ = walking_copies.draw_copies(robot, within, copies)
    known["torque_filter"] = np.maximum(0.0, known["torque_filter"])
    rng = np.random.default_rng(0)
    walks = []
    stood = np.ones(copies, bool)
    for log in logs:
        seconds = SETTLING + walking_copies.measured_time(log.speed)
        run, dt = walking_copies.walk(
            robots, known, log.speed, Terrain.flat(), seconds, log.gains, advance
        )
        stood &= ~run["fallen"][-1]
        window = slice(round(SETTLING / dt), round(seconds / dt))
        walk = _measured_walk(run, known, dt, window)
        torque = walk.torque + noise(log.walk.torque) * rng.normal(size=walk.torque.shape)
        pitch = walk.pitch + noise(log.walk.pitch) * rng.normal(size=walk.pitch.shape)
        walks.append(walk._replace(torque=torque, pitch=pitch))
    if 2 * stood.sum() < copies:
        raise ValueError(
            f"at least half of the {copies} simulated copies of the robot must stand under the "
            f"logs' crank speeds and gains, got {copies - stood.sum()} that fell"
        )
    standing = [MeasuredWalk(*(series[stood] for series in walk)) for walk in walks]
    mass = np.array([robot.mass for robot in robots])[stood]
    return Copies({name: values[stood] for name, values in known.items()}, standing, mass)


def _measured_walk(
    run: dict[str, Array], known: dict[str, Array], dt: float, window: slice
) -> MeasuredWalk:
    """Return walks of copies as measured with the errors of their set-ups.

    Args:
        run: Quantities of the walks by name, shape (steps, n) each.
        known: Parameters of the copies by name, shape (n,) each.
        dt: Time between two values of a series, in s.
        window: Steps that are measured.
    """
    torque = filtered(run["crank_torque"], known["torque_filter"], dt)
    series = (
        run["crank_angle"] + known["crank_zero"],
        known["torque_scale"] * torque,
        known["pitch_zero"] + delayed(run["pitch"], known["pitch_delay"], dt),
        run["x_position"],
    )
    return MeasuredWalk(*(values[window].T for values in series))
