"""Parameters and terrains of n robots' episodes: planned at a reset, put in force, and kept."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import shown
from jansen_env.gravity import GRAVITY
from jansen_env.parameters import (
    EPISODE,
    OF_ROBOTS,
    PARAMETERS,
    check,
    effective,
    nominal,
    robot_parameters,
)
from jansen_env.plants.base import BatchedPlant
from jansen_env.plants.initial_pose import resting_depth
from jansen_env.plants.robot_parameters import check_restitution
from jansen_env.robot import Compliance, Payload, Robot
from jansen_env.terrain import Terrain
from jansen_env.terrain.curriculum import Curriculum
from jansen_env.terrain.generators import Generator
from jansen_env.world.randomization import Distribution, Randomization, Uniform, UniformLevels

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Terrains(NamedTuple):
    """The ground of each robot.

    Attributes:
        terrains: fixed ones, and flat ones where they are drawn at each reset.
        generators: what draws them; None where they are fixed.
        own_friction, own_restitution: (n,) whether it was given, in place of the terrain's.
    """

    terrains: list[Terrain]
    generators: list[Generator | None]
    own_friction: NDArray[np.bool_]
    own_restitution: NDArray[np.bool_]


class Draws(NamedTuple):
    """Distributions of each robot's episodes.

    Attributes:
        levels: (n, 2) lowest and highest terrain level. randomizations: of each.
        curriculum: leads from level to level; None for a draw from ``levels``.
        by_default: of "terrain_level" and "randomize" those that were not asked for: what would
            do nothing of these is left out, not refused.
    """

    levels: Array
    randomizations: list[Randomization]
    curriculum: Curriculum | None
    by_default: Collection[str] = ()


class Plan(NamedTuple):
    """An episode to come."""

    values: NDArray[Any]  # (1,) of EPISODE
    terrain: Terrain | None  # None: the ground stays


class EpisodeParameters:
    """Parameters and terrains of the episodes of n robots.

    Args:
        plant: moves them. robots: of each, before randomisation. terrains, draws: of each.
        has: parameters of the world that do nothing unless there is what they are about, such as
            "noise_level", and whether there is.

    Attributes:
        values: (n,) :data:`jansen_env.parameters.EPISODE`, those of the present episodes.
        nominal: (n,) the same where nothing is drawn. level: (n,) of a curriculum.
        varies: whether anything is drawn.

    Raises:
        ValueError: a parameter is randomised that does nothing, is not honoured, or is more than
            the feet can carry; or levels of a ground without any.
    """

    def __init__(
        self,
        plant: BatchedPlant,
        robots: Sequence[Robot],
        terrains: Terrains,
        draws: Draws,
        has: Mapping[str, bool],
    ) -> None:
        n = len(robots)
        self._plant, self._generators = plant, list(terrains.generators)
        self._own = {"friction": terrains.own_friction, "restitution": terrains.own_restitution}
        self._randomizations, self.curriculum = list(draws.randomizations), draws.curriculum
        self.levels, self.level = draws.levels, draws.levels[:, 0].astype(np.int64)
        self._has, self._links_mass = dict(has), robots[0].links_mass  # of one design
        pairs = zip(robots, terrains.terrains, strict=True)
        self.nominal = np.array([nominal(*pair, EPISODE) for pair in pairs], EPISODE)
        self.values = self.nominal.copy()
        self._changed = np.zeros(n, bool)  # by a draw, from what the robot and its ground are
        self._check_draws(draws.by_default)
        drawn = any(one.distributions for one in self._randomizations)
        self.varies = bool(drawn or any(one is not None for one in self._generators))

    def _check_draws(self, by_default: Collection[str]) -> None:
        """Raises ValueError where something is drawn in vain; leaves it out where by default."""
        levels = self.levels
        has_levels = np.array([generator is not None for generator in self._generators])
        if "terrain_level" in by_default:
            levels[~has_levels] = 0.0
        for row in range(len(levels)):
            if "randomize" in by_default:
                self._randomizations[row] = self._randomizations[row].only(self._useful(row))
            self.check_names(row, [*self._randomizations[row].distributions], "randomize")
            self._check_feet(row, self._heaviest(row))
        if bad := np.flatnonzero(levels.any(axis=1) & ~has_levels).tolist():
            raise ValueError(
                f"terrain_level is {shown(levels[bad[0]].tolist())}, must be 0 on a ground that is "
                "not drawn and so has no levels"
            )
        if self.curriculum is not None and not has_levels.all():
            raise ValueError("curriculum is given, must be None on a ground that has no levels")

    @property
    def numbers(self) -> Array:
        """(n, parameters) :attr:`values` as plain numbers."""
        return self.values.view(float).reshape(len(self.values), -1)

    def ranges(self, row: int) -> dict[str, Distribution]:
        """Distributions of a robot's parameters, by name."""
        drawn = dict(self._randomizations[row].distributions)
        if self._generators[row] is not None:
            drawn.setdefault("terrain_level", UniformLevels(*self.levels[row].tolist()))
        return drawn

    def take(self, row: int, changes: Mapping[str, float]) -> None:
        """Let numbers that have been changed be a robot's nominal and present ones."""
        for name, value in changes.items():
            self.nominal[name][row] = self.values[name][row] = value
            if name in self._own:
                self._own[name][row] = True

    def checked_level(self, row: int, level: Any) -> int:
        """Return a terrain level of a robot. Raises ValueError: no such, or its ground has none."""
        self.check_names(row, ["terrain_level"], "set_parameters")
        return round(check("terrain_level", "terrain_level", level))

    def _useful(self, row: int) -> set[str]:
        """Return the names of the parameters that do something for a robot."""
        useful = {*effective(self._plant.robots[row])} & {*self._plant.honours}
        has = {**self._has, "delay": True, "terrain_level": self._generators[row] is not None}
        return useful | {name for name, present in has.items() if present}

    def check_names(self, row: int, names: Sequence[str], label: str) -> None:
        """Raises ValueError where a parameter would do nothing for a robot."""
        useful = self._useful(row)
        for name in names:
            if name not in useful:
                unknown = name in OF_ROBOTS and name not in self._plant.honours
                why = "this plant does not honour" if unknown else "does nothing here"
                raise ValueError(
                    f"{label} has {name!r}, which {why}, must be of "
                    f"{[one for one in PARAMETERS if one in useful]}"
                )

    def check_change(self, row: int, own: Compliance, changes: Mapping[str, Any]) -> None:
        """Check changes of a robot's or its ground's own numbers, of ``set_parameters``.

        Args:
            own: its pads. changes: by name, checked one by one.

        Raises:
            ValueError: its feet cannot bear what its episodes' numbers become, or a restitution
                in force or drawn excludes them.
        """
        pads = changes.get("pad_compliance", own)
        in_force = (of["restitution"][row] for of in (self._plant.parameters, self.nominal))
        restitution = changes.get("restitution", max(map(float, in_force)))
        if not pads.rigid and "restitution" in self._randomizations[row].distributions:
            raise ValueError(
                f"pad_compliance is {pads}, must be rigid, as randomize has 'restitution'"
            )
        check_restitution(np.array([not pads.rigid]), np.array([restitution]))
        numbers = {name: changes[name] for name in PARAMETERS if name in {*changes} - {"delay"}}
        if "payload" in changes:
            numbers["payload"] = changes["payload"].mass
        present = self.values[row].copy()
        for name, value in numbers.items():
            present[name] = value
        for values in (present, self._heaviest(row, numbers)):  # of this episode, and others
            self._check_feet(row, values, pads)

    def _check_feet(self, row: int, values: Any, pads: Compliance | None = None) -> None:
        """Raises ValueError where a robot's feet cannot bear a row of EPISODE; pads: others."""
        pads = pads or self._plant.robots[row].pad_compliance
        if pads.rigid:
            return
        check_restitution(np.array([True]), values["restitution"][None])
        mass = float(values["mass_scale"] * self._links_mass + values["payload"])
        stiffness = float(values["foot_stiffness_scale"]) * pads.stiffness
        resting_depth(mass, stiffness, GRAVITY * math.cos(values["tilt"]))

    def _heaviest(self, row: int, changes: Mapping[str, float] | None = None) -> Any:
        """The numbers of a robot's episodes that its feet can bear least, as far as is known."""
        values = self.nominal[row].copy()
        for name, value in (changes or {}).items():
            values[name] = value
        for name, drawn in self._randomizations[row].distributions.items():
            if isinstance(drawn, Uniform):
                low, high = drawn.low, drawn.high
                level = min(max(0.0, low), high)
                values[name] = {"foot_stiffness_scale": low, "tilt": level}.get(name, high)
        return values

    def plan(
        self, row: int, rng: np.random.Generator, options: Mapping[str, Any], delay: float,
        walked: float, command: float,
    ) -> Plan:  # fmt: skip
        """A robot's next episode; nothing changes yet but the generator's state.

        Args:
            options: of the reset, with numbers that are to be fixed. delay: s, as drawn.
            walked, command: how far it got towards its commands in its last one, m, and their mean
                size, m/s; 0 at first.

        Raises:
            ValueError: an option out of range or without effect, or no such ground.
        """
        randomization, generator = self._randomizations[row], self._generators[row]
        if not options and not self.varies and not self._changed[row]:
            values = self.nominal[row : row + 1].copy()
            values["delay"] = delay
            return Plan(values, None)
        values = self.nominal[row : row + 1].copy()
        one = values[0]
        one["delay"], one["terrain_level"] = delay, self._next_level(row, rng, walked, command)
        randomization.draw(rng, one)
        given = [name for name in PARAMETERS if name in options]
        self.check_names(row, given, "options")
        for name in given:
            one[name] = check(f"options[{name!r}]", name, options[name])
        terrain = None
        if generator is not None:
            terrain = generator(rng, round(float(one["terrain_level"])))
            for name, own in self._own.items():
                if not own[row] and name not in (*randomization.distributions, *given):
                    one[name] = getattr(terrain, name)
            if terrain.restitution != one["restitution"]:  # which compliant pads may exclude
                terrain = replace(terrain, restitution=float(one["restitution"]))
        self._check_feet(row, one)
        return Plan(values, terrain)

    def _next_level(
        self, row: int, rng: np.random.Generator, walked: float, command: float
    ) -> float:
        low, high = self.levels[row].tolist()
        if self.curriculum is not None:
            own = np.random.default_rng(rng.integers(2**63))  # so that what follows is the seed's
            commanded = command * self.curriculum.horizon
            return float(self.curriculum.next_level(int(self.level[row]), walked, commanded, own))
        return float(rng.integers(int(low), int(high), endpoint=True)) if high > low else low

    def begin(self, rows: Ints, plans: Sequence[Plan]) -> None:
        """Put planned episodes in force; the robots must be placed again.

        Raises:
            ValueError: feet too stiff for the time step of the plant ``"rigid_body"``; nothing has
                changed then.
        """
        before = [self._plant.terrains[row] for row in rows.tolist()]
        for row, plan in zip(rows.tolist(), plans, strict=True):
            if plan.terrain is not None:
                self._plant.set_terrain(row, plan.terrain)
        values = np.concatenate([plan.values for plan in plans])
        changed = np.array([plan.terrain is not None for plan in plans])
        changed |= robot_parameters(values) != robot_parameters(self.nominal[rows])
        due = changed | self._changed[rows]
        if due.any():
            try:
                self._plant.set_parameters(rows[due], robot_parameters(values[due]))
            except ValueError:
                for row, plan, terrain in zip(rows.tolist(), plans, before, strict=True):
                    if plan.terrain is not None:
                        self._plant.set_terrain(row, terrain)
                self._plant.set_parameters(rows, robot_parameters(self.values[rows]))
                raise
        self.values[rows], self._changed[rows] = values, changed
        if self.curriculum is not None:
            self.level[rows] = values["terrain_level"].astype(np.int64)

    def shown_robot(self, row: int, robot: Robot) -> Robot:
        """A robot with the payload that it has in this episode, for pictures."""
        load = self.values[row]
        place = float(load["payload_x"]), float(load["payload_y"])
        if (load["payload"], *place) == (robot.payload.mass, *robot.payload.position):
            return robot
        return replace(robot, payload=Payload(float(load["payload"]), position=place))

    def state(self, row: int) -> dict[str, Any]:
        """Parameters and terrain of a robot's episode, in plain numbers."""
        state: dict[str, Any] = {
            "parameters": dict(zip(PARAMETERS, self.values[row].item(), strict=True)),
            "level": int(self.level[row]),
        }
        if self._generators[row] is not None:
            terrain = self._plant.terrains[row]
            state["terrain"] = np.array(terrain.points)
            state["ground"] = (terrain.friction, terrain.restitution)
        return state

    def planned(self, row: int, state: Mapping[str, Any]) -> tuple[Plan, int]:
        """The episode of a :meth:`state`, and the curriculum's level.

        Raises:
            ValueError: it is not complete, or out of range.
        """
        given = state["parameters"]
        if not isinstance(given, Mapping) or {*given} != {*PARAMETERS}:
            raise ValueError(f"state['parameters'] is {shown(given)}, must have {[*PARAMETERS]}")
        values = np.zeros(1, EPISODE)
        for name in PARAMETERS:
            values[name] = check(f"state['parameters'][{name!r}]", name, given[name])
        self._check_feet(row, values[0])
        level = check("state['level']", "terrain_level", state["level"])
        terrain = None
        if self._generators[row] is not None:
            friction, restitution = state["ground"]
            terrain = Terrain(tuple(map(tuple, state["terrain"])), friction, restitution)
        return Plan(values, terrain), int(level)
