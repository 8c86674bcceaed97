"""Simulation backends of a single robot, and backends by name.

A *batch* (:class:`jansen_env.plants.batched_plant.BatchedPlant`) simulates n robots on arrays, and
environments use batches only. A *plant* of this module wraps a batch of one robot for interactive
use, verification and the paper's figures: it returns the result of each step as one object.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jansen_env.arrays import Array
from jansen_env.checks import finite, one_of, positive
from jansen_env.dynamics.gravity import GRAVITY, Gravity
from jansen_env.dynamics.reduced import Tables
from jansen_env.plants.base import (
    JointPlay,
    StepResult,
    check_pushes,
    check_state,
    has_play,
)
from jansen_env.plants.batch import TIME_STEP, Batch
from jansen_env.plants.batched_plant import BatchedPlant
from jansen_env.plants.parameters import EPISODE
from jansen_env.plants.rigid.rigid_batch import PLAY_TIME_STEP, RigidBodyBatch
from jansen_env.plants.rigid.rigid_batch import TIME_STEP as RIGID_TIME_STEP
from jansen_env.plants.robot_records import RobotRecords
from jansen_env.robot import Robot
from jansen_env.terrain import Ground

FIRST = np.zeros(1, np.int64)


class Plant:
    """Single robot on a terrain, with the methods ``reset`` and ``step`` and a ``state``.

    It wraps a batch of one robot. Its ``state`` is the mechanical state of the robot, not a saved
    state of an environment.

    Args:
        batch: Batch of one robot, which this object controls.

    Attributes:
        batch: The batch that was passed.
        time_step: Time step of the integration, in s.
        toes: Number of toes.
    """

    batch: BatchedPlant

    def __init__(self, batch: BatchedPlant) -> None:
        self.batch = batch
        self.time_step = batch.time_step
        self.toes = batch.toes

    @property
    def robot(self) -> Robot:
        """The robot, without the parameters of an episode."""
        return self.batch.robots[0]

    @property
    def terrain(self) -> Ground:
        """The terrain, without the parameters of an episode."""
        return self.batch.terrains[0]

    @property
    def state(self) -> Array:
        """Copy of the state: x, y, theta, psi and their rates, in m, rad and s, shape (8,).

        x and y are the position of the crank axis.
        """
        return self.batch.states[0].copy()

    @state.setter
    def state(self, value: Array) -> None:
        self.batch.set_mechanical_state(0, check_state(value))

    @property
    def x(self) -> float:
        """Horizontal position of the crank axis, in m."""
        return float(self.batch.states[0, 0])

    def set_parameters(self, values: np.void) -> None:
        """Apply the parameters of an episode; see :meth:`Batch.set_parameters`.

        Args:
            values: Parameters, a record of :data:`jansen_env.plants.parameters.EPISODE`.
        """
        self.batch.set_parameters(FIRST, np.array([values], EPISODE))

    def reset(self, x: float = 0.0, crank_angle: float = 0.0, pitch: float | None = None) -> Array:
        """Place the robot at rest; see :meth:`Batch.place_at`.

        Args:
            x: Position of the crank axis, in m.
            crank_angle: Crank angle, in rad.
            pitch: Pitch of the chassis, in rad. None turns the robot until both its fore and its
                back feet carry it.

        Returns:
            The new state, shape (8,).
        """
        self.batch.place_at(FIRST, np.array([finite("crank_angle", crank_angle)]), x, pitch)
        return self.state

    def lookahead(self, torque: float = 0.0, push: Array | None = None) -> StepResult:
        """Return the result of the next time step without changing the state.

        The rigid-body backend looks 10 ms ahead instead of one time step.

        Args:
            torque: Commanded crank torque, in N m.
            push: Impulse on the chassis in the first time step, in N s, shape (2,). None for no
                impulse.
        """
        pushes = None if push is None else check_pushes(push)[None, None]
        self.batch.lookahead(torque, pushes=pushes)
        return self._result(torque, self.batch.lookahead_steps)

    def step(self, torque: float, duration: float, pushes: Array | None = None) -> StepResult:
        """Hold a crank torque for some time. After an error, the state has not changed.

        Args:
            torque: Torque on the crank, in N m, positive counter-clockwise. Its reaction acts on
                the chassis.
            duration: Duration, in s, which is rounded to whole time steps.
            pushes: Impulse on the chassis at the crank axis in each time step, in N s, shape
                (steps, 2); see :meth:`Batch.step`. None for no impulses.

        Raises:
            ValueError: If ``duration`` is out of range, or ``pushes`` has a different shape.
            FloatingPointError: If the simulation diverges, that is, a speed becomes impossibly high
                or a pad gets too deep into the ground. The rigid-body backend also raises it if a
                joint comes apart or the robot reaches the end of the ground.
        """
        steps = max(1, round(positive("duration", duration) / self.time_step))
        impulses = None if pushes is None else check_pushes(pushes, steps)[None]
        self.batch.step(np.array([torque], dtype=float), steps, pushes=impulses)
        return self._result(torque, steps)

    def _result(self, torque: float, steps: int) -> StepResult:
        """Return the result of the last step of the batch.

        Args:
            torque: Torque that was commanded in that step, in N m.
            steps: Number of time steps.

        Raises:
            FloatingPointError: If the step was rejected.
        """
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
        """Return the centres of the toe pads, in m, shape (toes, 2)."""
        return self.batch.pad_centres(0)[: self.toes]

    def energy(self) -> float:
        """Return the kinetic plus potential energy, in J.

        The potential energy is 0 if the centre of mass is at y = 0.
        """
        return self.batch.energy(0)


class ProjectionPlant(Plant):
    """Single robot on a terrain, simulated by the projected equations.

    The arguments and errors are those of :class:`jansen_env.plants.batch.Batch`.
    """

    batch: Batch

    def __init__(
        self,
        robot: Robot,
        terrain: Ground,
        time_step: float = TIME_STEP,
        gravity: Gravity = GRAVITY,
        fixed_chassis: bool = False,
        links_collide: bool = False,
    ) -> None:
        super().__init__(
            Batch([robot], [terrain], time_step, gravity, 1, fixed_chassis, links_collide)
        )

    @property
    def tables(self) -> Tables:
        """Tables of the compiled robot, with the parameters of its episode applied."""
        return self.batch.tables_in_force(0)

    @property
    def prescribed_crank_speed(self) -> bool:
        """Whether the crank keeps its speed, whatever torque that takes.

        A crank at rest is locked in that case.
        """
        return bool(self.batch.properties["prescribed_speed"][0])

    @prescribed_crank_speed.setter
    def prescribed_crank_speed(self, driven: bool) -> None:
        self.batch.properties["prescribed_speed"] = bool(driven)


class RigidBodyPlant(Plant):
    """Single robot on a terrain, simulated body by body.

    The arguments and errors are those of
    :class:`jansen_env.plants.rigid.rigid_batch.RigidBodyBatch`.
    """

    batch: RigidBodyBatch

    def __init__(
        self,
        robot: Robot,
        terrain: Ground,
        time_step: float = RIGID_TIME_STEP,
        gravity: Gravity = GRAVITY,
        fixed_chassis: bool = False,
        links_collide: bool = False,
        joint_play: JointPlay = 0.0,
        backlash: float = 0.0,
    ) -> None:
        batch = RigidBodyBatch(
            robot, terrain, time_step, gravity, fixed_chassis, links_collide, joint_play, backlash
        )
        super().__init__(batch)


PLANTS = {"projection": TIME_STEP, "rigid_body": RIGID_TIME_STEP}
"""Names of the simulation backends, and their default time steps, in s."""


def plant_time_step(
    name: str, time_step: float | None = None, joint_play: JointPlay = 0.0
) -> float:
    """Return a time step, or the default time step of a simulation backend.

    Args:
        name: Name of the backend.
        time_step: Time step, in s. None for the default of the backend.
        joint_play: Radial clearance of pins, in m. Pins with play need a shorter time step.

    Raises:
        ValueError: If there is no backend with this name.
    """
    default = PLANTS[one_of("plant", name, sorted(PLANTS))]
    if has_play(joint_play):
        default = PLAY_TIME_STEP
    return default if time_step is None else time_step


def make_batch(
    name: str,
    robots: Sequence[Robot],
    terrains: Sequence[Ground],
    time_step: float,
    threads: int | None,
    fixed_chassis: bool,
    links_collide: bool,
    joint_play: JointPlay,
    backlash: float,
    records: RobotRecords,
) -> BatchedPlant:
    """Return robots on their terrains, simulated by a backend of :data:`PLANTS`.

    Args:
        name: Name of the backend.
        robots: The robots.
        terrains: Ground of each robot.
        time_step: Time step of the integration, in s.
        threads: Largest number of threads. None to choose it from the batch size.
        fixed_chassis: Whether all chassis are fixed.
        links_collide: Whether the sides of links touch vertices of the ground.
        joint_play: Radial clearance of pins, in m. Only the rigid-body backend has play.
        backlash: Dead band of the gear, in rad. Only the rigid-body backend has backlash.
        records: Records to use.

    Raises:
        ValueError: If an argument is out of range, or there are several robots and the backend can
            simulate only one.
    """
    if name == "projection":
        threads = 1 if len(robots) == 1 else threads
        return Batch(
            robots, terrains, time_step, GRAVITY, threads, fixed_chassis, links_collide, records
        )
    if len(robots) > 1:
        raise ValueError(f"plant must be 'projection' for several robots at once, got {name!r}")
    return RigidBodyBatch(
        robots[0],
        terrains[0],
        time_step,
        links_collide=links_collide,
        joint_play=joint_play,
        backlash=backlash,
        records=records,
    )
