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
from typing import Any, NamedTuple, TypeVar

import numpy as np
from tabulate import tabulate

import jansen_env
from jansen_env.cores import available_cores
from jansen_env.files import write_text, write_whole

K = TypeVar("K")
T = TypeVar("T")

PACKAGES = (
    "box2d", "envpool", "gymnasium", "mujoco", "numpy", "pymunk", "stable-baselines3",
    "torch",
)  # fmt: skip


class Ratio(NamedTuple):
    """Ratio of the medians of two series, and the lowest and highest ratio within a round."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.2f} ({self.low:.2f} to {self.high:.2f})"


def ratio(ours: Sequence[float], theirs: Sequence[float]) -> Ratio:
    """Ours over theirs; entry k of both was measured in round k."""
    by_round = [a / b for a, b in zip(ours, theirs, strict=True)]
    return Ratio(median(ours) / median(theirs), min(by_round), max(by_round))


def exponent(costs: Mapping[int, Sequence[float]]) -> float:
    """Return the exponent by which a cost grows with a size: the slope of both logarithms."""
    sizes, middle = np.log([*costs]), np.log([median(found) for found in costs.values()])
    return float(np.polyfit(sizes, middle, 1)[0])


def spread(values: Sequence[float], form: str = ",.0f") -> tuple[str, str, str]:
    """Median, lowest and highest of the rounds, as cells of a table."""
    middle, low, high = (format(v, form) for v in (median(values), min(values), max(values)))
    return middle, low, high


def take_turns(
    plays: Mapping[K, Callable[[], T]], rounds: int, warm_up: bool = True
) -> dict[K, list[T]]:
    """Return results of each contestant's plays by round, in reverse order every other round."""
    found: dict[K, list[T]] = {name: [] for name in plays}
    for play in plays.values() if warm_up else ():
        play()
    for number in range(rounds):
        for name in list(plays) if number % 2 == 0 else reversed(list(plays)):
            found[name].append(plays[name]())
    return found


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


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
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
        parser.add_argument(
            f"--{name}", type=int, default=default, metavar="N", help=f"({default})"
        )
    return parser


def chosen(parser: argparse.ArgumentParser, arguments: list[str] | None) -> argparse.Namespace:
    """The parsed command line; exits if it cannot be followed."""
    found = parser.parse_args(arguments)
    for name in ("episodes", "jobs", "rounds", "starts"):
        if getattr(found, name, 1) < 1:
            parser.error(f"--{name} is {getattr(found, name)}, must be at least 1")
    if found.out.exists() and not found.out.is_dir():
        parser.error(f"--out is {found.out}, must be a folder")
    return found


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


def subplots(rows: int, columns: int, width: float, height: float, **arguments: Any) -> Any:
    """A matplotlib figure and its axes (rows, columns), with grids; inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **arguments)
    for axis in axes.flat:
        axis.grid(alpha=0.3)
        axis.set_axisbelow(True)
    return figure, axes


def save(figure: Any, path: Path) -> None:
    """Write a matplotlib figure."""
    write_whole(path, partial(figure.savefig, dpi=110))
