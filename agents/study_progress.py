"""How far the runs of a study are: a live table in a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from types import TracebackType
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.live import Live
from rich.table import Table

from agents.runs import read_evaluations
from agents.study_plan import Run
from agents.study_runs import Outcome, is_finished, read_status

COLUMNS = ("run", "state", "steps", "of", "steps/s", "last return", "best return", "time left")
ORDER = ("training", "scoring", "starting", "failed", "lost", "stopped", "waiting", "stopped early",
         "finished")  # fmt: skip
LINE_PERIOD = 60.0  # s between two lines where there is no terminal, if nothing changes


class Progress:
    """Shows all runs of a study, read from their folders.

    Args:
        runs: of the study. console: where to; None for standard output.
    """

    def __init__(self, runs: Sequence[Run], console: Console | None = None) -> None:
        self.runs: list[Run] = []
        self.console = console or Console()
        self._stale: dict[str, dict[str, Any]] = {}
        self._finished: set[str] = set()
        self._live = Live(console=self.console, auto_refresh=False, vertical_overflow="ellipsis")
        self._line, self._written = "", 0.0
        for run in runs:
            self.add(run)

    def add(self, run: Run) -> None:
        """Show one more run."""
        self.runs.append(run)
        # What an earlier driver left behind says nothing of this one's runs.
        self._stale[run.name] = read_status(run.folder)
        if is_finished(run.folder):
            self._finished.add(run.name)

    def __enter__(self) -> Progress:
        if self.console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self.console.is_terminal:
            self._live.stop()

    def __call__(self, outcomes: dict[str, Outcome]) -> None:
        """Show how things stand; what has ended is known from its outcome."""
        rows = [self._row(run, outcomes.get(run.name)) for run in self.runs]
        if self.console.is_terminal:
            self._live.update(_table(rows), refresh=True)
            return
        line = summary(rows)
        states = line.split(";")[0]
        if states != self._line or time.monotonic() - self._written > LINE_PERIOD:
            self._line, self._written = states, time.monotonic()
            self.console.print(line, highlight=False, soft_wrap=True)

    def _row(self, run: Run, outcome: Outcome | None) -> dict[str, Any]:
        status = read_status(run.folder)
        if outcome is not None:
            state = outcome.state
        elif run.name in self._finished:
            state = "finished"
        elif status == self._stale[run.name]:
            state = "waiting"
        else:
            state = status.get("state", "waiting")
        return progress_row(run, state, status)


def progress_row(run: Run, state: str, status: dict[str, Any]) -> dict[str, Any]:
    """What is shown of a run, by :data:`COLUMNS`; None for what is not known."""
    try:
        evaluations = read_evaluations(run.folder)
    except (OSError, ValueError):
        evaluations = []
    returns = [row["return"] for row in evaluations]
    target = run.config["timesteps"]
    steps, rate = status.get("steps"), status.get("steps_per_second")
    if steps is None and evaluations:
        steps = int(evaluations[-1]["steps"])
    left = None
    if state == "training" and rate and steps is not None:
        left = max(target - steps, 0) / rate
    values = (run.name, state, steps, target, rate if state == "training" else None,
              returns[-1] if returns else None, max(returns, default=None), left)  # fmt: skip
    return dict(zip(COLUMNS, values, strict=True))


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """All runs in a line."""
    states = Counter(row["state"] for row in rows)
    counted = ", ".join(f"{states[state]} {state}" for state in ORDER if states[state])
    steps = sum(min(row["steps"] or 0, row["of"]) for row in rows)
    rate = sum(row["steps/s"] or 0.0 for row in rows)
    return f"{counted}; {steps:,} of {sum(row['of'] for row in rows):,} steps, {rate:,.0f} steps/s"


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    """Running ones first: where the terminal is too low for all, the last lines are left out."""
    table = Table(*COLUMNS, title=summary(rows), title_justify="left", box=SIMPLE_HEAD)
    table.columns[0].min_width = max(len(row["run"]) for row in rows) if rows else 0
    for column in table.columns[2:]:
        column.justify = "right"
    for row in sorted(rows, key=lambda row: ORDER.index(row["state"])):
        table.add_row(*(_cell(name, row[name]) for name in COLUMNS))
    return table


def _cell(name: str, value: Any) -> str:
    if value is None:
        return ""
    if name == "time left":
        return f"{value // 3600:.0f}:{value // 60 % 60:02.0f}:{value % 60:02.0f}"
    if isinstance(value, str):
        return value
    return f"{value:.1f}" if name.endswith("return") else f"{value:,.0f}"
