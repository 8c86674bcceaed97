"""The plants of one robot, views of a batch of one, and plants by name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jansen_env.arrays import Array
from jansen_env.checks import finite, one_of, positive
from jansen_env.dynamics.reduced import Tables
from jansen_env.gravity import GRAVITY, Gravity
from jansen_env.parameters import EPISODE
from jansen_env.plants.base import StepResult, check_pushes, check_state
from jansen_env.plants.batch import TIME_STEP, Batch
from jansen_env.plants.batched_plant import BatchedPlant
from jansen_env.plants.rigid.rigid_batch import TIME_STEP as RIGID_TIME_STEP
from jansen_env.plants.rigid.rigid_batch import RigidBodyBatch
from jansen_env.plants.robot_records import RobotRecords
from jansen_env.robot import Robot
from jansen_env.terrain import Ground

FIRST = np.zeros(1, np.int64)


class Plant:
    """A robot on a terrain: reset, step(torque), state. It is a :attr:`batch` of one."""

    batch: BatchedPlant

    def __init__(self, batch: BatchedPlant) -> None:
        self.batch = batch
        self.time_step, self.toes = batch.time_step, batch.toes

    @property
    def robot(self) -> Robot:
        """The robot, without parameters."""
        return self.batch.robots[0]

    @property
    def terrain(self) -> Ground:
        """The terrain, without parameters."""
        return self.batch.terrains[0]

    @property
    def state(self) -> Array:
        """(8,) x, y, theta, psi and their rates, a copy; x, y the crank axis, m, rad, s."""
        return self.batch.states[0].copy()

    @state.setter
    def state(self, value: Array) -> None:
        self.batch.set_state(0, check_state(value))

    @property
    def x(self) -> float:
        """Position of the crank axis along the ground, m."""
        return float(self.batch.states[0, 0])

    def set_parameters(self, values: np.void) -> None:
        """Put parameters in force, see :meth:`Batch.set_parameters`."""
        self.batch.set_parameters(FIRST, np.array([values], EPISODE))

    def reset(self, x: float = 0.0, crank_angle: float = 0.0, pitch: float | None = None) -> Array:
        """Place the robot at rest, see :meth:`Batch.place_at`; returns the new state (8,)."""
        self.batch.place_at(FIRST, np.array([finite("crank_angle", crank_angle)]), x, pitch)
        return self.state

    def lookahead(self, torque: float = 0.0, push: Array | None = None) -> StepResult:
        """Result of the next time step (rigid bodies: 10 ms); the state stays as it is.

        ``push``: (2,) N s, the impulse on the chassis in the first time step, None for none.
        """
        pushes = None if push is None else check_pushes(push)[None, None]
        self.batch.lookahead(torque, pushes=pushes)
        return self._result(torque, self.batch.lookahead_steps)

    def step(self, torque: float, duration: float, pushes: Array | None = None) -> StepResult:
        """Hold a crank torque for a while.

        Args:
            torque: N m on the crank, counter-clockwise positive (and its reaction on the chassis).
            duration: s, rounded to whole time steps.
            pushes: (steps, 2) as of one robot in :meth:`Batch.step`.

        Raises:
            ValueError: a duration out of range, or pushes of another shape.
            FloatingPointError: the simulation diverged: a speed that nothing has, a pad deep in the
                ground; with rigid bodies also a joint that came apart, or a robot at the end of the
                ground. The state is as it was before.
        """
        steps = max(1, round(positive("duration", duration) / self.time_step))
        impulses = None if pushes is None else check_pushes(pushes, steps)[None]
        self.batch.step(np.array([torque], dtype=float), steps, pushes=impulses)
        return self._result(torque, steps)

    def _result(self, torque: float, steps: int) -> StepResult:
        """Return the result of the batch's last step, of so many time steps."""
        batch = self.batch
        if batch.any_diverged:
            raise batch.refusal(torque)
        total = batch.accumulators[0]
        sums = dict(zip(total.dtype.names or (), total.item(), strict=True))
        return StepResult(
            slip=batch.slip[0].copy(),
            contact_force=batch.contact_force[0].copy(),
            non_toe_contact=sums["non_toe_impulse"] > 0.0,
            residual=sums["worst_residual"],
            joint_gap=float(batch.joint_gap[0]),
            torque=torque + sums["torque_impulse"] / (steps * self.time_step),
            **{name: sums[name] for name in StepResult._fields if name in sums},  # J
        )

    def toe_positions(self) -> Array:
        """(toes, 2) centres of the toe pads, m."""
        return self.batch.pad_centres(0)[: self.toes]

    def energy(self) -> float:
        """Kinetic plus potential energy, J (potential 0 with the centre of mass at y = 0)."""
        return self.batch.energy(0)


class ProjectionPlant(Plant):
    """A robot on a terrain, by the projected equations: arguments and errors of :class:`Batch`."""

    batch: Batch

    def __init__(
        self, robot: Robot, terrain: Ground, time_step: float = TIME_STEP,
        gravity: Gravity = GRAVITY, held: bool = False, links_collide: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(Batch([robot], [terrain], time_step, gravity, 1, held, links_collide))

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


class RigidBodyPlant(Plant):
    """A robot on a terrain, body by body: arguments and errors of :class:`RigidBodyBatch`."""

    batch: RigidBodyBatch

    def __init__(
        self, robot: Robot, terrain: Ground, time_step: float = RIGID_TIME_STEP,
        gravity: Gravity = GRAVITY, held: bool = False, links_collide: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(RigidBodyBatch(robot, terrain, time_step, gravity, held, links_collide))


PLANTS = {"projection": TIME_STEP, "rigid_body": RIGID_TIME_STEP}
"""The plants' names, and their time steps, s."""


def plant_time_step(name: str, time_step: float | None = None) -> float:
    """Return a plant's default time step, s, for None. Raises ValueError: not a plant's name."""
    default = PLANTS[one_of("plant", name, sorted(PLANTS))]
    return default if time_step is None else time_step


def make_batch(
    name: str, robots: Sequence[Robot], terrains: Sequence[Ground], time_step: float,
    threads: int | None, held: bool, links_collide: bool, records: RobotRecords,
) -> BatchedPlant:  # fmt: skip
    """Return robots on their terrains, or ``held``, moved by a plant of :data:`PLANTS`.

    Raises:
        ValueError: an argument out of range, or several robots of a plant that moves one.
    """
    if name == "projection":
        threads = 1 if len(robots) == 1 else threads
        return Batch(robots, terrains, time_step, GRAVITY, threads, held, links_collide, records)
    if len(robots) > 1:
        raise ValueError(f"plant must be 'projection' for several robots at once, got {name!r}")
    return RigidBodyBatch(
        robots[0], terrains[0], time_step, links_collide=links_collide, records=records
    )
