"""Trust in a search: its ranking of designs with another time step, plant, and other starts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr
from tabulate import tabulate

from agents.design.design_plan import Plan
from agents.design.measures import MEASURES
from agents.design.search import (
    JOURNAL,
    Searched,
    joined,
    make_walker,
    objectives_of,
    read_journal,
)
from jansen_env.baselines.policy import Policy
from jansen_env.files import write_text

DESIGNS = 100  # that are ranked, at most, of those of all seeds that keep all limits
HEAD = ["", "rank correlation", "median change (%)", "not known there"]
ELSEWHERE: dict[str, dict[str, Any]] = {
    "half the time step": {"time_step": 5e-4}, "a quarter of it": {"time_step": 2.5e-4},
    "rigid bodies": {"plant": "rigid_body"},
}  # fmt: skip
STARTS = 8  # other crank angles


def chosen(plan: Plan, searched: Searched, count: int) -> list[int]:
    """Indices of designs that keep all limits, evenly over the ranks of their first objective."""
    value = objectives_of(plan, searched.measured)[:, 0]
    fine = np.flatnonzero(searched.violation == 0.0)
    if not len(fine):
        return []
    order = fine[np.argsort(value[fine])]
    picks = np.unique(np.linspace(0, len(order) - 1, count).astype(int))
    return [int(k) for k in order[picks]]


def trust_report(plan: Plan, folder: Path, policy: Policy | None = None) -> str:
    """Rank designs of a search again elsewhere; writes ``trust.md`` and returns it.

    Raises:
        ValueError: too few designs keep all limits, or a journal is damaged.
    """
    parts = [part for path in sorted(folder.glob(f"seed_*/{JOURNAL}"))
             for part in read_journal(path, plan)]  # fmt: skip
    every = joined(parts) if parts else None
    picks = chosen(plan, every, DESIGNS) if every else []
    if every is None or len(picks) < 3:
        raise ValueError(f"{folder} has {len(picks)} designs in its limits, must have three")
    space = plan.space()
    designs = [space.candidate(every.unit[k]) for k in picks]
    first = next(iter(plan.objectives))
    group, own, one_start = MEASURES[first].group, every.measured[first][picks], []
    walker = make_walker(plan._replace(starts=1), policy)
    for k in range(STARTS):
        walker.angles = np.array([math.pi * (k + 0.5) / STARTS])
        one_start.append(walker.measure(group, designs)[first])
    rows = []
    for name, kwargs in ELSEWHERE.items():
        if "plant" not in kwargs:
            found = make_walker(plan, policy, **kwargs).measure(group, designs)[first]
            rows.append(_row(name, own, found))
        elif group != "loads":  # which that plant does not give; one start, as it takes minutes
            slow = make_walker(plan._replace(starts=1), policy, **kwargs)
            slow.angles = np.array([math.pi * 0.5 / STARTS])
            rows.append(_row(name, one_start[0], slow.measure(group, designs)[first]))
    rows += [_row(f"start {k + 1}", own, found) for k, found in enumerate(one_start)]
    noise = np.nanstd(one_start, axis=0) / np.abs(np.nanmean(one_start, axis=0))
    text = (
        f"# Trust in {folder.name}\n\n`python -m agents.design --trust {folder}`: {first} of "
        f"{len(picks)} designs of the search, evenly over the ranks of those in its limits.\n\n"
        f"{tabulate(rows, HEAD, 'github')}\n\nOver {STARTS} starts its standard deviation is "
        f"{100.0 * np.median(noise):.2g} % of itself in the median of the designs, "
        f"{100.0 * np.nanquantile(noise, 0.9):.2g} % in the worst tenth.\n"
    )
    write_text(folder / "trust.md", text)
    return text


def _row(name: str, own: np.ndarray, found: np.ndarray) -> list[str]:
    """Spearman's rank correlation, and by how much the measure changes."""
    both = np.isfinite(own) & np.isfinite(found)
    rank = spearmanr(own[both], found[both]).statistic if both.sum() > 2 else np.nan
    change = 100.0 * np.median(np.abs(found[both] / own[both] - 1.0))
    return [name, f"{rank:.3f}", f"{change:.2g}", str(int((~both).sum()))]
