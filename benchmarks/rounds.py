"""What the measurements of speed share: turns, goals, tables, and where it was measured."""

from __future__ import annotations

import importlib.util
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from typing import Any, Literal, NamedTuple, TypeVar

import jansen_env

T = TypeVar("T")

FEWEST_ROUNDS = 5
PACKAGES = (
    "box2d", "envpool", "gymnasium", "mujoco", "numba", "numpy", "pymunk", "stable-baselines3",
    "torch",
)  # fmt: skip
INSTALL = 'python -m pip install -c constraints.txt -e ".[bench]"'
"""What brings all that the measurements compare with."""


class Goal(NamedTuple):
    """A number and where it should be.

    Attributes:
        what: it is, with its unit. value: measured.
        bound: ``"at least"``, ``"at most"`` or ``"above"`` ``limit``.
    """

    what: str
    value: float
    bound: Literal["at least", "at most", "above"]
    limit: float

    @property
    def met(self) -> bool:
        """Whether the value is where it should be."""
        if self.bound == "at most":
            return self.value <= self.limit
        return self.value >= self.limit if self.bound == "at least" else self.value > self.limit


def take_turns(plays: Mapping[str, Callable[[], T]], rounds: int) -> dict[str, list[T]]:
    """What each contestant's play returned in each round.

    After a warm-up that does not count they take turns, in the other order every round, so that a
    change of load meets all of them.
    """
    found: dict[str, list[T]] = {name: [] for name in plays}
    for play in plays.values():
        play()
    for number in range(rounds):
        for name in list(plays) if number % 2 == 0 else reversed(list(plays)):
            found[name].append(plays[name]())
    return found


def ratio(ours: Sequence[float], theirs: Sequence[float]) -> dict[str, Any]:
    """How much faster (steps/s of each round): ratio of the medians, its range by round."""
    by_round = [a / b for a, b in zip(ours, theirs, strict=True)]
    return {"ratio": median(ours) / median(theirs), "range": [min(by_round), max(by_round)]}


def missing(modules: Iterable[str]) -> str:
    """What to say of the modules that are not installed; "" if all are."""
    lacking = sorted(name for name in set(modules) if importlib.util.find_spec(name) is None)
    return f"missing: {', '.join(lacking)}; install with\n{INSTALL}\n" if lacking else ""


def fresh(code: str, **variables: str) -> tuple[str, str]:
    """What a new Python process prints on its two channels.

    Args:
        code: to run. variables: of the environment, on top of this process's.

    Raises:
        RuntimeError: the code failed.
    """
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **variables}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        raise RuntimeError(f"a new process failed:\n{done.stderr}")
    return done.stdout, done.stderr


def cores() -> int:
    """Processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def cpu_name() -> str:
    """The processor as the system names it."""
    listing = Path("/proc/cpuinfo")
    lines = listing.read_text(encoding="utf-8").splitlines() if listing.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def machine() -> dict[str, Any]:
    """Processor, load, and versions of all that is measured."""
    versions = {"jansen_env": jansen_env.__version__, "python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return {
        "cpu": cpu_name(),
        "cores": cores(),
        "load_average": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "versions": versions,
    }


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table whose columns are aligned, numbers to the right."""
    body = [list(row) for row in rows]
    widths = [max(len(row[i]) for row in [list(head), *body]) for i in range(len(head))]

    def line(cells: Sequence[str]) -> str:
        first, *others = zip(cells, widths, strict=True)
        aligned = [first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in others)]
        return "| " + " | ".join(aligned) + " |"

    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    return "\n".join([line(head), line(rule), *map(line, body)])


def goal_table(goals: Iterable[Goal]) -> str:
    """The goals and whether they are met."""
    rows = [
        (
            goal.what,
            f"{goal.value:.3g}",
            f"{goal.bound} {goal.limit:g}",
            "yes" if goal.met else "no",
        )
        for goal in goals
    ]
    return table(("goal", "measured", "wanted", "met"), rows)
