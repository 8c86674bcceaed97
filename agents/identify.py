"""Identify what is not known of a machine, by logs of its walks: ``python -m agents.identify``.

Copies of the robot walk as the machine did. Their numbers are drawn, and so are errors of the
measurement: zeros of the crank and the IMU, the torque constant, filters, the floor. A ridge
regression on summary measures of their walks estimates each number (M. A. Beaumont et al.,
*Genetics* 162 (2002) 2025, of all copies with equal weights). Its errors on copies that it leaves
out are the intervals. A log that no copy explains is refused (:mod:`agents.likeness`).
"""

import json
import math
import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from tabulate import tabulate

from agents.likeness import Surface, cures
from agents.measurements import Log, Walk, compared, quantities, read_log, table
from agents.training.config import training_folder
from jansen_env.arrays import Array
from jansen_env.commands import predict
from jansen_env.commands.flags import Parser, positive_int, robot_file, whole
from jansen_env.commands.predict import ENV, STOPPED, WITHIN
from jansen_env.commands.progress import progress
from jansen_env.gravity import GRAVITY
from jansen_env.process import run
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.lengths import lengths
from jansen_env.robot.robot_file import write_robot
from jansen_env.scoring.metrics import SETTLING
from jansen_env.scoring.rollout import Advance, no_progress
from jansen_env.terrain.ground import Terrain
from jansen_env.world.settings import load_robot

Limits: TypeAlias = dict[str, tuple[float, float]]
NAMES = {
    "friction": "of the feet on the ground", "bearings": "times the bearings' friction",
    "damping": "N m s/rad more, of the crank", "payload": "kg more, at the crank's axis",
    "feet": "times the feet's stiffness",
}  # fmt: skip
"""Numbers of the machine that are identified."""
SETUP = {
    "crank_zero": "rad, in the angle of the crank",
    "pitch_zero": "rad, in pitch: the IMU's zero and how it is mounted",
    "torque_scale": "times the torque: the torque constant",
    "torque_filter": "s, time constant of the filter of torque or current",
    "pitch_delay": "s, by which pitch is later than the crank's angle",
    "slope": "rad, of the floor, which rises towards +x",
}
"""Numbers of the measurement that are identified, too: errors of set-up."""
SETUP_LIMITS: Limits = {
    "crank_zero": (-0.12, 0.12),
    "pitch_zero": (-0.03, 0.03),
    "torque_scale": (0.8, 1.2),
    "torque_filter": (0.0, 0.06),
    "pitch_delay": (-0.02, 0.04),
    "slope": (-0.005, 0.005),
}
FILTERED = 0.7  # of the copies' torques are filtered
FROM_ZERO = "bearings", "damping", "payload", "torque_filter"  # that are never below 0
INTERVAL = 2.5, 97.5  # per cent of the errors
TELLS = 0.7  # of the limits: an interval that is wider tells nothing
ORDERS, LAGS = 4, (2, 3, 5)  # harmonics of a step; steps of 20 ms, over which noise is not alike
MODEL = 0.01  # of torque and pitch, that a model's harmonics are off
SCALE = 0.003  # of the mass, that a scale is off
RIDGE = 3.0  # of the regression, on columns of variance 1
FEWEST = 256  # copies
CAUSES = (
    "usual causes are a reversed sign or a wrong unit of pitch, torque or current, a filtered "
    "current, a wrong zero of the crank, another robot or other gains than the log's comments "
    "say, and a floor that is not flat and level"
)


class Estimate(NamedTuple):
    """An estimate and its interval of 95 %; None, and all that was drawn, if logs do not tell."""

    value: float | None
    low: float
    high: float


class Copies(NamedTuple):
    """Copies that walked as logs did, measured by sensors with errors of set-up.

    Attributes:
        known: Numbers of the copies by name, shape (n,) each.
        walks: Walks of the copies for each log, shape (n, steps), with the log's noise.
        mass: Masses of the copies in kg, shape (n,).
    """

    known: dict[str, Array]
    walks: list[Walk]
    mass: Array


def limits(robot: Robot) -> Limits:
    """Return the range of each drawn number: that of predictions, or wider if it is identified."""
    torque = GRAVITY * robot.mass * abs(advance_per_turn(robot)) / (2.0 * math.pi)
    return {
        **WITHIN, "friction": (0.1, 1.4), "bearings": (0.0, 3.0), "damping": (0.0, 0.04 * torque),
        "payload": (0.0, 0.4 * robot.mass), "feet": (0.3, 2.5), **SETUP_LIMITS,
    }  # fmt: skip


def noise(series: Array) -> float:
    """Standard deviation of the white noise of a series, by the median of its third differences."""
    return float(np.median(np.abs(np.diff(series, 3)))) / (0.6745 * math.sqrt(20.0))


def filtered(series: Array, constants: Array, dt: float) -> Array:
    """Low-pass filter series, shape (steps, n), of first order with time constants (n,) in s."""
    decay = np.exp(-dt / np.maximum(constants, 1e-9))
    out = series.copy()
    for step in range(1, len(series)):
        out[step] = decay * out[step - 1] + (1.0 - decay) * series[step]
    return out


def delayed(series: Array, delays: Array, dt: float) -> Array:
    """Delay series, shape (steps, n), by times (n,) in s, which may be below 0."""
    steps = np.arange(len(series), dtype=float)
    pairs = zip(delays.tolist(), series.T, strict=True)
    return np.stack([np.interp(steps - delay / dt, steps, column) for delay, column in pairs], 1)


def walk_copies(
    robot: Robot, logs: Sequence[Log], within: Limits, copies: int, advance: Advance = no_progress
) -> Copies:
    """Draw copies within limits, and walk them as logs did; those that fell are left out.

    A share of the torques is not filtered if 0 is within the limits of the filter.

    Raises:
        ValueError: If fewer than half of the copies stand.
    """
    least, most = within["torque_filter"]
    spread = {**within, "torque_filter": (most - (most - least) / FILTERED, most)}
    robots, known, _ = predict.draw_copies(robot, spread if least == 0.0 else within, copies)
    known["torque_filter"] = np.maximum(0.0, known["torque_filter"])
    rng, walks, stood = np.random.default_rng(0), [], np.ones(copies, bool)
    for log in logs:
        seconds = SETTLING + predict.measured_time(log.speed)
        run, dt = predict.walk(
            robots, known, log.speed, Terrain.flat(), seconds, log.gains, advance
        )
        stood &= ~run["fallen"][-1]
        seen = (
            run["crank_angle"] + known["crank_zero"],
            known["torque_scale"] * filtered(run["crank_torque"], known["torque_filter"], dt),
            known["pitch_zero"] + delayed(run["pitch"], known["pitch_delay"], dt),
            run["x_position"],
        )
        crank, torque, pitch, x = (
            series[round(SETTLING / dt) : round(seconds / dt)].T for series in seen
        )
        torque = torque + noise(log.walk.torque) * rng.normal(size=torque.shape)
        pitch = pitch + noise(log.walk.pitch) * rng.normal(size=pitch.shape)
        walks.append(Walk(crank, torque, pitch, x))
    if 2 * stood.sum() < copies:
        raise ValueError(
            f"{copies - stood.sum()} of {copies} simulated copies of the robot fell under the "
            "logs' crank speeds and gains, at least half must stand"
        )
    standing = [Walk(*(series[stood] for series in walk)) for walk in walks]
    mass = np.array([robot.mass for robot in robots])[stood]
    return Copies({name: values[stood] for name, values in known.items()}, standing, mass)


def measures(walk: Walk, phases: int) -> Array:
    """Summary measures (n, m) of walks (n, steps) of a machine with so many crank pins.

    Harmonics of torque and pitch in the angle between steps; roots of the rest's autocovariances.
    """
    turned = phases * walk.crank[..., None] * np.arange(1, ORDERS + 1)
    ones = np.ones((*walk.crank.shape, 1))
    waves, columns = np.concatenate([ones, np.cos(turned), np.sin(turned)], axis=-1), []
    inverse = np.linalg.pinv(waves)
    for series in (walk.torque, walk.pitch):
        shares = np.einsum("nkt,nt->nk", inverse, series)
        left = series - np.einsum("ntk,nk->nt", waves, shares)
        lagged = np.stack([(left[:, lag:] * left[:, :-lag]).mean(axis=1) for lag in LAGS], axis=1)
        columns += [shares, np.sign(lagged) * np.sqrt(np.abs(lagged))]
    return np.concatenate(columns, axis=1)


def estimate(walked: Array, numbers: Array, measured: Array) -> Array:
    """Value, low and high (k, 3) of numbers (n, k) by measures (n, m) of walks and of logs (m,)."""
    middle, spread, mean = walked.mean(axis=0), walked.std(axis=0) + 1e-12, numbers.mean(axis=0)
    X = (walked - middle) / spread
    weights = np.linalg.solve(X.T @ X + RIDGE * np.eye(X.shape[1]), X.T)
    slopes = weights @ (numbers - mean)
    leverage = np.einsum("nk,kn->n", X, weights) + 1.0 / len(X)  # of a copy on its estimate
    errors = (numbers - mean - X @ slopes) / (1.0 - leverage)[:, None]
    value = mean + (measured - middle) / spread @ slopes
    return np.stack([value, *(value + np.percentile(errors, INTERVAL, axis=0))], axis=1)


def compared_measures(
    robot: Robot, logs: Sequence[Log], copies: Copies
) -> tuple[Array, Callable[[Sequence[Walk]], Array]]:
    """Return the copies' measures (n, m), with model errors, and a function for those of walks.

    A mass that a log's comments give is a measure.
    """
    phases, rng = len({leg.phase for leg in robot.legs}), np.random.default_rng(0)
    walked = []
    for walk in copies.walks:
        columns = measures(walk, phases)
        sizes = np.abs([walk.torque, walk.pitch]).mean(axis=(1, 2)).repeat(columns.shape[1] // 2)
        walked.append(columns + MODEL * sizes * rng.normal(size=columns.shape))
    weighed = [log.about["mass"] for log in logs if "mass" in log.about]
    for _ in weighed:
        errors = 1.0 + SCALE * rng.normal(size=len(copies.mass))
        walked.append((copies.mass * errors)[:, None])

    def measured(walks: Sequence[Walk]) -> Array:
        rows = [measures(Walk(*(series[None] for series in walk)), phases)[0] for walk in walks]
        return np.concatenate([*rows, weighed])

    return np.concatenate(walked, axis=1), measured


def identify(robot: Robot, logs: Sequence[Log], copies: Copies) -> dict[str, Estimate]:
    """Estimate the numbers :data:`NAMES` and :data:`SETUP` from logs and from copies' walks.

    An interval that reaches beyond the limits of what was drawn, or is nearly as wide, tells
    nothing. But one of :data:`FROM_ZERO` that reaches below 0 begins at 0.
    """
    walked, measured = compared_measures(robot, logs, copies)
    names = [*NAMES, *SETUP]
    numbers = np.stack([copies.known[name] for name in names], axis=1)
    rows = estimate(walked, numbers, measured([log.walk for log in logs]))
    within, estimates = limits(robot), {}
    for name, (value, low, high) in zip(names, rows.tolist(), strict=True):
        least, most = within[name]
        if name in FROM_ZERO and least == 0.0 < high:
            value, low = max(value, 0.0), max(low, 0.0)
        inside = least <= low and high <= most
        told = inside and high - low < TELLS * (most - least)
        estimates[name] = Estimate(value, low, high) if told else Estimate(None, least, most)
    return estimates


def check_explained(robot: Robot, logs: Sequence[Log], copies: Copies) -> tuple[float, float]:
    """Return the distance of logs from the copies, and the largest of copies that were left out.

    Raises:
        ValueError: If no copy explains the logs: they are farther, or an error of set-up is
            estimated beyond its limits. Names usual mistakes without which they would be explained.
    """
    walked, measured = compared_measures(robot, logs, copies)
    names = [*NAMES, *SETUP]
    numbers = np.stack([copies.known[name] for name in names], axis=1)
    within = limits(robot)
    surface = Surface(walked, numbers, np.array([within[name] for name in names]))

    def refusal(walks: Sequence[Walk]) -> tuple[float, str]:
        """The distance of walks, and why no copy explains them; empty if one does."""
        row = measured(walks)
        distance = surface.distance(row)
        if not distance <= surface.farthest:
            allowed = f"at most {surface.farthest:.3g}, as that of copies is"
            return distance, f"their distance from the copies must be {allowed}, got {distance:.3g}"
        for name, value in zip(names, estimate(walked, numbers, row)[:, 0].tolist(), strict=True):
            least, most = within[name]
            low = -math.inf if name in FROM_ZERO else least
            if name in SETUP and not low <= value <= most:
                allowed = f"between {least:g} and {most:g}"
                return distance, f"{name} must be {allowed}, got {value:.3g} ({SETUP[name]})"
        return distance, ""

    distance, unlike = refusal([log.walk for log in logs])
    if not unlike:
        return distance, surface.farthest
    advice = "correct the set-up and measure again"
    if not distance <= surface.farthest:
        found: dict[str, tuple[float, str]] = {}
        for cure in cures(robot, logs, copies.walks):
            left, still = refusal([cure.apply(log.walk) for log in logs])
            if not still and left < found.get(cure.cause, (math.inf,))[0]:
                found[cure.cause] = left, f"once {cure.change} (distance {left:.2g}): {cure.cause}"
        resembled = "; or ".join(text for _, text in sorted(found.values()))
        advice = f"they resemble copies {resembled}" if found else CAUSES
    raise ValueError(f"no simulated copy explains the logs: {unlike}; {advice}")


def report(
    logs: Sequence[Log],
    estimates: dict[str, Estimate],
    distances: tuple[float, float],
    copies: Copies,
) -> str:
    """Return what was identified, and the logs compared with copies that have these numbers.

    ``distances``: of the logs from the copies that explain them, and the largest of such copies.
    """

    def numbers(meanings: dict[str, str], head: str) -> str:
        rows = []
        for name, meaning in meanings.items():
            row = estimates[name]
            value = "not identifiable" if row.value is None else f"{row.value:.3g}"
            rows.append([f"{name}, {meaning}", value, f"{row.low:.3g}", f"{row.high:.3g}"])
        heads = (head, "estimate", "2.5 %", "97.5 %")
        return tabulate(rows, heads, "github", disable_numparse=True)

    seen = []
    for log, walk in zip(logs, copies.walks, strict=True):
        bands = {k: np.percentile(v, predict.SPAN).tolist() for k, v in quantities(walk).items()}
        seen += compared(f"{log.speed:g} rad/s", log, bands)
    distance, farthest = distances
    return (
        f"Copies explain the logs: their distance is {distance:.2g}, and that of copies which the "
        f"fit has not seen is up to {farthest:.2g}.\n\n"
        f"{numbers(NAMES, 'number')}\n\n{numbers(SETUP, 'error of set-up')}\n\n"
        f"The machine, and copies with these numbers:\n\n{table(seen)}"
    )


def randomize(robot: Robot, estimates: dict[str, Estimate]) -> dict[str, object]:
    """The argument ``randomize`` of environments that covers what is left uncertain."""
    spans = {name: [round(row.low, 4), round(row.high, 4)] for name, row in estimates.items()}
    shortest = min(size for name, size in lengths(robot).items() if name != "frame_angle")
    drawn: dict[str, object] = {
        "friction": spans["friction"], "mass_scale": [*WITHIN["mass"]],
        "payload": [robot.payload.mass + mass for mass in spans["payload"]],
        "motor_strength": [*WITHIN["battery"]],
        "lengths": round(WITHIN["lengths"][1] / shortest, 4),
    }  # fmt: skip
    return drawn if robot.pad_compliance.rigid else {**drawn, "foot_stiffness_scale": spans["feet"]}


def main(arguments: list[str] | None = None) -> None:
    """Identify, print a report, write the machine."""
    parser = Parser("python -m agents.identify", __doc__,
                    "python -m agents.identify slow.csv fast.csv --robot economy")  # fmt: skip
    add = parser.add_argument
    add("logs", nargs="+", metavar="LOG.csv", help="of one machine, at different speeds")
    add("--robot", help="a design or a robot file; default: the one that the first log names")
    add("--copies", type=whole(FEWEST, predict.MOST_COPIES), default=512,
        help="that walk; default: %(default)s")  # fmt: skip
    add("--out", type=robot_file, default=Path("identified.json"), metavar="FILE",
        help="robot file of the machine; default: %(default)s")  # fmt: skip
    add("--train", nargs="?", const=0, type=positive_int, metavar="STEPS",
        help="then train a policy over the identified ranges; default STEPS: the configuration's"
        )  # fmt: skip
    args = parser.parse_args(arguments)
    with parser.refusing():
        logs = [read_log(path) for path in args.logs]
        robot = load_robot("--robot", args.robot or logs[0].about.get("robot"))
        for path, log in zip(args.logs, logs, strict=True):
            print(*(f"{path}: {note}\n" for note in log.notes), sep="", end="")
        known = limits(robot)
        seconds = sum(SETTLING + predict.measured_time(log.speed) + STOPPED for log in logs)
        with progress(f"{args.copies} copies walk", 2.0 * seconds) as advance:
            copies = walk_copies(robot, logs, known, args.copies, advance)
            distances = check_explained(robot, logs, copies)
            estimates = identify(robot, logs, copies)
            known |= {name: (row.low, row.high) for name, row in estimates.items()}
            like = walk_copies(robot, logs, known, args.copies // 4, advance)
        print(report(logs, estimates, distances, like))
        numbers = dict.fromkeys(("mass", "battery", "feet", "bearings"), 1.0) | {
            name: row.value for name, row in estimates.items()
            if row.value is not None and name in ("bearings", "damping")
        }  # fmt: skip
        write_robot(args.out, predict.copy_of(robot, numbers, {}))
    drawn = randomize(robot, estimates)
    config = {"aluminium": "onboard.yml", "plywood": "weekend.yml"}[robot.material]
    run = ["--config", str(training_folder(ENV) / config),
           "--env-kwargs", json.dumps({"robot": str(args.out), "randomize": drawn})]  # fmt: skip
    print(f"\nrandomize={json.dumps(drawn)}\n")
    print(f"The friction of bearings and crank is in {args.out}.")
    print(f"To train:\n\n{shlex.join(['python', 'train.py', *run])}", flush=True)
    if args.train is not None:
        run += ["--timesteps", str(args.train)] if args.train else []
        trainer = Path(__file__).parents[1] / "train.py"
        raise SystemExit(subprocess.run([sys.executable, str(trainer), *run]).returncode)


if __name__ == "__main__":
    run("python -m agents.identify", main)
