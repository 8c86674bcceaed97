"""Write drawings of a robot's parts, sheets to cut, instructions and a bill of materials.

    jansen-workshop drawings built --out built

ROBOT is the name of a design or the path of a robot file. ``docs/workshop/drawings.md`` describes
the details.
"""

import argparse
import re
from pathlib import Path

from jansen_env.checks import within
from jansen_env.cli.flags import robot_file, robot_parser
from jansen_env.cli.progress import progress
from jansen_env.files import check_writable, write_bytes
from jansen_env.robot.robot_file import write_robot
from jansen_env.world.settings import load_robot
from jansen_workshop.drawings.materials import machine
from jansen_workshop.drawings.outlines import FITS
from jansen_workshop.drawings.sheets import drawings

SHEET = "2000x1000"  # common stock size, in mm
WIDEST_KERF = 2.0  # in mm; the smallest holes have a diameter of 3.2 mm
WIDEST_FIT = 0.5  # in mm, on a diameter; the smallest pins have a diameter of 3 mm


def _sheet(text: str) -> complex:
    """Parse the size of a sheet, in mm."""
    match = re.fullmatch(r"(\d{1,5}(?:\.\d+)?)x(\d{1,5}(?:\.\d+)?)", text)
    size = complex(*map(float, match.groups())) if match else 0j
    if not size.real * size.imag:
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT in mm, such as {SHEET}, got {text}")
    return size


def _fit(text: str) -> tuple[float, ...]:
    """Parse fit allowances in mm: the name of a process, or three numbers chosen by the builder."""
    try:
        fit = FITS.get(text) or tuple(map(float, text.split(",")))
    except ValueError:
        fit = ()
    if len(fit) != 3 or not all(abs(value) <= WIDEST_FIT for value in fit):
        raise argparse.ArgumentTypeError(
            f"must be one of {[*FITS]}, or PRESS,SLIDE,CLEAR in mm, up to {WIDEST_FIT:g}, "
            f"got {text}"
        )
    return fit


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    """Parse the command line; the result also has the ``parser``."""
    parser = robot_parser(
        "jansen-workshop drawings",
        __doc__,
        "FOLDER",
        "the robot's name",
        "jansen-workshop drawings built --sheet 1000x500",
        "jansen-workshop drawings klann --out klann --as-robot-file klann.json",
    )
    parser.add_argument(
        "--sheet",
        type=_sheet,
        default=SHEET,
        metavar="WIDTHxHEIGHT",
        help="size of a sheet in mm; default: %(default)s",
    )
    parser.add_argument(
        "--kerf",
        type=float,
        default=0.0,
        metavar="MM",
        help="width of the cut in mm, for which the lines compensate; default: 0",
    )
    parser.add_argument(
        "--fit",
        type=_fit,
        default=(0.0, 0.0, 0.0),
        metavar="PROCESS",
        help=f"process that cuts the parts, one of {', '.join(FITS)}; or PRESS,SLIDE,CLEAR, the "
        "increase of the diameters of these holes in mm; default: 0,0,0",
    )
    parser.add_argument(
        "--as-robot-file",
        type=robot_file,
        metavar="FILE",
        help="also write a robot file of the machine as it would be cut, to simulate it",
    )
    args = parser.parse_args(arguments)
    args.parser = parser
    return args


def main(arguments: list[str] | None = None) -> None:
    """Write the drawings.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    args = _parse(arguments)
    name = Path(args.robot).stem
    out = args.out or Path(name)
    with args.parser.refusing():
        robot = load_robot("ROBOT", args.robot)
        kerf = within("--kerf", args.kerf, 0.0, WIDEST_KERF)
        with progress("drawing", None):
            files, summary = drawings(robot, name, args.sheet, kerf, args.fit)
        cut = machine(robot)
        check_writable("--out", out)
        for file, text in files.items():
            write_bytes(out / file, text.encode() if isinstance(text, str) else text)
        if args.as_robot_file:
            write_robot(args.as_robot_file, cut)
    print(summary)
    if robot.springs:
        count = len(robot.springs) * len(robot.legs)
        print(f"the {count} springs are in the bill of materials, but not in the instructions")
    print(f"written: {out}")
