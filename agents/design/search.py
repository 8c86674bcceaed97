"""A search: generations asked for, measured and told, all kept in a journal in its folder.

The journal is the whole state: the same seed and answers give the same questions, so a search that
was killed asks again, tells what it had measured, and goes on where it was, bit for bit.
"""

import io
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import cma
import numpy as np
from numpy.typing import NDArray

from agents import need
from agents.design.design_plan import Plan
from agents.design.measures import GROUPS, Walker
from agents.design.variables import Candidate, Space
from agents.training.runs import locked
from jansen_env.arrays import Array
from jansen_env.checks import named_errors
from jansen_env.files import open_regular, write_bytes

JOURNAL = "journal.npy"
SPREAD = 0.03  # standard deviation of the first generation: farther from the start few close

Measured: TypeAlias = dict[str, Array]
Journal: TypeAlias = NDArray[np.void]
"""All that a search has measured (n,): "unit", variables (d,) from 0 to 1; each measure by name;
"violation" of its limits, 0 where all are kept."""


def best_of(plan: Plan, journal: Journal) -> int:
    """Return the index of the best of those that keep all limits, else of the nearest to it."""
    return int(np.lexsort((objectives_of(plan, journal)[:, 0], journal["violation"]))[0])


def front_of(plan: Plan, journal: Journal) -> list[int]:
    """Return indices of those that keep all limits and that no other is better than in all."""
    from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

    objectives, kept = objectives_of(plan, journal), np.flatnonzero(journal["violation"] == 0.0)
    front = NonDominatedSorting().do(objectives[kept], only_non_dominated_front=True)
    return sorted(kept[front].tolist(), key=lambda k: float(objectives[k, 0]))


class Cma:
    """CMA-ES (Hansen 2016) for the first objective; what breaks limits ranks behind, by how far."""

    def __init__(self, start: Array, population: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        options = {
            "bounds": [0.0, 1.0], "popsize": population, "seed": np.nan, "verbose": -9,
            "CMA_elitist": True,  # or it loses a start that keeps narrow limits
            "randn": lambda *shape: rng.standard_normal(shape),
        }  # fmt: skip
        inside = np.clip(start, 0.02, 0.98)
        self._search = cma.CMAEvolutionStrategy(inside, SPREAD, options)
        self._search.inject([inside], force=True)
        self._asked: list[Array] = []

    def ask(self) -> Array:
        """Return the next generation (n, d), from 0 to 1."""
        self._asked = self._search.ask()
        return np.array(self._asked)

    def tell(self, objectives: Array, violation: Array) -> None:
        """Take its objectives (n, k), to be small, and how far it breaks the limits (n,)."""
        rank = np.empty(len(violation))
        rank[np.lexsort((objectives[:, 0], violation))] = np.arange(len(violation))
        self._search.tell(self._asked, rank.tolist())


class Nsga2:
    """NSGA-II (Deb et al. 2002) for several objectives."""

    def __init__(self, start: Array, population: int, seed: int, objectives: int) -> None:
        need("design", "pymoo", who="nsga2")
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import Problem

        off = SPREAD * np.random.default_rng(seed).standard_normal((population, len(start)))
        off[0] = 0.0
        first = np.clip(start + off, 0.0, 1.0)
        self._problem = Problem(n_var=len(start), n_obj=objectives, n_ieq_constr=1, xl=0.0, xu=1.0)
        self._search = NSGA2(pop_size=population, sampling=first)
        self._search.setup(self._problem, termination=("n_gen", 10**9), seed=seed, verbose=False)
        self._asked: Any = None

    def ask(self) -> Array:
        """Return the next generation (n, d), from 0 to 1."""
        self._asked = self._search.ask()
        return np.array(self._asked.get("X"), float)

    def tell(self, objectives: Array, violation: Array) -> None:
        """Take its objectives (n, k), to be small, and how far it breaks the limits (n,)."""
        from pymoo.core.evaluator import Evaluator
        from pymoo.problems.static import StaticProblem

        values = np.nan_to_num(objectives)  # unknown ones break a limit, and do not count
        evaluated = StaticProblem(self._problem, F=values, G=violation[:, None])
        Evaluator().eval(evaluated, self._asked)
        self._search.tell(infills=self._asked)


def objectives_of(plan: Plan, measured: Measured | Journal) -> Array:
    """(n, k) the plan's objectives, to be small."""
    ways = [(name, 1.0 if way == "min" else -1.0) for name, way in plan.objectives.items()]
    return np.stack([sign * measured[name] for name, sign in ways], axis=1)


def make_walker(plan: Plan, starts: int | None = None, **changes: object) -> Walker:
    """Return what measures a plan's candidates.

    ``starts``: in place of the plan's. ``changes``: of its environment's arguments.
    """
    kwargs = {"robot": plan.robot, **plan.env_kwargs, **changes}
    return Walker(plan.env, kwargs, plan.speed, starts or plan.starts, plan.population)


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
    for group, units in GROUPS.items():
        if not able.any() or not {*units} & {*measured}:
            continue
        fit = [each for k in np.flatnonzero(able).tolist() if (each := candidates[k])]
        values = walker.measure(group, fit)
        for name in {*values} & {*measured}:
            measured[name][able] = values[name]
        able &= (broken(plan, measured, values) == 0.0) & (measured["closure"] > 0.0)
    lost = ~(measured["closure"] > 0.0) | ~np.isfinite(objectives_of(plan, measured)).all(axis=1)
    return measured, broken(plan, measured, wanted) + lost


def broken(plan: Plan, measured: Measured, names: Collection[str]) -> Array:
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
    plan: Plan, seed: int, folder: Path, progress: Callable[[Journal], object] = lambda _: None
) -> Journal:
    """Search, from where the folder's journal ends; returns all that was measured. After each
    generation ``progress`` is called with the journal so far.

    Raises ValueError: the journal is damaged, of another search, or another process writes it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    space, path, n, end = plan.space(), folder / JOURNAL, plan.population, 0
    walker = make_walker(plan)
    search = (Cma(space.start, n, seed) if plan.method == "cma"
              else Nsga2(space.start, n, seed, len(plan.objectives)))  # fmt: skip
    with locked(folder):
        journal = read_journal(path, plan)
        for end in range(n, n * plan.generations + 1, n):
            unit = search.ask()
            if len(journal) < end:
                measured, violation = measure(plan, walker, candidates(space, unit))
                part = np.empty(n, journal.dtype)
                for name, values in {**measured, "unit": unit, "violation": violation}.items():
                    part[name] = values
                journal = np.concatenate([journal, part])
                data = io.BytesIO()  # into a file NumPy does not notice that the disk is full
                np.save(data, journal)
                write_bytes(path, data.getvalue())
            part = journal[end - n : end]
            if not np.array_equal(unit, part["unit"]):
                raise ValueError(
                    f"{path}, generation {end // n}, is not what this search asks for; the plan, "
                    "seed or versions of the libraries are others: take another name"
                )
            search.tell(objectives_of(plan, part), part["violation"])
            progress(journal[:end])
    return journal[:end]


def candidates(space: Space, unit: Array) -> list[Candidate | None]:
    """Return the candidates of numbers (n, d); None for lengths that form no triangle."""
    made: list[Candidate | None] = []
    for numbers in unit:
        try:
            made.append(space.candidate(numbers))
        except ValueError:
            made.append(None)
    return made


def read_journal(path: Path, plan: Plan) -> Journal:
    """Return all that a plan's journal has; nothing without one. Raises ValueError: damaged."""
    names = dict.fromkeys([*plan.measured, "closure", "violation"])
    row = np.dtype([("unit", float, len(plan.space().start)), *((name, float) for name in names)])
    if not path.exists():
        return np.empty(0, row)
    with named_errors(f"{path} is damaged", Exception):  # NumPy raises many kinds
        with open_regular(path) as file:
            journal: Journal = np.load(file, allow_pickle=False)
        if journal.dtype != row or journal.ndim != 1:
            raise ValueError(f"it has rows of {journal.dtype}, must be of {row}")
        return journal
