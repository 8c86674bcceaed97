"""Identify unknown parameters of a machine from logs of its walks: ``jansen-workshop identify``.

Simulated copies of the robot repeat the walks of the machine
(:mod:`jansen_workshop.machine_copies`). Its parameters are estimated from those of the copies
(:mod:`jansen_workshop.estimation`).
"""

import argparse
import json
import shlex
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tabulate import tabulate

from jansen_env.cli.flags import Parser, positive_int, robot_file, whole
from jansen_env.cli.progress import progress
from jansen_env.registration import training_folder
from jansen_env.robot import Robot
from jansen_env.robot.lengths import lengths
from jansen_env.robot.robot_file import write_robot
from jansen_env.scoring.metrics import SETTLING
from jansen_env.world.settings import load_robot
from jansen_workshop.estimation import Estimate, check_explained, identify
from jansen_workshop.machine_copies import NAMES, SETUP, Copies, limits, walk_copies
from jansen_workshop.measured_walks import Log, compared, quantities, read_log, table
from jansen_workshop.walking_copies import (
    ENV,
    MOST_COPIES,
    SPAN,
    STOPPED,
    WITHIN,
    copy_of,
    measured_time,
)

FEWEST = 256  # smallest number of copies


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
        bands = {k: np.percentile(v, SPAN).tolist() for k, v in quantities(walk).items()}
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
    """Return a Markdown table, under a ``head``, of the estimates named in ``meanings``."""
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
    add("logs", nargs="+", metavar="LOG.csv", help="logs of one machine, at different speeds")
    add(
        "--robot",
        help="name of a design, or a robot file; default: the robot that the first log names",
    )
    add(
        "--copies",
        type=whole(FEWEST, MOST_COPIES),
        default=512,
        help="number of simulated copies; default: %(default)s",
    )
    add(
        "--out",
        type=robot_file,
        default=Path("identified.json"),
        metavar="FILE",
        help="robot file of the machine, which is written; default: %(default)s",
    )
    add(
        "--train",
        nargs="?",
        const=0,
        type=positive_int,
        metavar="STEPS",
        help="then train a policy over the identified ranges for STEPS steps; without STEPS, for "
        "the number of steps in the configuration",
    )
    args = parser.parse_args(arguments)
    args.parser = parser
    return args


def main(arguments: list[str] | None = None) -> None:
    """Identify a machine, print the report and write the robot file of the machine.

    Args:
        arguments: Arguments of the command. None selects those of the process.

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
    seconds = sum(SETTLING + measured_time(log.speed) + STOPPED for log in logs)
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
    return copy_of(robot, numbers, {})


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
