"""Registration of environments with Gymnasium and with the commands of this package."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import gymnasium as gym
from gymnasium.envs import registration

IDS: list[str] = []  # ids of all environments registered here, for commands, train.py and tests


def register(
    env_id: str,
    environment: str,
    max_episode_steps: int | None = None,
    reward_threshold: float | None = None,
) -> None:
    """Register an environment of one robot, and the vector environment of several robots.

    The training configurations of the environment are ``training/ID/ALGORITHM.yml`` in the folder
    of its module.

    Args:
        env_id: Id of the environment, such as "JansenWalker-v0".
        environment: Class of the environment of one robot, as "module:NameEnv". The class of the
            vector environment is "module:NameVectorEnv".
        max_episode_steps: Number of steps after which ``gym.make`` truncates episodes. None for no
            limit.
        reward_threshold: Mean return from which the environment counts as solved. None if this is
            not known.
    """
    registration.register(
        id=env_id,
        entry_point=environment,
        vector_entry_point=f"{environment.removesuffix('Env')}VectorEnv",
        max_episode_steps=max_episode_steps,
        reward_threshold=reward_threshold,
    )
    if env_id not in IDS:
        IDS.append(env_id)


def training_folder(env_id: str) -> Path:
    """Return the folder of an environment's training configurations, which is next to its module.

    Args:
        env_id: Id of the environment.
    """
    module = str(gym.spec(env_id).entry_point).partition(":")[0]
    return Path(str(import_module(module).__file__)).parent / "training" / env_id
