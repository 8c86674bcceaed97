"""Follow a turning reference with the crank of a held robot: ``JansenCrank-v0``."""

from jansen_env.tasks.crank.crank_env import JansenCrankEnv, JansenCrankVectorEnv

__all__ = ["JansenCrankEnv", "JansenCrankVectorEnv"]
