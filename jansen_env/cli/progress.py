"""Progress bars, shown only on a terminal, for commands that take more than a few seconds."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator

from jansen_env.scoring.rollout import Advance, no_progress


def on_terminal() -> bool:
    """Return whether standard output and standard error are both terminals."""
    streams = (sys.stdout, sys.stderr)
    return all(stream is not None and stream.isatty() for stream in streams)


@contextlib.contextmanager
def progress(title: str, total: float | None) -> Iterator[Advance]:
    """Show a progress bar on standard error while the context is active.

    Nothing is shown if there is no terminal, or if the package rich is not installed. The bar
    disappears at the end. Lines that are printed meanwhile appear above the bar.

    Args:
        title: Description of the work, shown at the beginning of the bar.
        total: Amount of work; None if it is not known.

    Yields:
        Function that advances the bar by an amount of work.
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
        "{task.description}",
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    )
    with bar:
        task = bar.add_task(title, total=total)
        yield lambda amount: bar.advance(task, amount)
