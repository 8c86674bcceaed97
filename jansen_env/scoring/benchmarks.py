"""The benchmarks of registered environments, and their arguments, checked."""

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
DEFAULT = "JansenWalkerBuilt-v0"  # of the commands, where no other is named
WALKERS = [name for name in IDS if name.startswith("JansenWalker")]


def single_env(env_id: str) -> type[SingleEnv[Task]]:
    """The environment of one robot."""
    return cast("type[SingleEnv[Task]]", load_env_creator(str(gym.spec(env_id).entry_point)))


def find_benchmark(env_id: str) -> Benchmark:
    """Return the benchmark of an environment, by default one of the return alone.

    No other id may reach ``gym.make``, which imports "MODULE:ID".

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
    """Whether one batch can hold environments with these arguments."""
    settings = single_env(env_id).TASK.SETTINGS
    together, alone = settings.defaults("several"), settings.defaults("single_only")
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
    """The environment of many robots."""
    entry = str(gym.spec(env_id).vector_entry_point)
    return cast("type[TaskVectorEnv[Task]]", load_env_creator(entry))


def check_env_kwargs(env_id: str, env_kwargs: Values) -> None:
    """Check the names of an environment's arguments, and its time limit; it checks the rest itself.

    Gymnasium's own arguments, with which other code could be made to run, are refused.

    Raises:
        ValueError: an unknown id or argument, no time limit, or a ``render_mode`` with windows.
    """
    find_benchmark(env_id)
    allowed = {*single_env(env_id).defaults(), "max_episode_steps"}
    if env_kwargs.get("render_mode") == "human":
        raise ValueError("render_mode must be None or 'rgb_array' for many robots, got 'human'")
    for name in env_kwargs:
        if name not in allowed:
            known = listed(sorted(allowed), name)
            raise invalid(f"an argument of {env_id}", name, f"in {known}")
    if "max_episode_steps" in env_kwargs:  # -1, no limit, would be an episode without an end
        positive_integer("max_episode_steps", env_kwargs["max_episode_steps"])
