"""Predict measurements on a real machine, with their uncertainty: ``jansen-workshop predict``.

Many copies of a robot walk at the same time. The parameters that are not known exactly for the real
machine differ from copy to copy, by Latin hypercube sampling. With ``--joint-play``, a few copies
also walk with play in their pins.
"""

import argparse
import json
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate

from jansen_env import __version__
from jansen_env.arrays import Array
from jansen_env.checks import within
from jansen_env.cli.flags import robot_parser, whole
from jansen_env.cli.progress import progress
from jansen_env.files import check_writable, write_text
from jansen_env.plants.base import LARGEST_PLAY
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.scoring.metrics import SETTLING
from jansen_env.scoring.rollout import Advance, no_progress
from jansen_env.tasks.walking.tuned import gains_of
from jansen_env.world.settings import load_robot
from jansen_workshop import play_effect
from jansen_workshop.walking_copies import (
    FASTEST,
    MOST_COPIES,
    SLOWEST,
    SPAN,
    STEPS,
    STOPPED,
    UNITS,
    WITHIN,
    climb,
    climbing_time,
    draw_copies,
    measure,
    measured_time,
)


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    """Parse the command line; the result also has the ``parser``."""
    parser = robot_parser(
        "jansen-workshop predict",
        __doc__,
        "FILE",
        "nothing is written",
        "jansen-workshop predict built",
        "jansen-workshop predict economy --speeds 1 2 --out economy.json",
    )
    parser.add_argument(
        "--speeds",
        type=float,
        nargs="+",
        default=[1.0, 2.0, 4.0],
        metavar="RAD_PER_S",
        help="crank speeds in rad/s; default: 1 2 4",
    )
    parser.add_argument(
        "--copies",
        type=whole(most=MOST_COPIES),
        default=256,
        help=f"number of simulated copies of the machine, at most {MOST_COPIES}; default: 256",
    )
    parser.add_argument(
        "--joint-play",
        type=float,
        default=0.0,
        metavar="M",
        help="radial clearance of the pins in m, whose effect a few slow walks estimate; it does "
        "not widen the predicted bands; default: 0, which estimates nothing",
    )
    args = parser.parse_args(arguments)
    args.parser = parser
    return args


def main(arguments: list[str] | None = None) -> None:
    """Predict the quantities, print a table of them, and write them as JSON.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    args = _parse(arguments)
    with args.parser.refusing():
        robot = _checked_robot(args)
        seconds = sum(simulated_time(robot, speed) for speed in args.speeds)
        with progress(f"{args.copies} copies of {args.robot} walk", seconds) as advance:
            predictions = {
                f"{speed:g}": predict(robot, speed, args.copies, advance) for speed in args.speeds
            }
        gains = gains_of(robot, "steady")
        content = {
            "format": "jansen_env predictions 1",
            "robot": args.robot,
            "version": __version__,
            "copies": args.copies,
            "gains": [*astuple(gains)],
            "within": WITHIN,
            "crank_speed": predictions,
        }
        _write(args.out, content)
    kp, ki, kd = astuple(gains)
    print(f"{args.robot}, PID of {kp:.3g} N m/rad, {ki:.3g} N m/(rad s), {kd:.3g} N m s/rad")
    for speed, quantities in predictions.items():
        print(f"\ncrank at {speed} rad/s\n\n{table(quantities)}")
    if not args.joint_play:
        return
    # The predictions are kept if a copy with play does not walk.
    with args.parser.refusing():
        seconds = sum(map(play_effect.simulated_time, args.speeds))
        walkers = f"{play_effect.COPIES} copies walk with and without play"
        with progress(walkers, seconds) as advance:
            changes = {
                f"{speed:g}": play_effect.changes_by_play(robot, speed, args.joint_play, advance)
                for speed in args.speeds
            }
        by_name = {
            speed: {name: change._asdict() for name, change in by.items()}
            for speed, by in changes.items()
        }
        content["joint_play"] = {"play": args.joint_play, "crank_speed": by_name}
        _write(args.out, content)
    for speed, by in changes.items():
        print(f"\njoint play of {args.joint_play} m, crank at {speed} rad/s\n")
        print(play_effect.table(by, predictions[speed]))


def _write(path: Path | None, content: dict[str, Any]) -> None:
    """Write predictions to a JSON file, if there is a path."""
    if path is not None:
        write_text(path, json.dumps(content, indent=1) + "\n")


def _checked_robot(args: argparse.Namespace) -> Robot:
    """Return the robot after checking all arguments, before the long computation.

    Raises:
        ValueError: If an argument is not allowed.
    """
    robot = load_robot("ROBOT", args.robot)
    if advance_per_turn(robot) == 0.0:
        raise ValueError(f"ROBOT must advance as its crank turns, got {args.robot}")
    if args.out is not None:
        check_writable("--out's folder", args.out.parent)
    for speed in args.speeds:
        within("--speeds", abs(speed), SLOWEST, FASTEST)
    within("--joint-play", args.joint_play, 0.0, LARGEST_PLAY)
    return robot


def table(quantities: dict[str, Any]) -> str:
    """Return a Markdown table of predictions.

    Args:
        quantities: Predictions by quantity, as returned by :func:`predict`.
    """
    rows = []
    for name, row in quantities.items():
        most = max(row["sources"], key=row["sources"].get, default="")
        source = f"{most}, {100 * row['sources'][most]:.0f} %" if most else ""
        numbers = [f"{row[key]:.3g}" for key in ("median", "low", "high")]
        rows.append([f"{name.replace('_', ' ')} ({UNITS[name]})", *numbers, source])
    heads = ("quantity", "median", "5 %", "95 %", "largest source")
    return tabulate(rows, heads, "github", disable_numparse=True)


def simulated_time(robot: Robot, speed: float) -> float:
    """Return the time that each copy walks in :func:`predict`, in s.

    Args:
        robot: Robot that walks.
        speed: Crank speed, in rad/s.
    """
    times = [SETTLING + measured_time(speed), *[climbing_time(robot, speed)] * len(STEPS)]
    return sum(times) + STOPPED * len(times)


def predict(
    robot: Robot, speed: float, copies: int, advance: Advance = no_progress
) -> dict[str, Any]:
    """Predict all quantities in :data:`UNITS` at a crank speed.

    Args:
        robot: Robot whose copies walk.
        speed: Crank speed, in rad/s.
        copies: Number of copies.
        advance: Function that is called with the time, in s, that the copies have walked since its
            last call.

    Returns:
        For each quantity a dictionary with the keys "median", "low", "high" and "sources". 90 % of
        the copies lie between ``low`` and ``high``. ``sources`` has the fraction of the variance
        that a linear regression attributes to each uncertain parameter. The remainder to 1 is not
        linear, because walking is chaotic.

    Raises:
        ValueError: If copies of the robot stand still.
    """
    robots, known, errors = draw_copies(robot, WITHIN, copies)
    pid = gains_of(robot, "steady")  # gains of the nominal robot; a copied robot matches no design
    measured = measure(robots, known, speed, pid, advance)
    measured["step_climbed"] = climb(robots, known, speed, pid, advance)
    inputs = {name: values[:, None] for name, values in known.items() if name != "start"}
    turn = 2.0 * known["start"]
    inputs |= {"lengths": errors, "start": np.stack([np.cos(turn), np.sin(turn)], axis=1)}
    return {name: summary(measured[name], inputs) for name in UNITS}


def summary(values: Array, inputs: dict[str, Array]) -> dict[str, Any]:
    """Return the median, the 90 % band, and the sources of the variance of a quantity.

    The fraction of the variance of all groups together is the adjusted R^2: the fraction that the
    same number of random columns would explain is subtracted. A small fraction can be negative.
    The sources are empty if there are fewer copies than the regression needs.

    Args:
        values: Values of the quantity, shape (copies,).
        inputs: Groups of inputs by name, each of shape (copies, columns).
    """
    low, high = np.percentile(values, SPAN).tolist()
    median = float(np.median(values))
    if set(np.unique(values)) <= {0.0, 1.0}:  # report events by their frequency
        median = low = high = float(values.mean())
    return {"median": median, "low": low, "high": high, "sources": _sources(values, inputs)}


def _sources(values: Array, inputs: dict[str, Array]) -> dict[str, float]:
    """Return the fraction of the variance of a quantity that each group of inputs explains.

    Args:
        values: Values of the quantity, shape (copies,).
        inputs: Groups of inputs by name, each of shape (copies, columns).
    """
    columns = np.concatenate([*inputs.values()], axis=1)
    spread = values - values.mean()
    free = len(values) - 1 - columns.shape[1]  # remaining degrees of freedom
    if free <= 0 or values.std() <= 1e-9 * max(1.0, abs(values.mean())):
        return {}
    columns = (columns - columns.mean(axis=0)) / columns.std(axis=0)
    slopes = np.linalg.lstsq(columns, spread, rcond=None)[0]
    explained = slopes * (spread @ columns) / (spread @ spread)  # their sum is R^2
    explained -= (1.0 - explained.sum()) / free  # subtract the part that chance explains
    ends = np.cumsum([part.shape[1] for part in inputs.values()])
    parts = [float(part.sum()) for part in np.split(explained, ends[:-1])]
    return {name: round(part, 3) for name, part in zip(inputs, parts, strict=True)}
