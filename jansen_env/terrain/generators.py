"""Generators of random terrains, which are sampled at each reset, and a curriculum of levels.

A generator is described by its name, its parameters and a level from 0 (easy) to 9 (hard). The
level determines all parameters of ``"stairs"``. For ``"stairs:rise=0.02"`` it determines only the
tread.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np
from typing_extensions import override

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

HIGHEST = 9  # highest level; the lowest is 0

LEVELS: dict[str, dict[str, tuple[float, float]]] = {
    "slope": {"angle": (0.01, 0.28)},
    "rough": {"height": (0.02, 0.2), "spacing": (0.2, 0.2)},
    "waves": {"height": (0.015, 0.24), "length": (1.0, 1.0)},
    "stairs": {"rise": (0.01, 0.1), "tread": (0.4, 0.4)},
    "steps": {"height": (0.035, 0.35), "spacing": (0.4, 0.4)},
    "stumps": {"height": (0.02, 0.11), "width": (0.2, 0.2), "spacing": (1.0, 1.0)},
    "ramps": {"angle": (0.045, 0.36), "length": (0.8, 0.8)},
}
"""Parameters of each generator at level 0 and level 9, in m and rad.

The parameters of the levels in between are evenly spaced.
"""
if (*LEVELS,) != KINDS:
    raise TypeError(
        "LEVELS must name the same terrains as KINDS in jansen_env/engine/ground_lines.py, in the "
        f"same order, {[*KINDS]}, got {[*LEVELS]}"
    )
MIXTURE = ("slope", "rough", "waves", "stairs", "steps", "stumps", "ramps")
"""Kinds of terrain from which ``"mixed"``, the terrain of the benchmarks, chooses at a reset.

Do not add new kinds of :data:`LEVELS` to this tuple. They would change the terrain of every seed of
``JansenWalkerRough-v0`` and ``JansenWalkerHardcore-v0``.
"""
GENERATORS = (*LEVELS, "mixed")
"""Names of all generators."""


def at_level(name: str, level: int) -> dict[str, float]:
    """Return the parameters of a generator at a level, by name.

    Args:
        name: Name of the generator, one of :data:`GENERATORS`.
        level: Level from 0 to 9.

    Raises:
        ValueError: If there is no such generator or level.
    """
    checks.one_of("generator", name, GENERATORS)
    share = checks.whole_number("level", level, HIGHEST) / HIGHEST
    return {key: low + share * (high - low) for key, (low, high) in LEVELS.get(name, {}).items()}


@dataclass(frozen=True)
class NamedGenerator:
    """A callable ``(rng, level) -> Terrain`` that samples a terrain of one kind at each call.

    For the name "mixed", each call also samples the kind of the terrain. Slopes and stairs go up or
    down at random, unless the user specifies the parameter that determines the direction. Friction
    and restitution have their default values.

    Args:
        name: Name of the generator, one of :data:`GENERATORS`.
        given: User-specified parameters as pairs (name, value). They do not change with the level.

    Raises:
        ValueError: If there is no such generator or parameter, or no terrain with these values.
    """

    name: str
    given: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        known = list(at_level(self.name, 0))
        for key, value in self.given:
            if not known:
                raise ValueError(
                    f"{self.name!r} must have no parameters, got {key!r}; choose a single kind to "
                    "set its parameters, such as 'stairs:rise=0.12'"
                )
            if key not in known:
                allowed = f"one of {known}"
                raise checks.invalid(f"a parameter of {self.name!r}", key, allowed)
            checks.finite(f"{key} of {self.name!r}", value)
        object.__setattr__(self, "given", tuple((key, float(v)) for key, v in self.given))
        for level in (0, HIGHEST):  # otherwise a reset could fail later
            with checks.named_errors(f"{str(self)!r} makes no ground at level {level}"):
                self._check(level)

    def __call__(self, rng: Random, level: int) -> Terrain:
        """Return a random terrain.

        Args:
            rng: Random number generator.
            level: Level from 0 to 9.

        Raises:
            ValueError: If there is no such level.
        """
        name = self.name
        if name == "mixed":
            name = MIXTURE[rng.integers(len(MIXTURE))]
        kind = KINDS.index(name)
        given = dict(self.given)
        named = at_level(name, level) | given
        values = np.array([*named.values()])
        fixed = np.array([name in given for name in named])
        # Sample a direction even if the user has specified it, so that the other samples stay the
        # same.
        choose_direction(kind, rng.random(), fixed, values)
        start = draw_start(kind, rng.random() if has_start(kind) else 0.0)
        return Terrain(profile(name, values, start, REACH, rng))

    def _check(self, level: int) -> None:
        """Check the parameters at a level.

        Raises:
            ValueError: If there is no terrain with these parameters.
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

    @override
    def __str__(self) -> str:
        """Return the specification as text, such as ``"stairs:rise=0.02"``."""
        given = ",".join(f"{key}={value:g}" for key, value in self.given)
        return f"{self.name}:{given}" if given else self.name


def make_generator(spec: object) -> Generator | None:
    """Return a generator ``(rng, level) -> Terrain``, or None if the terrain is fixed.

    Args:
        spec: For a generator, a name in :data:`GENERATORS`, alone or with user-specified parameters
            (``"stairs:rise=0.02,tread=0.3"``), or a callable ``(rng, level) -> Terrain``. For a
            fixed terrain, a :class:`Terrain`, ``"flat"``, ``"slope:0.1"`` or points.

    Raises:
        ValueError: If ``spec`` is a text that describes neither a generator nor a fixed terrain.
            The message lists the allowed values.
    """
    if not isinstance(spec, str):
        return spec if callable(spec) and not isinstance(spec, type) else None
    name, colon, text = spec.partition(":")
    if name == "flat" or (name == "slope" and colon and "=" not in text):
        return None  # make_terrain makes this terrain
    if name not in GENERATORS:
        known = checks.listed(GENERATORS, name)
        example = "'stairs:rise=0.02,tread=0.3'"
        allowed = f"'flat', 'slope:ANGLE', a name with parameters such as {example}, or one of"
        raise checks.invalid("terrain", spec, f"{allowed} {known}")
    return NamedGenerator(name, _parameters(spec, name, text) if colon else ())


def _parameters(spec: str, name: str, text: str) -> tuple[tuple[str, float], ...]:
    """Return the parameters in a text such as ``"rise=0.02,tread=0.3"``.

    Args:
        spec: Complete specification of the terrain, for error messages.
        name: Name of the generator, for error messages.
        text: The parameters.

    Raises:
        ValueError: If a parameter does not have the form NAME=NUMBER.
    """
    given: dict[str, float] = {}
    for part in text.split(","):
        key, _, number = part.partition("=")
        try:
            given[key.strip()] = float(number)
        except ValueError:
            allowed = f"NAME=NUMBER, with a name of {list(LEVELS.get(name, {}))}"
            source = f"a parameter of terrain {checks.shown(spec)}"
            raise checks.invalid(source, part, allowed) from None
    return tuple(given.items())


@dataclass(frozen=True)
class Curriculum:
    """A curriculum of terrain levels.

    The level rises after an episode in which the robot walks far, and falls after an episode in
    which it does not. When the level would rise beyond the highest one, the next level is sampled
    from all levels. This keeps a policy from forgetting the easy levels.

    Source: Rudin, Hoeller, Reist and Hutter, "Learning to Walk in Minutes Using Massively Parallel
    Deep Reinforcement Learning", CoRL 2021 (2022), section 2.2, and
    ``_update_terrain_curriculum`` of legged_gym.

    Args:
        up: Fraction of the commanded distance above which the level rises.
        down: Fraction of the commanded distance below which the level falls.
        highest: Highest level. Beyond it, a level from 0 to ``highest`` is sampled.
        horizon: Planned duration of an episode, in s. The commanded distance is the mean magnitude
            of the episode's commands times ``horizon``, so that an early fall does not count as a
            success.

    Raises:
        ValueError: If an argument is out of range, or ``down`` is larger than ``up``.
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
        """Return the level of the next episode.

        Args:
            level: Level of the present episode.
            walked: Distance walked in the commanded direction, in m.
            commanded: Commanded distance, in m; see ``horizon``. If it is 0, the level does not
                change.
            rng: Random number generator that samples a level beyond the highest one.

        Raises:
            ValueError: If an argument is out of range.
        """
        level = checks.whole_number("level", level, HIGHEST)
        walked = checks.finite("walked", walked)
        commanded = checks.non_negative("commanded", commanded)
        if commanded > 0.0:
            level += (walked > self.up * commanded) - (walked < self.down * commanded)
        if level > self.highest:
            return int(rng.integers(self.highest + 1))
        return max(level, 0)
