"""Environments for Stable-Baselines3, and policies trained with it. Imported on demand."""

from jansen_env.sb3.trained import load_policy
from jansen_env.sb3.vec_env import BatchVecEnv, make_vec_env

__all__ = ["BatchVecEnv", "load_policy", "make_vec_env"]
