"""Write a robot as MJCF, the format of MuJoCo, on level ground."""

from __future__ import annotations

import argparse
from pathlib import Path

from jansen_env.export_mjcf import to_mjcf
from jansen_env.files import write_text
from jansen_env.robot import ROBOTS
from jansen_env.terrain import Terrain


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    about = (__doc__ or "").partition("\n")[0]
    parser = argparse.ArgumentParser(prog="jansen-env mjcf", description=about)
    parser.add_argument("robot", choices=ROBOTS, metavar="ROBOT", help=", ".join(ROBOTS))
    parser.add_argument("--out", type=Path, metavar="FILE", help="(standard output)")
    found = parser.parse_args(arguments)
    text = to_mjcf(ROBOTS[found.robot](), Terrain.flat())
    if found.out is None:
        print(text, end="")
    else:
        write_text(found.out, text)
