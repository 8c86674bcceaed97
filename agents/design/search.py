"""Search loop: propose a generation, measure it, and report the results to the optimiser.

A journal in the folder of the search records everything that was measured, and it is the only state
on disk. With the same seed and the same results, the optimiser proposes the same candidates. A
search that was killed therefore replays its journal and continues where it stopped, bit for bit.
"""

import io
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import cma
import numpy as np
from numpy.typing import NDArray

from agents import need
from agents.design.design_plan import SearchPlan
from agents.design.measures import GROUPS, Walker
from agents.design.variables import Candidate, Space
from agents.training.runs import locked
from jansen_env.arrays import Array
from jansen_env.checks import named_errors
from jansen_env.files import open_regular, write_bytes

JOURNAL = "journal.npy"
# Standard deviation of the first generation. Farther from the initial design, few linkages can turn
# their crank through a full revolution.
SPREAD = 0.03

Measured: TypeAlias = dict[str, Array]
Journal: TypeAlias = NDArray[np.void]
"""Everything that a search has measured: a structured array with one record per candidate.

Its fields are ``unit``, the variables of the candidate, each from 0 to 1, shape (d,); every measure
under its name; and ``violation``, the total violation of the limits, which is 0 if the candidate
satisfies all of them.
"""


def best_of(plan: SearchPlan, journal: Journal) -> int:
    """Return the index of the best candidate.

    Among the candidates that satisfy all limits, the first objective decides. If no candidate
    satisfies all limits, the one with the smallest violation is the best.

    Args:
        plan: Plan of the search.
        journal: Journal of the search.
    """
    return int(np.lexsort((objectives_of(plan, journal)[:, 0], journal["violation"]))[0])


def front_of(plan: SearchPlan, journal: Journal) -> list[int]:
    """Return the indices of the Pareto front of the candidates that satisfy all limits.

    Args:
        plan: Plan of the search.
        journal: Journal of the search.

    Returns:
        Indices into the journal, sorted by the first objective.
    """
    from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

    objectives = objectives_of(plan, journal)
    allowed = np.flatnonzero(journal["violation"] == 0.0)
    front = NonDominatedSorting().do(objectives[allowed], only_non_dominated_front=True)
    return sorted(allowed[front].tolist(), key=lambda k: float(objectives[k, 0]))


class Cma:
    """CMA-ES (Hansen 2016) for one objective.

    Candidates that violate limits rank behind all others, in the order of their violation.

    Args:
        start: Initial design, variables from 0 to 1, shape (d,).
        population: Number of candidates per generation.
        seed: Seed of the search.
    """

    def __init__(self, start: Array, population: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        options = {
            "bounds": [0.0, 1.0],
            "popsize": population,
            "seed": np.nan,
            "verbose": -9,
            "CMA_elitist": True,  # otherwise an initial design within narrow limits is lost
            "randn": lambda *shape: rng.standard_normal(shape),
        }
        inside = np.clip(start, 0.02, 0.98)
        self._search = cma.CMAEvolutionStrategy(inside, SPREAD, options)
        self._search.inject([inside], force=True)
        self._generation: list[Array] = []

    def ask(self) -> Array:
        """Return the variables of the next generation, from 0 to 1, shape (n, d)."""
        self._generation = self._search.ask()
        return np.array(self._generation)

    def tell(self, objectives: Array, violation: Array) -> None:
        """Report the results of the generation that :meth:`ask` returned.

        Args:
            objectives: Objectives, where smaller is better, shape (n, k).
            violation: Violation of the limits, shape (n,).
        """
        rank = np.empty(len(violation))
        rank[np.lexsort((objectives[:, 0], violation))] = np.arange(len(violation))
        self._search.tell(self._generation, rank.tolist())


class Nsga2:
    """NSGA-II (Deb et al. 2002) for several objectives.

    Args:
        start: Initial design, variables from 0 to 1, shape (d,).
        population: Number of candidates per generation.
        seed: Seed of the search.
        objectives: Number of objectives.
    """

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
        self._generation: Any = None

    def ask(self) -> Array:
        """Return the variables of the next generation, from 0 to 1, shape (n, d)."""
        self._generation = self._search.ask()
        return np.array(self._generation.get("X"), float)

    def tell(self, objectives: Array, violation: Array) -> None:
        """Report the results of the generation that :meth:`ask` returned.

        Args:
            objectives: Objectives, where smaller is better, shape (n, k).
            violation: Violation of the limits, shape (n,).
        """
        from pymoo.core.evaluator import Evaluator
        from pymoo.problems.static import StaticProblem

        # A candidate with an unknown objective violates a limit, so this value does not matter.
        values = np.nan_to_num(objectives)
        evaluated = StaticProblem(self._problem, F=values, G=violation[:, None])
        Evaluator().eval(evaluated, self._generation)
        self._search.tell(infills=self._generation)


def objectives_of(plan: SearchPlan, measured: Measured | Journal) -> Array:
    """Return the objectives of a plan with signs such that smaller values are better.

    Args:
        plan: Plan of the search.
        measured: Measures of n candidates.

    Returns:
        Objectives, shape (n, k).
    """
    ways = [(name, 1.0 if way == "min" else -1.0) for name, way in plan.objectives.items()]
    return np.stack([sign * measured[name] for name, sign in ways], axis=1)


def make_walker(plan: SearchPlan, starts: int | None = None, **changes: object) -> Walker:
    """Return the walker that measures the candidates of a plan.

    Args:
        plan: Plan of the search.
        starts: Number of starting crank angles. None selects the number in the plan.
        **changes: Arguments of the environment that replace those of the plan.
    """
    kwargs = {"robot": plan.robot, **plan.env_kwargs, **changes}
    return Walker(plan.env, kwargs, plan.speed, starts or plan.starts, plan.population)


def measure(
    plan: SearchPlan, walker: Walker, candidates: Sequence[Candidate | None]
) -> tuple[Measured, Array]:
    """Measure candidates, the cheapest measures first.

    A candidate that violates a limit is not measured any further, and its remaining measures are
    NaN. An objective that is not known counts as one violated limit. A candidate whose linkage
    cannot turn violates all limits.

    Args:
        plan: Plan of the search.
        walker: Walker that measures the candidates.
        candidates: Candidates. None stands for link lengths that form no triangle; it violates all
            limits.

    Returns:
        The measures by name, shape (n,) each, and the violations of the limits, shape (n,).
    """
    n = len(candidates)
    wanted = plan.measured
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


def broken(plan: SearchPlan, measured: Measured, names: Collection[str]) -> Array:
    """Return by how much candidates violate the limits on some measures.

    A limit that is exceeded by x, as a fraction of its bound, contributes 1 - 1 / (1 + x). This is
    below 1, and a measure that is not known contributes 1. A candidate that was measured is
    therefore always closer to the limit than a candidate that was not.

    Args:
        plan: Plan of the search.
        measured: Measures of n candidates.
        names: Names of the measures whose limits count.

    Returns:
        Sum of the violations, shape (n,).
    """
    total = np.zeros(len(measured["closure"]))
    for name, (least, most) in plan.limits.items():
        if name in names:
            value = measured[name]
            excess = np.zeros(len(total))
            for bound, sign in ((least, -1.0), (most, 1.0)):
                if bound is not None:
                    excess = np.fmax(excess, sign * (value - bound) / (abs(bound) or 1.0))
            total += np.where(np.isnan(value), 1.0, 1.0 - 1.0 / (1.0 + excess))
    return total


def run_search(
    plan: SearchPlan,
    seed: int,
    folder: Path,
    progress: Callable[[Journal], object] = lambda _: None,
) -> Journal:
    """Run one search, or continue it where the journal in its folder ends.

    Args:
        plan: Plan of the search.
        seed: Seed of the search.
        folder: Folder of this search; it is created if it does not exist.
        progress: Function that is called after each generation, with the journal so far.

    Returns:
        The complete journal.

    Raises:
        ValueError: If the journal is damaged or belongs to another search, or if another process
            uses the folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    space = plan.space()
    path = folder / JOURNAL
    n = plan.population
    walker = make_walker(plan)
    optimiser = (
        Cma(space.start, n, seed)
        if plan.method == "cma"
        else Nsga2(space.start, n, seed, len(plan.objectives))
    )
    end = 0
    with locked(folder):
        journal = read_journal(path, plan)
        for end in range(n, n * plan.generations + 1, n):
            unit = optimiser.ask()
            if len(journal) < end:
                measured, violation = measure(plan, walker, candidates(space, unit))
                part = np.empty(n, journal.dtype)
                for name, values in {**measured, "unit": unit, "violation": violation}.items():
                    part[name] = values
                journal = np.concatenate([journal, part])
                write_journal(path, journal)
            part = journal[end - n : end]
            if not np.array_equal(unit, part["unit"]):
                raise ValueError(
                    f"generation {end // n} of {path} must contain the candidates that this search "
                    "proposes, got other candidates: the plan, the seed or the version of a "
                    "library has changed; choose another --name"
                )
            optimiser.tell(objectives_of(plan, part), part["violation"])
            progress(journal[:end])
    return journal[:end]


def candidates(space: Space, unit: Array) -> list[Candidate | None]:
    """Return the candidates that variables stand for; None if link lengths form no triangle.

    Args:
        space: Search space.
        unit: Variables from 0 to 1, shape (n, d).
    """
    made: list[Candidate | None] = []
    for numbers in unit:
        try:
            made.append(space.candidate(numbers))
        except ValueError:
            made.append(None)
    return made


def write_journal(path: Path, journal: Journal) -> None:
    """Write a journal to a file.

    Args:
        path: File to write.
        journal: The journal.
    """
    data = io.BytesIO()  # NumPy does not notice a full disk when it writes to a file
    np.save(data, journal)
    write_bytes(path, data.getvalue())


def read_journal(path: Path, plan: SearchPlan) -> Journal:
    """Read a journal; return an empty journal if there is no file.

    Args:
        path: File of the journal.
        plan: Plan of the search, which determines the fields.

    Raises:
        ValueError: If the file is damaged or has other fields.
    """
    names = dict.fromkeys([*plan.measured, "closure", "violation"])
    row = np.dtype([("unit", float, len(plan.space().start)), *((name, float) for name in names)])
    if not path.exists():
        return np.empty(0, row)
    with named_errors(f"{path} is damaged", Exception):  # NumPy raises many types
        with open_regular(path) as file:
            journal: Journal = np.load(file, allow_pickle=False)
        if journal.dtype != row or journal.ndim != 1:
            raise ValueError(f"it must have rows of {row}, got rows of {journal.dtype}")
        return journal
