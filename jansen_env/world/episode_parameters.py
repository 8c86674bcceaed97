"""Parameters and terrains of n robots' episodes: planned at a reset, applied, and kept."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env import parameters
from jansen_env.checks import shown
from jansen_env.engine import mathematics
from jansen_env.gravity import GRAVITY
from jansen_env.parameters import (
    EPISODE,
    OF_ROBOTS,
    OF_ROBOTS_COLUMNS,
    PARAMETERS,
    check,
    plain,
    robot_parameters,
)
from jansen_env.plants.initial_pose import resting_depth
from jansen_env.plants.plant import BatchedPlant
from jansen_env.plants.robot_parameters import check_restitution
from jansen_env.robot import Compliance, Payload, Robot
from jansen_env.terrain import Terrain
from jansen_env.terrain.generators import Generator
from jansen_env.world.argument_checks import Filled
from jansen_env.world.episode_lengths import Build
from jansen_env.world.randomization import Randomization, Uniform

Ints = NDArray[np.int64]


class Plan(NamedTuple):
    """An episode to come: parameters (1,) of EPISODE; terrain, None where it stays."""

    values: NDArray[Any]
    terrain: Terrain | None


class EpisodeParameters:
    """Parameters and terrains of the episodes of n robots.

    Args:
        plant: moves them. robots: of each, before randomisation. ground: the record, filled.
        generators: of each robot's terrains, None where they are fixed. randomizations: of each.
        has: parameters such as "noise_level", and whether the world has what they are about.
        by_default: arguments that are left out, not refused, where they would do nothing.

    Attributes:
        values: (n,) :data:`jansen_env.parameters.EPISODE`, those of the present episodes.
        nominal: (n,) the same where nothing is drawn. level: (n,) of a curriculum.
        levels: (n, 2) lowest and highest. varies: whether anything is drawn.

    Raises:
        ValueError: a parameter is randomised in vain, or beyond what the feet can carry; or a
            ground without levels has some.
    """

    def __init__(
        self,
        plant: BatchedPlant,
        robots: Sequence[Robot],
        ground: Filled,
        generators: Sequence[Generator | None],
        randomizations: Sequence[Randomization],
        has: Mapping[str, bool],
        by_default: Collection[str] = (),
    ) -> None:
        self._plant, self._generators, self.curriculum = plant, generators, ground.curriculum
        given = {"friction": ground.friction, "restitution": ground.restitution}
        self._own = {k: np.array([one is not None for one in v]) for k, v in given.items()}
        self._given, self.levels = list(randomizations), ground.terrain_level
        self._by_default = "randomize" in by_default
        self._has = dict(has)
        pairs = zip(robots, plant.terrains, strict=True)
        self.nominal = np.array([parameters.nominal(*pair, EPISODE) for pair in pairs], EPISODE)
        self.values = self.nominal.copy()
        self._changed = np.zeros(len(robots), bool)  # by a draw, from the nominal parameters
        self._check_draws(by_default)
        self.level = self.levels[:, 0].astype(np.int64)
        self.varies = any(self.randomizations) or any(one is not None for one in generators)

    def _check_draws(self, by_default: Collection[str]) -> None:
        """Raises ValueError where something is drawn in vain; leaves it out where by default."""
        levels = self.levels
        has_levels = np.array([generator is not None for generator in self._generators])
        if "terrain_level" in by_default:
            levels[~has_levels] = 0.0
        self.randomizations = [self._draws(*each) for each in enumerate(self._plant.robots)]
        for row, robot in enumerate(self._plant.robots):
            self._check_feet(robot, _heaviest(self.nominal[row], self.randomizations[row]))
        if bad := np.flatnonzero(levels.any(axis=1) & ~has_levels).tolist():
            low, high = levels[bad[0]].astype(int).tolist()
            given = low if low == high else (low, high)
            raise ValueError(
                f"terrain_level is {given}, must be 0 on a ground that is not drawn and so has no "
                "levels"
            )
        if self.curriculum is not None and not has_levels.all():
            raise ValueError("curriculum is given, must be None on a ground that has no levels")

    def take(self, row: int, changes: Mapping[str, float]) -> None:
        """Set a robot's nominal and present numbers."""
        for name, value in changes.items():
            self.nominal[name][row] = self.values[name][row] = value
            if name in self._own:
                self._own[name][row] = True

    def _draws(self, row: int, robot: Robot) -> Randomization:
        """Return what is randomised of a robot; ValueError: a parameter that would do nothing."""
        given = self._given[row]
        if self._by_default:
            useful = self._useful(row, robot)
            return {name: one for name, one in given.items() if name in useful}
        self.check_names(row, [*given], "randomize", robot)
        return given

    def take_robot(self, row: int, robot: Robot) -> None:
        """Take the payload and the draws of a robot that comes in place of another."""
        parameters.take_load(self.nominal[row], robot)
        self.randomizations[row] = self._draws(row, robot)

    def checked_level(self, row: int, level: Any) -> int:
        """Return a terrain level of a robot; ValueError: out of range, or its ground has none."""
        self.check_names(row, ["terrain_level"], "set_parameters")
        return round(check("terrain_level", "terrain_level", level))

    def _useful(self, row: int, robot: Robot) -> set[str]:
        useful = {*parameters.effective(robot)} & {*self._plant.honours}
        has = {**self._has, "delay": True, "terrain_level": self._generators[row] is not None}
        return useful | {name for name, present in has.items() if present}

    def check_names(
        self, row: int, names: Sequence[str], label: str, robot: Robot | None = None
    ) -> None:
        """Raises ValueError where a parameter would do nothing for a robot, or another one."""
        useful = self._useful(row, robot or self._plant.robots[row]) if names else ()
        for name in names:
            if name not in useful:
                unknown = name in OF_ROBOTS and name not in self._plant.honours
                why = "this plant does not honour" if unknown else "does nothing here"
                raise ValueError(
                    f"{label} has {name!r}, which {why}, must be of "
                    f"{[one for one in PARAMETERS if one in useful]}"
                )

    def check_change(self, row: int, pads: Compliance, numbers: Mapping[str, float]) -> None:
        """Raise ValueError where a robot with ``pads`` cannot have these numbers from now on."""
        in_force = (of["restitution"][row] for of in (self._plant.parameters, self.nominal))
        restitution = numbers.get("restitution", max(map(float, in_force)))
        if not pads.rigid and "restitution" in self.randomizations[row]:
            raise ValueError(
                f"pad_compliance is {pads}, must be rigid, as randomize has 'restitution'"
            )
        check_restitution(np.array([not pads.rigid]), np.array([restitution]))
        present = self.values[row].copy()
        for name, value in numbers.items():
            present[name] = value
        heaviest = _heaviest(self.nominal[row], self.randomizations[row], numbers)
        for values in (present, heaviest):  # of this episode, and others
            self._check_feet(replace(self._plant.robots[row], pad_compliance=pads), values)

    def _check_feet(self, robot: Robot, values: Any) -> None:
        """Raises ValueError where a robot's feet cannot bear a row of EPISODE."""
        pads = robot.pad_compliance
        if pads.rigid:
            return
        check_restitution(np.array([True]), values["restitution"][None])
        mass = float(values["mass_scale"] * robot.links_mass + values["payload"])
        stiffness = float(values["foot_stiffness_scale"]) * pads.stiffness
        resting_depth(mass, stiffness, GRAVITY * mathematics.cos(values["tilt"]))

    def plan(
        self, row: int, rng: np.random.Generator, options: Mapping[str, Any], delay: float,
        walked: float, command: float, build: Build | None = None,
    ) -> Plan:  # fmt: skip
        """Return a robot's next episode; nothing changes yet but the generator's state.

        Args:
            options: of the reset, with numbers that are to be fixed. delay: s, as drawn.
            walked, command: progress in its last episode, m, and mean command, m/s; 0 at first.
            build: that comes in its place; None for none.

        Raises:
            ValueError: an option out of range or without effect, or no such ground.
        """
        randomization, generator = self.randomizations[row], self._generators[row]
        values = plain(self.nominal)[row].copy().view(EPISODE)
        one = values[0]
        robot = None if build is None else build.robot
        if robot is not None:
            parameters.take_load(one, robot)
            randomization = self._draws(row, robot)
            self._check_feet(robot, _heaviest(one, randomization))
        one["delay"] = delay
        if not options and not self.varies and not self._changed[row]:
            return Plan(values, None)
        one["terrain_level"] = self._next_level(row, rng, walked, command)
        for name, distribution in randomization.items():
            label = f"a sample of randomize[{name!r}]"
            one[name] = check(label, name, distribution.sample(rng))
        given = [name for name in PARAMETERS if name in options]
        self.check_names(row, given, "options", robot)
        for name in given:
            one[name] = check(f"options[{name!r}]", name, options[name])
        terrain = None
        if generator is not None:
            terrain = generator(rng, round(float(one["terrain_level"])))
            for name, own in self._own.items():
                if not own[row] and name not in (*randomization, *given):
                    one[name] = getattr(terrain, name)
            if terrain.restitution != one["restitution"]:  # which compliant pads may exclude
                terrain = replace(terrain, restitution=float(one["restitution"]))
        self._check_feet(robot or self._plant.robots[row], one)
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
        """Apply planned episodes; the robots must be placed again.

        Raises:
            ValueError: feet too stiff for ``"rigid_body"``'s time step; nothing has changed then.
        """
        drawn = {row: plan.terrain for row, plan in zip(rows.tolist(), plans, strict=True)}
        grounds = {row: terrain for row, terrain in drawn.items() if terrain is not None}
        before = {row: self._plant.terrains[row] for row in grounds}
        for row, terrain in grounds.items():
            self._plant.set_terrain(row, terrain)
        numbers = np.concatenate([plain(plan.values) for plan in plans])
        values = numbers.view(EPISODE)[:, 0]
        other = numbers != plain(self.nominal)[rows]
        changed = np.array([plan.terrain is not None for plan in plans])
        changed |= other[:, OF_ROBOTS_COLUMNS].any(axis=1)
        due = changed | self._changed[rows]
        if due.any():
            try:
                self._plant.set_parameters(rows[due], robot_parameters(values[due]))
            except ValueError:
                for row, terrain in before.items():
                    self._plant.set_terrain(row, terrain)
                self._plant.set_parameters(rows, robot_parameters(self.values[rows]))
                raise
        plain(self.values)[rows], self._changed[rows] = numbers, changed
        if self.curriculum is not None:
            self.level[rows] = values["terrain_level"].astype(np.int64)

    def shown_robot(self, row: int, robot: Robot) -> Robot:
        """Return a robot with the payload that it has in this episode, for pictures."""
        mass, *place = (float(self.values[row][f"payload{end}"]) for end in ("", "_x", "_y"))
        if (mass, *place) == (robot.payload.mass, *robot.payload.position):
            return robot
        return replace(robot, payload=Payload(mass, position=(place[0], place[1])))

    def state(self, row: int) -> dict[str, Any]:
        """Return parameters and terrain of a robot's episode, in plain numbers."""
        state: dict[str, Any] = {
            "parameters": dict(zip(PARAMETERS, self.values[row].item(), strict=True)),
            "level": int(self.level[row]),
        }
        if self._generators[row] is not None:
            terrain = self._plant.terrains[row]
            state["terrain"] = np.array(terrain.points)
            state["ground"] = (terrain.friction, terrain.restitution)
        return state

    def planned(self, row: int, state: Mapping[str, Any], robot: Robot) -> tuple[Plan, int]:
        """Return a ``robot``'s episode of a :meth:`state`, and the level; ValueError: no range."""
        given = state["parameters"]
        if not isinstance(given, Mapping) or {*given} != {*PARAMETERS}:
            raise ValueError(f"state['parameters'] is {shown(given)}, must have {[*PARAMETERS]}")
        values = np.zeros(1, EPISODE)
        for name in PARAMETERS:
            values[name] = check(f"state['parameters'][{name!r}]", name, given[name])
        self._check_feet(robot, values[0])
        level = check("state['level']", "terrain_level", state["level"])
        terrain = None
        if self._generators[row] is not None:
            friction, restitution = state["ground"]
            terrain = Terrain(tuple(map(tuple, state["terrain"])), friction, restitution)
        return Plan(values, terrain), int(level)


def _heaviest(
    nominal: np.void, randomization: Randomization, changes: Mapping[str, float] | None = None
) -> Any:
    """Return the numbers of a robot's episodes that its feet can bear least, if known."""
    values = nominal.copy()
    for name, value in (changes or {}).items():
        values[name] = value
    for name, drawn in randomization.items():
        if isinstance(drawn, Uniform):
            level = min(max(0.0, drawn.low), drawn.high)
            least = {"foot_stiffness_scale": drawn.low, "tilt": level}
            values[name] = least.get(name, drawn.high)
    return values
