"""jansen_env: the Theo Jansen walking linkage as a Gymnasium environment."""

from jansen_env.cli.loading import end_quietly_while_loading

end_quietly_while_loading()  # before the imports that take most of the time

from typing import TYPE_CHECKING, Any

from jansen_env.registration import register
from jansen_env.robot import (
    ROBOTS,
    Bar,
    Compliance,
    Leg,
    Payload,
    Robot,
    Spring,
    TorsionSpring,
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
from jansen_env.terrain.generators import Curriculum
from jansen_env.world.observations import Noise
from jansen_env.world.push import Push

if TYPE_CHECKING:
    from jansen_env.scoring.evaluation import evaluate

__version__ = "1.0.0rc1"

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
    "Spring",
    "Terrain",
    "TorsionSpring",
    "Triangle",
    "built_robot",
    "evaluate",
    "holy_numbers_robot",
    "paper_robot",
    "phased_legs",
    "robot_from_joints",
]

for _id, _environment, _steps, _solved in (  # docs/training.md explains the reward thresholds
    ("JansenWalker-v0", "walking:JansenWalkerEnv", 500, 155.0),
    ("JansenWalkerBuilt-v0", "walking:JansenWalkerBuiltEnv", 500, 180.0),
    ("JansenWalkerRough-v0", "walking:JansenWalkerRoughEnv", 500, 240.0),
    ("JansenWalkerHardcore-v0", "walking:JansenWalkerHardcoreEnv", 500, 205.0),
    ("JansenCrank-v0", "crank:JansenCrankEnv", 1000, 875.0),
    ("JansenGoal-v0", "goal:JansenGoalEnv", 750, 2390.0),
):
    register(_id, f"jansen_env.tasks.{_environment}", _steps, _solved)


def __getattr__(name: str) -> Any:
    """Import :func:`jansen_env.scoring.evaluation.evaluate` on demand."""
    if name == "evaluate":
        from jansen_env.scoring.evaluation import evaluate

        return evaluate
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
