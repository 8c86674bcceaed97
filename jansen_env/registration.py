"""Registration of environments, with Gymnasium and with the commands of this package."""

from __future__ import annotations

from gymnasium.envs import registration

IDS: list[str] = []  # registered here: what commands, train.py and tests find


def register(
    env_id: str,
    environment: str,
    max_episode_steps: int | None = None,
    reward_threshold: float | None = None,
) -> None:
    """Register an environment of one robot, and that of many.

    Args:
        env_id: such as "JansenWalker-v0". environment: "module:NameEnv"; that of many is
            "module:NameVectorEnv". In the module's folder training configurations are
            ``training/ID/ALGORITHM.yml``.
        max_episode_steps: of ``gym.make``; None for no limit.
        reward_threshold: mean return from which it counts as solved; None if not known.
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
