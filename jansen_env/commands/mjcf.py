"""Write a robot as MJCF, the format of MuJoCo, on level ground."""

from __future__ import annotations

import argparse
from pathlib import Path

from jansen_env.export_mjcf import to_mjcf
from jansen_env.files import write_text
from jansen_env.robot import ROBOTS
from jansen_env.terrain import Terrain
from jansen_env.world.settings import load_robot


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    about = (__doc__ or "").partition("\n")[0]
    parser = argparse.ArgumentParser(prog="jansen-env mjcf", description=about)
    known = f"{', '.join(ROBOTS)}; or a robot file"
    parser.add_argument("robot", metavar="ROBOT", help=known)
    parser.add_argument("--out", type=Path, metavar="FILE", help="default: standard output")
    found = parser.parse_args(arguments)
    try:
        text = to_mjcf(load_robot("ROBOT", found.robot), Terrain.flat())
        if found.out is None:
            print(text, end="")
        else:
            write_text(found.out, text)
    except BrokenPipeError:
        raise
    except (OSError, ValueError) as error:
        parser.error(str(error))
