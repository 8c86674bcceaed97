"""Terrains that are drawn at each reset, by name, parameters and level: 0 easy to 9 hard, and a
curriculum of levels.

``"stairs"`` has all its parameters from the level, ``"stairs:rise=0.02"`` its tread alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np

from jansen_env import checks
from jansen_env.engine.ground_lines import (
    KINDS,
    REACH,
    START,
    choose_direction,
    draw_start,
    has_start,
)
from jansen_env.terrain.ground import TALLEST, Terrain, check_room, profile

Random: TypeAlias = np.random.Generator
Generator: TypeAlias = Callable[[Random, int], Terrain]

HIGHEST = 9  # of the levels, from 0

LEVELS: dict[str, dict[str, tuple[float, float]]] = {
    "slope": {"angle": (0.01, 0.28)},
    "rough": {"height": (0.02, 0.2), "spacing": (0.2, 0.2)},
    "waves": {"height": (0.015, 0.24), "length": (1.0, 1.0)},
    "stairs": {"rise": (0.01, 0.1), "tread": (0.4, 0.4)},
    "steps": {"height": (0.035, 0.35), "spacing": (0.4, 0.4)},
    "stumps": {"height": (0.02, 0.11), "width": (0.2, 0.2), "spacing": (1.0, 1.0)},
    "ramps": {"angle": (0.045, 0.36), "length": (0.8, 0.8)},
}
"""Parameters of each generator at level 0 and level 9, evenly spaced between; m and rad."""
if (*LEVELS,) != KINDS:
    raise TypeError(
        "LEVELS must name the same terrains as KINDS in jansen_env/engine/ground_lines.py, in the "
        f"same order, {[*KINDS]}, got {[*LEVELS]}"
    )
MIXTURE = ("slope", "rough", "waves", "stairs", "steps", "stumps", "ramps")
"""Kinds of terrain that ``"mixed"``, the terrain of the benchmarks, chooses from at a reset.

A terrain added to :data:`LEVELS` stays out of it: it would change what every seed of
``JansenWalkerRough-v0`` and ``JansenWalkerHardcore-v0`` means.
"""
GENERATORS = (*LEVELS, "mixed")
"""Their names."""


def at_level(name: str, level: int) -> dict[str, float]:
    """A generator's parameters at a level, by name. Raises ValueError: no such name or level."""
    checks.one_of("generator", name, GENERATORS)
    share = checks.whole_number("level", level, HIGHEST) / HIGHEST
    return {key: low + share * (high - low) for key, (low, high) in LEVELS.get(name, {}).items()}


@dataclass(frozen=True)
class NamedGenerator:
    """A ground of one kind, or of any for "mixed", drawn at each call: ``(rng, level) -> Terrain``.

    Slopes and stairs go up or down at random unless that is given. With default friction and
    restitution.

    Args:
        name: one of :data:`GENERATORS`.
        given: (parameter, value) that do not change with the level.

    Raises:
        ValueError: no such name or parameter, or no such ground with these values.
    """

    name: str
    given: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        known = list(at_level(self.name, 0))
        for key, value in self.given:
            if key not in known:
                raise ValueError(f"a parameter of {self.name!r} must be in {known}, got {key!r}")
            checks.finite(f"{key} of {self.name!r}", value)
        object.__setattr__(self, "given", tuple((key, float(v)) for key, v in self.given))
        for level in (0, HIGHEST):  # or a reset would be refused
            with checks.named_errors(f"{str(self)!r} makes no ground at level {level}"):
                self._check(level)

    def __call__(self, rng: Random, level: int) -> Terrain:
        """A ground. Raises ValueError: no such level."""
        name = self.name
        if name == "mixed":
            name = MIXTURE[rng.integers(len(MIXTURE))]
        kind, given = KINDS.index(name), dict(self.given)
        named = at_level(name, level) | given
        values, fixed = np.array([*named.values()]), np.array([name in given for name in named])
        # Sample the direction in any case: a fixed one must not change the other samples.
        choose_direction(kind, rng.random(), fixed, values)
        start = draw_start(kind, rng.random() if has_start(kind) else 0.0)
        return Terrain(profile(name, values, start, REACH, rng))

    def _check(self, level: int) -> None:
        """Check the parameters at a level.

        Raises:
            ValueError: If there is no ground with these parameters.
        """
        values = at_level(self.name, level) | dict(self.given)
        if self.name == "rough":
            checks.within("height", values["height"], -TALLEST, TALLEST)
            check_room(START, REACH, checks.positive("spacing", values["spacing"]))
        elif self.name != "mixed":
            random = [np.random.default_rng(0)] if self.name == "steps" else []
            make: Callable[..., Terrain] = getattr(Terrain, self.name)
            make(*random, **values)
        self(np.random.default_rng(0), level)

    def __str__(self) -> str:
        """Specification as text: ``"stairs:rise=0.02"``."""
        given = ",".join(f"{key}={value:g}" for key, value in self.given)
        return f"{self.name}:{given}" if given else self.name


def make_generator(spec: object) -> Generator | None:
    """Return a generator ``(rng, level) -> Terrain``, or None for a fixed ground.

    Args:
        spec: a name of :data:`GENERATORS`, alone or with parameters that are to stay as they are,
            ``"stairs:rise=0.02,tread=0.3"``, or a callable ``(rng, level) -> Terrain``; else fixed:
            a :class:`Terrain`, ``"flat"``, ``"slope:0.1"`` or points.

    Raises:
        ValueError: a text that is neither, with what is allowed.
    """
    if not isinstance(spec, str):
        return spec if callable(spec) and not isinstance(spec, type) else None
    name, colon, text = spec.partition(":")
    if name == "flat" or (name == "slope" and colon and "=" not in text):
        return None  # make_terrain's
    if name not in GENERATORS:
        drawn = "with parameters as in 'stairs:rise=0.02,tread=0.3' or without, one of"
        allowed = f"'flat', 'slope:ANGLE' or, {drawn} {checks.listed(GENERATORS, name)}"
        raise checks.invalid("terrain", spec, allowed)
    return NamedGenerator(name, _parameters(spec, name, text) if colon else ())


def _parameters(spec: str, name: str, text: str) -> tuple[tuple[str, float], ...]:
    given: dict[str, float] = {}
    for part in text.split(","):
        key, _, number = part.partition("=")
        try:
            given[key.strip()] = float(number)
        except ValueError:
            allowed = f"must be NAME=NUMBER, with a name of {list(LEVELS.get(name, {}))}"
            wrong = f"{checks.shown(spec)}: {checks.shown(part)}"
            raise ValueError(f"terrain is {wrong} {allowed}") from None
    return tuple(given.items())


@dataclass(frozen=True)
class Curriculum:
    """Up after a long walk, down after a short one, and past the top to any level.

    Rudin, Hoeller, Reist and Hutter, "Learning to Walk in Minutes Using Massively Parallel Deep
    Reinforcement Learning", CoRL 2021 (2022), section 2.2; ``_update_terrain_curriculum`` of
    legged_gym. Levels drawn at the top keep the easy ones from being forgotten.

    Args:
        up: goes up beyond this share of the commanded distance. down: goes down below this one.
        highest: level; beyond it, any from 0 to it.
        horizon: s, that an episode is planned to last: the commanded distance is the mean size of
            its commands times this, so that falling early is no success.

    Raises:
        ValueError: an argument out of range, or ``down`` above ``up``.
    """

    up: float = 0.5
    down: float = 0.25
    highest: int = HIGHEST
    horizon: float = 10.0

    def __post_init__(self) -> None:
        checks.set_checked(self, partial(checks.within, low=0.0, high=1.0), "up", "down")
        checks.set_checked(self, partial(checks.whole_number, most=HIGHEST), "highest")
        checks.set_checked(self, checks.positive, "horizon")
        if self.down > self.up:
            raise ValueError(f"down must be at most up ({self.up}), got {self.down}")

    def next_level(
        self, level: int, walked: float, commanded: float, rng: np.random.Generator
    ) -> int:
        """The level of the next episode. Raises ValueError: an argument out of range.

        Args:
            level: of this one. walked: m, towards the command. commanded: m, see ``horizon``; after
                0 m the level stays. rng: draws the level beyond the highest.
        """
        level = checks.whole_number("level", level, HIGHEST)
        walked = checks.finite("walked", walked)
        commanded = checks.non_negative("commanded", commanded)
        if commanded > 0.0:
            level += (walked > self.up * commanded) - (walked < self.down * commanded)
        if level > self.highest:
            return int(rng.integers(self.highest + 1))
        return max(level, 0)
