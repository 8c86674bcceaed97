"""Arguments of n robots: one value for all, or one for each.

All functions raise ValueError for a value out of range, or not one for each robot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import (
    entries,
    instance,
    non_negative,
    positive,
    positive_integer,
    shown,
    within,
)
from jansen_env.parameters import LONGEST_DELAY
from jansen_env.robot import ROBOTS, Compliance, Payload, Robot
from jansen_env.robot.motor import MOTORS, Motor
from jansen_env.terrain import Terrain, make_terrain
from jansen_env.terrain.curriculum import Curriculum
from jansen_env.terrain.generators import HIGHEST, make_generator
from jansen_env.world.episode_parameters import Terrains
from jansen_env.world.randomization import Randomization
from jansen_env.world.settings import Ground, Machine

Array = NDArray[np.float64]

FLAT = Terrain.flat()  # where a robot stands before its ground is drawn
FURTHEST_SCAN, MOST_SCANNED = 100.0, 1000  # m, and places, of a height scan


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


def load_curriculum(curriculum: Any) -> Curriculum | None:
    """A curriculum; True stands for the default one, None and False for none."""
    if curriculum is None or isinstance(curriculum, (bool, np.bool_)):
        return Curriculum() if curriculum else None
    instance("curriculum", curriculum, Curriculum)
    found: Curriculum = curriculum
    return found


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


def entries_of(name: str, value: Any, count: int) -> list[Any]:
    """``count`` values: the entries of a sequence or array (count,), or one value repeated."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, (list, tuple)):
        return [value] * count
    if len(value) != count:
        raise ValueError(f"{name} has {len(value)} entries, must have {count}, or be one")
    return list(value)


def broadcast_terrains(count: int, ground: Ground) -> Terrains:
    """Return ``count`` terrains from one, or from one for each; friction, restitution likewise."""
    terrain, friction, restitution = ground.terrain, ground.friction, ground.restitution
    several = isinstance(terrain, Each) or (
        isinstance(terrain, (list, tuple))
        and all(isinstance(one, (Terrain, str)) or callable(one) for one in terrain)
    )
    chosen_terrains = entries_of("terrain", terrain, count) if several else [terrain] * count
    different = {id(one): one for one in chosen_terrains}
    known = {key: make_generator(one) for key, one in different.items()}
    generators = [known[id(one)] for one in chosen_terrains]
    fixed = [
        FLAT if generator else one
        for one, generator in zip(chosen_terrains, generators, strict=True)
    ]
    frictions = [
        None if one is None else non_negative("friction", one)
        for one in entries_of("friction", friction, count)
    ]
    restitutions = [
        None if one is None else within("restitution", one, 0.0, 1.0)
        for one in entries_of("restitution", restitution, count)
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
    return Terrains(terrains, generators, own_friction, own_restitution)


def broadcast_randomizations(count: int, randomize: Any) -> list[Randomization]:
    """``count`` randomisations from one, or from one for each."""
    made: dict[int, Randomization] = {}
    each = entries_of("randomize", randomize, count)
    for one in each:
        if id(one) not in made:
            made[id(one)] = Randomization(one)
    return [made[id(one)] for one in each]


def broadcast_levels(count: int, terrain_level: Any) -> Array:
    """(count, 2) lowest and highest terrain level, from one, (low, high), or one for each."""
    levels = broadcast_ranges(count, "terrain_level", terrain_level, 0, HIGHEST)
    if (levels != np.round(levels)).any():
        raise ValueError(f"terrain_level is {shown(terrain_level)}, must be whole numbers")
    return levels


def broadcast_robots(count: int, machine: Machine) -> list[Robot]:
    """Return ``count`` robots of one design, with one payload, motor ... or with one for each."""
    parts: dict[str, tuple[Any, Callable[[Any], Any]]] = {
        "payload": (machine.payload, load_payload),
        "motor": (machine.motor, load_motor),
        "pad_compliance": (machine.pad_compliance, load_compliance),
        "torque_limit": (machine.torque_limit, lambda value: positive("torque_limit", value)),
    }
    columns = [
        [None if one is None else load(one) for one in entries_of(name, value, count)]
        for name, (value, load) in parts.items()
    ]
    made: dict[Any, Robot] = {}
    robots = []
    for chosen in zip(*columns, strict=True):
        if chosen not in made:
            *fields, limit = chosen
            changes = dict(zip(parts, fields, strict=False))
            changes = {name: value for name, value in changes.items() if value is not None}
            one = replace(load_robot(machine.robot), **changes)
            if limit is not None:
                one = replace(one, motor=replace(one.motor, torque_limit=limit))
            made[chosen] = one
        robots.append(made[chosen])
    return robots


def broadcast_delays(count: int, delay: Any) -> Array:
    """(count, 2) ranges of the actions' delay, s, see :func:`broadcast_ranges`."""
    return broadcast_ranges(count, "delay", delay, 0.0, LONGEST_DELAY)


def broadcast_ranges(count: int, name: str, value: Any, least: float, most: float) -> Array:
    """(count, 2) ranges between ``least`` and ``most``.

    Args:
        value: a number or (low, high) for all; an array (count,) of numbers, or an array
            (count, 2) or list of ranges for each.
    """
    several = isinstance(value, (np.ndarray, Each)) or (
        isinstance(value, (list, tuple))
        and any(isinstance(one, (list, tuple, np.ndarray)) for one in value)
    )
    values = entries_of(name, value, count) if several else [value] * count
    return np.array([number_range(name, one, least, most) for one in values])


def scanned_places(scan: Any) -> Array:
    """(count,) m, places from the crank axis at which a robot looks at the ground.

    Args:
        scan: (behind, ahead, count); None for none.
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


def broadcast_numbers(
    count: int, name: str, value: Any, check: Callable[[str, Any], float]
) -> Array:
    """Return (count,) numbers from one, or from one for each, each through ``check``."""
    return np.array([check(name, one) for one in entries_of(name, value, count)])
