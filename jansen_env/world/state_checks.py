"""Checks of a saved state, before anything changes to restore a robot to it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from jansen_env import checks
from jansen_env.arrays import Array, Bools
from jansen_env.plants.base import (
    check_deflection,
    check_fixed_chassis,
    check_in_contact,
    check_state,
)
from jansen_env.robot import Robot
from jansen_env.robot.robot_file import robot_from_json
from jansen_env.world.episode_lengths import Build
from jansen_env.world.episode_parameters import Plan
from jansen_env.world.push import check_schedule
from jansen_env.world.saved_states import VERSION
from jansen_env.world.settings import Check, Values, load_robot

if TYPE_CHECKING:
    from jansen_env.world.world import World


class Restored(NamedTuple):
    """A checked saved state of a robot, to which the robot can be restored.

    Attributes:
        record: Fields of the robot's record, by name.
        plan: Parameters, terrain and robot of the episode.
        level: Level of the robot in the curriculum.
        in_contact: Whether each pad was on the ground, shape (pads,), or None if that is not known.
    """

    record: Values
    plan: Plan
    level: int
    in_contact: Bools | None


def check_saved_state(
    world: World, i: int, state: Values, of_task: Mapping[str, Check]
) -> Restored:
    """Check a saved state for ``World.restore``.

    Args:
        world: Simulation of the robot.
        i: Index of the robot.
        state: State that ``World.get_state`` returned.
        of_task: Checks of fields of the task's part of the record, by path.

    Returns:
        The checked state.

    Raises:
        ValueError: If an entry is missing, unknown or out of range.
    """
    if state.get("version") != VERSION:
        raise checks.invalid("state['version']", state.get("version"), VERSION)
    pads = world.plant.pads
    unit = partial(checks.within, low=-1.0, high=1.0)
    positive = partial(checks.within, low=0.0, high=checks.MOST_SINGLE)
    special: dict[str, Check] = {
        "state": partial(_check_motion, world.fixed_chassis),
        "statistics.deflection": lambda name, value: check_deflection(value, pads, name),
        "parameters": lambda name, value: checks.instance(name, value, Mapping),
        "schedule": check_schedule,
        "action": unit,
        "action_before": unit,
        "ground_load.impulse": positive,
        "ground_load.unevenness": positive,
    }
    record = world.saved.check("state['record']", state["record"], {**special, **of_task})
    if "state" not in record:
        raise ValueError("state['record'] must come from get_state(), got one without 'state'")
    build = _check_build(world, i, state)
    robot = build.robot if build else world.robots[i]
    plan, level = world.episodes.planned(i, state, record.get("parameters", {}), robot)
    delay = plan.values["delay"].item()
    checks.within("state['record']['parameters']['delay']", delay, 0.0, world.longest_delay)
    in_contact = check_in_contact(state["in_contact"], pads)
    return Restored(record, plan._replace(build=build), level, in_contact)


def _check_motion(fixed_chassis: bool, name: str, value: object) -> Array:
    """Return the mechanical state of a saved record as an array, shape (8,).

    Raises:
        ValueError: If it is not finite, or moves a fixed chassis.
    """
    motion = check_state(value, name)
    if fixed_chassis:
        check_fixed_chassis(motion)
    return motion


def _check_build(world: World, i: int, state: Values) -> Build | None:
    """Return the robot of a state, or None if the present robot need not be replaced.

    Raises:
        ValueError: If the state contains a robot or lengths that the world cannot restore.
    """
    lengths = world.lengths
    robot: Robot = lengths.constructed[i]
    if "robot" in state:
        if world.fixed_chassis:
            raise ValueError(
                "this environment cannot restore a different robot; remove 'robot' from the state"
            )
        with checks.named_errors("state['robot'] is not a robot", RecursionError):
            robot = robot_from_json(state["robot"])
        load_robot("state['robot']", robot)
    other = robot if robot != lengths.nominal[i] else None
    if other is not None:
        world.plant.check_robot(other)
    return lengths.plan(i, state.get("lengths", {}), None, other)
