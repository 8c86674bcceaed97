"""Settings of a world: checked arguments, and the robots and terrains that they give.

All functions raise ValueError for a value out of range.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, replace
from enum import Enum
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar, TypeAlias, TypeVar, cast

import numpy as np
import pymunk
from numpy.typing import NDArray
from typing_extensions import TypeAliasType, TypedDict

from jansen_env import checks
from jansen_env.arrays import Array, Bools
from jansen_env.checks import (
    instance,
    invalid,
    listed,
    load_record,
    non_negative,
    number_range,
    one_of,
    positive,
    shown,
    within,
)
from jansen_env.engine.integrator import DIVERGED
from jansen_env.parameters import (
    ARGUMENTS,
    LONGEST_DELAY,
    Uniform,
    argument_values,
    load_randomization,
)
from jansen_env.plants.base import check_time_step
from jansen_env.plants.plant import PLANTS
from jansen_env.robot import ROBOTS, Compliance, Payload, Robot, named_robot
from jansen_env.robot.motor import IDEAL, MOTORS, Motor
from jansen_env.robot.robot_file import read_robot
from jansen_env.robot.soundness import check_loaded
from jansen_env.terrain import Ground, Shapes, Terrain, make_ground
from jansen_env.terrain.generators import HIGHEST, Curriculum, Generator, make_generator
from jansen_env.terrain.shapes import ShapeSource, is_shapes
from jansen_env.world.observations import Noise
from jansen_env.world.push import Push

Check: TypeAlias = Callable[[str, Any], Any]  # of an argument's name and value
Values: TypeAlias = dict[str, Any]
"""Values by name: options of a reset, changes, states, information."""
Arguments: TypeAlias = tuple[Any, ...]
"""Arguments of a kernel but the first."""

T = TypeVar("T")
Range = TypeAliasType("Range", float | Sequence[float])  # a number, or (low, high)
PerRobot = TypeAliasType("PerRobot", T | Sequence[T | None] | NDArray[np.generic], type_params=(T,))
"""One for all robots, or one for each; None in a sequence: see :class:`WorldSettings`."""

MOST_TIME_STEPS = 10_000  # time steps in a control period: seconds on the slowest plant
RENDER_MODES = ["human", "rgb_array"]
FLAT = Terrain.flat()  # where a robot stands before its ground is drawn
FURTHEST_SCAN, MOST_SCANNED = 100.0, 1000  # m, and places, of a height scan


def control_period(control_dt: object, time_step: object) -> tuple[float, float]:
    """``control_dt`` and ``time_step``, s: the first 1 to ``MOST_TIME_STEPS`` times the second."""
    period = positive("control_dt", control_dt)
    step = check_time_step(time_step)
    steps = period / step
    too_long = steps > MOST_TIME_STEPS * (1.0 + 1e-9)
    if too_long or steps < 1.0 - 1e-9 or abs(steps - round(steps)) > 1e-6 * steps:
        allowed = f"at most {MOST_TIME_STEPS} times" if too_long else "a multiple of"
        raise invalid("control_dt", control_dt, f"{allowed} time_step, {shown(time_step)}")
    return period, step


def flag(name: str, value: object) -> bool:
    """A switch: True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise invalid(name, value, "True or False")
    return bool(value)


def optional(check: Check) -> Check:
    """A check that also accepts None."""
    return lambda name, value: None if value is None else check(name, value)


def option(
    options: Values, name: str, drawn: float, low: float = -np.inf, high: float = np.inf
) -> float:
    """An option of ``reset``, or the number that was drawn in its place."""
    return within(f"options[{name!r}]", options[name], low, high) if name in options else drawn


def entries_of(name: str, value: object, count: int) -> list[Any]:
    """``count`` values: the entries of a sequence or array (count,), or one value repeated."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, (list, tuple)):
        return [value] * count
    if len(value) != count:
        raise ValueError(f"{name} must be one value or {count} values, got {len(value)} values")
    return list(value)


def contradiction(argument: str, value: object, name: str) -> ValueError:
    """Return the error of an argument and a draw of ``randomize`` that exclude each other."""
    return ValueError(
        f"{argument} is {shown(value)} and randomize has {name!r}: they contradict each other; "
        "give only one of them"
    )


class Own(Enum):
    """Marker in :class:`Each` for a robot whose value the user does not give."""

    VALUE = "the environment's own value"


class Each(tuple[Any, ...]):
    """One value for each robot, where a plain sequence could as well be one value for all.

    :attr:`Own.VALUE` leaves the environment's own value to a robot.
    """


def shared(default: Any, check: Check, single_only: bool = False) -> Any:
    """A field of settings with one value for all robots.

    ``single_only``: several robots at once must have the default.
    """
    return field(default=default, metadata={"check": check, "single_only": single_only})


def each(default: Any, check: Check, several: Callable[[Any], bool] | None = None) -> Any:
    """A field of settings that becomes a list with a value for each robot.

    ``several``: whether an argument of many robots has one value for each, and not one for all;
    by default sequences and arrays do.
    """
    several = several or (lambda value: isinstance(value, (list, tuple, np.ndarray)))
    return field(default=default, metadata={"check": check, "several": several})


def range_each(
    default: Any, least: float, most: float, check: Callable[..., object] = number_range
) -> Any:
    """A field that becomes a list of (low, high), one for each robot.

    Arrays, and lists with a range or None in them, have an entry for each robot.
    """

    def several(value: object) -> bool:
        return isinstance(value, np.ndarray) or (
            isinstance(value, (list, tuple))
            and any(part is None or isinstance(part, (list, tuple, np.ndarray)) for part in value)
        )

    return each(default, lambda name, value: check(name, value, least, most), several)


def _by_name(kind: type, known: Values, name: str, value: object) -> Any:
    """Return a value of a type, or a known one by its name."""
    if isinstance(value, kind):
        return value
    if not isinstance(value, str) or value not in known:
        allowed = f"a {kind.__name__} or one of {listed(sorted(known), value)}"
        raise invalid(name, value, allowed)
    return known[value]


def load_robot(name: str, value: object) -> Robot:
    """Return a robot that can stand, also by the name of a design or the path of its file.

    Raises:
        ValueError: If it is no robot, or its file cannot be read.
        LinkageError: If it cannot turn its crank or cannot stand.
    """
    return check_loaded(name, _robot_of(name, value))


def load_held_robot(name: str, value: object) -> Robot:
    """Return a robot as :func:`load_robot` does. If it cannot stand there is a warning only."""
    return check_loaded(name, _robot_of(name, value), standing=False)


def _robot_of(name: str, value: object) -> Robot:
    if isinstance(value, Robot):
        return value
    if isinstance(value, (str, Path)) and str(value).endswith(".json"):
        return read_robot(value)
    if not isinstance(value, str):
        raise invalid(name, value, f"a Robot or one of {sorted(ROBOTS)}")
    return named_robot(value, name)


def load_motor(name: str, value: object) -> Motor:
    """A motor, also by its name, or of a dictionary of its arguments."""
    of_record = isinstance(value, Mapping)
    motor = load_record(Motor, name, value) if of_record else _by_name(Motor, MOTORS, name, value)
    return cast("Motor", motor)


def load_compliance(name: str, value: object) -> Compliance:
    """The compliance of feet, also of a dictionary of its arguments."""
    return cast("Compliance", instance(name, load_record(Compliance, name, value), Compliance))


def load_payload(name: str, value: object) -> Payload:
    """A payload, also by its mass at the crank axis, kg, or of a dictionary of its arguments."""
    if isinstance(value, (Payload, Mapping)):
        return cast("Payload", load_record(Payload, name, value))
    return Payload(non_negative(name, value))


def load_curriculum(name: str, value: object) -> Curriculum | None:
    """A curriculum; True stands for the default one, None and False for none."""
    if value is None or isinstance(value, (bool, np.bool_)):
        return Curriculum() if value else None
    return cast("Curriculum", load_record(Curriculum, name, value))


def _load_ground(name: str, value: Any) -> Ground | Generator:
    return make_generator(value) or make_ground(value)


def _several_terrains(value: object) -> bool:
    """Whether an argument has a ground for each robot: no list of shapes or of points."""
    return isinstance(value, (list, tuple)) and all(
        terrain is None
        or isinstance(terrain, (Terrain, Shapes, str))
        or is_shapes(terrain)
        or (callable(terrain) and not isinstance(terrain, pymunk.Shape))
        for terrain in value
    )


def _levels(name: str, value: object, least: float, most: float) -> tuple[float, float]:
    low, high = number_range(name, value, least, most)
    if (low, high) != (round(low), round(high)):
        raise invalid(name, value, "whole numbers")
    return low, high


def scanned_places(name: str, scan: object) -> Array:
    """(count,) m, places from the crank axis, of (behind, ahead, count); none for None."""
    if scan is None:
        return np.empty(0)
    values = checks.entries(name, scan, "None or (behind, ahead, count)", 3)
    behind, ahead = (within(f"{name}[{i}]", values[i], 0.0, FURTHEST_SCAN) for i in (0, 1))
    count = checks.positive_integer(f"{name}[2]", values[2], MOST_SCANNED)
    return np.linspace(-behind, ahead, count)


class RobotArguments(TypedDict, total=False):
    """Arguments of every environment; :class:`WorldSettings` has their defaults and checks."""

    robot: PerRobot[Robot | str | Path]
    motor: PerRobot[Motor | str | None]
    torque_limit: PerRobot[float | None]
    delay: PerRobot[Range]
    control_dt: float
    track_joint_forces: bool
    randomize: PerRobot[Values | None]
    reset_noise_scale: PerRobot[float]
    observe_lengths: bool
    render_mode: str | None


class WorldArguments(RobotArguments, total=False):
    """Arguments of every environment of free robots, see :class:`WorldSettings`."""

    payload: PerRobot[Payload | float | None]
    pad_compliance: PerRobot[Compliance | None]
    time_step: float | None
    plant: str
    links_collide: bool
    terrain: PerRobot[Ground | ShapeSource | str | Generator | Sequence[Sequence[float]]]
    friction: PerRobot[float | None]
    restitution: PerRobot[float | None]
    terrain_level: PerRobot[int | Sequence[int]]
    curriculum: Curriculum | bool | None
    torque_rate: float | None
    observe: str
    height_scan: Sequence[float] | None
    noise: Noise | Values | None
    push: Push | Values | None


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """Arguments of an environment, checked: robots, ground, and what disturbs or is drawn.

    Times in s. None stands for the robot's, the motor's or the terrain's own value. Lists have a
    value for each robot; types are those of checked values. Where None is no value, as of
    ``delay``, None in a list leaves the environment's own value to that robot.

    A preset may draw a parameter (``randomize``) that also has an argument, such as ``friction``.
    The user's argument then replaces the preset's draw for every robot that it gives a value to.

    Attributes:
        held: Whether chassis are held in the air.
        FIXED: Names of the fields that are no arguments.
        num_envs: Number of robots of a vector environment; None for an environment of one robot.
        preset: Values that the environment chooses in place of the defaults below.
        given: Names of the arguments that the user gives.
        by_user: For each argument that may differ between robots, whether the user gives it to
            each robot, shape (n,).

    Raises:
        ValueError: If a value is out of range, or if an argument and ``randomize``, both given by
            the user, contradict each other.
    """

    held: ClassVar[bool] = False
    ideal_torque: ClassVar[float | None] = None  # N m, limit of an ideal motor; None: its own
    FIXED: ClassVar[frozenset[str]] = frozenset({"num_envs", "preset", "given", "by_user"})

    num_envs: int | None = None
    preset: Values = field(default_factory=dict)
    given: frozenset[str] = frozenset()
    by_user: dict[str, Bools] = field(init=False, default_factory=dict)
    robot: list[Robot] = each("paper", load_robot)
    payload: list[Payload | None] = each(None, optional(load_payload))
    motor: list[Motor | None] = each(None, optional(load_motor))
    torque_limit: list[float | None] = each(None, optional(positive))
    pad_compliance: list[Compliance | None] = each(None, optional(load_compliance))
    delay: list[tuple[float, float]] = range_each(0.0, 0.0, LONGEST_DELAY)
    control_dt: float = 0.02
    time_step: float | None = None
    plant: str = shared("projection", partial(one_of, known=sorted(PLANTS)), single_only=True)
    links_collide: bool = shared(False, flag)
    terrain: list[Ground | Generator] = each("flat", _load_ground, _several_terrains)
    friction: list[float | None] = each(None, optional(non_negative))
    restitution: list[float | None] = each(None, optional(partial(within, low=0.0, high=1.0)))
    terrain_level: list[tuple[float, float]] = range_each(0, 0, HIGHEST, _levels)
    curriculum: Curriculum | None = shared(None, load_curriculum)
    randomize: list[Values] = each(None, load_randomization)
    reset_noise_scale: list[float] = each(0.1, partial(within, low=0.0, high=DIVERGED))
    torque_rate: float | None = shared(None, optional(positive))
    observe: str = shared("all", partial(one_of, known=("all", "onboard")))
    height_scan: Array = shared(None, scanned_places)
    noise: Noise | None = shared(None, partial(load_record, Noise))
    push: Push | None = shared(None, partial(load_record, Push))
    observe_lengths: bool = shared(False, flag)
    track_joint_forces: bool = shared(False, flag, single_only=True)
    render_mode: str | None = shared(None, partial(one_of, known=(None, *RENDER_MODES)))

    def __post_init__(self) -> None:
        for argument in fields(self):
            if "check" in argument.metadata:
                object.__setattr__(self, argument.name, self._checked(argument))
        object.__setattr__(self, "randomize", [*map(self._draws, range(self.count))])

    def _checked(self, argument: Field[Any]) -> Any:
        name, value, marks = argument.name, getattr(self, argument.name), argument.metadata
        check = marks["check"]
        if "several" in marks:
            return self._checked_each(argument, value)
        checked = check(name, value)
        if self.count > 1 and marks["single_only"] and checked != argument.default:
            others = "vectorization_mode='sync' has the others"
            raise invalid(name, value, f"{argument.default!r} for several robots at once; {others}")
        return checked

    def _checked_each(self, argument: Field[Any], value: Any) -> list[Any]:
        """Return the checked value of each robot, and note in :attr:`by_user` whose it is."""
        name, marks = argument.name, argument.metadata
        check, several = marks["check"], marks["several"]
        self.by_user[name] = np.full(self.count, name in self.given)
        if self.num_envs is None or not (isinstance(value, Each) or several(value)):
            return [check(name, value)] * self.count
        entries = entries_of(name, value, self.count)
        none_is_own = argument.default is not None and not isinstance(value, Each)
        for i, entry in enumerate(entries):
            if entry is Own.VALUE or (entry is None and none_is_own):
                entries[i] = self.preset.get(name, argument.default)
                self.by_user[name][i] = False
        checked = {id(entry): check(name, entry) for entry in entries}
        return [checked[id(entry)] for entry in entries]

    def _draws(self, i: int) -> Values:
        """Return a robot's ``randomize`` without the preset's draws that an argument replaces.

        Raises:
            ValueError: If the user gives both an argument and another draw of the same parameter.
        """
        drawn: Values = self.randomize[i]
        if not drawn:
            return drawn
        for argument in ARGUMENTS:
            value = getattr(self, argument)[i]
            if value is None or not self.by_user[argument][i]:
                continue
            named = argument_values(argument, value)
            if not self.by_user["randomize"][i]:
                drawn = {name: draw for name, draw in drawn.items() if name not in named}
                continue
            for name, limits in named.items():
                draw = drawn.get(name)
                same = isinstance(draw, Uniform) and (draw.low, draw.high) == limits
                if draw is not None and not same:
                    raise contradiction(argument, value, name)
        if self.curriculum is not None and "terrain_level" in drawn:
            raise contradiction("curriculum", self.curriculum, "terrain_level")
        return drawn

    @property
    def count(self) -> int:
        """The number of robots."""
        return 1 if self.num_envs is None else self.num_envs

    @classmethod
    def defaults(cls, mark: str | None = None) -> Values:
        """Return the defaults of the arguments by name, or of those "several" or "single_only"."""
        arguments = [f for f in fields(cls) if f.name not in cls.FIXED]
        return {f.name: f.default for f in arguments if mark is None or f.metadata.get(mark)}

    @classmethod
    def equip(
        cls,
        robot: Robot,
        payload: Payload | None = None,
        motor: Motor | None = None,
        torque_limit: float | None = None,
        pad_compliance: Compliance | None = None,
    ) -> Robot:
        """Return a robot with other parts, where they are not None."""
        given = {"payload": payload, "motor": motor, "pad_compliance": pad_compliance}
        parts: Values = {name: part for name, part in given.items() if part is not None}
        if motor is None and torque_limit is None and robot.motor == IDEAL:
            torque_limit = cls.ideal_torque
        equipped = replace(robot, **parts)
        limit = equipped.motor.torque_limit if torque_limit is None else torque_limit
        return replace(equipped, motor=replace(equipped.motor, torque_limit=limit))

    def make_robots(self) -> list[Robot]:
        """Return robots with their payloads, motors ...; those of the same parts are one object."""
        parts = self.payload, self.motor, self.torque_limit, self.pad_compliance
        return [*map(cache(self.equip), self.robot, *parts)]

    def make_terrains(self) -> tuple[list[Ground], list[Generator | None]]:
        """Return terrains, flat where a reset draws them, and the generators that draw."""
        made: dict[object, Ground] = {}  # robots on the same ground share it
        terrains = []
        for ground, *numbers in zip(self.terrain, self.friction, self.restitution, strict=True):
            key = (id(ground), *numbers)
            if key not in made:
                fixed = ground if isinstance(ground, (Terrain, Shapes)) else FLAT
                made[key] = make_ground(fixed, *numbers)
            terrains.append(made[key])
        return terrains, [None if isinstance(g, (Terrain, Shapes)) else g for g in self.terrain]


@dataclass(frozen=True, kw_only=True)
class HeldSettings(WorldSettings):
    """Robots whose chassis are held in the air: no ground, no disturbances."""

    held: ClassVar[bool] = True
    ideal_torque: ClassVar[float | None] = 5.0
    FIXED: ClassVar[frozenset[str]] = WorldSettings.FIXED | (
        {*WorldArguments.__annotations__} - {*RobotArguments.__annotations__, "time_step"}
    )

    robot: list[Robot] = each("paper", load_held_robot)
    control_dt: float = 0.01
    time_step: float | None = shared(0.001, lambda name, value: check_time_step(value))
    randomize: list[Values] = each(None, partial(load_randomization, parameters=()))
