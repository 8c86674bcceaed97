"""Estimate the parameters of a machine from logs of its walks and from simulated copies.

A ridge regression on summary measures of the walks estimates each parameter (M. A. Beaumont et al.,
*Genetics* 162 (2002) 2025, here with equal weights for all copies). The errors of the regression on
copies that are left out of it yield the intervals. If no copy explains a log, the log is rejected
(:mod:`jansen_workshop.likeness`).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jansen_env.arrays import Array
from jansen_env.robot import Robot
from jansen_workshop.likeness import Surface, cures
from jansen_workshop.machine_copies import FROM_ZERO, NAMES, SETUP, Copies, limits
from jansen_workshop.measured_walks import Log, MeasuredWalk

INTERVAL = 2.5, 97.5  # percentiles of the errors
# A parameter is not identifiable if its interval is wider than this fraction of the sampled range.
TELLS = 0.7
ORDERS = 4  # number of harmonics of a step
# Lags of the autocovariances in control steps of 20 ms. Noise is not correlated over these lags.
LAGS = (2, 3, 5)
MODEL = 0.01  # error of the model's harmonics, as a fraction of torque and pitch
SCALE = 0.003  # error of the scale, as a fraction of the mass
RIDGE = 3.0  # regularisation of the regression, for columns of variance 1
CAUSES = (
    "usual causes are a reversed sign or a wrong unit of pitch, torque or current, a filtered "
    "current, a wrong zero of the crank, another robot or other gains than the log's comments "
    "say, and a floor that is not flat and level"
)


class Estimate(NamedTuple):
    """An estimate of a parameter with its 95 % interval.

    Attributes:
        value: The estimate. None if the logs do not determine the parameter.
        low: Lower end of the interval, or of the sampled range if ``value`` is None.
        high: Upper end of the interval, or of the sampled range if ``value`` is None.
    """

    value: float | None
    low: float
    high: float


def measures(walk: MeasuredWalk, phases: int) -> Array:
    """Return summary measures of walks.

    For torque and for pitch, the measures are the harmonics in the crank angle and the signed
    square roots of the autocovariances of the remainder.

    Args:
        walk: Walks, shape (n, steps).
        phases: Number of crank pins. A walk repeats this many times per turn of the crank.

    Returns:
        The measures, shape (n, m).
    """
    turned = phases * walk.crank[..., None] * np.arange(1, ORDERS + 1)
    ones = np.ones((*walk.crank.shape, 1))
    waves = np.concatenate([ones, np.cos(turned), np.sin(turned)], axis=-1)
    inverse = np.linalg.pinv(waves)
    columns = []
    for series in (walk.torque, walk.pitch):
        harmonics = np.einsum("nkt,nt->nk", inverse, series)
        left = series - np.einsum("ntk,nk->nt", waves, harmonics)
        lagged = np.stack([(left[:, lag:] * left[:, :-lag]).mean(axis=1) for lag in LAGS], axis=1)
        columns += [harmonics, np.sign(lagged) * np.sqrt(np.abs(lagged))]
    return np.concatenate(columns, axis=1)


def estimate(walked: Array, numbers: Array, measured: Array) -> Array:
    """Estimate parameters by a ridge regression on the summary measures of copies.

    Args:
        walked: Measures of the copies, shape (n, m).
        numbers: Parameters of the copies, shape (n, k).
        measured: Measures of the logs, shape (m,).

    Returns:
        Estimate and lower and upper end of the interval of each parameter, shape (k, 3).
    """
    middle = walked.mean(axis=0)
    spread = walked.std(axis=0) + 1e-12
    mean = numbers.mean(axis=0)
    X = (walked - middle) / spread
    weights = np.linalg.solve(X.T @ X + RIDGE * np.eye(X.shape[1]), X.T)
    slopes = weights @ (numbers - mean)
    # The leverage is the influence of a copy on its own estimate.
    leverage = np.einsum("nk,kn->n", X, weights) + 1.0 / len(X)
    errors = (numbers - mean - X @ slopes) / (1.0 - leverage)[:, None]
    value = mean + (measured - middle) / spread @ slopes
    return np.stack([value, *(value + np.percentile(errors, INTERVAL, axis=0))], axis=1)


class Comparison:
    """Measures of the copies, with which the measures of a machine's walks are compared.

    If the comments of a log contain a mass, the mass is a measure as well.

    Args:
        robot: The robot as designed.
        logs: Logs of the machine.
        copies: Copies that repeated the walks of the logs.

    Attributes:
        names: Names of the k unknown parameters.
        limits: Range of each parameter, shape (k, 2).
        numbers: Parameters of the copies, shape (n, k).
        walked: Measures of the copies with model errors, shape (n, m).
    """

    def __init__(self, robot: Robot, logs: Sequence[Log], copies: Copies) -> None:
        within = limits(robot)
        self.names = [*NAMES, *SETUP]
        self.limits = np.array([within[name] for name in self.names])
        self.numbers = np.stack([copies.known[name] for name in self.names], axis=1)
        self._phases = len({leg.phase for leg in robot.legs})
        self._weighed = [log.about["mass"] for log in logs if "mass" in log.about]
        self.walked = self._with_model_errors(copies)

    def _with_model_errors(self, copies: Copies) -> Array:
        """Return the measures of the copies with model errors, shape (n, m)."""
        rng = np.random.default_rng(0)
        walked = []
        for walk in copies.walks:
            columns = measures(walk, self._phases)
            sizes = np.abs([walk.torque, walk.pitch]).mean(axis=(1, 2))
            sizes = sizes.repeat(columns.shape[1] // 2)
            walked.append(columns + MODEL * sizes * rng.normal(size=columns.shape))
        for _ in self._weighed:
            errors = 1.0 + SCALE * rng.normal(size=len(copies.mass))
            walked.append((copies.mass * errors)[:, None])
        return np.concatenate(walked, axis=1)

    def measured(self, walks: Sequence[MeasuredWalk]) -> Array:
        """Return the measures of the machine.

        Args:
            walks: One walk per log, in which each series has the shape (steps,).

        Returns:
            The measures, shape (m,).
        """
        rows = [
            measures(MeasuredWalk(*(series[None] for series in walk)), self._phases)[0]
            for walk in walks
        ]
        return np.concatenate([*rows, self._weighed])

    def estimates(self, walks: Sequence[MeasuredWalk]) -> Array:
        """Return what :func:`estimate` returns for walks of the machine, shape (k, 3).

        Args:
            walks: One walk per log.
        """
        return estimate(self.walked, self.numbers, self.measured(walks))


def identify(robot: Robot, logs: Sequence[Log], copies: Copies) -> dict[str, Estimate]:
    """Estimate the parameters in :data:`NAMES` and :data:`SETUP`.

    A parameter is not identifiable if its interval reaches beyond the sampled range or is nearly as
    wide as this range. The interval of a parameter in :data:`FROM_ZERO` is cut off at 0.

    Args:
        robot: The robot as designed.
        logs: Logs of the machine.
        copies: Copies that repeated the walks of the logs.

    Returns:
        The estimates by name.
    """
    comparison = Comparison(robot, logs, copies)
    rows = comparison.estimates([log.walk for log in logs]).tolist()
    ranges = comparison.limits.tolist()
    estimates = {}
    for name, (value, low, high), (least, most) in zip(comparison.names, rows, ranges, strict=True):
        if name in FROM_ZERO and least == 0.0 < high:
            value = max(value, 0.0)
            low = max(low, 0.0)
        inside = least <= low and high <= most
        identifiable = inside and high - low < TELLS * (most - least)
        estimates[name] = (
            Estimate(value, low, high) if identifiable else Estimate(None, least, most)
        )
    return estimates


def check_explained(robot: Robot, logs: Sequence[Log], copies: Copies) -> tuple[float, float]:
    """Check that the copies explain the logs.

    Args:
        robot: The robot as designed.
        logs: Logs of the machine.
        copies: Copies that repeated the walks of the logs.

    Returns:
        The distance of the logs from the copies, and the largest distance among copies that the
        fit has not seen.

    Raises:
        ValueError: If no copy explains the logs: either the logs are farther away than the copies,
            or the estimate of a set-up error is outside its range. The message names common
            mistakes that would explain the logs.
    """
    comparison = Comparison(robot, logs, copies)
    surface = Surface(comparison.walked, comparison.numbers, comparison.limits)
    distance, reason = _refusal(comparison, surface, [log.walk for log in logs])
    if not reason:
        return distance, surface.farthest
    if distance <= surface.farthest:
        advice = "correct the set-up and measure again"
    else:
        corrections = _corrections(robot, logs, copies, comparison, surface)
        resembled = "; or ".join(corrections)
        advice = f"they resemble copies {resembled}" if corrections else CAUSES
    raise ValueError(f"no simulated copy explains the logs: {reason}; {advice}")


def _refusal(
    comparison: Comparison, surface: Surface, walks: Sequence[MeasuredWalk]
) -> tuple[float, str]:
    """Return the distance of walks and the reason why no copy explains them, "" if one does."""
    distance = surface.distance(comparison.measured(walks))
    if not distance <= surface.farthest:
        allowed = f"at most {surface.farthest:.3g}, like that of other copies"
        return distance, f"their distance from the copies must be {allowed}, got {distance:.3g}"
    values = comparison.estimates(walks)[:, 0].tolist()
    ranges = comparison.limits.tolist()
    for name, value, (least, most) in zip(comparison.names, values, ranges, strict=True):
        low = -math.inf if name in FROM_ZERO else least
        if name in SETUP and not low <= value <= most:
            allowed = f"between {least:g} and {most:g}"
            return distance, f"{name} must be {allowed}, got {value:.3g} ({SETUP[name]})"
    return distance, ""


def _corrections(
    robot: Robot,
    logs: Sequence[Log],
    copies: Copies,
    comparison: Comparison,
    surface: Surface,
) -> list[str]:
    """Return descriptions of the mistakes that would explain the logs, the most likely first.

    Args:
        robot: The robot as designed.
        logs: Logs of the machine.
        copies: Copies that repeated the walks of the logs.
        comparison: Measures of the copies.
        surface: Fit of these measures.
    """
    found: dict[str, tuple[float, str]] = {}
    for cure in cures(robot, logs, copies.walks):
        distance, reason = _refusal(comparison, surface, [cure.apply(log.walk) for log in logs])
        if not reason and distance < found.get(cure.cause, (math.inf,))[0]:
            text = f"once {cure.change} (distance {distance:.2g}): {cure.cause}"
            found[cure.cause] = distance, text
    return [text for _, text in sorted(found.values())]
