"""Settings of a world: checks of its arguments, and the robots and terrains made from them.

All functions that check a value raise ValueError if the value is out of range.
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
from jansen_env.plants.base import (
    JointPlay,
    check_backlash,
    check_joint_play,
    check_no_play,
    check_time_step,
)
from jansen_env.plants.parameters import (
    ARGUMENTS,
    LONGEST_DELAY,
    Uniform,
    argument_values,
    load_randomization,
)
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

Check: TypeAlias = Callable[[str, Any], Any]
"""Function that checks an argument: it takes the name and the value, and returns the result."""
Values: TypeAlias = dict[str, Any]
"""Values by name, such as reset options, changes, saved states, or information."""
Arguments: TypeAlias = tuple[Any, ...]
"""Arguments of a kernel, except the first one."""

T = TypeVar("T")
Range = TypeAliasType("Range", float | Sequence[float])
"""A number, or a range (low, high)."""
PerRobot = TypeAliasType("PerRobot", T | Sequence[T | None] | NDArray[np.generic], type_params=(T,))
"""One value for all robots, or a sequence with one value per robot.

:class:`WorldSettings` explains the meaning of None in a sequence.
"""

MOST_TIME_STEPS = 10_000  # largest number of time steps per control step, which can take seconds
RENDER_MODES = ["human", "rgb_array"]
FLAT = Terrain.flat()  # terrain of a robot until its first terrain is generated
FURTHEST_SCAN = 100.0  # largest distance of a scan, in m
MOST_SCANNED = 1000  # largest number of points of a scan


def control_period(control_dt: object, time_step: object) -> tuple[float, float]:
    """Return the checked duration of a control step and the checked time step.

    Args:
        control_dt: Duration of a control step, in s.
        time_step: Time step of the integration, in s.

    Returns:
        Both arguments as floats, in s.

    Raises:
        ValueError: If ``control_dt`` is not a whole multiple of ``time_step``, from 1 to
            :data:`MOST_TIME_STEPS`, or an argument is out of range.
    """
    period = positive("control_dt", control_dt)
    step = check_time_step(time_step)
    steps = period / step
    too_long = steps > MOST_TIME_STEPS * (1.0 + 1e-9)
    if too_long or steps < 1.0 - 1e-9 or abs(steps - round(steps)) > 1e-6 * steps:
        allowed = f"at most {MOST_TIME_STEPS} times" if too_long else "a multiple of"
        raise invalid("control_dt", control_dt, f"{allowed} time_step, {shown(time_step)}")
    return period, step


def flag(name: str, value: object) -> bool:
    """Return ``value`` as a bool.

    Raises:
        ValueError: If it is not True or False.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise invalid(name, value, "True or False")
    return bool(value)


def optional(check: Check) -> Check:
    """Return a check that also accepts None, and returns None in that case."""
    return lambda name, value: None if value is None else check(name, value)


def option(
    options: Values, name: str, drawn: float, low: float = -np.inf, high: float = np.inf
) -> float:
    """Return a reset option, or the sampled value if the option is not given.

    Args:
        options: Options of the reset.
        name: Name of the option.
        drawn: Sampled value.
        low: Smallest allowed value of the option.
        high: Largest allowed value of the option.

    Raises:
        ValueError: If the option is out of range.
    """
    return within(f"options[{name!r}]", options[name], low, high) if name in options else drawn


def entries_of(name: str, value: object, count: int) -> list[Any]:
    """Return one value per robot.

    Args:
        name: Name of the argument, for the error message.
        value: A single value, or a sequence or array of values, shape (count,).
        count: Number of robots.

    Returns:
        The entries of the sequence, or the single value repeated ``count`` times.

    Raises:
        ValueError: If a sequence has a different number of entries.
    """
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, (list, tuple)):
        return [value] * count
    if len(value) != count:
        raise ValueError(f"{name} must be one value or {count} values, got {len(value)} values")
    return list(value)


def contradiction(argument: str, value: object, name: str) -> ValueError:
    """Return the error for an argument that contradicts an entry of ``randomize``.

    Args:
        argument: Name of the argument.
        value: Value of the argument.
        name: Name of the randomised parameter.
    """
    return ValueError(
        f"{argument} is {shown(value)} and randomize has {name!r}: they contradict each other; "
        "give only one of them"
    )


class Own(Enum):
    """Marker in :class:`Each` for a robot for which the user specifies no value."""

    VALUE = "the environment's own value"


class Each(tuple[Any, ...]):
    """One value per robot, for arguments whose single value may itself be a sequence.

    A robot whose entry is :attr:`Own.VALUE` keeps the environment's own value.
    """


def shared(default: Any, check: Check, single_only: bool = False) -> Any:
    """Return a field of settings with one value for all robots.

    Args:
        default: Default of the argument.
        check: Check of the argument.
        single_only: Whether only an environment of one robot may have a value other than the
            default.
    """
    return field(default=default, metadata={"check": check, "single_only": single_only})


def each(default: Any, check: Check, several: Callable[[Any], bool] | None = None) -> Any:
    """Return a field of settings that becomes a list with one value per robot.

    Args:
        default: Default of the argument.
        check: Check of one robot's value.
        several: Function that returns whether an argument contains one value per robot, rather than
            one value for all robots. None treats every sequence and every array as one value per
            robot.
    """
    several = several or (lambda value: isinstance(value, (list, tuple, np.ndarray)))
    return field(default=default, metadata={"check": check, "several": several})


def range_each(
    default: Any, least: float, most: float, check: Callable[..., object] = number_range
) -> Any:
    """Return a field of settings that becomes a list of ranges (low, high), one per robot.

    An argument has one entry per robot if it is an array, or a list that contains a range or None.

    Args:
        default: Default of the argument.
        least: Smallest allowed value.
        most: Largest allowed value.
        check: Check of one robot's range.
    """

    def several(value: object) -> bool:
        return isinstance(value, np.ndarray) or (
            isinstance(value, (list, tuple))
            and any(part is None or isinstance(part, (list, tuple, np.ndarray)) for part in value)
        )

    return each(default, lambda name, value: check(name, value, least, most), several)


def _by_name(kind: type, known: Values, name: str, value: object) -> Any:
    """Return a value if it has a type, or the known value with that name.

    Args:
        kind: The type.
        known: Known values, by name.
        name: Name of the argument, for the error message.
        value: The value, or its name.

    Raises:
        ValueError: If ``value`` is neither.
    """
    if isinstance(value, kind):
        return value
    if not isinstance(value, str) or value not in known:
        allowed = f"a {kind.__name__} or one of {listed(sorted(known), value)}"
        raise invalid(name, value, allowed)
    return known[value]


def load_robot(name: str, value: object) -> Robot:
    """Return a robot, after checking that it can turn its crank and stand.

    Args:
        name: Name of the argument, for error messages.
        value: The robot, the name of a design, or the path of a robot file.

    Raises:
        ValueError: If ``value`` is not a robot, or the file cannot be read.
        LinkageError: If the robot cannot turn its crank or cannot stand.
    """
    return check_loaded(name, _robot_of(name, value))


def load_held_robot(name: str, value: object) -> Robot:
    """Return a robot as :func:`load_robot` does, but only warn if the robot cannot stand."""
    return check_loaded(name, _robot_of(name, value), standing=False)


def _robot_of(name: str, value: object) -> Robot:
    """Return a robot from a robot, the name of a design, or the path of a robot file."""
    if isinstance(value, Robot):
        return value
    if isinstance(value, (str, Path)) and str(value).endswith(".json"):
        return read_robot(value)
    if not isinstance(value, str):
        raise invalid(name, value, f"a Robot, a robot file (.json) or one of {sorted(ROBOTS)}")
    return named_robot(value, name)


def load_motor(name: str, value: object) -> Motor:
    """Return a motor.

    Args:
        name: Name of the argument, for error messages.
        value: The motor, its name, or a dictionary of its arguments.
    """
    of_record = isinstance(value, Mapping)
    motor = load_record(Motor, name, value) if of_record else _by_name(Motor, MOTORS, name, value)
    return cast("Motor", motor)


def load_compliance(name: str, value: object) -> Compliance:
    """Return the compliance of feet.

    Args:
        name: Name of the argument, for error messages.
        value: The compliance, or a dictionary of its arguments.
    """
    return cast("Compliance", instance(name, load_record(Compliance, name, value), Compliance))


def load_payload(name: str, value: object) -> Payload:
    """Return a payload.

    Args:
        name: Name of the argument, for error messages.
        value: The payload, a dictionary of its arguments, or a mass at the crank axis, in kg.
    """
    if isinstance(value, (Payload, Mapping)):
        return cast("Payload", load_record(Payload, name, value))
    return Payload(non_negative(name, value))


def load_curriculum(name: str, value: object) -> Curriculum | None:
    """Return a curriculum, or None for no curriculum.

    Args:
        name: Name of the argument, for error messages.
        value: The curriculum, or a dictionary of its arguments. True selects the default
            curriculum; False and None select none.
    """
    if value is None or isinstance(value, (bool, np.bool_)):
        return Curriculum() if value else None
    return cast("Curriculum", load_record(Curriculum, name, value))


def _load_ground(name: str, value: Any) -> Ground | Generator:
    """Return the generator that ``value`` specifies, or else the terrain."""
    return make_generator(value) or make_ground(value)


def _several_terrains(value: object) -> bool:
    """Return whether an argument is a list of terrains, one per robot.

    A list of shapes or of points is a single terrain.
    """
    return isinstance(value, (list, tuple)) and all(
        terrain is None
        or isinstance(terrain, (Terrain, Shapes, str))
        or is_shapes(terrain)
        or (callable(terrain) and not isinstance(terrain, pymunk.Shape))
        for terrain in value
    )


def _levels(name: str, value: object, least: float, most: float) -> tuple[float, float]:
    """Return the lowest and highest terrain level of a robot, both whole numbers."""
    low, high = number_range(name, value, least, most)
    if (low, high) != (round(low), round(high)):
        raise invalid(name, value, "whole numbers")
    return low, high


def scanned_places(name: str, scan: object) -> Array:
    """Return the positions at which a height scan measures the terrain.

    Args:
        name: Name of the argument, for error messages.
        scan: Distance behind and distance ahead of the crank axis, in m, and number of positions:
            (behind, ahead, count). None for no scan.

    Returns:
        Positions relative to the crank axis, in m, shape (count,). Without a scan, the array is
        empty.
    """
    if scan is None:
        return np.empty(0)
    values = checks.entries(name, scan, "None or (behind, ahead, count)", 3)
    behind = within(f"{name}[0]", values[0], 0.0, FURTHEST_SCAN)
    ahead = within(f"{name}[1]", values[1], 0.0, FURTHEST_SCAN)
    count = checks.positive_integer(f"{name}[2]", values[2], MOST_SCANNED)
    return np.linspace(-behind, ahead, count)


class RobotArguments(TypedDict, total=False):
    """Arguments of every environment; :class:`WorldSettings` defines their defaults and checks."""

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
    """Arguments of every environment of walking robots; see :class:`WorldSettings`."""

    payload: PerRobot[Payload | float | None]
    pad_compliance: PerRobot[Compliance | None]
    time_step: float | None
    plant: str
    links_collide: bool
    joint_play: JointPlay
    backlash: float
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
    """Checked arguments of an environment: robots, terrains, disturbances and randomisation.

    All times are in s. None stands for the robot's, the motor's, or the terrain's own value. A list
    contains one value per robot. The annotated types are the types after the checks. If None is not
    a valid value of an argument, such as ``delay``, a robot whose entry in a list is None keeps the
    environment's own value.

    A preset may randomise a parameter (``randomize``) that is also an argument, such as
    ``friction``. In that case, an argument of the user replaces the preset's randomisation for
    every robot for which the argument specifies a value.

    Attributes:
        fixed_chassis: Whether all chassis are fixed in the air.
        ideal_torque: Torque limit of an ideal motor, in N m. None for the limit of the motor.
        FIXED: Names of the fields that are not arguments.
        num_envs: Number of robots of a vector environment. None for an environment of one robot.
        preset: Values that the environment uses in place of the defaults below.
        given: Names of the arguments that the user specifies.
        by_user: For each argument that may differ between robots, whether the user specifies it for
            each robot, shape (n,).

    Raises:
        ValueError: If a value is out of range, or an argument of the user contradicts the user's
            ``randomize``.
    """

    fixed_chassis: ClassVar[bool] = False
    ideal_torque: ClassVar[float | None] = None
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
    joint_play: JointPlay = shared(0.0, lambda _, value: check_joint_play(value), single_only=True)
    backlash: float = shared(0.0, lambda _, value: check_backlash(value), single_only=True)
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
        if self.plant != "rigid_body":
            check_no_play(self.joint_play, self.backlash)

    def _checked(self, argument: Field[Any]) -> Any:
        """Return the checked value of an argument, or a list with one value per robot."""
        name = argument.name
        value = getattr(self, argument.name)
        marks = argument.metadata
        check = marks["check"]
        if "several" in marks:
            return self._checked_each(argument, value)
        checked = check(name, value)
        if self.count > 1 and marks["single_only"] and checked != argument.default:
            other = "vectorization_mode='sync' allows other values"
            raise invalid(name, value, f"{argument.default!r} for several robots at once ({other})")
        return checked

    def _checked_each(self, argument: Field[Any], value: Any) -> list[Any]:
        """Return the checked value of each robot.

        The method also notes in :attr:`by_user` for which robots the user specifies the value.
        """
        name = argument.name
        marks = argument.metadata
        check = marks["check"]
        several = marks["several"]
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
        """Return a robot's ``randomize`` without the preset's entries that an argument replaces.

        Raises:
            ValueError: If the user specifies both an argument and a different distribution of the
                same parameter.
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
        """Number of robots."""
        return 1 if self.num_envs is None else self.num_envs

    @classmethod
    def defaults(cls, mark: str | None = None) -> Values:
        """Return the defaults of the arguments, by name.

        Args:
            mark: ``"several"`` selects the arguments that may differ between robots, and
                ``"single_only"`` those that only an environment of one robot may change. None
                selects all arguments.
        """
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
        """Return a robot with some of its parts replaced.

        Args:
            robot: The robot.
            payload: New payload. None keeps the payload.
            motor: New motor. None keeps the motor.
            torque_limit: New torque limit of the motor, in N m. None keeps the limit of the motor;
                if the robot's own motor is ideal, None selects :attr:`ideal_torque`.
            pad_compliance: New compliance of the feet. None keeps the compliance.
        """
        given = {"payload": payload, "motor": motor, "pad_compliance": pad_compliance}
        parts: Values = {name: part for name, part in given.items() if part is not None}
        if motor is None and torque_limit is None and robot.motor == IDEAL:
            torque_limit = cls.ideal_torque
        equipped = replace(robot, **parts)
        limit = equipped.motor.torque_limit if torque_limit is None else torque_limit
        return replace(equipped, motor=replace(equipped.motor, torque_limit=limit))

    def make_robots(self) -> list[Robot]:
        """Return the robots with their payloads, motors, torque limits and compliances.

        Robots with the same parts are the same object.
        """
        parts = self.payload, self.motor, self.torque_limit, self.pad_compliance
        return [*map(cache(self.equip), self.robot, *parts)]

    def make_terrains(self) -> tuple[list[Ground], list[Generator | None]]:
        """Return the terrain and the terrain generator of each robot.

        Returns:
            The terrains, which are flat for robots whose terrain is generated at a reset, and the
            generators, which are None for robots on a user-specified terrain.
        """
        made: dict[object, Ground] = {}  # robots on the same terrain share one object
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
    """Checked arguments of an environment whose robots have a fixed chassis in the air.

    There is no ground and there are no disturbances.
    """

    fixed_chassis: ClassVar[bool] = True
    ideal_torque: ClassVar[float | None] = 5.0
    FIXED: ClassVar[frozenset[str]] = WorldSettings.FIXED | (
        {*WorldArguments.__annotations__} - {*RobotArguments.__annotations__, "time_step"}
    )

    robot: list[Robot] = each("paper", load_held_robot)
    control_dt: float = 0.01
    time_step: float | None = shared(0.001, lambda name, value: check_time_step(value))
    randomize: list[Values] = each(None, partial(load_randomization, parameters=()))
