"""Command-line flags that several commands share."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from typing_extensions import override

from jansen_env.checks import MAX_STEPS, invalid, listed
from jansen_env.files import check_writable
from jansen_env.registration import IDS
from jansen_env.robot import ROBOTS
from jansen_env.scoring.benchmarks import DEFAULT, find_benchmark
from jansen_env.scoring.evaluation import MOST_EPISODES


class Parser(argparse.ArgumentParser):
    """Parser that prints an error before the usage, and examples at the end of its help.

    Args:
        prog: Name of the command.
        description: Description of the command. Only its first paragraph is shown.
        *examples: Command lines that are shown as examples.
    """

    def __init__(self, prog: str, description: str | None, *examples: str) -> None:
        super().__init__(
            prog,
            description=(description or "").partition("\n\n")[0],
            epilog="\n  ".join(["examples:", *examples]),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    @override
    def error(self, message: str) -> NoReturn:
        """Print an error and the usage, and exit with status 2.

        Args:
            message: Description of the error.
        """
        self.exit(2, f"{self.prog}: error: {message}\n{self.format_usage()}")

    @contextmanager
    def refusing(self) -> Iterator[None]:
        """Report a ValueError or an OSError of a file as a wrong argument of the command."""
        try:
            yield
        except OSError as error:
            if error.filename is None:  # standard output or a pipe failed, so no argument is wrong
                raise
            self.error(f"{error.filename}: {error.strerror or error}")
        except ValueError as error:
            self.error(str(error))


def env_id(text: str) -> str:
    """Parse the id of an environment that has a benchmark.

    Args:
        text: Argument on the command line.

    Raises:
        argparse.ArgumentTypeError: If there is no such environment.
    """
    if text not in IDS:
        known = listed(sorted(IDS), text)
        raise argparse.ArgumentTypeError(str(invalid("ID", text, f"one of {known}")))
    return text


def imported_env_id(text: str) -> str:
    """Parse the id of an environment, or MODULE:ID to import the module that registers it.

    Args:
        text: Argument on the command line.

    Raises:
        argparse.ArgumentTypeError: If the module cannot be imported, or if there is no such
            environment.
    """
    module, _, name = text.rpartition(":")
    if module:
        try:
            import_module(module)
        except (ImportError, TypeError, ValueError) as error:
            message = f"module {module!r} cannot be imported: {error}"
            raise argparse.ArgumentTypeError(message) from error
    return env_id(name)


def mapping(text: str) -> dict[str, Any]:
    """Parse a YAML mapping such as ``{friction: 0.5}``.

    Args:
        text: Argument on the command line.

    Raises:
        argparse.ArgumentTypeError: If the text is not a YAML mapping.
    """
    from jansen_env.files.plain_yaml import parse_yaml

    try:
        value = parse_yaml(text, repr(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    if not isinstance(value, dict):
        raise argparse.ArgumentTypeError(
            f"must be a YAML mapping such as '{{friction: 0.5}}', got {text!r}"
        )
    return value


def robot_file(text: str) -> Path:
    """Parse the path of a robot file that is to be written.

    Args:
        text: Argument on the command line.

    Raises:
        argparse.ArgumentTypeError: If the path does not end in ``.json``, or if its folder cannot
            be written to.
    """
    file = path_flag(text)
    if file.suffix != ".json":
        raise argparse.ArgumentTypeError(f"must end in .json, got {text}")
    try:
        check_writable("its folder", file.parent)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return file


def positive_int(text: str, low: int = 1, most: int = MAX_STEPS) -> int:
    """Parse a whole number, which may also be written as ``1e5``.

    Args:
        text: Argument on the command line.
        low: Lowest allowed number.
        most: Highest allowed number.

    Raises:
        argparse.ArgumentTypeError: If the text is not a whole number from ``low`` to ``most``.
    """
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not (low <= value <= most and value.is_integer()):
        raise argparse.ArgumentTypeError(
            f"must be a whole number from {low} to {most}, got {text!r}"
        )
    return int(value)


non_negative_int = partial(positive_int, low=0)


def whole(low: int = 1, most: int = MAX_STEPS) -> Callable[[str], int]:
    """Return a function that parses whole numbers, for the ``type`` of a flag.

    Args:
        low: Lowest allowed number.
        most: Highest allowed number.
    """
    return partial(positive_int, low=low, most=most)


episode_count = whole(most=MOST_EPISODES)


def path_flag(text: str) -> Path:
    """Parse the path of a file or folder.

    Args:
        text: Argument on the command line.

    Raises:
        argparse.ArgumentTypeError: If the text is empty or contains a null byte.
    """
    if not text.strip():
        raise argparse.ArgumentTypeError("must be a path, got an empty string")
    if "\0" in text:
        raise argparse.ArgumentTypeError(f"must not contain a null byte, got {text!r}")
    return Path(text)


def robot_parser(
    prog: str, description: str | None, metavar: str, out: str, *examples: str
) -> Parser:
    """Return a parser with the argument ROBOT and the flag ``--out``.

    Args:
        prog: Name of the command.
        description: Description of the command. Only its first paragraph is shown.
        metavar: Name of the value of ``--out`` in the help.
        out: Text that describes the default of ``--out`` in the help.
        *examples: Command lines that are shown as examples.
    """
    parser = Parser(prog, description, *examples)
    parser.add_argument(
        "robot",
        metavar="ROBOT",
        help=f"one of {', '.join(ROBOTS)}; one of these with a number of legs, such as built:12; "
        "or a robot file",
    )
    parser.add_argument(
        "--out", type=path_flag, metavar=metavar, help=f"output to write; default: {out}"
    )
    return parser


def policy_parser(
    prog: str, description: str | None, *examples: str, required: bool = False
) -> Parser:
    """Return a parser with the flags of policies and their environment.

    Args:
        prog: Name of the command.
        description: Description of the command. Only its first paragraph is shown.
        *examples: Command lines that are shown as examples.
        required: Whether ``--policy`` is required.
    """
    named = "; ".join(f"{name}: {', '.join(find_benchmark(name).baselines)}" for name in IDS)
    parser = Parser(prog, description, *examples)
    add = parser.add_argument
    add(
        "--policy",
        action="append",
        default=[],
        required=required,
        metavar="NAME",
        help=f"a baseline ({named}), 'pretrained', the folder of a run, the file of a model or "
        "policy, or MODULE:FUNCTION for a function that makes a policy; repeat the flag to compare "
        "policies",
    )
    add(
        "--env",
        default=DEFAULT,
        type=imported_env_id,
        metavar="ID",
        help=f"id of the environment: {', '.join(IDS)}, or MODULE:ID to import the module that "
        "registers it; default: %(default)s",
    )
    add(
        "--env-kwargs",
        default={},
        type=mapping,
        metavar="YAML",
        help="arguments of the environment, e.g. '{friction: 0.5}'",
    )
    add("--seed", type=non_negative_int, default=0, help="seed of the initial states; default: 0")
    return parser


def parse_policies(parser: Parser, arguments: list[str] | None, flag: str) -> argparse.Namespace:
    """Parse a command line with a parser of :func:`policy_parser`.

    A command for the robot, such as a speed, must not be among the environment's arguments.

    Args:
        parser: Parser of the command line.
        arguments: Arguments of the command. None selects those of the process.
        flag: Name of the flag that has the commands for the robot.
    """
    args = parser.parse_args(arguments)
    if (option := find_benchmark(args.env).option) in args.env_kwargs:
        parser.error(f"{option} has no effect in --env-kwargs; give {flag}")
    args.parser = parser
    return args
