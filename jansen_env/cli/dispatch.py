"""A console script with several commands, each of which is the function ``main`` of a module."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from importlib import import_module

from jansen_env import __version__
from jansen_env.checks import listed
from jansen_env.cli.process import guarded


def run_command(
    program: str,
    commands: Mapping[str, str],
    package: str,
    arguments: list[str] | None,
    installation: Callable[[str], str],
) -> None:
    """Run one of the commands of a console script.

    Args:
        program: Name of the console script.
        commands: Descriptions of the commands by name.
        package: Package that has a module for each command.
        arguments: Arguments of the command line, beginning with the name of the command. None
            selects those of the process.
        installation: Function of the name of a missing package, which returns the arguments of
            pip that install it.

    Raises:
        SystemExit: If an argument is wrong, a package is missing, or the command is stopped.
    """
    with guarded(program):
        given = sys.argv[1:] if arguments is None else arguments
        args = _parse(program, commands, given)
        try:
            import_module(f"{package}.{args.command}").main(args.arguments)
        except ModuleNotFoundError as error:
            missing = (error.name or "").partition(".")[0]
            if missing in ("", package.partition(".")[0]):
                raise
            command = f"python -m pip install {installation(missing)}"
            raise SystemExit(f"{program} {args.command} needs {missing}: {command}") from error


def _parse(program: str, commands: Mapping[str, str], arguments: list[str]) -> argparse.Namespace:
    """Parse the name of a command; its arguments are parsed by the command itself."""
    table = "\n".join(f"  {name:<13} {does}" for name, does in commands.items())
    parser = argparse.ArgumentParser(
        program,
        epilog=f"commands:\n{table}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--version", action="version", version=__version__)
    add("command", metavar="COMMAND", help="one of the commands below")
    add("arguments", nargs=argparse.REMAINDER, metavar="...", help=f"see {program} COMMAND --help")
    args = parser.parse_args(arguments or ["--help"])
    if args.command not in commands:
        allowed = listed([*commands], args.command)
        parser.error(f"COMMAND must be one of {allowed}, got {args.command!r}")
    return args
