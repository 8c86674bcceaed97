"""Proofs note the numbers they measure: ``python -m pytest tests/proofs --numbers FILE``."""

from __future__ import annotations

from pathlib import Path

import pytest

from jansen_env.files import write_text

ROWS = pytest.StashKey[list[str]]()
HEAD = "| what is measured | found | allowed | unit | test |\n|---|---|---|---|---|\n"


def pytest_configure(config):
    config.stash[ROWS] = []


@pytest.fixture
def measured(request):
    """``measured(what, value, limit, unit)``: note a number, and fail if it is above its limit."""

    def note(what: str, value: float, limit: float, unit: str = "1") -> None:
        test = f"{request.path.stem}::{request.node.originalname}"
        row = f"| {what} | {value:.3g} | {limit:.3g} | {unit} | `{test}` |"
        request.config.stash[ROWS].append(row)
        assert value <= limit, f"{what}: {value} {unit}, allowed is {limit}"  # a NaN fails, too

    return note


def pytest_sessionfinish(session):
    """The table of all numbers, in Markdown."""
    file, rows = session.config.getoption("--numbers", None), session.config.stash[ROWS]
    if file:
        write_text(Path(file), HEAD + "\n".join(rows) + "\n")
