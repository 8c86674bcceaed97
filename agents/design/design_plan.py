"""Plan of a search, read from YAML and validated completely before the search begins."""

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from types import NoneType

from agents.design.measures import GROUPS, MEASURES
from agents.design.variables import Space
from jansen_env.checks import named_errors, one_of, shown
from jansen_env.files.plain_yaml import Rule, check_keys, read_yaml
from jansen_env.scoring.benchmarks import WALKERS, check_env_kwargs
from jansen_env.scoring.rollout import EnvKwargs

PLANS = Path(__file__).parent / "plans"
OBJECTIVES = {"cma": (1,), "nsga2": (2, 3)}
"""Numbers of objectives that each search method accepts."""
KEYS: dict[str, Rule] = {
    "env": Rule(words=tuple(WALKERS)), "env_kwargs": Rule((dict,)), "robot": Rule((str,)),
    "profile": Rule((str, NoneType)), "speed": Rule((float,), 0.01, 2.0),
    "method": Rule(words=tuple(OBJECTIVES)), "generations": Rule((int,), 1, 100_000),
    "population": Rule((int,), 4, 4096), "starts": Rule((int,), 1, 64),
    "variables": Rule((dict,)), "objectives": Rule((dict,)), "limits": Rule((dict,)),
    "seeds": Rule((int,), 1, 1000),
}  # fmt: skip


@dataclass(frozen=True)
class SearchPlan:
    """Settings of a search; ``docs/design.md`` explains every entry.

    Attributes:
        speed: Commanded speed, in m/s.
        generations: Number of generations.
        variables: What the search varies; see :class:`agents.design.variables.Space`.
        objectives: ``"min"`` or ``"max"`` by the name of the measure to optimise.
        env: Id of the environment on which candidates walk.
        env_kwargs: Arguments of the environment, without those that the search sets.
        robot: Name or file of the design that the search starts from.
        profile: File of a crank-speed profile to start from. None selects the tuned profile of the
            robot's design.
        method: ``"cma"`` for one objective, or ``"nsga2"`` for two or three.
        population: Number of candidates per generation.
        starts: Number of crank angles from which each candidate walks.
        limits: Lowest and highest allowed value by the name of the measure. None means that this
            side has no limit.
        seeds: Number of searches, with seeds from 0.

    Raises:
        ValueError: If an entry is not allowed.
    """

    speed: float
    generations: int
    variables: dict[str, object]
    objectives: dict[str, str]
    env: str = "JansenWalkerBuilt-v0"
    env_kwargs: EnvKwargs = field(default_factory=dict)
    robot: str = "built"
    profile: str | None = None
    method: str = "cma"
    population: int = 32
    starts: int = 2
    limits: dict[str, list[float | None]] = field(default_factory=dict)
    seeds: int = 1

    def __post_init__(self) -> None:
        check_keys("", vars(self), KEYS)
        limits = {name: ends for name, ends in self.limits.items() if ends is not None}
        object.__setattr__(self, "limits", limits)
        check_env_kwargs(self.env, self.env_kwargs)
        for name in ("robot", "speed_command", "terrain"):
            if name in self.env_kwargs:
                raise ValueError(f"env_kwargs must not contain {name!r}, which the search sets")
        ways = dict.fromkeys(MEASURES, Rule(words=("min", "max")))
        check_keys("objectives", {**self.objectives}, ways)
        for name, ends in self.limits.items():
            _check_ends(f"limits.{one_of('limits', name, MEASURES)}", ends)
        if len(self.objectives) not in OBJECTIVES[self.method]:
            wanted = " to ".join(map(str, OBJECTIVES[self.method]))
            raise ValueError(
                f"objectives must have {wanted} entries with {self.method}, "
                f"got {len(self.objectives)}"
            )
        traced = [name for name in self.measured if name in GROUPS["loads"]]
        if traced and self.env_kwargs.get("plant", "projection") != "projection":
            plant = self.env_kwargs["plant"]
            raise ValueError(
                f"plant must be 'projection' to measure {traced[0]}, got {shown(plant)}"
            )
        self.space()

    @property
    def measured(self) -> list[str]:
        """Names of all measures that the objectives and limits use."""
        return [*dict.fromkeys([*self.objectives, *self.limits])]

    def space(self) -> Space:
        """Return the search space."""
        return Space(self.robot, self.speed, self.variables, self.profile)


def read_plan(path: str | Path) -> SearchPlan:
    """Read a plan from a file, or a plan that comes with the package by its name.

    Args:
        path: YAML file, or the name of a plan in :data:`PLANS`.

    Raises:
        ValueError: If the plan cannot be read or an entry is not allowed. The message names the
            file.
    """
    if not Path(path).exists() and not str(path).endswith((".yml", ".yaml")):
        shipped = [file.stem for file in sorted(PLANS.glob("*.yml"))]
        path = PLANS / f"{one_of('plan', str(path), shipped)}.yml"
    content = read_yaml(path)
    with named_errors(path):
        return make_plan(content)


def make_plan(content: Mapping[str, object]) -> SearchPlan:
    """Return the plan that a mapping describes.

    Args:
        content: Entries of the plan by name.

    Raises:
        ValueError: If an entry is missing, unknown or not allowed.
    """
    Rule((dict,)).check("plan", content)
    check_keys("", dict(content), KEYS)
    needed = [f.name for f in fields(SearchPlan) if MISSING is f.default is f.default_factory]
    if missing := [name for name in needed if name not in content]:
        raise ValueError(f"a plan must have the entry {missing[0]!r}, got none")
    return SearchPlan(**content)  # type: ignore[arg-type] # checked by KEYS


def _check_ends(name: str, ends: object) -> None:
    """Check that a limit is a pair of a lowest and a highest value, at most one of them null."""
    if isinstance(ends, list) and len(ends) == 2 and ends != [None, None]:
        bounds = [end for end in ends if end is not None]
        numbers = all(type(end) in (int, float) and math.isfinite(end) for end in bounds)
        if numbers and bounds == sorted(bounds):
            return
    allowed = "[least, most], either of which may be null"
    raise ValueError(f"{name} must be {allowed}, got {shown(ends)}")
