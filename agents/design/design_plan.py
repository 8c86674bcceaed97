"""Plan of a search, as YAML, checked whole."""

from __future__ import annotations

import math
from pathlib import Path
from types import NoneType
from typing import Any, NamedTuple

from agents.design.measures import MEASURES
from agents.design.variables import Space
from jansen_env.checks import listed, one_of, shown
from jansen_env.plain_yaml import Rule, check_keys, read_yaml
from jansen_env.scoring.benchmarks import WALKERS, check_env_kwargs

METHODS = ("cma", "nsga2", "map_elites")
PLANS = Path(__file__).parent / "plans"
KEYS: dict[str, Rule] = {
    "env": Rule(words=tuple(WALKERS)), "env_kwargs": Rule((dict,)), "robot": Rule((str,)),
    "profile": Rule((str, NoneType)),
    "speed": Rule((float,), 0.01, 2.0), "policy": Rule((str, NoneType)),
    "method": Rule(words=METHODS), "generations": Rule((int,), 1, 100_000),
    "population": Rule((int,), 4, 4096), "starts": Rule((int,), 1, 64),
    "variables": Rule((dict,)), "objectives": Rule((dict,)), "limits": Rule((dict,)),
    "map": Rule((dict,)), "seeds": Rule((int,), 1, 1000),
}  # fmt: skip
DEFAULTS: dict[str, Any] = {
    "env": "JansenWalkerBuilt-v0", "env_kwargs": {}, "robot": "built", "profile": None,
    "policy": None, "method": "cma", "population": 32, "starts": 2,
    "limits": {}, "map": {}, "seeds": 1,
}  # fmt: skip
MOST_CELLS = 200  # of a map, each way


class Plan(NamedTuple):
    """A search; ``docs/design.md`` has what each entry means."""

    env: str
    env_kwargs: dict[str, Any]
    robot: str
    profile: str | None
    speed: float
    policy: str | None
    method: str
    generations: int
    population: int
    starts: int
    variables: dict[str, Any]
    objectives: dict[str, str]
    limits: dict[str, list[float | None]]
    map: dict[str, list[float]]
    seeds: int

    @property
    def measured(self) -> list[str]:
        """Names of all measures that the search needs."""
        return [*dict.fromkeys([*self.objectives, *self.map, *self.limits])]

    def space(self) -> Space:
        """Return the variables."""
        return Space(self.robot, self.speed, self.variables, self.profile)


def read_plan(path: str | Path) -> Plan:
    """Read a plan from a file, or one of the shipped ones by its name.

    Raises:
        ValueError: it cannot be read, or an entry is not allowed; names the file.
    """
    if not Path(path).exists() and not str(path).endswith((".yml", ".yaml")):
        shipped = [one.stem for one in sorted(PLANS.glob("*.yml"))]
        path = PLANS / f"{one_of('plan', str(path), shipped)}.yml"
    found = read_yaml(path)
    try:
        return make_plan(found)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def make_plan(found: Any) -> Plan:
    """Return the plan that a mapping describes. Raises ValueError: an entry is not allowed."""
    Rule((dict,)).check("plan", found)
    check_keys("", found, KEYS)
    found = {**DEFAULTS, **found}
    if missing := [name for name in KEYS if name not in found]:
        raise ValueError(f"the plan lacks {missing[0]!r}")
    plan = Plan(**found)
    plan = plan._replace(limits={k: v for k, v in plan.limits.items() if v is not None})
    check_env_kwargs(plan.env, plan.env_kwargs)
    for name in ("robot", "speed_command", "terrain"):
        if name in plan.env_kwargs:
            raise ValueError(f"env_kwargs has {name!r}, which the search sets")
    for name, way in plan.objectives.items():
        _check_measure("objectives", name)
        Rule(words=("min", "max")).check(f"objectives.{name}", way)
    for name, ends in plan.limits.items():
        _check_measure("limits", name)
        _check_ends(f"limits.{name}", ends)
    wanted = {"cma": (1, 1), "nsga2": (2, 3), "map_elites": (1, 1)}[plan.method]
    if not wanted[0] <= len(plan.objectives) <= wanted[1]:
        raise ValueError(
            f"objectives has {len(plan.objectives)} entries, {plan.method} must have "
            f"{' to '.join(map(str, dict.fromkeys(wanted)))}"
        )
    if len(plan.map) != (2 if plan.method == "map_elites" else 0):
        raise ValueError(f"map has {len(plan.map)} entries, must have 2 for map_elites, else 0")
    for name, cells in plan.map.items():
        _check_measure("map", name)
        _check_cells(f"map.{name}", cells)
    traced = [name for name in plan.measured if MEASURES[name].group == "loads"]
    if traced and plan.env_kwargs.get("plant", "projection") != "projection":
        raise ValueError(f"{traced[0]} is measured on the plant 'projection' alone")
    if plan.policy is not None and [*plan.variables] != ["lengths"]:
        raise ValueError(
            f"variables has {[*plan.variables]}, must have lengths alone beside a policy"
        )
    plan.space()
    return plan


def _check_measure(where: str, name: Any) -> None:
    if name not in MEASURES:
        raise ValueError(f"{where} has {shown(name)}, must be of {listed(MEASURES, name)}")


def _number(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value)


def _check_ends(name: str, ends: Any) -> None:
    """Check a pair of a least and a largest value, each of which may be null."""
    allowed = "[least, most], either of which may be null"
    if not isinstance(ends, list) or len(ends) != 2 or ends == [None, None]:
        raise ValueError(f"{name} is {shown(ends)}, must be {allowed}")
    given = [end for end in ends if end is not None]
    if not all(map(_number, given)) or given != sorted(given):
        raise ValueError(f"{name} is {shown(ends)}, must be {allowed}")


def _check_cells(name: str, cells: Any) -> None:
    fine = isinstance(cells, list) and len(cells) == 3 and all(map(_number, cells))
    if not fine or not cells[0] < cells[1] or cells[2] not in range(1, MOST_CELLS + 1):
        raise ValueError(
            f"{name} is {shown(cells)}, must be [lowest, highest, cells], 1 to {MOST_CELLS} cells"
        )
