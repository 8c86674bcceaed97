"""Progress bars of commands that take longer than a few seconds, on a terminal alone."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator

from jansen_env.scoring.rollout import Advance, no_progress


def on_terminal() -> bool:
    """Return whether standard output and standard error are both a terminal."""
    streams = (sys.stdout, sys.stderr)
    return all(stream is not None and stream.isatty() for stream in streams)


@contextlib.contextmanager
def progress(title: str, total: float | None) -> Iterator[Advance]:
    """Show a bar on standard error while the work within runs; yield what advances it.

    Nothing is shown where there is no terminal, or without the package rich. The bar disappears at
    the end. Lines that the work prints stand above it.

    Args:
        title: What is being done, at the beginning of the bar.
        total: Amount of work; None where it is not known.
    """
    try:
        if not on_terminal():
            raise ImportError
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TimeRemainingColumn
    except ImportError:
        yield no_progress
        return
    bar = Progress(
        "{task.description}", BarColumn(), TaskProgressColumn(), TimeRemainingColumn(),
        console=Console(stderr=True), transient=True,
    )  # fmt: skip
    with bar:
        task = bar.add_task(title, total=total)
        yield lambda amount: bar.advance(task, amount)
