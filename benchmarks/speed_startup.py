"""Starting: the import, the first environment on a machine, and an environment in a new process."""

from __future__ import annotations

import json
import tempfile
from statistics import median
from typing import Any

from benchmarks.rounds import Goal, fresh, table

NEEDS: tuple[str, ...] = ()
RUNS, QUICK_RUNS = 5, 1

IMPORT = """
import json, sys, time
start = time.perf_counter()
import jansen_env
imported = time.perf_counter()
heavy = sorted({"torch", "stable_baselines3"} & set(sys.modules))
assert not heavy, f"import jansen_env brings in {heavy}"
"""
WALK = """
import gymnasium as gym
begun = time.perf_counter()
env = gym.make("JansenWalker-v0")
made = time.perf_counter()
env.reset(seed=0)
env.step(env.action_space.sample())
stepped = time.perf_counter()
"""
PRINT_IMPORT = 'print(json.dumps({"import": imported - start}))'
PRINT_WALK = 'print(json.dumps({"make": made - begun, "reset and step": stepped - made}))'
COMPILES = "compiles"  # a word of what is said while it does


def measure(rounds: int, quick: bool) -> dict[str, Any]:
    """Seconds: of one process that compiles, and medians of later ones; ready for JSON.

    Raises:
        RuntimeError: the import brings in what only training needs, or the compiling is not told.
    """
    del rounds  # new processes do not warm up
    found: dict[str, list[dict[str, float]]] = {"import": [], "first": [], "later": []}
    with tempfile.TemporaryDirectory() as cache:
        numbers, errors = _numbers(IMPORT + WALK + PRINT_WALK, NUMBA_CACHE_DIR=cache)
        found["first"].append(numbers)
        said = errors.strip().replace(cache, "NUMBA_CACHE_DIR")
        if COMPILES not in said:
            raise RuntimeError(f"it compiled, but said only {said!r}")
        for _ in range(QUICK_RUNS if quick else RUNS):
            found["import"].append(_numbers(IMPORT + PRINT_IMPORT)[0])
            found["later"].append(_numbers(IMPORT + WALK + PRINT_WALK, NUMBA_CACHE_DIR=cache)[0])
    return {
        "runs": len(found["import"]),
        "seconds": {
            which: {name: median(run[name] for run in runs) for name in runs[0]}
            for which, runs in found.items()
        },
        "all": found,
        "said": said,
    }


def _numbers(code: str, **variables: str) -> tuple[dict[str, float], str]:
    printed, errors = fresh(code, **variables)
    numbers: dict[str, float] = json.loads(printed.splitlines()[-1])
    return numbers, errors


def report(result: dict[str, Any]) -> str:
    """The result as a table."""
    seconds = result["seconds"]
    rows = [("import jansen_env", f"{seconds['import']['import']:.2f}", "")]
    rows += [
        (title, f"{seconds[which]['make']:.2f}", f"{seconds[which]['reset and step']:.2f}")
        for title, which in (
            ("gym.make, nothing compiled yet", "first"),
            ("gym.make, a later process", "later"),
        )
    ]
    head = ("in a new process", "s", "first reset and step, s")
    return f"{table(head, rows)}\n\nThe first one says: {result['said']}"


def goals(result: dict[str, Any]) -> list[Goal]:
    """Where the times should be."""
    seconds = result["seconds"]
    return [
        Goal("import jansen_env, s", seconds["import"]["import"], "at most", 0.5),
        Goal("gym.make, first reset and step in a later process, s",
             sum(seconds["later"].values()), "at most", 1.0),
    ]  # fmt: skip
