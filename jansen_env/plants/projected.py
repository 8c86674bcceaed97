"""The projection plant: pymunk finds the ground, the projected equations feel it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.dynamics.reduced import Tables
from jansen_env.gravity import GRAVITY, Gravity
from jansen_env.plants.batch import DETECTION_INTERVAL, TIME_STEP, Batch
from jansen_env.plants.plant_of_one import PlantOfOne
from jansen_env.plants.trace import PeakLoads
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain


class ProjectionPlant(PlantOfOne[Batch]):
    """A robot on a terrain, by the projected equations: arguments and errors of :class:`Batch`."""

    def __init__(
        self,
        robot: Robot,
        terrain: Terrain,
        time_step: float = TIME_STEP,
        gravity: Gravity = GRAVITY,
        detection_interval: float = DETECTION_INTERVAL,
        held: bool = False,
    ) -> None:
        super().__init__(Batch([robot], [terrain], time_step, gravity, detection_interval, 1, held))

    @property
    def detection_interval(self) -> float:
        """Time between two looks for the ground, s."""
        return self.batch.detection_interval

    @property
    def tables(self) -> Tables:
        """The compiled robot under its parameters."""
        return self.batch.tables_in_force(0)

    @property
    def prescribed_crank_speed(self) -> bool:
        """Whether the crank keeps its speed whatever torque that takes: locked, if it stands."""
        return bool(self.batch.params["prescribed_speed"][0])

    @prescribed_crank_speed.setter
    def prescribed_crank_speed(self, driven: bool) -> None:
        self.batch.params["prescribed_speed"] = bool(driven)

    @property
    def tracing(self) -> bool:
        """Whether :meth:`step` keeps a record of its time steps in :attr:`trace`."""
        return self.batch.tracing

    @tracing.setter
    def tracing(self, value: bool) -> None:
        self.batch.tracing = bool(value)

    @property
    def trace(self) -> NDArray[np.void]:
        """(steps,) time steps of the last :meth:`step` or :meth:`lookahead`, see :class:`Batch`."""
        return self.batch.trace

    @property
    def touchdowns(self) -> NDArray[np.bool_]:
        """(steps,) whether a pad touched down in each time step of the last traced :meth:`step`."""
        return self.batch.touchdowns

    def joint_forces(
        self, torque: float = 0.0, push: NDArray[np.float64] | None = None
    ) -> JointForces:
        """Mean forces in every joint over the next time step under a crank torque (N m).

        They contain a landing toe's impulse / time step. ``push``: see :meth:`lookahead`.
        """
        return self.batch.joint_forces(torque, push)

    def peak_loads(self) -> PeakLoads:
        """The largest loads on any joint in the last :meth:`step`, which must have been traced."""
        return self.batch.peak_loads()
