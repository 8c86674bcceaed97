"""The rigid-body plant as a batch of one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.engine.records import ROBOT
from jansen_env.parameters import ROBOT_PARAMETERS
from jansen_env.plants.base import ENERGIES, StepResult
from jansen_env.plants.rigid_body import RigidBodyPlant
from jansen_env.plants.trace import PeakLoads
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]


class BatchOfOne:
    """A :class:`jansen_env.plants.base.BatchedPlant` of the one robot of ``plant``."""

    changeable: frozenset[str] = frozenset()
    knows_joint_forces, joints_open, tracing = False, True, False

    def __init__(self, plant: RigidBodyPlant) -> None:
        self.plant, self.honours = plant, plant.honours
        self.robots, self.terrains = [plant.robot], [plant.terrain]
        self.toes, self.time_step = plant.toes, plant.time_step
        self.slip, self.contact_force = np.zeros((1, self.toes)), np.zeros((1, self.toes, 2))
        self.rows, self.joint_gap = np.zeros(1, ROBOT), np.zeros(1)
        self.accumulators = self.rows["accumulators"]
        self.nominal = np.array([plant.nominal], ROBOT_PARAMETERS)
        self.parameters = self.nominal.copy()
        self._know_surface()
        self.diverged, self.any_diverged = np.zeros(1, bool), False

    def _know_surface(self) -> None:
        self.surface: Array = self.terrains[0].polyline.copy()
        self.rows["status"]["end_vertex"] = len(self.surface)

    def set_parameters(self, rows: NDArray[np.int64], values: NDArray[np.void]) -> None:
        for value in values:
            self.plant.set_parameters(value)
            self.parameters[0] = value

    def change(self, row: int, changes: dict[str, Any]) -> None:
        """Refuse all changes with ValueError: this plant is built once."""
        raise ValueError(f"{sorted(changes)} cannot be changed on this plant")

    def set_terrain(self, row: int, terrain: Terrain) -> None:
        self.plant.set_terrain(terrain)
        self.terrains[0] = terrain
        for name in ("friction", "restitution"):
            self.nominal[name] = self.parameters[name] = getattr(terrain, name)
        self._know_surface()

    @property
    def states(self) -> Array:
        """(1, 8) a copy."""
        return self.plant.state[None]

    @property
    def in_contact(self) -> NDArray[np.bool_] | None:
        return self.plant.in_contact

    @in_contact.setter
    def in_contact(self, value: NDArray[np.bool_] | None) -> None:
        self.plant.in_contact = value

    @property
    def deflection(self) -> Array:
        """(1, pads, 2) compression and bend of compliant pads, m, a copy."""
        return self.plant.deflection[None]

    def set_state(self, row: int, state: ArrayLike, deflection: Array | None = None) -> None:
        self.plant.state = np.asarray(state, dtype=float)
        if deflection is not None:
            self.plant.deflection = deflection

    def place(self, rows: NDArray[np.int64], crank_angles: Array) -> None:
        self.plant.reset(0.0, float(crank_angles[0]))
        self._keep(self.plant.lookahead())

    def step(
        self,
        torque: Array,
        steps: int,
        earlier: Array | None = None,
        switch: NDArray[np.int64] | None = None,
        rows: NDArray[np.int64] | None = None,
        meanwhile: Callable[[], None] | None = None,
        pushes: Array | None = None,
    ) -> None:
        """Hold a crank torque (1,), N m; ``meanwhile`` is called afterwards, or alone."""
        if rows is not None and len(rows) == 0:
            if meanwhile is not None:
                meanwhile()
            return
        before, first, push = 0.0, 0, None if pushes is None else pushes[0]
        if earlier is not None and switch is not None:
            before, first = float(earlier[0]), int(switch[0])
        try:
            result = self.plant.step(float(torque[0]), steps * self.time_step, before, first, push)
            self._keep(result)
            lacking = result.torque - float(torque[0])
            self.accumulators["torque_impulse"] = lacking * steps * self.time_step
        except FloatingPointError:
            self.accumulators[:] = 0.0
            self.slip[:] = self.contact_force[:] = self.joint_gap[:] = 0.0
            self.diverged[:] = self.any_diverged = True
        if meanwhile is not None:
            meanwhile()

    def _keep(self, result: StepResult) -> None:
        self.diverged[:] = self.any_diverged = False
        self.slip[0], self.contact_force[0] = result.slip, result.contact_force
        self.joint_gap[0] = result.joint_gap
        sums = self.accumulators
        sums["non_toe_impulse"] = float(result.non_toe_contact)
        sums["worst_residual"] = result.residual
        for name in ENERGIES:
            sums[name] = getattr(result, name)

    def contact_frames(self, row: int) -> tuple[Array, Array]:
        return self.plant.contact_frames()

    def joint_forces(self, torque: float = 0.0, push: Array | None = None) -> JointForces:
        """Raise ValueError: they are not known."""
        raise ValueError("joint forces are not known on this plant")

    def peak_loads(self) -> PeakLoads:
        """Raise ValueError: they are not known."""
        raise ValueError("joint loads are not known on this plant")

    def close(self) -> None:
        """Nothing is held."""
