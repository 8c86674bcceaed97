"""Flags that commands share."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from jansen_env.checks import MAX_STEPS, invalid, listed
from jansen_env.files import check_writable
from jansen_env.registration import IDS
from jansen_env.robot import ROBOTS
from jansen_env.scoring.benchmarks import DEFAULT, find_benchmark
from jansen_env.scoring.evaluation import MOST_EPISODES


class Parser(argparse.ArgumentParser):
    """Parser that prints an error before the usage, and examples at the end of its help."""

    def __init__(self, prog: str, description: str | None, *examples: str) -> None:
        super().__init__(
            prog, description=(description or "").partition("\n\n")[0],
            epilog="\n  ".join(["examples:", *examples]),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )  # fmt: skip

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message}\n{self.format_usage()}")

    @contextmanager
    def refusing(self) -> Iterator[None]:
        """Report a ValueError, or an OSError of a file, of the work within as a wrong argument."""
        try:
            yield
        except OSError as error:
            if error.filename is None:  # standard output, or a pipe: no argument is wrong
                raise
            self.error(f"{error.filename}: {error.strerror or error}")
        except ValueError as error:
            self.error(str(error))


def env_id(text: str) -> str:
    """Parse the id of an environment that has a benchmark."""
    if text not in IDS:
        known = listed(sorted(IDS), text)
        raise argparse.ArgumentTypeError(str(invalid("ID", text, f"one of {known}")))
    return text


def imported_env_id(text: str) -> str:
    """Parse the id of an environment, or MODULE:ID of one that this module registers."""
    module, _, name = text.rpartition(":")
    if module:
        try:
            import_module(module)
        except (ImportError, TypeError, ValueError) as error:
            message = f"module {module!r} cannot be imported: {error}"
            raise argparse.ArgumentTypeError(message) from error
    return env_id(name)


def mapping(text: str) -> dict[str, Any]:
    """Parse a YAML mapping such as ``{friction: 0.5}``."""
    from jansen_env.plain_yaml import parse_yaml

    try:
        value = parse_yaml(text, repr(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    if not isinstance(value, dict):
        raise argparse.ArgumentTypeError(f"{text!r} is no YAML mapping such as '{{friction: 0.5}}'")
    return value


def robot_file(text: str) -> Path:
    """Parse the path of a robot file to write, in a folder that can be written to."""
    file = path_flag(text)
    if file.suffix != ".json":
        raise argparse.ArgumentTypeError(f"must end in .json, got {text}")
    try:
        check_writable("its folder", file.parent)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return file


def positive_int(text: str, low: int = 1, most: int = MAX_STEPS) -> int:
    """Parse a whole number from ``low`` to ``most``, also written ``1e5``."""
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
    """Return a type of flags for whole numbers from ``low`` to ``most``."""
    return partial(positive_int, low=low, most=most)


episode_count = whole(most=MOST_EPISODES)


def path_flag(text: str) -> Path:
    """Parse the path of a file or folder, which must not be empty."""
    if not text.strip():
        raise argparse.ArgumentTypeError("must be a path, got an empty text")
    if "\0" in text:
        raise argparse.ArgumentTypeError(f"must have no zero byte, got {text!r}")
    return Path(text)


def robot_parser(
    prog: str, description: str | None, metavar: str, out: str, *examples: str
) -> Parser:
    """Return a parser of a robot and of ``--out``, which is ``out`` by default."""
    parser = Parser(prog, description, *examples)
    parser.add_argument(
        "robot",
        metavar="ROBOT",
        help=f"{', '.join(ROBOTS)}; one of these with a number of legs, such as built:12; "
        "or a robot file",
    )
    parser.add_argument("--out", type=path_flag, metavar=metavar, help=f"default: {out}")
    return parser


def policy_parser(
    prog: str, description: str | None, *examples: str, required: bool = False
) -> Parser:
    """Return a parser with the flags of policies and their environment."""
    named = "; ".join(f"{name}: {', '.join(find_benchmark(name).baselines)}" for name in IDS)
    parser = Parser(prog, description, *examples)
    add = parser.add_argument
    add("--policy", action="append", default=[], required=required, metavar="NAME",
        help=f"a baseline ({named}), 'pretrained', a run's folder, or a file of a model or policy; "
        "repeat to compare")  # fmt: skip
    add("--env", default=DEFAULT, type=imported_env_id, metavar="ID",
        help=f"environment: {', '.join(IDS)}, or MODULE:ID; default: %(default)s")  # fmt: skip
    add("--env-kwargs", default={}, type=mapping, metavar="YAML",
        help="arguments of the environment, e.g. '{friction: 0.5}'")  # fmt: skip
    add("--seed", type=non_negative_int, default=0, help="seed of the starts; default: 0")
    return parser


def parse_policies(parser: Parser, arguments: list[str] | None, flag: str) -> argparse.Namespace:
    """Parse a command line of :func:`policy_parser`, whose commands are given by ``flag``."""
    args = parser.parse_args(arguments)
    if (option := find_benchmark(args.env).option) in args.env_kwargs:
        parser.error(f"{option} in --env-kwargs has no effect here, must be in {flag}")
    args.parser = parser
    return args
