"""A search: generations asked for, measured and told, each a line of a journal in its folder.

The journal is the whole state: a search that was killed asks again, tells what it had measured,
and goes on where it was, bit for bit.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.design.design_plan import Plan
from agents.design.measures import Walker, groups_of
from agents.design.optimisers import Cma, MapElites, Nsga2, Optimiser, check_installed
from agents.design.variables import Candidate, Space
from agents.training.runs import locked
from jansen_env.baselines.policy import Array, Policy
from jansen_env.checks import shown
from jansen_env.commands.named_policies import load_named
from jansen_env.files import open_regular
from jansen_env.scoring.rollout import make_env

JOURNAL = "journal.jsonl"

Measured = dict[str, Array]
Progress = Callable[[int, Measured, Array], None]
"""Gets the number of a generation, its measures and violations."""


class Searched(NamedTuple):
    """All that a search has measured: variables (n, d) from 0 to 1, measures (n,), violations (n,)
    of its limits, 0 where all are kept."""

    unit: Array
    measured: Measured
    violation: Array

    def best(self, plan: Plan) -> int:
        """Return the index of the best of those that keep all limits, else of the nearest to it."""
        return int(np.lexsort((objectives_of(plan, self.measured)[:, 0], self.violation))[0])

    def front(self, plan: Plan) -> list[int]:
        """Return indices of those that keep all limits and that no other is better than in all."""
        objectives, fine = objectives_of(plan, self.measured), np.flatnonzero(self.violation == 0.0)
        feasible = objectives[fine]

        def beaten(k: int) -> bool:
            better = (feasible <= objectives[k]).all(axis=1) & (feasible < objectives[k]).any(
                axis=1
            )
            return bool(better.any())

        kept = [k for k in fine.tolist() if not beaten(k)]
        return sorted(kept, key=lambda k: float(objectives[k, 0]))


def objectives_of(plan: Plan, measured: Measured) -> Array:
    """(n, k) the plan's objectives, to be small."""
    ways = [(name, 1.0 if way == "min" else -1.0) for name, way in plan.objectives.items()]
    return np.stack([sign * measured[name] for name, sign in ways], axis=1)


def make_walker(
    plan: Plan, policy: Policy | None = None, starts: int | None = None, **changes: object
) -> Walker:
    """Return what measures a plan's candidates.

    ``starts``: in place of the plan's. ``changes``: of its environment's arguments.
    """
    kwargs = {"robot": plan.robot, **plan.env_kwargs, **changes}
    return Walker(plan.env, kwargs, plan.speed, starts or plan.starts, plan.population, policy)


def load_policy(plan: Plan) -> Policy | None:
    """Return the policy that turns all cranks, None for profiles. Raises ValueError: no policy."""
    if plan.policy is None:
        return None
    env = make_env(plan.env, {**plan.env_kwargs, "robot": plan.robot})
    return load_named(plan.policy, env)


def make_optimiser(plan: Plan, start: Array, seed: int) -> Optimiser:
    """Return a plan's method at its beginning. Raises ValueError: its library is missing."""
    check_installed(plan.method)
    if plan.method == "cma":
        return Cma(start, plan.population, seed)
    if plan.method == "nsga2":
        return Nsga2(start, plan.population, seed, len(plan.objectives))
    low, high, cells = zip(*plan.map.values(), strict=True)
    ranges = [*zip(low, high, strict=True)]
    return MapElites(start, plan.population, seed, [*map(int, cells)], ranges)


def measure(
    plan: Plan, walker: Walker, candidates: Sequence[Candidate | None]
) -> tuple[Measured, Array]:
    """Return measures (n,) by name, and violations (n,) of the limits.

    What breaks a limit is not measured further: NaN. An objective that is not known counts as a
    limit broken. None is a candidate whose lengths form no triangle; it breaks all limits, as one
    does whose linkage cannot turn.
    """
    n, wanted = len(candidates), plan.measured
    measured = {name: np.full(n, np.nan) for name in [*wanted, "closure"]}
    able = np.array([candidate is not None for candidate in candidates])
    for group in groups_of(["closure", *wanted]):
        rows = np.flatnonzero(able)
        if not len(rows):
            break
        values = walker.measure(
            group, [candidate for k in rows.tolist() if (candidate := candidates[k])]
        )
        for name in {*values} & {*measured}:
            measured[name][rows] = values[name]
        able &= (broken(plan, measured, values) == 0.0) & (measured["closure"] > 0.0)
    lost = ~(measured["closure"] > 0.0) | ~np.isfinite(objectives_of(plan, measured)).all(axis=1)
    return measured, broken(plan, measured, wanted) + lost


def broken(plan: Plan, measured: Measured, names: Any) -> Array:
    """(n,) how far the limits on some measures are broken, in all.

    1 - 1 / (1 + x) for each of them, x in shares of the bound: below 1, so that what got far enough
    to be measured is nearer than what did not, which counts 1.
    """
    total = np.zeros(len(measured["closure"]))
    for name, (least, most) in plan.limits.items():
        if name in names:
            value, excess = measured[name], np.zeros(len(total))
            for bound, sign in ((least, -1.0), (most, 1.0)):
                if bound is not None:
                    excess = np.fmax(excess, sign * (value - bound) / (abs(bound) or 1.0))
            total += np.where(np.isnan(value), 1.0, 1.0 - 1.0 / (1.0 + excess))
    return total


def run_search(
    plan: Plan, seed: int, folder: Path, policy: Policy | None = None,
    progress: Progress = lambda *_: None,
) -> Searched:  # fmt: skip
    """Search, from where the folder's journal ends; returns all that was measured.

    Raises:
        ValueError: the journal is damaged, of another search, or another process writes it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder):
        return _search(plan, seed, folder, policy, progress)


def execute_search(plan: Plan, seed: int, folder: Path) -> None:
    """Run a seed's search on one core, in a process that has nothing else to do."""
    os.environ["JANSEN_ENV_THREADS"] = "1"
    run_search(plan, seed, folder, load_policy(plan))


def _search(
    plan: Plan, seed: int, folder: Path, policy: Policy | None, progress: Progress
) -> Searched:
    """Run a search as in :func:`run_search`, in a folder that is locked."""
    space, walker = plan.space(), make_walker(plan, policy)
    optimiser = make_optimiser(plan, space.start, seed)
    told = read_journal(folder / JOURNAL, plan)
    cut_torn_line(folder / JOURNAL)
    parts = []
    for number in range(plan.generations):
        unit = optimiser.ask()
        if number < len(told):
            if not np.array_equal(unit, told[number].unit):
                raise ValueError(
                    f"{folder / JOURNAL}, line {number + 1}, is not what this search asks for; the "
                    "plan, seed or versions of the libraries are others: take another name"
                )
            part = told[number]
        else:
            part = Searched(unit, *measure(plan, walker, candidates(space, unit)))
            _append(folder / JOURNAL, part)
        progress(number, part.measured, part.violation)
        places = np.stack([part.measured[name] for name in plan.map], 1) if plan.map else part.unit
        optimiser.tell(objectives_of(plan, part.measured), part.violation, places)
        parts.append(part)
    return joined(parts)


def joined(parts: Sequence[Searched]) -> Searched:
    """Return generations as one."""
    units, measured, violations = zip(*parts, strict=True)
    names = measured[0]
    every = {name: np.concatenate([values[name] for values in measured]) for name in names}
    return Searched(np.concatenate(units), every, np.concatenate(violations))


def candidates(space: Space, unit: Array) -> list[Candidate | None]:
    """Return the candidates of numbers (n, d); None for lengths that form no triangle."""
    made: list[Candidate | None] = []
    for numbers in unit:
        try:
            made.append(space.candidate(numbers))
        except ValueError:
            made.append(None)
    return made


def cut_torn_line(path: Path) -> None:
    """Remove a journal's last line if a process died before its end."""
    if path.exists():
        with open_regular(path) as file:
            data = file.read()
        os.truncate(path, data.rfind(b"\n") + 1)


def _append(path: Path, part: Searched) -> None:
    """Add a generation to a journal, and see it on the disk."""
    row = {
        "unit": part.unit.tolist(), "violation": part.violation.tolist(),
        "measured": {name: values.tolist() for name, values in part.measured.items()},
    }  # fmt: skip
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")
        file.flush()
        os.fsync(file.fileno())


def read_journal(path: Path, plan: Plan) -> list[Searched]:
    """Return the generations of a plan's journal, but for a last line without its end.

    Raises:
        ValueError: it is damaged; says in which line.
    """
    if not path.exists():
        return []
    with open_regular(path) as file:
        data = file.read()
    parts, names = [], {*plan.measured, "closure"}
    for number, line in enumerate(data.split(b"\n")[:-1], start=1):
        try:
            row = json.loads(line)
            measured = {name: np.array(values, float) for name, values in row["measured"].items()}
            part = Searched(
                np.array(row["unit"], float), measured, np.array(row["violation"], float)
            )
            if part.unit.ndim != 2 or any(
                each.shape != (len(part.unit),) for each in (part.violation, *measured.values())
            ):
                raise ValueError("its rows differ in length")
            if {*measured} != names:
                raise ValueError(f"it has measured {sorted(measured)}, must have {sorted(names)}")
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise ValueError(f"{path}, line {number}, is damaged: {shown(str(error))}") from error
        parts.append(part)
    return parts
