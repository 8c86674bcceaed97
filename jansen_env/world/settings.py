"""Keyword arguments of the world as frozen records, and the robots and terrains they give.

All functions raise ValueError for a value out of range.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, TypedDict

import numpy as np

from jansen_env import checks
from jansen_env.checks import instance, listed, load_record, non_negative, positive, shown, within
from jansen_env.parameters import LONGEST_DELAY
from jansen_env.plants.plant import plant_time_step
from jansen_env.robot import ROBOTS, Compliance, Payload, Robot
from jansen_env.robot.motor import MOTORS, Motor
from jansen_env.robot.robot_file import read_robot
from jansen_env.terrain import Terrain, make_terrain
from jansen_env.terrain.curriculum import Curriculum
from jansen_env.terrain.generators import HIGHEST, Generator, make_generator
from jansen_env.world import argument_checks as arguments
from jansen_env.world.argument_checks import Array, Filled, PerRobot, optional, per_robot, single
from jansen_env.world.noise import Noise
from jansen_env.world.push import Push
from jansen_env.world.randomization import load_randomization

FLAT = Terrain.flat()  # where a robot stands before its ground is drawn
FURTHEST_SCAN, MOST_SCANNED = 100.0, 1000  # m, and places, of a height scan


def _by_name(kind: type, known: Mapping[str, Any], name: str, value: Any) -> Any:
    """Return a value of a type, or a known one by its name."""
    if isinstance(value, kind):
        return value
    if not isinstance(value, str) or value not in known:
        allowed = f"a {kind.__name__} or one of {listed(sorted(known), value)}"
        raise ValueError(f"{name} is {shown(value)}, must be {allowed}")
    return known[value]


def load_robot(name: str, value: Any) -> Robot:
    """A robot by itself, by the name of a design, or by the path of its file."""
    if isinstance(value, (str, Path)) and str(value).endswith(".json"):
        return read_robot(value)
    robot = _by_name(Robot, ROBOTS, name, value)
    return robot if isinstance(robot, Robot) else _built_in(value)


@cache
def _built_in(name: str) -> Robot:
    return ROBOTS[name]()


load_motor = partial(_by_name, Motor, MOTORS)
load_compliance = partial(instance, kind=Compliance)


def load_payload(name: str, value: Any) -> Payload:
    """A payload by itself or by its mass at the crank axis, kg."""
    return value if isinstance(value, Payload) else Payload(non_negative(name, value))


def load_curriculum(name: str, value: Any) -> Curriculum | None:
    """A curriculum; True stands for the default one, None and False for none."""
    if value is None or isinstance(value, (bool, np.bool_)):
        return Curriculum() if value else None
    return instance(name, value, Curriculum)


def _plant_name(name: str, value: Any) -> str:
    plant_time_step(value)  # which refuses another
    return value


def _terrains(count: int, name: str, value: Any) -> list[Any]:
    several = isinstance(value, arguments.Each) or (
        isinstance(value, (list, tuple))
        and all(isinstance(one, (Terrain, str)) or callable(one) for one in value)
    )
    return arguments.entries_of(name, value, count) if several else [value] * count


def _levels(count: int, name: str, value: Any) -> Array:
    levels = arguments.broadcast_ranges(count, name, value, 0, HIGHEST)
    if (levels != np.round(levels)).any():
        raise ValueError(f"{name} is {shown(value)}, must be whole numbers")
    return levels


def scanned_places(name: str, scan: Any) -> Array:
    """(count,) m, places from the crank axis, of (behind, ahead, count); none for None."""
    if scan is None:
        return np.empty(0)
    allowed = "None or (behind, ahead, count)"
    values = checks.entries(name, scan, allowed)
    if len(values) != 3:
        raise ValueError(f"{name} is {shown(scan)}, must be {allowed}")
    behind, ahead = (within(f"{name}[{i}]", values[i], 0.0, FURTHEST_SCAN) for i in (0, 1))
    return np.linspace(
        -behind, ahead, checks.positive_integer(f"{name}[2]", values[2], MOST_SCANNED)
    )


class Machine(TypedDict, total=False):
    """The robot. A torque limit of None is the motor's, other Nones are the robot's own."""

    robot: Annotated[PerRobot[Robot | str | Path], per_robot("paper", load_robot)]
    payload: Annotated[PerRobot[Payload | float | None], per_robot(None, optional(load_payload))]
    motor: Annotated[PerRobot[Motor | str | None], per_robot(None, optional(load_motor))]
    torque_limit: Annotated[PerRobot[float | None], per_robot(None, optional(positive))]
    pad_compliance: Annotated[
        PerRobot[Compliance | None], per_robot(None, optional(load_compliance))
    ]


class Control(TypedDict, total=False):
    """Actuation and simulation; times in s."""

    delay: Annotated[PerRobot[arguments.Range], arguments.range_per_robot(0.0, 0.0, LONGEST_DELAY)]
    control_dt: Annotated[float, field(default=0.02)]
    time_step: Annotated[float | None, field(default=None)]
    plant: Annotated[str, single("projection", _plant_name, only=True)]
    track_joint_forces: Annotated[bool, single(False, arguments.flag, only=True)]


class Ground(TypedDict, total=False):
    """The terrain, or how it is drawn."""

    terrain: Annotated[
        PerRobot[Terrain | str | Generator | Sequence[Sequence[float]]],
        arguments.broadcast_by("flat", _terrains),
    ]
    friction: Annotated[PerRobot[float | None], per_robot(None, optional(non_negative))]
    restitution: Annotated[
        PerRobot[float | None], per_robot(None, optional(partial(within, low=0.0, high=1.0)))
    ]
    terrain_level: Annotated[PerRobot[int | Sequence[int]], arguments.broadcast_by(0, _levels)]
    curriculum: Annotated[Curriculum | bool | None, single(None, load_curriculum)]


class Randomness(TypedDict, total=False):
    """Randomisation between episodes; the starting crank speed in rad/s."""

    randomize: Annotated[PerRobot[Mapping[str, Any] | None], per_robot(None, load_randomization)]
    reset_noise_scale: Annotated[PerRobot[float], per_robot(0.1, arguments.start_noise)]


class Sensing(TypedDict, total=False):
    """Sensors, their noise, and pushes."""

    height_scan: Annotated[Sequence[float] | None, single(None, scanned_places)]
    noise: Annotated[Noise | Mapping[str, Any] | None, single(None, partial(load_record, Noise))]
    push: Annotated[Push | Mapping[str, Any] | None, single(None, partial(load_record, Push))]
    observe_lengths: Annotated[bool, single(False, arguments.flag)]


RECORDS = {
    "machine": Machine, "control": Control, "ground": Ground, "randomness": Randomness,
    "sensing": Sensing,
}  # fmt: skip
"""The world's records by the names under which it takes them."""


def equip(
    robot: Robot,
    payload: Payload | None = None,
    motor: Motor | None = None,
    pad_compliance: Compliance | None = None,
    torque_limit: float | None = None,
) -> Robot:
    """Return a robot with other parts, where they are not None."""
    given = {"payload": payload, "motor": motor, "pad_compliance": pad_compliance}
    parts: dict[str, Any] = {name: one for name, one in given.items() if one is not None}
    own = replace(robot, **parts)
    limit = own.motor.torque_limit if torque_limit is None else torque_limit
    return replace(own, motor=replace(own.motor, torque_limit=limit))


def make_robots(machine: Filled) -> list[Robot]:
    """Return robots, each with its payload, motor ...; those made of the same parts are one."""
    made: dict[Any, Robot] = {}
    parts = machine.payload, machine.motor, machine.pad_compliance, machine.torque_limit
    robots = []
    for robot, *chosen in zip(machine.robot, *parts, strict=True):
        key = (id(robot), *chosen)
        if key not in made:
            made[key] = equip(robot, *chosen)
        robots.append(made[key])
    return robots


def make_terrains(ground: Filled) -> tuple[list[Terrain], list[Generator | None]]:
    """Return terrains, flat where they are drawn at each reset, and the generators that draw."""
    different = {id(one): one for one in ground.terrain}
    known = {key: make_generator(one) for key, one in different.items()}
    made: dict[Any, Terrain] = {}  # robots on equal ground share it
    terrains = []
    for one, *numbers in zip(ground.terrain, ground.friction, ground.restitution, strict=True):
        key = (id(one), *numbers)
        if key not in made:
            made[key] = make_terrain(FLAT if known[id(one)] else one, *numbers)
        terrains.append(made[key])
    return terrains, [known[id(one)] for one in ground.terrain]
