"""Verification tests note the numbers they measure: ``--numbers FILE`` writes them as a table."""

import math
from pathlib import Path

import pytest

from jansen_env.files import write_text

NUMBERS = pytest.StashKey[dict[tuple[str, str], tuple[float, float, str]]]()
HEAD = "| what is measured | found | allowed | unit | test |\n|---|---|---|---|---|\n"


def pytest_configure(config):
    config.stash[NUMBERS] = {}


@pytest.fixture
def measured(request):
    """``measured(what, value, limit, unit)``: note a number, and fail if it is above its limit.

    Of the numbers that a test notes under one name, the table has the one nearest to its limit.
    """

    def note(what: str, value: float, limit: float, unit: str = "1") -> None:
        numbers = request.config.stash[NUMBERS]
        name = what, f"{request.path.stem}::{request.node.originalname}"
        worst, allowed, _ = numbers.get(name, (-math.inf, 1.0, ""))
        if value * allowed >= worst * limit:
            numbers[name] = float(value), float(limit), unit
        assert value <= limit, f"{what}: {value} {unit}, allowed is {limit}"  # a NaN fails, too

    return note


def pytest_sessionfinish(session):
    """The table of all numbers, in Markdown."""
    file = session.config.getoption("--numbers", None)
    if file:
        rows = [
            f"| {what} | {value:.2g} | {limit:.2g} | {unit} | `{test}` |"
            for (what, test), (value, limit, unit) in session.config.stash[NUMBERS].items()
        ]
        write_text(Path(file), HEAD + "\n".join(rows) + "\n")
