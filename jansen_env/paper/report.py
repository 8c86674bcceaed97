"""Claims, interpretations and errata as Markdown tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple

from tabulate import tabulate

from jansen_env.paper.claims import HOLDS, Claim
from jansen_env.paper.errata import Erratum
from jansen_env.paper.interpretations import NEAR, PRINTED_LEVEL, Level, PIDLevel

TORQUE = ("interpretation", "lowest (N m)", "mean (N m)", "highest (N m)")


def as_markdown(
    claims: list[Claim], errata: list[Erratum], levels: list[Level], pid_levels: list[PIDLevel]
) -> str:
    """All tables under their headings."""
    return (
        f"# Claims\n\n{claims_table(claims)}\n# Errata in numbers\n\n{errata_table(errata)}\n"
        f"# Torque at a constant 1 rad/s, by interpretation\n\n{levels_table(levels)}\n"
        f"# Torque under the PID, by interpretation\n\n{pid_table(pid_levels)}"
    )


def as_lines(claims: list[Claim]) -> str:
    """Return the verdicts, one a line within 80 columns, and the number of claims that hold."""
    lines = [f"{c.verdict:<24}{c.key.replace('_', ' ')} ({c.where})" for c in claims]
    held = sum(c.verdict == HOLDS for c in claims)
    return "\n".join([*lines, f"{held} of {len(claims)} claims hold without a condition"])


def claims_table(claims: list[Claim]) -> str:
    """The claims in Markdown."""
    cells = [(f"{c.key} ({c.where})", c.says, c.computed, f"**{c.verdict}**", c.why)
             for c in claims]  # fmt: skip
    return _table(("claim", "says", "computed", "verdict", "why"), cells)


def levels_table(levels: list[Level]) -> str:
    """The torque by interpretation, in Markdown."""
    cells = [(name, *map(_number, values)) for name, *values in map(astuple, levels)]
    return _table((*TORQUE, "joint loss (W)"), cells)


def errata_table(errata: list[Erratum]) -> str:
    """Effects of the errata, in Markdown."""
    return _table(("erratum", "comes to"), [(e.name, e.found) for e in errata])


def pid_table(levels: list[PIDLevel]) -> str:
    """The PID's torque by interpretation, in Markdown."""
    cells = [(name, *map(_number, values), f"{100 * near:.0f} %")
             for name, *values, near in map(astuple, levels)]  # fmt: skip
    return _table((*TORQUE, f"within {NEAR} of {abs(PRINTED_LEVEL)} N m"), cells)


def _number(value: float) -> str:
    return f"{round(value, 3) + 0.0:.3f}"  # not -0.000


def _table(head: Sequence[str], cells: Sequence[Sequence[str]]) -> str:
    # Cells of whole sentences: not padded to one width.
    return tabulate(cells, head, "github", disable_numparse=True, stralign=None) + "\n"
