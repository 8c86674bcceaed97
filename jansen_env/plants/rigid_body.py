"""The rigid-body plant of one robot."""

from __future__ import annotations

from jansen_env.gravity import GRAVITY, Gravity
from jansen_env.plants.plant_of_one import PlantOfOne
from jansen_env.plants.rigid_batch import (
    ITERATIONS,
    TIME_STEP,
    TOUCHDOWN_ITERATIONS,
    RigidBodyBatch,
)
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain


class RigidBodyPlant(PlantOfOne[RigidBodyBatch]):
    """A robot on a terrain, body by body: arguments and errors of :class:`RigidBodyBatch`."""

    def __init__(
        self,
        robot: Robot,
        terrain: Terrain,
        time_step: float = TIME_STEP,
        gravity: Gravity = GRAVITY,
        iterations: int = ITERATIONS,
        touchdown_iterations: int = TOUCHDOWN_ITERATIONS,
        fixed_base: bool = False,
    ) -> None:
        numbers = iterations, touchdown_iterations, fixed_base
        super().__init__(RigidBodyBatch(robot, terrain, time_step, gravity, *numbers))
