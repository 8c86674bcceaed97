"""Walk to a goal and stand there: ``JansenGoal-v0``."""

from jansen_env.tasks.goal.goal_env import JansenGoalEnv, JansenGoalVectorEnv

__all__ = ["JansenGoalEnv", "JansenGoalVectorEnv"]
