"""The console script ``jansen-env``, whose commands use existing robots and policies."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path

from jansen_env import __version__
from jansen_env.checks import listed
from jansen_env.process import guarded

COMMANDS = {
    "enjoy": "watch policies, in a window or as a film",
    "evaluate": "score policies side by side",
    "replay": "write a web page that replays walks",
    "play": "walk a robot by hand and design its lengths, on a page in a browser",
    "drawings": "draw a robot's parts, to be cut",
    "predict": "what a built machine would measure, with its uncertainty",
    "paper": "run the paper's simulation, draw its figures, test its claims",
    "mjcf": "export a robot to MuJoCo",
}
"""Descriptions of the commands by name. Each command is a module of :mod:`jansen_env.commands`."""
EXTRAS = {"mujoco": "mujoco", "stable_baselines3": "train", "torch": "train"}
"""Packages that are not part of the extra ``tools``, and the extra that contains them."""
CHECKOUT = Path(__file__).parents[1] / "pyproject.toml"


def main(arguments: list[str] | None = None) -> None:
    """Run a command.

    Args:
        arguments: Arguments of the command line, beginning with the name of the command. None for
            those of the process.

    Raises:
        SystemExit: If an argument is wrong, a package is missing, or the command is stopped.
    """
    with guarded("jansen-env"):
        _run(sys.argv[1:] if arguments is None else arguments)


def _run(arguments: list[str]) -> None:
    """Parse the name of a command and run it."""
    table = "\n".join(f"  {name:<10} {does}" for name, does in COMMANDS.items())
    parser = argparse.ArgumentParser(
        "jansen-env",
        epilog=f"commands:\n{table}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--version", action="version", version=__version__)
    add("command", metavar="COMMAND", help="one of those below")
    add("arguments", nargs=argparse.REMAINDER, metavar="...", help="see jansen-env COMMAND --help")
    args = parser.parse_args(arguments or ["--help"])
    if args.command not in COMMANDS:
        allowed = listed([*COMMANDS], args.command)
        parser.error(f"COMMAND is {args.command!r}, must be one of {allowed}")
    try:
        import_module(f"jansen_env.commands.{args.command}").main(args.arguments)
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing in ("", "jansen_env"):
            raise
        extra = f"[{EXTRAS.get(missing, 'tools')}]"
        package = (
            f'-c constraints.txt -e ".{extra}"' if CHECKOUT.exists() else f'"jansen-env{extra}"'
        )
        text = f"jansen-env {args.command} needs {missing}: python -m pip install {package}"
        raise SystemExit(text) from error


if __name__ == "__main__":
    main()
