"""jansen_env: the Theo Jansen walking linkage as a Gymnasium environment."""

from typing import TYPE_CHECKING, Any

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
    robot_from_joints,
)
from jansen_env.robot.kinematics import LinkageError
from jansen_env.robot.motor import MOTORS, Motor
from jansen_env.terrain import Terrain
from jansen_env.terrain.curriculum import Curriculum
from jansen_env.world.noise import Noise
from jansen_env.world.push import Push

if TYPE_CHECKING:
    from jansen_env.scoring.evaluation import evaluate

__version__ = "0.1.0"

__all__ = [
    "MOTORS", "ROBOTS", "Bar", "Compliance", "Curriculum", "Leg", "LinkageError", "Motor", "Noise",
    "Payload", "Push", "Robot", "Terrain", "Triangle", "built_robot", "evaluate",
    "holy_numbers_robot", "paper_robot", "phased_legs", "robot_from_joints",
]  # fmt: skip

for _name, _entry, _steps, _solved in (
    ("JansenWalker", "walker:JansenWalker", 500, 180.0),
    ("JansenWalkerBuilt", "presets:JansenWalkerBuilt", 500, 300.0),
    ("JansenCrank", "crank_env:JansenCrank", 1000, 875.0),
    ("JansenGoal", "goal_env:JansenGoal", 750, 770.0),
    ("JansenWalkerRough", "presets:JansenWalkerRough", 500, 140.0),
    ("JansenWalkerHardcore", "presets:JansenWalkerHardcore", 500, 110.0),
):
    register(
        id=f"{_name}-v0",
        entry_point=f"jansen_env.envs.{_entry}Env",
        vector_entry_point=f"jansen_env.envs.{_entry}VectorEnv",
        max_episode_steps=_steps,
        reward_threshold=_solved,  # docs/training.md says where they come from
    )


def __getattr__(name: str) -> Any:
    """Import on demand: :func:`jansen_env.scoring.evaluation.evaluate`."""
    if name == "evaluate":
        from jansen_env.scoring.evaluation import evaluate

        return evaluate
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
