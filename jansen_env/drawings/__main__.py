"""Write drawings of a robot's parts, sheets to cut, its assembly and its bill of materials.

    python -m jansen_env.drawings built --out built

ROBOT is the name of a design or the path of a robot file. See ``docs/drawings.md``.
"""

from __future__ import annotations

import argparse
import math
from importlib.util import find_spec
from pathlib import Path

from jansen_env.drawings.assembly import assembly_svg
from jansen_env.drawings.materials import bill_of_materials, counts, hardware, to_csv
from jansen_env.drawings.outlines import cut_parts
from jansen_env.drawings.part_files import nest, to_dxf, to_svg
from jansen_env.drawings.shaft_order import CollisionError, layers, units
from jansen_env.files import writable, write_text
from jansen_env.robot import ROBOTS, Robot
from jansen_env.world.settings import load_robot

SHEET = "2000x1000"  # mm, a common stock size
LARGEST = 1e5  # mm, of a sheet


def drawings(robot: Robot, title: str, sheet: complex) -> tuple[dict[str, str], str]:
    """Return the text of every file by its name, and what to tell the user.

    Without assembly and hardware where links collide in any order.

    Args:
        sheet: width and height, mm.

    Raises:
        ValueError: a part is larger than the sheet, or cannot be made; names it.
        LinkageError: a leg does not close.
    """
    parts, number, bill, files = cut_parts(robot), counts(robot), bill_of_materials(robot), {}
    for part in parts:
        files[f"parts/{part.name}.dxf"] = to_dxf([part])
        files[f"parts/{part.name}.svg"] = to_svg([part])
    for thickness in sorted({part.thickness for part in parts}):
        same = [part for part in parts if part.thickness == thickness]
        laid = nest([part for part in same for _ in range(number[part.name])], sheet)
        for k, lying in enumerate(laid, 1):
            name = f"sheets/{thickness:g}mm_{k}"
            files[f"{name}.dxf"], files[f"{name}.svg"] = to_dxf(lying, sheet), to_svg(lying, sheet)
    mass = sum(part.mass for part in bill)
    said = f"{sum(number.values())} parts to cut, {mass:.2f} kg with all others"
    said += f"; the robot is of {robot.mass:.2f} kg"
    try:
        placed = layers(robot)
    except CollisionError as error:
        said += f"; no assembly: {error}"
    else:
        width = placed[-1].z + placed[-1].part.thickness
        title += f": the first of {len(units(robot))} crank pins with its legs; {width:.0f} mm wide"
        files["assembly.svg"] = assembly_svg(robot, placed, title)
        bill += hardware(robot, placed)
    files["materials.csv"] = to_csv(bill)
    return files, said


def _sheet(text: str) -> complex:
    """Size of a sheet, mm."""
    width, _, height = text.partition("x")
    try:
        size = complex(float(width), float(height))
    except ValueError:
        size = complex(math.nan, math.nan)
    if not (0.0 < size.real <= LARGEST and 0.0 < size.imag <= LARGEST):
        raise argparse.ArgumentTypeError(f"is {text}, must be WIDTHxHEIGHT in mm, such as {SHEET}")
    return size


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    about = (__doc__ or "").partition("\n")[0]
    parser = argparse.ArgumentParser(prog="python -m jansen_env.drawings", description=about)
    known = f"{', '.join(ROBOTS)}; or a robot file"
    parser.add_argument("robot", metavar="ROBOT", help=known)
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="(the robot's name)")
    parser.add_argument(
        "--sheet", type=_sheet, default=SHEET, metavar="WIDTHxHEIGHT", help="mm (%(default)s)"
    )
    found = parser.parse_args(arguments)
    if missing := [name for name in ("ezdxf", "matplotlib") if find_spec(name) is None]:
        raise SystemExit(
            f"this needs {' and '.join(missing)}, which the extra 'drawings' installs: "
            'python -m pip install "jansen-env[drawings]", or in a checkout -e ".[drawings]"'
        )
    name = Path(found.robot).stem
    out = Path(name) if found.out is None else found.out
    try:
        files, said = drawings(load_robot("ROBOT", found.robot), name, found.sheet)
    except ValueError as error:
        parser.error(str(error))
    if not writable(out):
        parser.error(f"--out is {out}, must be a folder that can be written to")
    try:
        for file, text in files.items():
            write_text(out / file, text)
    except OSError as error:
        parser.error(f"{error.filename} cannot be written: {error.strerror}")
    print(f"{out}: {said}")


if __name__ == "__main__":
    main()
