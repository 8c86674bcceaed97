"""The protocol of plants: robots as records, which a plant places and moves."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array, Bools, Ints, Rows
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.dynamics.pads import pad_layout
from jansen_env.engine import episode
from jansen_env.engine.episode import Episodes, Observing
from jansen_env.engine.records import MACHINE, WORLD
from jansen_env.gravity import GRAVITY, Gravity, gravity_vector
from jansen_env.parameters import EPISODE, nominal
from jansen_env.plants.base import check_time_step
from jansen_env.plants.robot_parameters import check_restitution
from jansen_env.plants.robot_records import RobotRecords
from jansen_env.plants.shape_planes import ShapePlanes
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.robot_arrays import machine_row
from jansen_env.terrain import Ground

GRAVITY_XY = ["gravity_x", "gravity_y"]  # fields of PARAMS
PLANES_PER_PAD = 4  # kept of a robot, on average over its pads
NOT_THE_ROBOT = (*GRAVITY_XY, "steepest", "held")  # fields of PARAMS that a robot does not have


class BatchedPlant(ABC):
    """n robots on their terrains, one record each. A derived class places and moves them.

    Args:
        robots: The robots.
        terrains: The ground of each robot.
        time_step: Time step of the integration in s.
        gravity: In m/s^2 downwards, or a vector (x, y).
        held: Whether all chassis stay where they are.
        records: Records to use; None for new ones.

    Attributes:
        records: The robots, see :class:`RobotRecords`.
        machines: Shape (n,), ``MACHINE`` of :mod:`jansen_env.engine.records`: the robots without
            parameters.
        world: Shape (1,), ``WORLD`` of the same: data that the robots have in common.
        toes, pads: Number of toes, and of contact pads with them, of each robot.
        any_diverged: Whether a robot's last step was refused.
        joint_gap: Shape (n,), widest gap of any joint in the last step, in m.
        knows_joint_forces: Whether :meth:`joint_forces` returns them.
        joints_open: Whether joints can gap.
        tracing: Whether the first robot's time steps are recorded, for :meth:`peak_loads`.
        lookahead_steps: Number of time steps that placing looks ahead.
    """

    knows_joint_forces: bool
    joints_open: bool
    tracing: bool
    lookahead_steps: int
    in_contact: Any
    surface: Any

    def __init__(
        self,
        robots: Sequence[Robot],
        terrains: Sequence[Ground],
        time_step: float,
        gravity: Gravity,
        held: bool,
        records: RobotRecords | None,
    ) -> None:
        n = len(robots)
        self.robots = list(robots)
        self.terrains = list(terrains)
        self.held = bool(held)
        self.time_step = check_time_step(time_step)
        self.toes = len(robots[0].toes)
        self.pads = len(pad_layout(robots[0]).joint)
        self._every = np.arange(n)
        self.records = records or RobotRecords(n, self.toes, self.pads)
        self.gravity = gravity_vector(gravity)
        self._torque_rate = math.inf
        self._apply_parameters = episode.apply_parameters.bound()
        self.world = np.zeros(1, WORLD)
        self.world["time_step"] = self.world["period"] = self.time_step
        self.world["toes"] = self.toes
        self.world["steps"] = 1
        self.world["stride"] = 1
        self.world["capacity"] = PLANES_PER_PAD * self.pads
        self.machines = np.zeros(n, MACHINE)
        nominal_params: Any = self.machines["nominal"]
        nominal_params[GRAVITY_XY] = self.gravity
        nominal_params["steepest"] = [terrain.steepest for terrain in terrains]
        nominal_params["held"] = held
        BatchedPlant._set_machines(self, self._every)
        pairs = zip(robots, terrains, strict=True)
        self.records.parameters[:] = np.array([nominal(*pair) for pair in pairs], EPISODE)
        check_restitution(nominal_params["compliant"], self.records.parameters["restitution"])
        self.any_diverged = False
        self.joint_gap = np.zeros(n)

    def set_control(
        self, steps: int, period: float, torque_rate: float = math.inf, **flags: bool
    ) -> None:
        """Prepare for :meth:`control_step`.

        Args:
            steps: Number of time steps of a control step.
            period: Time of a control step in s.
            torque_rate: Fastest change of commanded torques in N m/s; infinite without a limit.
            flags: Fields of ``WORLD`` of :mod:`jansen_env.engine.records`: what kernels do.
        """
        self.world["steps"] = steps
        self.world["period"] = period
        for name, value in flags.items():
            self.world[name] = value
        self._torque_rate = torque_rate
        self._apply(self._every)

    def _set_machines(self, rows: Ints) -> None:
        """Note robots (k,) as they are without parameters."""
        noted = dict[int, Rows]()
        nominal_params: Any = self.machines["nominal"]
        for row in rows.tolist():
            robot = self.robots[row]
            if id(robot) not in noted:
                machine = machine_row(robot)
                machine["advance"] = advance_per_turn(robot)
                noted[id(robot)] = machine
            kept = {name: nominal_params[name][row] for name in NOT_THE_ROBOT}
            self.machines[row] = noted[id(robot)][0]
            for name, value in kept.items():
                nominal_params[name][row] = value

    def _apply(self, rows: Ints) -> None:
        """Derive what kernels read of robots (k,) from their parameters."""
        self._apply_parameters(
            rows,
            *self.gravity,
            GRAVITY,
            self._torque_rate,
            self.world,
            self.machines,
            self.records.robots,
        )

    # What a plant does.

    @abstractmethod
    def control_step(
        self,
        rows: Ints,
        actions: Array,
        episodes: Episodes,
        observing: Observing,
        meanwhile: Callable[[], None] | None = None,
    ) -> None:
        """Let robots take a control step, see :mod:`jansen_env.engine.episode`.

        Args:
            rows: Shape (k,), the robots.
            actions: Shape (n, 1), finite for each of them.
            episodes: Other parts of their records.
            observing: How they are observed.
            meanwhile: Called while others move, to place robots that do not.
        """

    @abstractmethod
    def step(
        self,
        torque: Array,
        steps: int,
        earlier: Array | None = None,
        switch: Ints | None = None,
        rows: Ints | None = None,
        pushes: Array | None = None,
    ) -> None:
        """Hold crank torques for some time steps, as far as the motors go.

        A robot that becomes faster than :data:`jansen_env.engine.integrator.DIVERGED`, leaves the
        ground that is known for the step or gets too deep into it stays as it was before, without
        sums, and is named in :attr:`diverged`. The others continue.

        Args:
            torque: Shape (n,), in N m.
            steps: Number of time steps.
            earlier: Shape (n,), torque held instead in the first ``switch`` time steps, in N m.
            switch: Shape (n,), number of these time steps.
            rows: Shape (k,), the robots that move; None for all.
            pushes: Shape (n, steps, 2), impulse on each chassis at the crank axis in each time
                step, world x and y, in N s; None for none.

        Raises:
            ValueError: If ``pushes`` has another shape.
        """

    @abstractmethod
    def shapes(self, row: int) -> ShapePlanes | None:
        """Return the shapes of a robot's ground in pymunk, or None for a height line."""

    @abstractmethod
    def look_down(self, rows: Ints, scan: Array) -> None:
        """Measure the ground that robots on pymunk's shapes observe.

        Height lines need no measurement.

        Args:
            rows: Indices of the robots, shape (k,).
            scan: Positions relative to the crank axis at which a robot observes the height of the
                ground, in m, shape (points,).
        """

    @abstractmethod
    def lookahead(
        self, torque: float = 0.0, rows: Ints | None = None, pushes: Array | None = None
    ) -> None:
        """Fill sums with the next :attr:`lookahead_steps` time steps; states stay.

        Args:
            torque: In N m.
            rows: Shape (k,), the robots; None for all.
            pushes: Shape (n, 1, 2), impulses in the first time step in N s; None for none.
        """

    @abstractmethod
    def place(self, rows: Ints, crank_angles: ArrayLike, crank_speeds: ArrayLike = 0.0) -> None:
        """Place robots at x = 0, see :meth:`place_at`, with sums of a look ahead in time.

        Args:
            rows: Shape (k,), the robots.
            crank_angles: Shape (k,), in rad.
            crank_speeds: Shape (k,), with which they start, in rad/s.
        """

    @abstractmethod
    def place_at(
        self, rows: Ints, crank_angles: ArrayLike, x: float = 0.0, pitch: float | None = None
    ) -> None:
        """Place robots at rest on their lowest toes.

        Args:
            rows: Shape (k,), the robots.
            crank_angles: Shape (k,), in rad.
            x: Position of the crank axis in m.
            pitch: In rad; None turns a robot until its fore and its back feet carry it.
        """

    @abstractmethod
    def set_state(self, row: int, state: ArrayLike, deflection: Array | None = None) -> None:
        """Put a robot into a state (8,), with ``deflection`` (pads, 2) in m if it is known."""

    @abstractmethod
    def set_parameters(self, rows: Ints, values: Rows) -> None:
        """Apply parameters (k,), records of :data:`jansen_env.parameters.EPISODE`."""

    @abstractmethod
    def set_robots(self, rows: Ints, robots: Sequence[Robot]) -> None:
        """Exchange robots (k,), with parameters that change nothing; they must be placed again."""

    @abstractmethod
    def set_terrain(self, row: int, terrain: Ground) -> None:
        """Change a robot's ground; it must be placed again."""

    @abstractmethod
    def check_feet(self, robot: Robot, values: np.void) -> None:
        """Check that the time step is short enough for a robot's feet with these parameters.

        Raises:
            ValueError: If the time step is too long.
        """

    @abstractmethod
    def check_robot(self, robot: Robot) -> None:
        """Raise the errors that :meth:`set_robots` would raise for this robot."""

    @abstractmethod
    def keep(self, rows: Ints) -> Callable[[], None]:
        """Return a function that makes robots (k,), and their grounds, what they are now."""

    @abstractmethod
    def joint_forces(self, torque: float = 0.0, push: Array | None = None) -> JointForces:
        """Return the forces in every joint of the first robot; ValueError: they are not known."""

    @abstractmethod
    def peak_loads(self) -> tuple[float, float]:
        """Return the largest force (N) and impulse (N s) on joints in the last step."""

    @abstractmethod
    def refusal(self, torque: float) -> FloatingPointError:
        """Return the error of the first robot's last step, which was refused."""

    @abstractmethod
    def energy(self, row: int) -> float:
        """Return a robot's kinetic plus potential energy in J."""

    @abstractmethod
    def pad_centres(self, row: int) -> Array:
        """Return the centres (pads, 2) of a robot's pads in m, toes first."""

    @abstractmethod
    def contact_frames(self, row: int) -> tuple[Array, Array]:
        """Return points (toes, 2) of the ground nearest to a robot's toes, and tangents there."""

    @abstractmethod
    def close(self) -> None:
        """Release threads."""

    @abstractmethod
    def reconnect(self) -> None:
        """Take other views of the records, which have been made anew."""

    # Views of the records.

    @property
    def states(self) -> Array:
        """(n, 8) x, y, theta, psi and rates, x, y the crank axis, m, rad, s; to be read."""
        return self.records.states

    @property
    def slip(self) -> Array:
        """(n, toes) m, of the last step."""
        return self.records.slip

    @property
    def contact_force(self) -> Array:
        """(n, toes, 2) N, of the last step."""
        return self.records.contact_force

    @property
    def accumulators(self) -> Rows:
        """(n,) ACCUMULATORS, sums over the last step."""
        return self.records.accumulators

    @property
    def params(self) -> Rows:
        """(n,) PARAMS, as kernels read them."""
        return self.records.params

    @property
    def parameters(self) -> Rows:
        """(n,) EPISODE, the parameters that apply."""
        return self.records.parameters

    @property
    def deflection(self) -> Array:
        """(n, pads, 2) m, compression and bend of compliant pads; to be read."""
        return self.records.deflection

    @property
    def diverged(self) -> Bools:
        """(n,) whether the last step was refused."""
        return self.records.diverged
