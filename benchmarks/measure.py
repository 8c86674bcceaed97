"""Turns, the machine, the command line and tables of all benchmarks."""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from typing import TypeVar

from tabulate import tabulate

import jansen_env
from jansen_env.commands.flags import Parser, positive_int
from jansen_env.cores import available_cores
from jansen_env.files import check_writable, write_text

K = TypeVar("K")
T = TypeVar("T")

PACKAGES = "box2d", "envpool", "gymnasium", "mujoco", "numpy", "pymunk"


def take_turns(plays: Mapping[K, Callable[[], T]], rounds: int) -> dict[K, list[T]]:
    """Return results of each contestant by round, after a warm-up; every other round reversed."""
    results: dict[K, list[T]] = {name: [] for name in plays}
    for play in plays.values():
        play()
    for number in range(rounds):
        for name in list(plays) if number % 2 == 0 else reversed(list(plays)):
            results[name].append(plays[name]())
    return results


def rate_table(
    rates: Mapping[tuple[str, ...], Sequence[float]],
    names: Sequence[str],
    references: Iterable[tuple[str, ...]],
) -> str:
    """Medians, lowest and highest of rates by contestant, and medians over those of references."""
    references, middle = list(references), {key: median(rates[key]) for key in rates}
    rows = [
        (*key, *(f"{rate:,.0f}" for rate in (middle[key], min(series), max(series))),
         *(f"{middle[key] / middle[other]:.2f}" for other in references))
        for key, series in rates.items()
    ]  # fmt: skip
    ratios = (f"/ {', '.join(other)}" for other in references)
    return table((*names, "steps/s", "lowest", "highest", *ratios), rows)


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


def options(doc: str | None, out: str, **counts: int) -> Parser:
    """A command line with ``--out``, ``--quick`` and options for counts, by their defaults."""
    command = f"python -m benchmarks.{Path(sys.argv[0]).stem}"
    parser = Parser(command, doc, f"{command} --quick --out logs/tried")
    parser.add_argument("--out", type=Path, default=Path(out), metavar="DIR",
                        help=f"folder for tables ({out})")  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="try the program; proves nothing")
    for name, default in counts.items():
        parser.add_argument(f"--{name}", type=positive_int, default=default, metavar="N",
                            help=f"({default})")  # fmt: skip
    return parser


def parse(parser: Parser, arguments: list[str] | None) -> argparse.Namespace:
    """The parsed command line; exits if it cannot be followed."""
    args = parser.parse_args(arguments)
    with parser.refusing():
        check_writable("--out", args.out)
    return args


def report(path: Path, *parts: str) -> None:
    """Write the parts as paragraphs of a Markdown file, and print them."""
    text = "\n\n".join(parts) + "\n"
    write_text(path, text)
    print(text)
