"""Identify unknown parameters of a machine from logs of its walks: ``jansen-workshop identify``.

Simulated copies of the robot repeat the walks of the machine. The parameters of the copies are
sampled, and so are errors of the measurement: the zeros of the crank angle and of the IMU, the
torque constant, filters, and the slope of the floor. A ridge regression on summary measures of the
walks estimates each parameter (M. A. Beaumont et al., *Genetics* 162 (2002) 2025, here with equal
weights for all copies). The errors of the regression on copies that are left out of it yield the
intervals. If no copy explains a log, the log is rejected (:mod:`jansen_workshop.likeness`).
"""

import argparse
import json
import math
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from tabulate import tabulate

from jansen_env.arrays import Array
from jansen_env.cli.flags import Parser, positive_int, robot_file, whole
from jansen_env.cli.progress import progress
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.registration import training_folder
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.lengths import lengths
from jansen_env.robot.robot_file import write_robot
from jansen_env.scoring.metrics import SETTLING
from jansen_env.scoring.rollout import Advance, no_progress
from jansen_env.terrain.ground import Terrain
from jansen_env.world.settings import load_robot
from jansen_workshop.commands import predict
from jansen_workshop.commands.measurements import Log, Walk, compared, quantities, read_log, table
from jansen_workshop.commands.predict import ENV, STOPPED, WITHIN
from jansen_workshop.likeness import Surface, cures

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
INTERVAL = 2.5, 97.5  # percentiles of the errors
# An interval that is wider than this fraction of the sampled range counts as not identifiable.
TELLS = 0.7
ORDERS = 4  # number of harmonics of a step
# Lags of the autocovariances in control steps of 20 ms. Noise is not correlated over these lags.
LAGS = (2, 3, 5)
MODEL = 0.01  # error of the model's harmonics, as a fraction of torque and pitch
SCALE = 0.003  # error of the scale, as a fraction of the mass
RIDGE = 3.0  # regularisation of the regression, for columns of variance 1
FEWEST = 256  # smallest number of copies
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


class Copies(NamedTuple):
    """Simulated copies that repeated the walks of the logs, measured with errors of the set-up.

    Attributes:
        known: Parameters of the copies by name, shape (n,) each.
        walks: For each log, the walks of the copies, shape (n, steps), with the noise of the log.
        mass: Masses of the copies, in kg, shape (n,).
    """

    known: dict[str, Array]
    walks: list[Walk]
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
    robots, known, _ = predict.draw_copies(robot, within, copies)
    known["torque_filter"] = np.maximum(0.0, known["torque_filter"])
    rng = np.random.default_rng(0)
    walks = []
    stood = np.ones(copies, bool)
    for log in logs:
        seconds = SETTLING + predict.measured_time(log.speed)
        run, dt = predict.walk(
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
            f"{copies - stood.sum()} of {copies} simulated copies of the robot fell under the "
            "logs' crank speeds and gains, at least half must stand"
        )
    standing = [Walk(*(series[stood] for series in walk)) for walk in walks]
    mass = np.array([robot.mass for robot in robots])[stood]
    return Copies({name: values[stood] for name, values in known.items()}, standing, mass)


def _measured_walk(
    run: dict[str, Array], known: dict[str, Array], dt: float, window: slice
) -> Walk:
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
    return Walk(*(values[window].T for values in series))


def measures(walk: Walk, phases: int) -> Array:
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

    def measured(self, walks: Sequence[Walk]) -> Array:
        """Return the measures of the machine.

        Args:
            walks: One walk per log, in which each series has the shape (steps,).

        Returns:
            The measures, shape (m,).
        """
        rows = [
            measures(Walk(*(series[None] for series in walk)), self._phases)[0] for walk in walks
        ]
        return np.concatenate([*rows, self._weighed])

    def estimates(self, walks: Sequence[Walk]) -> Array:
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
            or the estimate of a set-up error is out of its range. The message names common mistakes
            that would explain the logs.
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


def _refusal(comparison: Comparison, surface: Surface, walks: Sequence[Walk]) -> tuple[float, str]:
    """Return the distance of walks and the reason why no copy explains them, "" if one does."""
    distance = surface.distance(comparison.measured(walks))
    if not distance <= surface.farthest:
        allowed = f"at most {surface.farthest:.3g}, as that of copies is"
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


def report(
    logs: Sequence[Log],
    estimates: dict[str, Estimate],
    distances: tuple[float, float],
    copies: Copies,
) -> str:
    """Return a report of the estimates, which also compares the logs with matching copies.

    Args:
        logs: Logs of the machine.
        estimates: Estimates by name.
        distances: Distances that :func:`check_explained` returned.
        copies: Copies whose parameters were sampled from the estimated intervals.
    """
    rows = []
    for log, walk in zip(logs, copies.walks, strict=True):
        bands = {k: np.percentile(v, predict.SPAN).tolist() for k, v in quantities(walk).items()}
        rows += compared(f"{log.speed:g} rad/s", log, bands)
    distance, farthest = distances
    return (
        f"Copies explain the logs: their distance is {distance:.2g}, and that of copies which the "
        f"fit has not seen is up to {farthest:.2g}.\n\n"
        f"{_estimate_table(NAMES, 'number', estimates)}\n\n"
        f"{_estimate_table(SETUP, 'error of set-up', estimates)}\n\n"
        f"The machine, and copies with these numbers:\n\n{table(rows)}"
    )


def _estimate_table(meanings: dict[str, str], head: str, estimates: dict[str, Estimate]) -> str:
    """Return a Markdown table of the estimates that have a meaning, under a ``head``."""
    rows = []
    for name, meaning in meanings.items():
        row = estimates[name]
        value = "not identifiable" if row.value is None else f"{row.value:.3g}"
        rows.append([f"{name}, {meaning}", value, f"{row.low:.3g}", f"{row.high:.3g}"])
    heads = (head, "estimate", "2.5 %", "97.5 %")
    return tabulate(rows, heads, "github", disable_numparse=True)


def randomize(robot: Robot, estimates: dict[str, Estimate]) -> dict[str, object]:
    """Return the argument ``randomize`` of environments that covers the remaining uncertainty.

    Args:
        robot: The robot as designed.
        estimates: Estimates by name.
    """
    spans = {name: [round(row.low, 4), round(row.high, 4)] for name, row in estimates.items()}
    shortest = min(size for name, size in lengths(robot).items() if name != "frame_angle")
    ranges: dict[str, object] = {
        "friction": spans["friction"],
        "mass_scale": [*WITHIN["mass"]],
        "payload": [robot.payload.mass + mass for mass in spans["payload"]],
        "motor_strength": [*WITHIN["battery"]],
        "lengths": round(WITHIN["lengths"][1] / shortest, 4),
    }
    if not robot.pad_compliance.rigid:
        ranges["foot_stiffness_scale"] = spans["feet"]
    return ranges


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    """Parse the command line; the result also has the ``parser``."""
    parser = Parser(
        "jansen-workshop identify",
        __doc__,
        "jansen-workshop identify slow.csv fast.csv --robot economy",
    )
    add = parser.add_argument
    add("logs", nargs="+", metavar="LOG.csv", help="of one machine, at different speeds")
    add("--robot", help="a design or a robot file; default: the one that the first log names")
    add(
        "--copies",
        type=whole(FEWEST, predict.MOST_COPIES),
        default=512,
        help="that walk; default: %(default)s",
    )
    add(
        "--out",
        type=robot_file,
        default=Path("identified.json"),
        metavar="FILE",
        help="robot file of the machine; default: %(default)s",
    )
    add(
        "--train",
        nargs="?",
        const=0,
        type=positive_int,
        metavar="STEPS",
        help="then train a policy over the identified ranges; default STEPS: the configuration's",
    )
    args = parser.parse_args(arguments)
    args.parser = parser
    return args


def main(arguments: list[str] | None = None) -> None:
    """Identify a machine, print the report and write the robot file of the machine.

    Args:
        arguments: Arguments of the command. If None, those of the process.

    Raises:
        SystemExit: If an argument or a log is wrong, or with the status of the training.
    """
    args = _parse(arguments)
    with args.parser.refusing():
        logs = [read_log(path) for path in args.logs]
        robot = load_robot("--robot", args.robot or logs[0].about.get("robot"))
        for path, log in zip(args.logs, logs, strict=True):
            print(*(f"{path}: {note}\n" for note in log.notes), sep="", end="")
        estimates = _identify_and_report(robot, logs, args.copies)
        write_robot(args.out, _identified_robot(robot, estimates))
    ranges = randomize(robot, estimates)
    flags = _training_flags(robot, args.out, ranges)
    print(f"\nrandomize={json.dumps(ranges)}\n")
    print(f"The friction of bearings and crank is in {args.out}.")
    print(f"To train:\n\n{shlex.join(['python', 'train.py', *flags])}", flush=True)
    if args.train is not None:
        flags += ["--timesteps", str(args.train)] if args.train else []
        trainer = Path(__file__).parents[3] / "train.py"
        raise SystemExit(subprocess.run([sys.executable, str(trainer), *flags]).returncode)


def _identify_and_report(robot: Robot, logs: Sequence[Log], count: int) -> dict[str, Estimate]:
    """Let ``count`` copies repeat the walks of the logs, print the report, return the estimates."""
    within = limits(robot)
    seconds = sum(SETTLING + predict.measured_time(log.speed) + STOPPED for log in logs)
    with progress(f"{count} copies walk", 2.0 * seconds) as advance:
        copies = walk_copies(robot, logs, within, count, advance)
        distances = check_explained(robot, logs, copies)
        estimates = identify(robot, logs, copies)
        intervals = {name: (row.low, row.high) for name, row in estimates.items()}
        matching = walk_copies(robot, logs, {**within, **intervals}, count // 4, advance)
    print(report(logs, estimates, distances, matching))
    return estimates


def _identified_robot(robot: Robot, estimates: dict[str, Estimate]) -> Robot:
    """Return the robot with the identified friction of bearings and crank."""
    numbers = dict.fromkeys(("mass", "battery", "feet", "bearings"), 1.0)
    for name in ("bearings", "damping"):
        value = estimates[name].value
        if value is not None:
            numbers[name] = value
    return predict.copy_of(robot, numbers, {})


def _training_flags(robot: Robot, path: Path, ranges: dict[str, object]) -> list[str]:
    """Return the flags of ``train.py`` that train a policy for a machine.

    Args:
        robot: The robot as designed.
        path: Robot file of the machine.
        ranges: Argument ``randomize`` of the environments.
    """
    config = {"aluminium": "onboard.yml", "plywood": "weekend.yml"}[robot.material]
    return [
        "--config",
        str(training_folder(ENV) / config),
        "--env-kwargs",
        json.dumps({"robot": str(path), "randomize": ranges}),
    ]
