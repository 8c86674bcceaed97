"""Progress of a study's runs: a bar in a terminal, a line at each change elsewhere."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from agents.studies.backends import Watch
from agents.studies.plan import Run
from agents.studies.run import RunResult, is_finished, run_state
from agents.training.runs import read_evaluations


@contextmanager
def study_progress(runs: Sequence[Run], console: Console | None = None) -> Iterator[Watch]:
    """Give the function that shows how many runs are in which state, and the steps evaluated.

    Args:
        runs: of the study. console: to print to; None for standard output.
    """
    console, before = console or Console(), ""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    bars = Progress(*columns, TimeRemainingColumn(), console=console,
                    disable=not console.is_terminal, speed_estimate_period=7200.0)  # fmt: skip
    task = bars.add_task("", total=sum(run.config["timesteps"] for run in runs))

    def watch(results: dict[str, RunResult]) -> None:
        nonlocal before
        states = [results[r.name].state if r.name in results else run_state(r) for r in runs]
        counts = sorted(Counter(states).items())
        line = ", ".join(f"{count} {state}" for state, count in counts)
        bars.update(task, completed=sum(map(_steps, runs)), description=line)
        if line != before and not console.is_terminal:
            console.print(line, highlight=False, soft_wrap=True)
        before = line

    with bars:
        yield watch


def _steps(run: Run) -> int:
    """Return the steps of a run's last evaluation."""
    if is_finished(run.folder):
        return int(run.config["timesteps"])
    with suppress(ValueError, IndexError):  # a damaged file is the report's to name
        return int(read_evaluations(run.folder)[-1]["steps"])
    return 0
