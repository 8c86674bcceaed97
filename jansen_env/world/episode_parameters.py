"""Episode parameters and terrain of each robot.

They are sampled at a reset, applied to the simulation backend, and kept for ``info`` and saved
states.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from jansen_env.arrays import Ints, Rows
from jansen_env.checks import entries, finite, instance, invalid, listed, shown
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.engine import mathematics
from jansen_env.plants import parameters
from jansen_env.plants.base import resting_depth
from jansen_env.plants.batched_plant import BatchedPlant
from jansen_env.plants.parameters import (
    EPISODE,
    PARAMETERS,
    Randomization,
    Uniform,
    check,
    plain,
)
from jansen_env.plants.robot_parameters import check_restitution
from jansen_env.robot import Compliance, Payload, Robot
from jansen_env.terrain import Ground, Terrain
from jansen_env.terrain.generators import Generator
from jansen_env.uniform import draw_seed
from jansen_env.world.episode_lengths import Build
from jansen_env.world.settings import Values, WorldSettings, contradiction

DELAY = list(PARAMETERS).index("delay")

Progress = Callable[[int], tuple[float, float]]
"""Function that returns a robot's progress in its last episode and its mean commanded speed.

Its argument is the index of the robot. The progress is in m and the speed in m/s; both are 0 before
the first episode.
"""


class Plan(NamedTuple):
    """Plan of an episode that has not begun yet.

    Attributes:
        values: Parameters of the episode, a record of
            :data:`jansen_env.plants.parameters.EPISODE`, shape (1,).
        terrain: Terrain of the episode. None to keep the present terrain.
        build: Robot of the episode. None to keep the present robot.
    """

    values: Rows
    terrain: Ground | None
    build: Build | None = None


class EpisodeParameters:
    """Parameters and terrains of the episodes of n robots.

    Args:
        plant: Simulation backend with the robots, before randomisation.
        settings: Settings of the world.
        generators: Terrain generator of each robot. None for a robot on a user-specified terrain.
        has: Whether the world has sensor noise (key "noise_level") and random pushes (key
            "push_strength").

    Attributes:
        curriculum: Curriculum of the terrain levels. None for no curriculum.
        level: Present level of each robot in the curriculum, shape (n,).
        levels: Lowest and highest terrain level of each robot, shape (n, 2).
        randomizations: Randomised parameters of each robot, without those that have no effect.
        varies: Whether any parameter or terrain is sampled.

    Raises:
        ValueError: If a randomised parameter has no effect or exceeds what the feet can carry, or a
            terrain without levels is given a level or a curriculum.
    """

    def __init__(
        self,
        plant: BatchedPlant,
        settings: WorldSettings,
        generators: Sequence[Generator | None],
        has: Mapping[str, bool],
    ) -> None:
        self._plant = plant
        self._generators = generators
        self._has = dict(has)
        self.curriculum = settings.curriculum
        self._fixed = {  # whether an argument overrides the value of generated terrains
            name: np.array([value is not None for value in getattr(settings, name)])
            for name in ("friction", "restitution")
        }
        self._given = [{k: r[k] for k in r if k != "lengths"} for r in settings.randomize]
        self.levels = np.array(settings.terrain_level, float)
        self._by_user = settings.by_user
        pairs = zip(plant.robots, plant.terrains, strict=True)
        nominal = np.array([parameters.nominal(*pair) for pair in pairs], EPISODE)
        self._nominal = plain(nominal)  # plain numbers, because NumPy copies them faster
        self._check_draws()
        self.level = self.levels[:, 0].astype(np.int64)
        self.varies = any(self.randomizations) or any(make is not None for make in generators)

    @property
    def nominal(self) -> Rows:
        """Parameters without randomisation, shape (n,), of the type EPISODE."""
        return self._nominal.view(EPISODE)[:, 0]

    def _check_draws(self) -> None:
        """Check what the user randomises, and drop a preset's entries that have no effect.

        Raises:
            ValueError: If a parameter that the user randomises has no effect or exceeds what the
                feet can carry, or a terrain without levels is given a level or a curriculum.
        """
        has_levels = np.array([generator is not None for generator in self._generators])
        self.levels[~has_levels & ~self._by_user["terrain_level"]] = 0.0
        self.randomizations = [self.draws(i, robot) for i, robot in enumerate(self._plant.robots)]
        for i, robot in enumerate(self._plant.robots):
            for extreme in (_heaviest, _stiffest):
                self._check_feet(robot, extreme(self.nominal[i], self.randomizations[i]))
        if bad := np.flatnonzero(self.levels.any(axis=1) & ~has_levels).tolist():
            low, high = self.levels[bad[0]].astype(int).tolist()
            given = low if low == high else (low, high)
            allowed = "0 for terrain that is not generated, because it has no levels"
            raise invalid("terrain_level", given, allowed)
        if self.curriculum is not None and not has_levels.all():
            raise invalid("curriculum", self.curriculum, "None on terrain that has no levels")

    def changed(self, i: int, numbers: Mapping[str, float], build: Build | None) -> Plan:
        """Return a plan for the rest of a robot's current episode.

        Args:
            i: Index of the robot.
            numbers: New values of parameters, by name.
            build: New robot. None to keep the present robot.
        """
        values = _with(self._plant.parameters[[i]], numbers)
        given: Values = {name: numbers[name] for name in self._fixed if name in numbers}
        terrain = replace(self._plant.terrains[i], **given) if given else None
        return Plan(values, terrain, build)

    def set_nominal(self, i: int, numbers: Mapping[str, float]) -> None:
        """Set parameters of a robot's later episodes, in place of a preset's randomisation.

        Args:
            i: Index of the robot.
            numbers: New values of parameters, by name.
        """
        self.replace_draws(i, numbers)
        for name, value in numbers.items():
            self.nominal[name][i] = value
            if name in self._fixed:
                self._fixed[name][i] = True

    def replace_draws(self, i: int, names: Collection[str]) -> None:
        """Stop the preset's randomisation of parameters that the user sets for a robot.

        Args:
            i: Index of the robot.
            names: Names of the parameters.
        """
        if self._by_user["randomize"][i]:
            return
        for draws in (self._given, self.randomizations):
            draws[i] = {name: draw for name, draw in draws[i].items() if name not in names}

    def check_not_drawn(self, i: int, name: str, value: object) -> None:
        """Check that the user does not randomise a parameter, because a new value has no effect.

        Args:
            i: Index of the robot.
            name: Name of the parameter.
            value: New value of the parameter, for the error message.

        Raises:
            ValueError: If the user randomises the parameter.
        """
        if self._by_user["randomize"][i] and name in self._given[i]:
            raise contradiction(name, value, name)

    def draws(self, i: int, robot: Robot) -> Randomization:
        """Return the randomised parameters of a robot.

        Args:
            i: Index of the robot.
            robot: The robot, which may be one that is to replace the present robot.

        Raises:
            ValueError: If the user randomises a parameter that has no effect on the robot.
        """
        given = self._given[i]
        if not self._by_user["randomize"][i]:
            useful = self._useful(i, robot)
            return {name: drawn for name, drawn in given.items() if name in useful}
        self.check_names(i, [*given], "randomize", robot)
        return given

    def _useful(self, i: int, robot: Robot) -> set[str]:
        """Return the names of the parameters that have an effect on a robot."""
        has = {**self._has, "terrain_level": self._generators[i] is not None}
        others = (name for name, row in PARAMETERS.items() if not row.of_robot)
        return {*parameters.effective(robot), *(name for name in others if has.get(name, True))}

    def check_names(
        self, i: int, names: Sequence[str], label: str, robot: Robot | None = None
    ) -> None:
        """Check that all parameters have an effect on a robot.

        Args:
            i: Index of the robot.
            names: Names of the parameters.
            label: Source of the names, for the error message.
            robot: Robot that is to replace the present one. None for the present robot.

        Raises:
            ValueError: If a parameter has no effect.
        """
        useful = self._useful(i, robot or self._plant.robots[i]) if names else ()
        if idle := [name for name in names if name not in useful]:
            known = [name for name in PARAMETERS if name in useful]
            allowed = f"a parameter that has an effect here, one of {known}"
            raise invalid(f"a key of {label}", idle[0], allowed)

    def check_change(self, i: int, pads: Compliance, numbers: Mapping[str, float]) -> None:
        """Check that a robot can have new pads and parameters from now on.

        Args:
            i: Index of the robot.
            pads: Compliance of the pads after the change.
            numbers: New values of parameters, by name.

        Raises:
            ValueError: If the pads contradict a restitution, or the feet cannot carry the robot in
                this episode or in a later one.
        """
        in_force = (of["restitution"][i] for of in (self._plant.parameters, self.nominal))
        restitution = numbers.get("restitution", max(map(float, in_force)))
        if not pads.rigid and "restitution" in self.randomizations[i]:
            raise invalid("pad_compliance", pads, "rigid, because randomize has 'restitution'")
        check_restitution(np.array([not pads.rigid]), np.array([restitution]))
        nominal = _with(self.nominal[i], numbers)
        robot = self._plant.robots[i]
        # Parameters of later episodes, in addition to those of this episode.
        later = [extreme(nominal, self.randomizations[i]) for extreme in (_heaviest, _stiffest)]
        for values in (_with(self._plant.parameters[i], numbers), *later):
            self._check_feet(replace(robot, pad_compliance=pads), values)

    def _check_robot(self, i: int, robot: Robot) -> Randomization:
        """Return the randomised parameters of a robot that is to replace the present one.

        Args:
            i: Index of the present robot.
            robot: The new robot.

        Raises:
            ValueError: If the feet of the new robot cannot carry it in every later episode.
        """
        nominal = self.nominal[i].copy()
        randomization = self.draws(i, robot)
        parameters.set_payload(nominal, robot.payload)
        for extreme in (_heaviest, _stiffest):
            self._check_feet(robot, extreme(nominal, randomization))
        return randomization

    def _check_feet(self, robot: Robot, values: np.void) -> None:
        """Check that the compliant feet of a robot can carry it and are not too stiff.

        Args:
            robot: The robot.
            values: Parameters of its episode, a record of
                :data:`jansen_env.plants.parameters.EPISODE`.

        Raises:
            ValueError: If the feet cannot carry the robot with these parameters, the restitution is
                above 0, or the time step is too long for the feet.
        """
        pads = robot.pad_compliance
        if pads.rigid:
            return
        check_restitution(np.array([True]), values["restitution"][None])
        mass = float(values["mass_scale"] * robot.links_mass + values["payload"])
        stiffness = float(values["foot_stiffness_scale"]) * pads.stiffness
        gravity = GRAVITY * values["gravity_scale"] * mathematics.cos(values["tilt"])
        resting_depth(mass, stiffness, gravity)
        self._plant.check_feet(robot, values)

    def plan(
        self,
        i: int,
        rng: np.random.Generator,
        options: Values,
        delay: float,
        progress: Progress,
        build: Build | None = None,
    ) -> Plan:
        """Return the plan of a robot's next episode. Only the state of the generator changes.

        ``docs/life_of_a_step.md`` documents the order of the samples, and
        ``test_the_order_of_draws_is_the_documented_one`` checks it.

        Args:
            i: Index of the robot.
            rng: Random number generator of the robot.
            options: Options of the reset. Parameters among them are not sampled.
            delay: Sampled delay, in s.
            progress: Function that returns the robot's progress in its last episode, for the
                curriculum.
            build: Robot that replaces the present one. None to keep the present robot.

        Raises:
            ValueError: If an option is out of range or has no effect, or the terrain generator does
                not return a valid terrain.
        """
        row = self._nominal[i].copy()
        row[DELAY] = delay
        values = row.view(EPISODE)
        if not options and not self.varies and build is None:
            return Plan(values, None)
        numbers = values[0]
        randomization = self.randomizations[i]
        generator = self._generators[i]
        robot = None if build is None else build.robot
        if robot is not None:
            randomization = self._check_robot(i, robot)
            parameters.set_payload(numbers, robot.payload)
        if not options and not self.varies:
            return Plan(values, None, build)
        numbers["terrain_level"] = self._next_level(i, rng, progress)
        for name, distribution in randomization.items():
            label = f"a sample of randomize[{name!r}]"
            numbers[name] = check(label, name, distribution.sample(rng))
        given = [name for name in PARAMETERS if name in options]
        self.check_names(i, given, "options", robot)
        for name in given:
            numbers[name] = check(f"options[{name!r}]", name, options[name])
        terrain = None
        if generator is not None:
            terrain = generator(rng, round(float(numbers["terrain_level"])))
            if not isinstance(terrain, Terrain):  # only height lines have levels
                raise invalid(f"the terrain of {shown(generator)}", terrain, "a Terrain")
            for name, fixed in self._fixed.items():
                if not fixed[i] and name not in (*randomization, *given):
                    numbers[name] = getattr(terrain, name)
            # Compliant pads may be incompatible with the restitution of the generated terrain.
            if terrain.restitution != numbers["restitution"]:
                terrain = replace(terrain, restitution=float(numbers["restitution"]))
        self._check_feet(robot or self._plant.robots[i], numbers)
        return Plan(values, terrain, build)

    def _next_level(self, i: int, rng: np.random.Generator, progress: Progress) -> float:
        """Return the terrain level of a robot's next episode, by the curriculum or at random."""
        low, high = self.levels[i].tolist()
        if self.curriculum is not None:
            # With a separate generator, later samples do not depend on the curriculum.
            separate = np.random.default_rng(draw_seed(rng))
            walked, command = progress(i)
            commanded = command * self.curriculum.horizon
            level = int(self.level[i])
            return float(self.curriculum.next_level(level, walked, commanded, separate))
        return float(rng.integers(int(low), int(high), endpoint=True)) if high > low else low

    def apply(self, which: Ints, plans: Sequence[Plan]) -> None:
        """Apply planned terrains and parameters. The robots must be placed again afterwards.

        Args:
            which: Indices of the robots, shape (k,).
            plans: Plan of each of these robots.

        Raises:
            ValueError: If feet are too stiff for the time step of the backend ``"rigid_body"``.
        """
        in_force = self._plant.parameters
        changed: list[int] = []
        for i, plan in zip(which.tolist(), plans, strict=True):
            if plan.terrain is not None:
                self._plant.set_terrain(i, plan.terrain)
            if plan.values.tobytes() != in_force[i].tobytes():
                changed.append(i)
        if changed:
            values = [plan.values for i, plan in zip(which, plans, strict=True) if i in changed]
            self._plant.set_parameters(np.array(changed), np.concatenate(values))

    def begin(self, draws: Mapping[int, Randomization]) -> None:
        """Begin episodes of robots that have been exchanged.

        Args:
            draws: Randomised parameters of these robots, by index.
        """
        for i, randomization in draws.items():
            parameters.set_payload(self.nominal[i], self._plant.robots[i].payload)
            self.randomizations[i] = randomization

    def shown_robot(self, i: int, robot: Robot) -> Robot:
        """Return a robot with the payload of its current episode, for pictures.

        Args:
            i: Index of the robot.
            robot: The robot.
        """
        parameters = self._plant.parameters[i]
        mass = float(parameters["payload"])
        place = (float(parameters["payload_x"]), float(parameters["payload_y"]))
        if mass == robot.payload.mass and place == tuple(robot.payload.position):
            return robot
        return replace(robot, payload=Payload(mass, position=place))

    def state(self, i: int) -> Values:
        """Return the level and the generated terrain of a robot, for a saved state."""
        state: Values = {"level": int(self.level[i])}
        terrain = self._plant.terrains[i]
        if self._generators[i] is not None and isinstance(terrain, Terrain):
            state["terrain"] = {
                "points": np.array(terrain.points),
                "friction": terrain.friction,
                "restitution": terrain.restitution,
            }
        return state

    def planned(
        self, i: int, state: Values, given: Mapping[str, object], robot: Robot
    ) -> tuple[Plan, int]:
        """Return the plan that restores an episode, and the level of the robot.

        Args:
            i: Index of the robot.
            state: Saved state, with the entries of :meth:`state`.
            given: Parameters of the episode, by name. Others get their nominal values.
            robot: Robot of the restored episode.

        Raises:
            ValueError: If a value of the state is out of range.
        """
        label = "state['record']['parameters']"
        if unknown := [name for name in given if name not in PARAMETERS]:
            allowed = f"one of {listed([*PARAMETERS], unknown[0])}"
            raise invalid(f"a field of {label}", unknown[0], allowed)
        values = self.nominal[[i]]
        for name, value in given.items():
            values[name] = check(f"{label}[{name!r}]", name, value)
        self._check_feet(robot, values[0])
        self._check_robot(i, robot)
        level = check("state['level']", "terrain_level", state["level"])
        terrain = None
        if self._generators[i] is not None:
            terrain = _load_terrain("state['terrain']", state["terrain"])
        return Plan(values, terrain), int(level)


def _load_terrain(name: str, value: object) -> Terrain:
    """Return a generated terrain of a saved state.

    Args:
        name: Name of the terrain, for error messages.
        value: Points, friction and restitution of the terrain, by name.

    Raises:
        ValueError: If an entry is missing, unknown or out of range.
    """
    given = instance(name, value, Mapping)
    if {*given} != {"points", "friction", "restitution"}:
        allowed = "points, friction and restitution by name"
        raise invalid(name, value, allowed)
    points = entries(f"{name}['points']", given["points"], "(x, y) points")
    friction = finite(f"{name}['friction']", given["friction"])
    restitution = finite(f"{name}['restitution']", given["restitution"])
    return Terrain(points, friction, restitution)


def _with(values: Any, numbers: Mapping[str, float]) -> Any:
    """Return a copy of one or several records of EPISODE, with new values of some parameters."""
    values = values.copy()
    for name, value in numbers.items():
        values[name] = value
    return values


def _heaviest(nominal: np.void, randomization: Randomization) -> np.void:
    """Return the episode parameters with the highest foot load."""
    values = nominal.copy()
    for name, drawn in randomization.items():
        if isinstance(drawn, Uniform):
            level = min(max(0.0, drawn.low), drawn.high)
            least = {"foot_stiffness_scale": drawn.low, "tilt": level}
            values[name] = least.get(name, drawn.high)
    return values


def _stiffest(nominal: np.void, randomization: Randomization) -> np.void:
    """Return the parameters with the stiffest and most damped feet under the lightest robot."""
    values = nominal.copy()
    for name in ("foot_stiffness_scale", "foot_damping_scale"):
        if isinstance(drawn := randomization.get(name), Uniform):
            values[name] = drawn.high
    for name in ("mass_scale", "inertia_scale"):
        if isinstance(drawn := randomization.get(name), Uniform):
            values[name] = drawn.low
    return values
