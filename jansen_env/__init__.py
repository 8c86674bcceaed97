"""jansen_env: the Theo Jansen walking linkage as a Gymnasium environment."""

from gymnasium.envs.registration import register

from jansen_env.robot import (
    ROBOTS,
    Bar,
    Compliance,
    Leg,
    Payload,
    Robot,
    Triangle,
    built_robot,
    holy_numbers_robot,
    paper_robot,
    phased_legs,
)
from jansen_env.robot.kinematics import LinkageError
from jansen_env.robot.motor import MOTORS, Motor
from jansen_env.terrain import Terrain
from jansen_env.terrain.curriculum import Curriculum
from jansen_env.world.noise import Noise
from jansen_env.world.push import Push

__version__ = "0.1.0"

__all__ = [
    "MOTORS",
    "ROBOTS",
    "Bar",
    "Compliance",
    "Curriculum",
    "Leg",
    "LinkageError",
    "Motor",
    "Noise",
    "Payload",
    "Push",
    "Robot",
    "Terrain",
    "Triangle",
    "built_robot",
    "holy_numbers_robot",
    "paper_robot",
    "phased_legs",
]

register(
    id="JansenWalker-v0",
    entry_point="jansen_env.envs.walker:JansenWalkerEnv",
    vector_entry_point="jansen_env.envs.walker:JansenWalkerVectorEnv",
    max_episode_steps=500,
)

register(
    id="JansenWalkerBuilt-v0",
    entry_point="jansen_env.envs.presets:JansenWalkerBuiltEnv",
    vector_entry_point="jansen_env.envs.presets:JansenWalkerBuiltVectorEnv",
    max_episode_steps=500,
)

register(
    id="JansenCrank-v0",
    entry_point="jansen_env.envs.crank_env:JansenCrankEnv",
    vector_entry_point="jansen_env.envs.crank_env:JansenCrankVectorEnv",
    max_episode_steps=1000,
)

register(
    id="JansenGoal-v0",
    entry_point="jansen_env.envs.goal_env:JansenGoalEnv",
    vector_entry_point="jansen_env.envs.goal_env:JansenGoalVectorEnv",
    max_episode_steps=750,
)

register(
    id="JansenWalkerRough-v0",
    entry_point="jansen_env.envs.presets:JansenWalkerRoughEnv",
    vector_entry_point="jansen_env.envs.presets:JansenWalkerRoughVectorEnv",
    max_episode_steps=500,
)

register(
    id="JansenWalkerHardcore-v0",
    entry_point="jansen_env.envs.presets:JansenWalkerHardcoreEnv",
    vector_entry_point="jansen_env.envs.presets:JansenWalkerHardcoreVectorEnv",
    max_episode_steps=500,
)
