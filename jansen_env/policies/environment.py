"""Checks of a policy's file, which may come from anybody, against the environment that it names.

They need the environment's arguments only, and build no environment.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import load_env_creator

from jansen_env.checks import one_of, positive_integer, within
from jansen_env.plants.make import plant_time_step
from jansen_env.world.argument_checks import control_period

SHORTEST_PERIOD, LONGEST_PERIOD = 1e-4, 1.0  # s, for which an action is held
MOST_TIME_STEPS = 200_000  # of an episode; walkers have 10,000 by default


def arguments_of(env_id: str) -> dict[str, Any]:
    """Return the default arguments of an environment of this package, and its time limit.

    Raises:
        ValueError: the package has no environment of this id.
    """
    specs = {name: spec for name, spec in gym.registry.items()
             if str(spec.entry_point).startswith("jansen_env.")}  # fmt: skip
    env: Any = load_env_creator(str(specs[one_of("env.id", env_id, sorted(specs))].entry_point))
    parameters = inspect.signature(env).parameters
    limit = {"max_episode_steps": specs[env_id].max_episode_steps}
    return {name: parameter.default for name, parameter in parameters.items()} | limit


def check_action(
    env_id: str, env_kwargs: Mapping[str, Any], torque_limit: float, control_dt: float
) -> None:
    """Check a policy's torque limit (N m) and control period (s) against its environment.

    Raises:
        ValueError: they differ; there is no such environment; the period is out of range; or an
            episode has no end, or more than :data:`MOST_TIME_STEPS` time steps.
    """
    given = {**arguments_of(env_id), **env_kwargs}
    env: Any = load_env_creator(str(gym.registry[env_id].entry_point))
    robot = env.TASK.WORLD.driven_robot(given["robot"], given["motor"], given["torque_limit"])
    plant = given.get("plant", "projection")  # the crank has none to choose
    period, step = control_period(given["control_dt"], plant_time_step(plant, given["time_step"]))
    for name, own, needed in (
        ("torque_limit", torque_limit, robot.motor.torque_limit),
        ("control_dt", control_dt, within("control_dt", period, SHORTEST_PERIOD, LONGEST_PERIOD)),
    ):
        if not math.isclose(own, needed):
            raise ValueError(f"{name} is {own}, must be {needed} as of {env_id} with env.kwargs")
    steps = positive_integer("max_episode_steps", given["max_episode_steps"])
    if (count := steps * round(period / step)) > MOST_TIME_STEPS:
        raise ValueError(
            f"max_episode_steps is {steps} with control_dt {period} and time_step {step}, "
            f"{count} time steps, must be at most {MOST_TIME_STEPS} of these"
        )
