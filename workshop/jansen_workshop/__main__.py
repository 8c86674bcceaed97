"""The console script ``jansen-workshop``, for those who build a machine and measure it."""

from __future__ import annotations

from jansen_env.cli.dispatch import run_command

COMMANDS = {
    "drawings": "draw a robot's parts, to be cut, with instructions and a bill of materials",
    "predict": "predict measurements on a built machine, with their uncertainty",
    "measurements": "compare logs of a machine with the published predictions",
    "identify": "find the properties of a machine from its logs",
}
"""Descriptions of the commands by name. Each command is a module of :mod:`.commands`."""


def main(arguments: list[str] | None = None) -> None:
    """Run a command.

    Args:
        arguments: Arguments of the command line, beginning with the name of the command. None
            selects those of the process.

    Raises:
        SystemExit: If an argument is wrong, a package is missing, or the command is stopped.
    """
    run_command(
        "jansen-workshop",
        COMMANDS,
        "jansen_workshop.commands",
        arguments,
        lambda package: "-c constraints.txt -e . -e workshop",
    )


if __name__ == "__main__":
    main()
