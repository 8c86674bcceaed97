"""Benchmarks of the registered environments, and checks of the environments' arguments."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import cast

import gymnasium as gym
from gymnasium.envs.registration import load_env_creator

from jansen_env.checks import invalid, listed, one_of, positive_integer
from jansen_env.dynamics.projection import leg_sides
from jansen_env.envs.single import SingleEnv
from jansen_env.envs.vector import TaskVectorEnv
from jansen_env.registration import IDS
from jansen_env.scoring.metrics import Benchmark
from jansen_env.tasks.task import Task
from jansen_env.world.settings import Values, load_robot

RETURN_ALONE = Benchmark()
DEFAULT = "JansenWalkerBuilt-v0"  # environment of commands if the user names none
WALKERS = [name for name in IDS if name.startswith("JansenWalker")]


def single_env(env_id: str) -> type[SingleEnv[Task]]:
    """Return the class of the environment of one robot.

    Args:
        env_id: Id of the environment.
    """
    return cast("type[SingleEnv[Task]]", load_env_creator(str(gym.spec(env_id).entry_point)))


def find_benchmark(env_id: str) -> Benchmark:
    """Return the benchmark of an environment.

    An environment that has no benchmark is scored by the return alone. The id is checked
    here because ``gym.make`` would import the module of an id "MODULE:ID".

    Args:
        env_id: Id of the environment.

    Raises:
        ValueError: If no environment of this package has this id.
    """
    entry = single_env(one_of("environment id", env_id, sorted(IDS))).BENCHMARK
    if not entry:
        return RETURN_ALONE
    module, _, name = entry.partition(":")
    benchmark: Benchmark = getattr(importlib.import_module(module), name)
    return benchmark


def can_be_batched(env_id: str, env_kwargs: Values, variants: Sequence[Values] = ({},)) -> bool:
    """Return whether one batch can contain environments with these arguments.

    Args:
        env_id: Id of the environments.
        env_kwargs: Arguments of all environments.
        variants: Further arguments that differ between the environments.
    """
    settings = single_env(env_id).TASK.SETTINGS
    together = settings.defaults("several")
    alone = settings.defaults("single_only")
    given = [variant.get("robot", env_kwargs.get("robot", "paper")) for variant in variants]
    several = (robots if isinstance(robots, (list, tuple)) else [robots] for robots in given)
    each = [robot for robots in several for robot in robots]
    return (
        len({leg_sides(load_robot("robot", robot)) for robot in each}) == 1
        and all(env_kwargs.get(name, value) == value for name, value in alone.items())
        and env_kwargs.get("render_mode") in (None, "rgb_array")
        and all(set(variant) <= {*together, "max_episode_steps"} for variant in variants)
    )


def vector_env(env_id: str) -> type[TaskVectorEnv[Task]]:
    """Return the class of the environment of many robots.

    Args:
        env_id: Id of the environment.
    """
    entry = str(gym.spec(env_id).vector_entry_point)
    return cast("type[TaskVectorEnv[Task]]", load_env_creator(entry))


def check_env_kwargs(env_id: str, env_kwargs: Values) -> None:
    """Check the names of an environment's arguments, and its time limit.

    The environment itself checks the values of its other arguments. Gymnasium's own arguments are
    rejected, because they could make other code run.

    Args:
        env_id: Id of the environment.
        env_kwargs: Arguments of the environment.

    Raises:
        ValueError: If the id or an argument is unknown, if there is no time limit, or if the
            ``render_mode`` opens windows.
    """
    find_benchmark(env_id)
    allowed = {*single_env(env_id).defaults(), "max_episode_steps"}
    if env_kwargs.get("render_mode") == "human":
        raise ValueError("render_mode must be None or 'rgb_array' for many robots, got 'human'")
    for name in env_kwargs:
        if name not in allowed:
            known = listed(sorted(allowed), name)
            raise invalid(f"an argument of {env_id}", name, f"one of {known}")
    if "max_episode_steps" in env_kwargs:  # -1 (no limit) would allow an episode without an end
        positive_integer("max_episode_steps", env_kwargs["max_episode_steps"])
