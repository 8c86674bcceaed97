"""Walk at a commanded speed: ``JansenWalker-v0`` and its presets."""

from jansen_env.tasks.walking.presets import (
    JansenWalkerBuiltEnv,
    JansenWalkerBuiltVectorEnv,
    JansenWalkerHardcoreEnv,
    JansenWalkerHardcoreVectorEnv,
    JansenWalkerRoughEnv,
    JansenWalkerRoughVectorEnv,
)
from jansen_env.tasks.walking.walker_env import JansenWalkerEnv, JansenWalkerVectorEnv

__all__ = [
    "JansenWalkerBuiltEnv",
    "JansenWalkerBuiltVectorEnv",
    "JansenWalkerEnv",
    "JansenWalkerHardcoreEnv",
    "JansenWalkerHardcoreVectorEnv",
    "JansenWalkerRoughEnv",
    "JansenWalkerRoughVectorEnv",
    "JansenWalkerVectorEnv",
]
