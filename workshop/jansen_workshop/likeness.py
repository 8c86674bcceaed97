"""Check whether simulated copies of a robot, or a common mistake, explain a log.

A quadratic surface over the unknown parameters is fitted to the summary measures of the copies. The
distance of a log is the distance to the nearest point of this surface, in standard deviations of
the residuals of the fit (chaos, sensor noise, link lengths). Copies that the fit has not seen show
which distances are usual.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from jansen_env.arrays import Array
from jansen_env.robot import Robot
from jansen_workshop.measured_walks import CONTROL_DT, Log, MeasuredWalk

LEFT_OUT = 8  # the fit leaves out one copy in this many
RIDGE = 0.03  # regularisation, added to variances of 1
FILTERS = 0.1, 0.15, 0.2, 0.3, 0.5, 1.0  # time constants of the low-pass filter of a sensor, in s
DELAYS = tuple(range(3, 26))  # delays in control steps of 20 ms
ZERO_STEP = 0.1  # distance between the zeros of the crank angle that are tried, in rad


class Surface:
    """Quadratic fit of summary measures as functions of the unknown parameters.

    Attributes:
        farthest: Largest distance from the surface among copies that the fit has not seen.
    """

    def __init__(self, walked: Array, numbers: Array, ends: Array) -> None:
        """Fit the surface.

        Args:
            walked: Measures of the copies, shape (n, m).
            numbers: Unknown parameters of the copies, shape (n, k).
            ends: Ranges from which the parameters were sampled, shape (k, 2).
        """
        count = numbers.shape[1]
        scaled = 2.0 * (numbers - ends[:, 0]) / np.ptp(ends, axis=1) - 1.0
        seen = len(walked) - len(walked) // LEFT_OUT
        first, second = np.triu_indices(count)
        products = scaled[:, first] * scaled[:, second]
        basis = np.concatenate([np.ones((len(scaled), 1)), scaled, products], axis=1)[:seen]
        inverse = np.linalg.inv(basis.T @ basis + 1e-3 * np.eye(basis.shape[1]))
        fit = inverse @ basis.T @ walked[:seen]
        leverage = np.einsum("nk,kl,nl->n", basis, inverse, basis)
        errors = (walked[:seen] - basis @ fit) / (1.0 - leverage)[:, None]
        spread = errors.std(axis=0) + 1e-12
        covariance = np.cov((errors / spread).T) + RIDGE * np.eye(len(spread))
        self._whiten = np.linalg.cholesky(np.linalg.inv(covariance)) / spread[:, None]
        self._level = fit[0]
        self._slope = fit[1 : count + 1]
        self._bend = np.zeros((count, count, len(spread)))
        self._bend[first, second] += 0.5 * fit[count + 1 :]
        self._bend[second, first] += 0.5 * fit[count + 1 :]
        self.farthest = max(self.distance(row) for row in walked[seen:])

    def distance(self, measured: Array) -> float:
        """Return the root mean square distance of measures from the surface.

        Args:
            measured: Measures, shape (m,).
        """

        def errors(scaled: Array) -> Array:
            """Return the whitened distances from the surface at scaled parameters."""
            bend = np.einsum("k,klm->lm", scaled, self._bend)
            return (measured - self._level - scaled @ (self._slope + bend)) @ self._whiten

        def slopes(scaled: Array) -> Array:
            """Return the derivatives of the whitened distances."""
            bend = np.einsum("k,klm->lm", scaled, self._bend)
            return (-(self._slope + 2.0 * bend) @ self._whiten).T

        start = np.zeros(len(self._slope))
        nearest = least_squares(errors, start, slopes, bounds=(-1.0, 1.0))
        return math.sqrt(2.0 * nearest.cost / len(measured))


class Cure(NamedTuple):
    """Correction that undoes a common mistake in a log.

    Attributes:
        change: Description of the correction, a clause.
        cause: The mistake.
        apply: Function that returns the corrected walk.
    """

    change: str
    cause: str
    apply: Callable[[MeasuredWalk], MeasuredWalk]


def unfiltered(series: Array, constant: float) -> Array:
    """Undo a first-order low-pass filter.

    Args:
        series: Filtered values at the control steps, shape (steps,).
        constant: Time constant, in s.
    """
    decay = math.exp(-CONTROL_DT / constant)
    return np.append(series[0], (series[1:] - decay * series[:-1]) / (1.0 - decay))


def scale(walk: MeasuredWalk, name: str, factor: float) -> MeasuredWalk:
    """Multiply a series of a walk by a factor.

    Args:
        walk: The walk.
        name: Name of the series.
        factor: The factor.
    """
    return walk._replace(**{name: factor * getattr(walk, name)})


def shift(walk: MeasuredWalk, name: str, offset: float) -> MeasuredWalk:
    """Add a constant to a series of a walk.

    Args:
        walk: The walk.
        name: Name of the series.
        offset: The constant, in the unit of the series.
    """
    return walk._replace(**{name: getattr(walk, name) + offset})


def take_off_filter(walk: MeasuredWalk, constant: float) -> MeasuredWalk:
    """Undo a first-order low-pass filter of the torque.

    Args:
        walk: The walk.
        constant: Time constant, in s.
    """
    return walk._replace(torque=unfiltered(walk.torque, constant))


def advance_pitch(walk: MeasuredWalk, steps: int) -> MeasuredWalk:
    """Shift the pitch to earlier times; the walk becomes shorter by the same number of steps.

    Args:
        walk: The walk.
        steps: Number of control steps of 20 ms.
    """
    cut = MeasuredWalk(*(series[:-steps] for series in walk))
    return cut._replace(pitch=walk.pitch[steps:])


def cures(robot: Robot, logs: Sequence[Log], walks: Sequence[MeasuredWalk]) -> Iterator[Cure]:
    """Yield corrections that undo common mistakes in the logs of one machine.

    Args:
        robot: The robot as designed.
        logs: Logs of the machine.
        walks: For each log, the walks of the copies, shape (n, steps).
    """
    yield from _pitch_and_torque_cures(robot, logs, walks)
    phases = len({leg.phase for leg in robot.legs})  # a walk repeats this often per turn
    most = math.ceil(math.pi / phases / ZERO_STEP)
    for count in range(-most, most + 1):
        offset = ZERO_STEP * count
        yield Cure(
            f"about {offset:+.1f} rad are added to the crank's angle",
            "the zero of the crank is wrong",
            partial(shift, name="crank", offset=offset),
        )
    for constant in FILTERS:
        yield Cure(
            f"a low-pass filter of {constant:g} s is taken off torque",
            "torque or current are filtered",
            partial(take_off_filter, constant=constant),
        )
    for steps in DELAYS:
        yield Cure(
            f"pitch is taken {CONTROL_DT * steps:g} s earlier",
            "pitch is delayed or filtered",
            partial(advance_pitch, steps=steps),
        )


def _pitch_and_torque_cures(
    robot: Robot, logs: Sequence[Log], walks: Sequence[MeasuredWalk]
) -> Iterator[Cure]:
    """Yield corrections of the sign, the unit and the zero of pitch and torque."""
    reverse = partial(scale, name="pitch", factor=-1.0)
    yield Cure("the sign of pitch is reversed", "the IMU is mounted the other way round", reverse)

    factor = _variation_ratio(logs, walks, "torque")
    gears = f"the torque is the motor's (gear ratio {robot.motor.gear_ratio:g})"
    yield Cure(
        f"torque is multiplied by {factor:.2g}",
        f"unit or torque constant are wrong, or {gears}",
        partial(scale, name="torque", factor=factor),
    )
    factor = _variation_ratio(logs, walks, "pitch")
    yield Cure(
        f"pitch is multiplied by {factor:.2g}",
        "its unit is wrong (1 rad is 57.3 degrees)",
        partial(scale, name="pitch", factor=factor),
    )
    usual = float(np.median([walk.pitch.mean() for walk in walks]))
    offset = usual - float(np.mean([log.walk.pitch.mean() for log in logs]))
    yield Cure(
        f"{offset:+.2g} rad are added to pitch",
        "the IMU was not zeroed",
        partial(shift, name="pitch", offset=offset),
    )


def _variation_ratio(logs: Sequence[Log], walks: Sequence[MeasuredWalk], name: str) -> float:
    """Return the variation of a series in the median copy, divided by that in the logs."""
    copies = sum(float(np.median(getattr(walk, name).std(axis=1))) for walk in walks)
    return copies / max(1e-12, sum(float(getattr(log.walk, name).std()) for log in logs))
