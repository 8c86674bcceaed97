"""Turns, ratios, the machine, the command line, tables and figures of all benchmarks."""

from __future__ import annotations

import argparse
import importlib.util
import os
import platform
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from tabulate import tabulate

import jansen_env
from jansen_env.baselines.policy import Policy
from jansen_env.commands.named_policies import label, load_named
from jansen_env.cores import available_cores
from jansen_env.files import write_text, write_whole
from jansen_env.scoring.rollout import make_env

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

K = TypeVar("K")
T = TypeVar("T")

WALKER = "JansenWalker-v0"
PACKAGES = (
    "box2d", "envpool", "gymnasium", "mujoco", "numpy", "pymunk", "stable-baselines3",
    "torch",
)  # fmt: skip


class Ratio(NamedTuple):
    """Ratio of the medians of two series, and the lowest and highest ratio within a round."""

    value: float
    low: float
    high: float


def ratio(ours: Sequence[float], theirs: Sequence[float]) -> Ratio:
    """Ours over theirs; entry k of both was measured in round k."""
    by_round = [a / b for a, b in zip(ours, theirs, strict=True)]
    return Ratio(median(ours) / median(theirs), min(by_round), max(by_round))


def spread(values: Sequence[float], form: str = ",.0f") -> tuple[str, str, str]:
    """Median, lowest and highest of the rounds, as cells of a table."""
    middle, low, high = (format(v, form) for v in (median(values), min(values), max(values)))
    return middle, low, high


def take_turns(plays: Mapping[K, Callable[[], T]], rounds: int) -> dict[K, list[T]]:
    """Return results of each contestant by round, after a warm-up; every other round reversed."""
    results: dict[K, list[T]] = {name: [] for name in plays}
    for play in plays.values():
        play()
    for number in range(rounds):
        for name in list(plays) if number % 2 == 0 else reversed(list(plays)):
            results[name].append(plays[name]())
    return results


def machine() -> str:
    """Processor, cores, load, and the versions of all that is measured."""
    listing = Path("/proc/cpuinfo")
    lines = listing.read_text(encoding="utf-8").splitlines() if listing.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    parts = [next(iter(names), platform.machine()), f"{available_cores()} cores"]
    if hasattr(os, "getloadavg"):
        parts.append(f"load average {os.getloadavg()[0]:.2f} at the start")
    versions = {"jansen_env": jansen_env.__version__, "Python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return f"{', '.join(parts)}; {', '.join(f'{n} {number}' for n, number in versions.items())}."


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table, the first column aligned to the left, the others to the right."""
    align = ("left", *["right"] * (len(head) - 1))
    return tabulate(list(rows), head, tablefmt="pipe", disable_numparse=True, colalign=align)


def options(doc: str | None, out: str, **counts: int) -> argparse.ArgumentParser:
    """A command line with ``--out``, ``--quick`` and options for counts, by their defaults."""
    parser = argparse.ArgumentParser(
        f"python -m benchmarks.{Path(sys.argv[0]).stem}", description=(doc or "").partition("\n")[0]
    )
    parser.add_argument("--out", type=Path, default=Path(out), metavar="DIR",
                        help=f"folder for tables and figures ({out})")  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="try the program; proves nothing")
    for name, default in counts.items():
        parser.add_argument(f"--{name}", type=int, default=default, metavar="N",
                            help=f"({default})")  # fmt: skip
    return parser


def parse(parser: argparse.ArgumentParser, arguments: list[str] | None) -> argparse.Namespace:
    """The parsed command line; exits if it cannot be followed."""
    args = parser.parse_args(arguments)
    for name in ("episodes", "jobs", "rounds", "starts"):
        if getattr(args, name, 1) < 1:
            parser.error(f"--{name} is {getattr(args, name)}, must be at least 1")
    if args.out.exists() and not args.out.is_dir():
        parser.error(f"--out is {args.out}, must be a folder")
    return args


def parse_with_policies(
    parser: argparse.ArgumentParser, arguments: list[str] | None, envs: Sequence[str] = (WALKER,)
) -> tuple[argparse.Namespace, dict[str, Policy]]:
    """The command line with ``--policy``, and the policies beside the PID and the profile."""
    parser.add_argument("--policy", action="append", default=[], metavar="NAME",
                        help="also a run's folder or model")  # fmt: skip
    parser.add_argument("--env", choices=envs, default=envs[0], help=f"({envs[0]})")
    args = parse(parser, arguments)
    try:
        return args, load_policies(["pid", "profile", *args.policy], args.env)
    except ValueError as error:
        parser.error(str(error))


def load_policies(names: Iterable[str], env_id: str = WALKER) -> dict[str, Policy]:
    """Policies by label; see :func:`jansen_env.commands.named_policies.load_named`."""
    env = make_env(env_id, {})
    policies = {label(name): load_named(name, env) for name in names}
    env.close()
    return policies


def require(*modules: str) -> None:
    """Exit with what to install unless these modules are there."""
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    if missing:
        raise SystemExit(f"not installed: {', '.join(missing)}; install the extra 'bench'")


def report(path: Path, *parts: str) -> None:
    """Write the parts as paragraphs of a Markdown file, and print them."""
    text = "\n\n".join(parts) + "\n"
    write_text(path, text)
    print(text)


def subplots(
    rows: int, columns: int, width: float, height: float, **arguments: object
) -> tuple[Figure, NDArray[np.object_]]:
    """A matplotlib figure and its axes (rows, columns), with grids; inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **arguments)  # type: ignore[call-overload]
    for axis in axes.flat:
        axis.grid(alpha=0.3)
        axis.set_axisbelow(True)
    return figure, axes


def save(figure: Figure, path: Path) -> None:
    """Write a matplotlib figure."""
    write_whole(path, partial(figure.savefig, dpi=110))
