"""CMA-ES (``cma``), NSGA-II (``pymoo``) and MAP-Elites (``pyribs``) behind one protocol.

All numbers lie between 0 and 1. The same seed and answers give the same questions, so a search
resumes when it is told again what it was told.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any, Protocol

import cma
import numpy as np

from jansen_env.baselines.policy import Array

SPREAD = 0.03  # standard deviation of the first generation: farther from the start few close
MUTATION, LINE = 0.03, 0.2  # of MAP-Elites: of one parent, and along the line between two
INFEASIBLE, THRESHOLD = -1e12, -1e9  # objectives that no map takes, and the least that it does


def check_installed(method: str) -> None:
    """Raise a ValueError where the library of a method is missing."""
    library = {"nsga2": "pymoo", "map_elites": "ribs"}.get(method)
    if library and find_spec(library) is None:
        raise ValueError(
            f"{method} needs {library}, which the extra 'design' installs: "
            'python -m pip install -c constraints.txt -e ".[design]"'
        )


class Optimiser(Protocol):
    """Protocol of a method."""

    def ask(self) -> Array:
        """Return the next generation (n, d)."""
        ...

    def tell(self, objectives: Array, violation: Array, places: Array) -> None:
        """Take its objectives (n, k), to be small; how far it breaks the limits (n,); its places
        (n, 2) on the map."""
        ...


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
        """See :class:`Optimiser`."""
        self._asked = self._search.ask()
        return np.array(self._asked)

    def tell(self, objectives: Array, violation: Array, places: Array) -> None:
        """See :class:`Optimiser`."""
        rank = np.empty(len(violation))
        rank[np.lexsort((objectives[:, 0], violation))] = np.arange(len(violation))
        self._search.tell(self._asked, rank.tolist())


class Nsga2:
    """NSGA-II (Deb et al. 2002) for several objectives."""

    def __init__(self, start: Array, population: int, seed: int, objectives: int) -> None:
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import Problem

        first = first_generation(start, population, seed)
        self._problem = Problem(n_var=len(start), n_obj=objectives, n_ieq_constr=1, xl=0.0, xu=1.0)
        self._search = NSGA2(pop_size=population, sampling=first)
        self._search.setup(self._problem, termination=("n_gen", 10**9), seed=seed, verbose=False)
        self._asked: Any = None

    def ask(self) -> Array:
        """See :class:`Optimiser`."""
        self._asked = self._search.ask()
        return np.array(self._asked.get("X"), float)

    def tell(self, objectives: Array, violation: Array, places: Array) -> None:
        """See :class:`Optimiser`."""
        from pymoo.core.evaluator import Evaluator
        from pymoo.problems.static import StaticProblem

        values = np.nan_to_num(objectives)  # unknown ones break a limit, and do not count
        evaluated = StaticProblem(self._problem, F=values, G=violation[:, None])
        Evaluator().eval(evaluated, self._asked)
        self._search.tell(infills=self._asked)


class MapElites:
    """MAP-Elites (Mouret and Clune 2015) with variation along lines (Vassiliades and Mouret 2018):
    the best by the first objective in every cell of a map of two measures."""

    def __init__(
        self, start: Array, population: int, seed: int, cells: Sequence[int],
        ranges: Sequence[tuple[float, float]],
    ) -> None:  # fmt: skip
        from ribs.archives import GridArchive
        from ribs.emitters import IsoLineEmitter
        from ribs.schedulers import Scheduler

        archive = GridArchive(
            solution_dim=len(start), dims=[*cells], ranges=[*ranges], learning_rate=1.0,
            threshold_min=THRESHOLD, seed=seed,
        )  # fmt: skip
        emitter = IsoLineEmitter(
            archive, iso_sigma=MUTATION, line_sigma=LINE, bounds=[(0.0, 1.0)] * len(start),
            x0=start, batch_size=population, seed=seed,
        )  # fmt: skip
        self._search = Scheduler(archive, [emitter])

    def ask(self) -> Array:
        """See :class:`Optimiser`."""
        return np.array(self._search.ask(), float)

    def tell(self, objectives: Array, violation: Array, places: Array) -> None:
        """See :class:`Optimiser`."""
        worth = np.where(violation > 0.0, INFEASIBLE, -np.nan_to_num(objectives[:, 0]))
        self._search.tell(worth, np.nan_to_num(places))


def first_generation(start: Array, population: int, seed: int) -> Array:
    """The start, and others about it (population, d)."""
    off = SPREAD * np.random.default_rng(seed).standard_normal((population, len(start)))
    off[0] = 0.0
    return np.clip(start + off, 0.0, 1.0)
