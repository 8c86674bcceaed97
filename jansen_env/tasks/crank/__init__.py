"""Turn the crank of a robot with a fixed chassis along a reference: ``JansenCrank-v0``."""

from jansen_env.tasks.crank.crank_env import JansenCrankEnv, JansenCrankVectorEnv

__all__ = ["JansenCrankEnv", "JansenCrankVectorEnv"]
