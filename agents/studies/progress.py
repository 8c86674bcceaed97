"""Progress of a study's runs: bars in a terminal, a line at each change elsewhere."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from agents.studies.plan import Run
from agents.studies.run import RunResult, is_finished, read_status
from agents.training.runs import read_evaluations

SHOWN = ("starting", "training", "scoring", "failed", "lost")


class StudyProgress:
    """Shows the runs of a study, read from their folders; steps are those of evaluations.

    Args:
        runs: of the study. console: to print to; None for standard output.
    """

    def __init__(self, runs: Sequence[Run], console: Console | None = None) -> None:
        self.console, self._line = console or Console(), ""
        self._bars = Progress(
            TextColumn("{task.description}"), TextColumn("{task.fields[state]}"), BarColumn(),
            MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.fields[best]}"),
            console=self.console, disable=not self.console.is_terminal,
            speed_estimate_period=7200.0,
        )  # fmt: skip
        steps = sum(run.config["timesteps"] for run in runs)
        self._all = self._bars.add_task("all", total=steps, state="", best="")
        self._runs = [
            (
                run,
                self._bars.add_task(
                    run.name, total=run.config["timesteps"], state="", best="", visible=False
                ),
            )
            for run in runs
        ]

    def __enter__(self) -> StudyProgress:
        self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bars.stop()

    def __call__(self, results: dict[str, RunResult]) -> None:
        """Update; the state of runs that have ended is their result's."""
        states: Counter[str] = Counter()
        total = 0
        for run, task in self._runs:
            state = results[run.name].state if run.name in results else run_state(run)
            rows = read_returns(run)
            steps = run.config["timesteps"] if state == "finished" else rows[-1][0] if rows else 0
            best = f"best return {max(row[1] for row in rows):.1f}" if rows else ""
            states[state], total = states[state] + 1, total + steps
            visible = state in SHOWN
            self._bars.update(task, completed=steps, state=state, best=best, visible=visible)
        line = ", ".join(f"{count} {state}" for state, count in sorted(states.items()))
        self._bars.update(self._all, completed=total, state=line)
        if line != self._line and not self.console.is_terminal:
            self._line = line
            self.console.print(line, highlight=False, soft_wrap=True)


def run_state(run: Run) -> str:
    """Return a run's state by its folder."""
    if is_finished(run.folder):
        return "finished"
    return str(read_status(run.folder).get("state", "waiting"))


def read_returns(run: Run) -> list[tuple[int, float]]:
    """Return steps and return of a run's evaluations."""
    rows: list[dict[str, Any]] = []
    with suppress(ValueError):  # a damaged file is the report's to name
        rows = read_evaluations(run.folder)
    return [(int(row["steps"]), row["return"]) for row in rows]
