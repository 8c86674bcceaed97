"""Base class of simulation backends, which keep robots as records, place them, and move them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array, Bools, Ints, Rows
from jansen_env.dynamics.gravity import GRAVITY, Gravity, gravity_vector
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.dynamics.pads import pad_layout
from jansen_env.engine import episode
from jansen_env.engine.episode import Episodes, Observing
from jansen_env.engine.records import MACHINE, WORLD
from jansen_env.plants.base import check_time_step
from jansen_env.plants.parameters import EPISODE, nominal
from jansen_env.plants.robot_parameters import check_restitution
from jansen_env.plants.robot_records import RobotRecords
from jansen_env.plants.shape_planes import ShapePlanes
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.robot_arrays import machine_row
from jansen_env.terrain import Ground

GRAVITY_XY = ["gravity_x", "gravity_y"]  # fields of PROPERTIES
PLANES_PER_PAD = 4  # contact planes that are kept per pad, on average over the pads of a robot
NOT_THE_ROBOT = (
    *GRAVITY_XY,
    "steepest",
    "fixed_chassis",
)  # fields of PROPERTIES that do not belong to a robot


class BatchedPlant(ABC):
    """Batch of n robots on their terrains, with one record per robot.

    It is the simulation backend that environments use. Derived classes place the robots and move
    them: :class:`jansen_env.plants.batch.Batch` by the projected equations, and
    :class:`jansen_env.plants.rigid.rigid_batch.RigidBodyBatch` body by body, for one robot. For a
    single robot outside an environment, :class:`jansen_env.plants.plant.Plant` wraps a batch.

    Args:
        robots: The robots.
        terrains: Ground of each robot.
        time_step: Time step of the integration, in s.
        gravity: Gravitational acceleration, in m/s^2: a number that acts downwards, or a vector
            (x, y).
        fixed_chassis: Whether all chassis are fixed.
        records: Records to use. If None, the batch makes new ones.

    Attributes:
        robots: The robots, without the parameters of an episode.
        terrains: Ground of each robot, without the parameters of an episode.
        fixed_chassis: Whether all chassis are fixed.
        time_step: Time step of the integration, in s.
        gravity: Gravitational acceleration (x, y), in m/s^2, before tilt and scale.
        records: Records of the robots; see :class:`RobotRecords`.
        machines: Robots without the parameters of an episode, ``MACHINE`` of
            :mod:`jansen_env.engine.records`, shape (n,).
        engine_settings: Data that the robots have in common, ``WORLD`` of
            :mod:`jansen_env.engine.records`, shape (1,).
        toes: Number of toes of each robot.
        pads: Number of contact pads of each robot, toes included.
        any_diverged: Whether the last step of any robot was rejected because the robot diverged.
        joint_gap: Widest gap of any joint in the last step, in m, shape (n,).
        knows_joint_forces: Whether :meth:`joint_forces` returns joint forces.
        joints_open: Whether joints can have gaps.
        tracing: Whether the time steps of the first robot are traced, for :meth:`peak_loads`.
        lookahead_steps: Number of time steps that :meth:`lookahead` simulates.
        in_contact: Whether each pad of the first robot is on the ground, shape (pads,), or None if
            that is not known.
        surface: Vertices of all terrains, in m, shape (vertices, 2).
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
        fixed_chassis: bool,
        records: RobotRecords | None,
    ) -> None:
        n = len(robots)
        self.robots = list(robots)
        self.terrains = list(terrains)
        self.fixed_chassis = bool(fixed_chassis)
        self.time_step = check_time_step(time_step)
        self.toes = len(robots[0].toes)
        self.pads = len(pad_layout(robots[0]).joint)
        self._every = np.arange(n)
        self.records = records or RobotRecords(n, self.toes, self.pads)
        self.gravity = gravity_vector(gravity)
        self._torque_rate = math.inf
        self._apply_parameters = episode.apply_parameters.bound()
        self.engine_settings = np.zeros(1, WORLD)
        self.engine_settings["time_step"] = self.engine_settings["period"] = self.time_step
        self.engine_settings["toes"] = self.toes
        self.engine_settings["steps"] = 1
        self.engine_settings["stride"] = 1
        self.engine_settings["capacity"] = PLANES_PER_PAD * self.pads
        self.machines = np.zeros(n, MACHINE)
        nominal_properties: Any = self.machines["nominal"]
        nominal_properties[GRAVITY_XY] = self.gravity
        nominal_properties["steepest"] = [terrain.steepest for terrain in terrains]
        nominal_properties["fixed_chassis"] = fixed_chassis
        BatchedPlant._set_machines(self, self._every)
        pairs = zip(robots, terrains, strict=True)
        self.records.parameters[:] = np.array([nominal(*pair) for pair in pairs], EPISODE)
        check_restitution(nominal_properties["compliant"], self.records.parameters["restitution"])
        self.any_diverged = False
        self.joint_gap = np.zeros(n)

    def set_control(
        self, steps: int, period: float, torque_rate: float = math.inf, **flags: bool
    ) -> None:
        """Define the control steps. Call this method before :meth:`control_step`.

        Args:
            steps: Number of time steps per control step.
            period: Duration of a control step, in s.
            torque_rate: Fastest change of commanded torques, in N m/s. Infinite for no limit.
            **flags: Further fields of ``WORLD`` of :mod:`jansen_env.engine.records`, which select
                what the kernels compute.
        """
        self.engine_settings["steps"] = steps
        self.engine_settings["period"] = period
        for name, value in flags.items():
            self.engine_settings[name] = value
        self._torque_rate = torque_rate
        self._apply(self._every)

    def _set_machines(self, rows: Ints) -> None:
        """Store robots without the parameters of an episode in :attr:`machines`.

        Args:
            rows: Indices of the robots, shape (k,).
        """
        noted = dict[int, Rows]()
        nominal_properties: Any = self.machines["nominal"]
        for row in rows.tolist():
            robot = self.robots[row]
            if id(robot) not in noted:
                machine = machine_row(robot)
                machine["advance"] = advance_per_turn(robot)
                noted[id(robot)] = machine
            kept = {name: nominal_properties[name][row] for name in NOT_THE_ROBOT}
            self.machines[row] = noted[id(robot)][0]
            for name, value in kept.items():
                nominal_properties[name][row] = value

    def _apply(self, rows: Ints) -> None:
        """Compute the values that kernels read from the parameters of some robots.

        Args:
            rows: Indices of the robots, shape (k,).
        """
        self._apply_parameters(
            rows,
            *self.gravity,
            GRAVITY,
            self._torque_rate,
            self.engine_settings,
            self.machines,
            self.records.robots,
        )

    # Methods of a simulation backend.

    @abstractmethod
    def control_step(
        self,
        rows: Ints,
        actions: Array,
        episodes: Episodes,
        observing: Observing,
        meanwhile: Callable[[], None] | None = None,
    ) -> None:
        """Simulate one control step of some robots; see :mod:`jansen_env.engine.episode`.

        Args:
            rows: Indices of the robots, shape (k,).
            actions: Actions of all robots, as fractions of the torque limit, shape (n, 1). The
                actions of the robots in ``rows`` must be finite.
            episodes: Parts of the robots' records that belong to the episode and the task.
            observing: Observations of the robots, and the settings that define them.
            meanwhile: Function that is called while these robots move. It may place robots that are
                not in ``rows``.
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
        """Hold crank torques for some time steps, within the limits of the motors.

        The step of a robot is rejected if the robot becomes faster than
        :data:`jansen_env.engine.integrator.DIVERGED`, leaves the stretch of ground that is known
        for the step, or gets too deep into the ground. Such a robot keeps the state that it had
        before the step, its sums are 0, and its entry in :attr:`diverged` is True. The other robots
        continue.

        Args:
            torque: Commanded crank torque of each robot, in N m, shape (n,).
            steps: Number of time steps.
            earlier: Torque that is held instead in the first ``switch`` time steps, in N m, shape
                (n,). If None, ``torque`` is held from the beginning.
            switch: Number of time steps with the torque ``earlier``, shape (n,).
            rows: Indices of the robots that move, shape (k,). None for all robots.
            pushes: Impulse on each chassis at the crank axis in each time step, in the x and y
                directions of the world, in N s, shape (n, steps, 2). None for no impulses.

        Raises:
            ValueError: If ``pushes`` has a different shape.
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
        """Fill the sums with those of the next :attr:`lookahead_steps` time steps.

        The states are restored afterwards.

        Args:
            torque: Commanded crank torque of all these robots, in N m.
            rows: Indices of the robots, shape (k,). None for all robots.
            pushes: Impulse on each chassis in the first time step, in N s, shape (n, 1, 2). None
                for no impulses.
        """

    @abstractmethod
    def place(self, rows: Ints, crank_angles: ArrayLike, crank_speeds: ArrayLike = 0.0) -> None:
        """Place robots at x = 0, look ahead in time, and set their crank speeds.

        See :meth:`place_at` and :meth:`lookahead`.

        Args:
            rows: Indices of the robots, shape (k,).
            crank_angles: Crank angle of each of these robots, in rad, shape (k,).
            crank_speeds: Crank speed with which each of these robots starts, in rad/s, shape (k,).
        """

    @abstractmethod
    def place_at(
        self, rows: Ints, crank_angles: ArrayLike, x: float = 0.0, pitch: float | None = None
    ) -> None:
        """Place robots at rest on their lowest toes.

        Args:
            rows: Indices of the robots, shape (k,).
            crank_angles: Crank angle of each of these robots, in rad, shape (k,).
            x: Position of the crank axis, in m.
            pitch: Pitch of the chassis, in rad. None turns a robot until both its fore and its back
                feet carry it.
        """

    @abstractmethod
    def set_mechanical_state(
        self, row: int, state: ArrayLike, deflection: Array | None = None
    ) -> None:
        """Set the mechanical state of a robot.

        Args:
            row: Index of the robot.
            state: x, y, theta, psi and their rates, in m, rad and s, shape (8,).
            deflection: Compression and bend of compliant pads, in m, shape (pads, 2). None if they
                are not known.
        """

    @abstractmethod
    def set_parameters(self, rows: Ints, values: Rows) -> None:
        """Apply the parameters of an episode.

        Args:
            rows: Indices of the robots, shape (k,).
            values: Parameters of each of these robots, records of
                :data:`jansen_env.plants.parameters.EPISODE`, shape (k,).
        """

    @abstractmethod
    def set_robots(self, rows: Ints, robots: Sequence[Robot]) -> None:
        """Exchange robots and reset their parameters to the nominal values.

        The robots must be placed again afterwards.

        Args:
            rows: Indices of the robots to exchange, shape (k,).
            robots: New robots, k of them.
        """

    @abstractmethod
    def set_terrain(self, row: int, terrain: Ground) -> None:
        """Replace a robot's ground. The robot must be placed again afterwards.

        Args:
            row: Index of the robot.
            terrain: The new ground.
        """

    @abstractmethod
    def check_feet(self, robot: Robot, values: np.void) -> None:
        """Check that the time step is short enough for a robot's compliant feet.

        Args:
            robot: The robot.
            values: Parameters of its episode, a record of
                :data:`jansen_env.plants.parameters.EPISODE`.

        Raises:
            ValueError: If the time step is too long for the feet under these parameters.
        """

    @abstractmethod
    def check_robot(self, robot: Robot) -> None:
        """Raise the errors that :meth:`set_robots` would raise for this robot."""

    @abstractmethod
    def keep(self, rows: Ints) -> Callable[[], None]:
        """Save robots and their grounds.

        Args:
            rows: Indices of the robots, shape (k,).

        Returns:
            A function that restores these robots and grounds to what they were at this call.
        """

    @abstractmethod
    def joint_forces(self, torque: float = 0.0, push: Array | None = None) -> JointForces:
        """Return the forces in every joint of the first robot.

        Args:
            torque: Crank torque, in N m.
            push: Impulse on the chassis in the next time step, in N s, shape (2,). None for no
                impulse.

        Raises:
            ValueError: If the backend does not compute joint forces.
        """

    @abstractmethod
    def peak_loads(self) -> tuple[float, float]:
        """Return the largest loads on joints of the first robot in its last step.

        Returns:
            The largest force, in N, and the largest impulse, in N s.
        """

    @abstractmethod
    def refusal(self, torque: float) -> FloatingPointError:
        """Return the error that describes why the last step of the first robot was rejected.

        Args:
            torque: Torque that was commanded in that step, in N m.
        """

    @abstractmethod
    def energy(self, row: int) -> float:
        """Return the kinetic plus potential energy of a robot, in J."""

    @abstractmethod
    def pad_centres(self, row: int) -> Array:
        """Return the centres of a robot's pads, toes first, in m, shape (pads, 2)."""

    @abstractmethod
    def contact_frames(self, row: int) -> tuple[Array, Array]:
        """Return the point of the ground nearest to each toe of a robot, and the tangent there.

        Returns:
            The points, in m, shape (toes, 2), and the tangents of the ground at these points, shape
            (toes, 2).
        """

    @abstractmethod
    def close(self) -> None:
        """Release the threads."""

    @abstractmethod
    def reconnect(self) -> None:
        """Take new views of the records after they have been replaced by new arrays."""

    # Views of the records. Treat them as read-only.

    @property
    def states(self) -> Array:
        """State of each robot, shape (n, 8): x, y, theta, psi and their rates, in m, rad and s.

        x and y are the position of the crank axis.
        """
        return self.records.states

    @property
    def slip(self) -> Array:
        """Distance that each toe slid under load in the last step, in m, shape (n, toes)."""
        return self.records.slip

    @property
    def contact_force(self) -> Array:
        """Mean tangential and normal force on each toe in the last step (N), shape (n, toes, 2)."""
        return self.records.contact_force

    @property
    def accumulators(self) -> Rows:
        """Sums over the last step, records ``ACCUMULATORS``, shape (n,)."""
        return self.records.accumulators

    @property
    def properties(self) -> Rows:
        """Values that kernels read, records ``PROPERTIES``, shape (n,)."""
        return self.records.properties

    @property
    def parameters(self) -> Rows:
        """Parameters of the current episodes, records ``EPISODE``, shape (n,)."""
        return self.records.parameters

    @property
    def deflection(self) -> Array:
        """Compression and bend of compliant pads, in m, shape (n, pads, 2)."""
        return self.records.deflection

    @property
    def diverged(self) -> Bools:
        """Whether the last step of each robot was rejected, shape (n,)."""
        return self.records.diverged
