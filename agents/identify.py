"""Identify what is not known of a machine, by logs of its walks: ``python -m agents.identify``.

Copies of the robot whose numbers are drawn walk as the machine did. A ridge regression on summary
measures of their walks estimates each number (M. A. Beaumont et al., *Genetics* 162 (2002) 2025, of
all copies with equal weights). Its errors on copies that it leaves out are the intervals.
"""

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

from agents.measurements import Log, Walk, compared, quantities, read_log, table
from agents.training.config import training_folder
from jansen_env.arrays import Array
from jansen_env.commands import predict
from jansen_env.commands.flags import Parser, positive_int, robot_file
from jansen_env.commands.predict import ENV, WITHIN
from jansen_env.gravity import GRAVITY
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.lengths import lengths
from jansen_env.robot.robot_file import write_robot
from jansen_env.scoring.metrics import SETTLING
from jansen_env.terrain.ground import Terrain
from jansen_env.world.settings import load_robot

Limits: TypeAlias = dict[str, tuple[float, float]]
NAMES = {
    "friction": "of the feet on the ground", "bearings": "times the bearings' friction",
    "damping": "N m s/rad more, of the crank", "payload": "kg more, at the crank's axis",
    "feet": "times the feet's stiffness",
}  # fmt: skip
"""Numbers that are identified."""
INTERVAL = 2.5, 97.5  # per cent of the errors
TELLS = 0.7  # of the limits: an interval that is wider tells nothing
ORDERS, LAGS = 4, (2, 3, 5)  # harmonics of a step; steps of 20 ms, over which noise is not alike
MODEL = 0.01  # of torque and pitch, that a model's harmonics are off
RIDGE = 3.0  # of the regression, on columns of variance 1
FEWEST = 256  # copies


class Estimate(NamedTuple):
    """An estimate and its interval of 95 %; None, and all that was drawn, if logs do not tell."""

    value: float | None
    low: float
    high: float


class Copies(NamedTuple):
    """Copies that walked as logs did: their numbers (n,), and of each log their walks (n, steps).

    Their torque and pitch have the noise of the log's.
    """

    known: dict[str, Array]
    walks: list[Walk]


def limits(robot: Robot) -> Limits:
    """Return the range of each drawn number: that of predictions, or wider if it is identified."""
    torque = GRAVITY * robot.mass * abs(advance_per_turn(robot)) / (2.0 * math.pi)
    return {
        **WITHIN, "friction": (0.2, 1.2), "bearings": (0.3, 3.0), "damping": (0.0, 0.03 * torque),
        "payload": (0.0, 0.3 * robot.mass), "feet": (0.3, 2.5),
    }  # fmt: skip


def noise(series: Array) -> float:
    """Standard deviation of the white noise of a series, by the median of its third differences."""
    return float(np.median(np.abs(np.diff(series, 3)))) / (0.6745 * math.sqrt(20.0))


def walk_copies(robot: Robot, logs: Sequence[Log], within: Limits, copies: int) -> Copies:
    """Draw copies within limits, and walk them as logs did; those that fell are left out."""
    robots, known, _ = predict.draw_copies(robot, within, copies)
    rng, walks, stood = np.random.default_rng(0), [], np.ones(copies, bool)
    for log in logs:
        seconds = SETTLING + predict.measured_time(log.speed)
        run, dt = predict.walk(robots, known, log.speed, Terrain.flat(), seconds, log.gains)
        stood &= ~run["fallen"][-1]
        crank, torque, pitch, x = (
            run[name][round(SETTLING / dt) : round(seconds / dt)].T
            for name in ("crank_angle", "crank_torque", "pitch", "x_position")
        )
        torque = torque + noise(log.walk.torque) * rng.normal(size=torque.shape)
        pitch = pitch + noise(log.walk.pitch) * rng.normal(size=pitch.shape)
        walks.append(Walk(crank, torque, pitch, x))
    return Copies({name: values[stood] for name, values in known.items()},
                  [Walk(*(series[stood] for series in walk)) for walk in walks])  # fmt: skip


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


def identify(robot: Robot, logs: Sequence[Log], copies: Copies) -> dict[str, Estimate]:
    """Estimate the numbers :data:`NAMES` of a machine from its logs and from copies' walks."""
    phases, rng = len({leg.phase for leg in robot.legs}), np.random.default_rng(0)
    walked, measured = [], []
    for log, walk in zip(logs, copies.walks, strict=True):
        columns = measures(walk, phases)
        sizes = np.abs([walk.torque, walk.pitch]).mean(axis=(1, 2)).repeat(columns.shape[1] // 2)
        walked.append(columns + MODEL * sizes * rng.normal(size=columns.shape))
        measured.append(measures(Walk(*(series[None] for series in log.walk)), phases)[0])
    numbers = np.stack([copies.known[name] for name in NAMES], axis=1)
    rows = estimate(np.concatenate(walked, axis=1), numbers, np.concatenate(measured))
    within = limits(robot)
    ends = np.array([within[name] for name in NAMES])
    rows = np.clip(rows, ends[:, :1], ends[:, 1:])
    told = rows[:, 2] - rows[:, 1] < TELLS * np.ptp(ends, axis=1)
    return {
        name: Estimate(*row) if known else Estimate(None, *within[name])
        for name, row, known in zip(NAMES, rows.tolist(), told, strict=True)
    }


def report(logs: Sequence[Log], estimates: dict[str, Estimate], copies: Copies) -> str:
    """Return two tables: the estimates, and the logs beside copies that have these numbers."""
    rows = [
        [f"{name}, {NAMES[name]}",
         "not identifiable" if row.value is None else f"{row.value:.3g}",
         f"{row.low:.3g}", f"{row.high:.3g}"]
        for name, row in estimates.items()
    ]  # fmt: skip
    heads, seen = ("number", "estimate", "2.5 %", "97.5 %"), []
    for log, walk in zip(logs, copies.walks, strict=True):
        bands = {k: np.percentile(v, predict.SPAN).tolist() for k, v in quantities(walk).items()}
        seen += compared(f"{log.speed:g} rad/s", log, bands)
    numbers = tabulate(rows, heads, "github", disable_numparse=True)
    return f"{numbers}\n\nThe machine, and copies with these numbers:\n\n{table(seen)}"


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
    add("--copies", type=lambda text: positive_int(text, FEWEST), default=512,
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
        estimates = identify(robot, logs, walk_copies(robot, logs, known, args.copies))
        known |= {name: (row.low, row.high) for name, row in estimates.items()}
        print(report(logs, estimates, walk_copies(robot, logs, known, args.copies // 4)))
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
    main()
