"""Single robots of a world: changed while they walk, and asked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from jansen_env.parameters import CHANGES, PARAMETERS, check
from jansen_env.world import broadcasting as bc

if TYPE_CHECKING:
    from jansen_env.world.world import World

PLACED = ("delay", "terrain_level")  # what a change of it puts in force at the next reset


def checked(world: World, row: int, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return changes of a robot, ready for :func:`apply`.

    Raises:
        ValueError: one is out of range, or the plant cannot change it.
    """
    physical = sorted({*changes} - {*PLACED})
    if not {*physical} <= world.plant.changeable:
        raise ValueError(f"{physical[0]} cannot be changed with plant='rigid_body'")
    checks: dict[str, Callable[[Any], Any]] = {
        "payload": bc.load_payload,
        "motor": bc.load_motor,
        "pad_compliance": bc.load_compliance,
        "delay": world.checked_delay_range,
        "terrain_level": lambda value: world.episodes.checked_level(row, value),
    }
    checked = {
        name: checks.get(name, partial(check, name, name))(value) for name, value in changes.items()
    }
    world.episodes.check_names(row, [name for name in checked if name in CHANGES], "changes")
    if physical:
        world.episodes.check_change(row, world.robots[row].pad_compliance, checked)
    return checked


def apply(world: World, row: int, checked: dict[str, Any]) -> None:
    """Put changes of a robot and its ground in force."""
    if "delay" in checked:
        world.delay_range[row] = checked["delay"]
    if "terrain_level" in checked:
        world.episodes.level[row] = world.episodes.levels[row] = checked["terrain_level"]
    physical = {name: value for name, value in checked.items() if name not in PLACED}
    if not physical:
        return
    world.plant.change(row, physical)
    world.robots[row] = world.plant.robots[row]
    load = world.robots[row].payload
    place = {"payload_x": load.position[0], "payload_y": load.position[1]}
    for name, value in physical.items():
        numbers = {"payload": load.mass, **place} if name == "payload" else {name: value}
        world.episodes.take(row, numbers if name in PARAMETERS else {})
    world.update_scales(np.array([row]))


def get_attr(world: World, name: str) -> list[Any] | None:
    """Return what each robot has of its own by that name; None for another name.

    Names: ``robot``, ``terrain``, ``terrain_level``, ``payload``, ``motor``,
    ``torque_limit``, ``pad_compliance``, ``delay`` (s, of this episode), ``state``,
    ``weight``, ``reset_noise_scale``, ``friction``, ``restitution`` and
    :data:`jansen_env.parameters.CHANGES`.
    """
    if name == "robot":
        return list(world.robots)
    if name == "terrain":
        return list(world.plant.terrains)
    if name == "terrain_level":
        return list(world.episodes.values["terrain_level"].astype(int).tolist())
    if name in ("payload", "motor", "pad_compliance"):
        return [getattr(robot, name) for robot in world.robots]
    if name == "torque_limit":
        return [robot.motor.torque_limit for robot in world.robots]
    if name == "delay":
        return [world.delay_of(row) for row in range(world.num_envs)]
    if name in ("weight", "reset_noise_scale"):
        return list(getattr(world, name).tolist())
    if name == "state":
        return list(world.plant.states.copy())
    if name in ("friction", "restitution", *CHANGES):
        return list(world.episodes.values[name].tolist())
    return None
