"""Watch two robots climb stairs within seconds, on a page in a browser: ``jansen-env demo``."""

import argparse
import tempfile
import webbrowser
from pathlib import Path
from urllib.parse import urlencode

from jansen_env.cli.enjoy import display
from jansen_env.cli.flags import Parser, path_flag
from jansen_env.viewer.web.walk import write_walk

START = {
    "robot": "built",
    "control": "rough policy",
    "terrain": "stairs",
    "level": 4,
    "robot2": "built",
    "control2": "pid",
}
"""Choices on the page: two robots with the same lengths, one of them under a trained policy."""
STORY = (
    "Two robots climb stairs: the upper one under a trained policy, the lower one under a tuned "
    "PID."
)
NEXT = """\
Try next:
  jansen-env play       turn the crank by hand, change the links, choose the terrain
  jansen-env enjoy      watch the trained policy in a window or as a video
  jansen-env benchmark --policy pid --tracks flat --out pid.json
                        score a policy
  jansen-env verify     compare walks on this machine with the published ones"""


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    parser = Parser(
        "jansen-env demo",
        "Watch two robots climb stairs, on a page in a browser.",
        "jansen-env demo",
        "jansen-env demo --no-open --out pages",
    )
    add = parser.add_argument
    add(
        "--out",
        type=path_flag,
        metavar="FOLDER",
        help="folder to which the page is written; default: a temporary folder",
    )
    add("--no-open", action="store_true", help="do not open a browser")
    args = parser.parse_args(arguments)
    args.parser = parser
    return args


def main(arguments: list[str] | None = None) -> None:
    """Write the page, open it if there is a display, and print what to try next.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    args = parse(arguments)
    with args.parser.refusing():
        folder = Path(args.out or tempfile.mkdtemp(prefix="jansen_env-")).absolute()
        page = write_walk(folder / "walk.html", urlencode(START))
    # Without a display, Python might open the page in a text browser, which would not show it.
    opened = not args.no_open and display() and webbrowser.open(page.as_uri())
    print(STORY)
    print("The page is open in your browser:" if opened else "Open this page in any browser:")
    print(f"  {page}\n\n{NEXT}")
