"""Arguments that the environments share, checked in one place."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from numbers import Integral
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from jansen_env.checks import (
    entries,
    finite,
    instance,
    non_negative,
    positive,
    positive_integer,
    shown,
    whole_number,
    within,
)
from jansen_env.curriculum import Curriculum
from jansen_env.motor import MOTORS, Motor
from jansen_env.plants.base import check_time_step
from jansen_env.robot import ROBOTS, Compliance, Payload, Robot
from jansen_env.terrain import Terrain, make_terrain
from jansen_env.terrain_generators import HIGHEST, make_generator
from jansen_env.world.episode_parameters import Grounds
from jansen_env.world.parameters import LONGEST_DELAY
from jansen_env.world.randomization import Randomization

Array = NDArray[np.float64]

RENDER_MODES = ["human", "rgb_array"]
MOST_STEPS = 10_000  # time steps in a control period: seconds on the slowest plant
MOST_DELAYED = 10_000  # control periods in a delay: torques that are kept
MOST_ROBOTS = 1_000_000  # of a vector environment: gigabytes
FLAT = Terrain.flat()  # where a robot stands before its ground is drawn
FURTHEST_SCAN, MOST_SCANNED = 100.0, 1000  # m, and places, of a height scan
MOST_EPISODE_STEPS = 2**53  # the largest number up to which floats count one by one


def load_robot(robot: Robot | str) -> Robot:
    """A robot by itself or by the name of a design."""
    if isinstance(robot, Robot):
        return robot
    if not isinstance(robot, str) or robot not in ROBOTS:
        raise ValueError(f"robot is {shown(robot)}, must be a Robot or one of {sorted(ROBOTS)}")
    return ROBOTS[robot]()


def load_motor(motor: Motor | str) -> Motor:
    """A motor by itself or by its name."""
    if isinstance(motor, Motor):
        return motor
    if not isinstance(motor, str) or motor not in MOTORS:
        raise ValueError(f"motor is {shown(motor)}, must be a Motor or one of {sorted(MOTORS)}")
    return MOTORS[motor]


def load_compliance(pads: Any) -> Compliance:
    """How pads give. Raises ValueError for anything but a :class:`Compliance`."""
    instance("pad_compliance", pads, Compliance)
    found: Compliance = pads
    return found


def load_payload(payload: Any) -> Payload:
    """A payload by itself or by its mass at the crank axis, kg."""
    return payload if isinstance(payload, Payload) else Payload(non_negative("payload", payload))


def number_range(name: str, value: Any, least: float, most: float) -> tuple[float, float]:
    """A number or a pair between ``least`` and ``most`` as (low, high)."""
    pair: tuple[Any, ...] = (value, value)
    if isinstance(value, (tuple, list, np.ndarray)):
        pair = entries(name, value, "a number or (low, high)")
    if len(pair) != 2:
        raise ValueError(f"{name} is {shown(value)}, must be a number or (low, high)")
    low, high = (within(name, one, least, most) for one in pair)
    if low > high:
        raise ValueError(f"{name} is {shown(value)}, must be (low, high) with low <= high")
    return low, high


class Each(tuple[Any, ...]):
    """One value for each robot, where a plain sequence could as well be one value for all."""


def terrain_of_each(
    count: int, terrain: Any, friction: Any = None, restitution: Any = None
) -> Grounds:
    """``count`` terrains from one, or from one for each; friction and restitution likewise.

    Raises:
        ValueError: not one for each, or a value out of range.
    """
    several = isinstance(terrain, Each) or (
        isinstance(terrain, (list, tuple))
        and all(isinstance(one, (Terrain, str)) or callable(one) for one in terrain)
    )
    chosen_terrains = _each("terrain", terrain, count) if several else [terrain] * count
    different = {id(one): one for one in chosen_terrains}
    known = {key: make_generator(one) for key, one in different.items()}
    generators = [known[id(one)] for one in chosen_terrains]
    fixed = [
        FLAT if generator else one
        for one, generator in zip(chosen_terrains, generators, strict=True)
    ]
    frictions = [
        None if one is None else non_negative("friction", one)
        for one in _each("friction", friction, count)
    ]
    restitutions = [
        None if one is None else within("restitution", one, 0.0, 1.0)
        for one in _each("restitution", restitution, count)
    ]
    made: dict[Any, Terrain] = {}  # robots on equal ground share it
    terrains = []
    for chosen in zip(fixed, frictions, restitutions, strict=True):
        key = (id(chosen[0]), *chosen[1:])
        if key not in made:
            made[key] = make_terrain(*chosen)
        terrains.append(made[key])
    own_friction, own_restitution = (
        np.array([one is not None for one in given]) for given in (frictions, restitutions)
    )
    return Grounds(terrains, generators, own_friction, own_restitution)


def randomization_of_each(count: int, randomize: Any) -> list[Randomization]:
    """``count`` randomisations from one, or from one for each.

    Raises:
        ValueError: not one for each, or a name or range that there is not.
    """
    made: dict[int, Randomization] = {}
    each = _each("randomize", randomize, count)
    for one in each:
        if id(one) not in made:
            made[id(one)] = Randomization(one)
    return [made[id(one)] for one in each]


def load_curriculum(curriculum: Any) -> Curriculum | None:
    """A curriculum; True stands for the default one, None and False for none.

    Raises:
        ValueError: anything else.
    """
    if curriculum is None or isinstance(curriculum, (bool, np.bool_)):
        return Curriculum() if curriculum else None
    instance("curriculum", curriculum, Curriculum)
    found: Curriculum = curriculum
    return found


def levels_of_each(count: int, terrain_level: Any) -> Array:
    """(count, 2) lowest and highest terrain level, from one, (low, high), or one for each.

    Raises:
        ValueError: no whole numbers from 0 to :data:`jansen_env.terrain_generators.HIGHEST`.
    """
    levels = ranges_of_each(count, "terrain_level", terrain_level, 0, HIGHEST)
    if (levels != np.round(levels)).any():
        raise ValueError(f"terrain_level is {shown(terrain_level)}, must be whole numbers")
    return levels


def _each(name: str, value: Any, count: int) -> list[Any]:
    """``count`` values: the entries of a sequence or array (count,), or one value repeated."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, (list, tuple)):
        return [value] * count
    if len(value) != count:
        raise ValueError(f"{name} has {len(value)} entries, must have {count}, or be one")
    return list(value)


def robot_of_each(
    count: int,
    robot: Robot | str,
    payload: Any = None,
    motor: Any = None,
    pad_compliance: Any = None,
    torque_limit: Any = None,
) -> list[Robot]:
    """``count`` robots of one design, with one payload, motor and so on or with one for each.

    None leaves what the robot has.

    Raises:
        ValueError: not one for each, or a value out of range.
    """
    parts: dict[str, tuple[Any, Callable[[Any], Any]]] = {
        "payload": (payload, load_payload),
        "motor": (motor, load_motor),
        "pad_compliance": (pad_compliance, load_compliance),
        "torque_limit": (torque_limit, lambda value: positive("torque_limit", value)),
    }
    columns = [
        [None if one is None else load(one) for one in _each(name, value, count)]
        for name, (value, load) in parts.items()
    ]
    made: dict[Any, Robot] = {}
    robots = []
    for chosen in zip(*columns, strict=True):
        if chosen not in made:
            *fields, limit = chosen
            changes = dict(zip(parts, fields, strict=False))
            changes = {name: value for name, value in changes.items() if value is not None}
            one = replace(load_robot(robot), **changes)
            if limit is not None:
                one = replace(one, motor=replace(one.motor, torque_limit=limit))
            made[chosen] = one
        robots.append(made[chosen])
    return robots


def delay_of_each(count: int, delay: Any) -> Array:
    """(count, 2) ranges of the actions' delay, s, see :func:`ranges_of_each`."""
    return ranges_of_each(count, "delay", delay, 0.0, LONGEST_DELAY)


def ranges_of_each(count: int, name: str, value: Any, least: float, most: float) -> Array:
    """(count, 2) ranges between ``least`` and ``most``.

    Args:
        value: a number or (low, high) for all; an array (count,) of numbers, or an array
            (count, 2) or list of ranges for each.

    Raises:
        ValueError: not one for each, or a value out of range.
    """
    several = isinstance(value, (np.ndarray, Each)) or (
        isinstance(value, (list, tuple))
        and any(isinstance(one, (list, tuple, np.ndarray)) for one in value)
    )
    values = _each(name, value, count) if several else [value] * count
    return np.array([number_range(name, one, least, most) for one in values])


def scanned_places(scan: Any) -> Array:
    """(count,) m, places from the crank axis at which a robot looks at the ground.

    Args:
        scan: (behind, ahead, count); None for none.

    Raises:
        ValueError: anything else, or out of range.
    """
    if scan is None:
        return np.empty(0)
    allowed = "None or (behind, ahead, count)"
    values = entries("height_scan", scan, allowed)
    if len(values) != 3:
        raise ValueError(f"height_scan is {shown(scan)}, must be {allowed}")
    behind, ahead = (within(f"height_scan[{i}]", values[i], 0.0, FURTHEST_SCAN) for i in (0, 1))
    count = positive_integer("height_scan[2]", values[2], MOST_SCANNED)
    return np.linspace(-behind, ahead, count)


def numbers_of_each(count: int, name: str, value: Any, check: Callable[[str, Any], float]) -> Array:
    """(count,) numbers from one, or from one for each, as ``check`` of :mod:`jansen_env.checks` has it.

    Raises:
        ValueError: not one for each, or out of range.
    """
    return np.array([check(name, one) for one in _each(name, value, count)])


def limit_of_each(count: int, limit: Any) -> Array:
    """(count,) steps after which an episode is truncated, from one or from one for each.

    None and -1, as ``gym.make`` has it, stand for never (inf).

    Raises:
        ValueError: not one for each, or no whole number above 0.
    """
    name = "max_episode_steps"

    def steps(one: Any) -> float:
        if one is None or (isinstance(one, Integral) and one == -1):
            return math.inf
        return float(positive_integer(name, one, MOST_EPISODE_STEPS))

    return np.array([steps(one) for one in _each(name, limit, count)])


def seed_of_each(count: int, seed: Any) -> list[int | None]:
    """``count`` seeds: seed, seed + 1, ... from one, those of a sequence, or none.

    Raises:
        ValueError: anything else.
    """
    if seed is None:
        return [None] * count
    allowed = f"a whole number, or {count} of them"
    if isinstance(seed, Integral):
        return [whole_number("seed", seed) + i for i in range(count)]
    seeds = entries("seed", seed, allowed)
    if len(seeds) != count:
        raise ValueError(f"seed is {shown(seed)}, must be {allowed}")
    return [None if one is None else whole_number("seed", one) for one in seeds]


def autoreset_mode(mode: Any) -> AutoresetMode:
    """Gymnasium's :class:`AutoresetMode`, also by its value."""
    try:
        return AutoresetMode(mode)
    except ValueError:
        allowed = [one.value for one in AutoresetMode]
        raise ValueError(f"autoreset_mode is {shown(mode)}, must be one of {allowed}") from None


def signature_of(task: type, without: Sequence[str] = ()) -> inspect.Signature:
    """The signature of a task's constructor, less some of its arguments."""
    found = inspect.signature(task)
    kept = [p for name, p in found.parameters.items() if name not in without]
    return found.replace(parameters=kept)


def with_defaults(task: type, defaults: Mapping[str, Any]) -> inspect.Signature:
    """The signature of a task's constructor with other defaults."""
    found = inspect.signature(task)
    changed = [
        parameter.replace(default=defaults.get(name, parameter.default))
        for name, parameter in found.parameters.items()
    ]
    return found.replace(parameters=changed)


def known_arguments(environment: type, given: Mapping[str, Any]) -> None:
    """Raises TypeError for arguments that an environment does not have."""
    allowed = inspect.signature(environment).parameters
    unknown = sorted({*given} - {*allowed})
    if unknown:
        raise TypeError(
            f"{environment.__name__} got an unexpected keyword argument {unknown[0]!r}, must be in {sorted(allowed)}"
        )


def reset_mask(count: int, mask: Any) -> NDArray[np.bool_]:
    """Which robots to reset (count,), all for None.

    Raises:
        TypeError: no array of bools. ValueError: not one for each, or none of them set.
    """
    if mask is None:
        return np.ones(count, bool)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        raise TypeError(f"options['reset_mask'] is {mask!r}, must be an array of bools")
    if mask.shape != (count,) or not mask.any():
        raise ValueError(
            f"options['reset_mask'] is {mask!r}, must have shape ({count},) and name one robot at "
            "least"
        )
    return mask


def reset_options(options: Any) -> dict[str, Any]:
    """The options of ``reset``, a copy; none for None. Raises ValueError for anything else."""
    if options is None:
        return {}
    instance("options", options, dict)
    return dict(options)


def options_of_each(count: int, options: dict[str, Any]) -> list[dict[str, Any]]:
    """The options of ``reset`` for each robot: arrays and lists have one entry for each.

    Raises:
        ValueError: not one for each.
    """
    columns = {name: _each(f"options[{name!r}]", value, count) for name, value in options.items()}
    return [{name: values[i] for name, values in columns.items()} for i in range(count)]


def control_period(control_dt: Any, time_step: Any) -> tuple[float, float]:
    """``control_dt`` and ``time_step`` in s: the first 1 to :data:`MOST_STEPS` times the second.

    Raises:
        ValueError: anything else.
    """
    period = positive("control_dt", control_dt)
    step = check_time_step(time_step)
    steps = period / step
    if steps > MOST_STEPS * (1.0 + 1e-9):
        raise ValueError(
            f"control_dt is {shown(control_dt)}, must be at most {MOST_STEPS} times time_step, "
            f"{shown(time_step)}"
        )
    if steps < 1.0 - 1e-9 or abs(steps - round(steps)) > 1e-6 * steps:
        raise ValueError(
            f"control_dt is {shown(control_dt)}, must be a multiple of time_step, "
            f"{shown(time_step)}"
        )
    return period, step


def interval(name: str, value: Any) -> float:
    """A time in s above 0; inf for None, which stands for never."""
    return math.inf if value is None else positive(name, value)


def flag(name: str, value: Any) -> bool:
    """A switch: True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name} is {shown(value)}, must be True or False")
    return bool(value)


def render_mode(mode: Any, allowed: Sequence[str] = RENDER_MODES) -> str | None:
    """None or one of those allowed."""
    if mode is None or (isinstance(mode, str) and mode in allowed):
        return mode
    raise ValueError(f"render_mode is {shown(mode)}, must be None or one of {allowed}")


def actions_of_each(count: int, actions: Any) -> Array:
    """Actions (count, 1) as an array of floats.

    Raises:
        ValueError: no numbers, or of another shape.
    """
    try:
        values: Array = np.ascontiguousarray(actions, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(
            f"actions are {shown(actions)}, must be numbers, shape ({count}, 1)"
        ) from None
    if values.shape != (count, 1):
        raise ValueError(f"actions have shape {values.shape}, must have ({count}, 1)")
    return values


def one_action(action: Any) -> Array:
    """The action (1,) of one robot as (1, 1); the number 0 stands for no torque.

    Raises:
        ValueError: it is not one finite number.
    """
    if isinstance(action, int) and action == 0:  # what gymnasium.utils.play does without a key
        return np.zeros((1, 1))
    try:
        values: Array = np.asarray(action, dtype=float)
    except (TypeError, ValueError, OverflowError):
        values = np.empty(0)
    if values.shape != (1,) or not math.isfinite(values.item()):
        raise ValueError(f"action is {shown(action)}, must be one finite number, shape (1,)")
    return values[None]


def known_options(options: dict[str, Any], allowed: Sequence[str]) -> None:
    """Raises ValueError for options of ``reset`` that are not ``allowed``."""
    unknown = sorted({*options} - {*allowed})
    if unknown:
        raise ValueError(f"reset options {unknown} are unknown, must be in {sorted(allowed)}")


def option(
    options: Mapping[str, Any],
    name: str,
    drawn: float,
    low: float | None = None,
    high: float | None = None,
) -> float:
    """An option of ``reset``, or what was drawn in its place.

    Raises:
        ValueError: not finite, or not between ``low`` and ``high``, where these are given.
    """
    if name not in options:
        return drawn
    label = f"options[{name!r}]"
    if low is None or high is None:
        return finite(label, options[name])
    return within(label, options[name], low, high)


def known_parameters(changes: dict[str, Any], allowed: Sequence[str]) -> None:
    """Raises TypeError for what cannot be changed of one robot."""
    unknown = sorted({*changes} - {*allowed})
    if unknown:
        raise TypeError(f"{unknown} cannot be changed, must be in {sorted(allowed)}")


def complete_state(state: Mapping[str, Any], example: Mapping[str, Any]) -> None:
    """Raises ValueError where a state to go on from has not all that ``example`` has."""
    missing = sorted({*example} - {*state})
    if missing:
        raise ValueError(f"state lacks {missing}, must come from get_state()")


def info_keys(value: Any, known: Sequence[str]) -> tuple[str, ...] | None:
    """What information is asked for; None: all. Raises ValueError: not a list of known keys."""
    if value is None:
        return None
    if not (isinstance(value, (list, tuple)) and all(isinstance(key, str) for key in value)):
        raise ValueError(f"info_keys is {shown(value)}, must be None or a list of {sorted(known)}")
    if unknown := sorted(set(value) - set(known)):
        raise ValueError(f"info_keys has {unknown}, must be of {sorted(known)}")
    return tuple(value)
