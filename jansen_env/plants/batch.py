"""Projection backend: n robots that move by the projected equations, free or with fixed chassis."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import override

from jansen_env.arrays import Array, Bools, Ints, Rows
from jansen_env.checks import finite
from jansen_env.dynamics.gravity import GRAVITY, Gravity
from jansen_env.dynamics.joint_forces import JointForces, joint_forces
from jansen_env.dynamics.reduced import Tables, compile_robot
from jansen_env.engine import collision, episode, integrator
from jansen_env.engine.collision import MARGIN, SPECULATIVE_MARGIN
from jansen_env.engine.contact_frames import put_contact_frames
from jansen_env.engine.episode import Episodes, Observing
from jansen_env.engine.records import PLANE, UNKNOWN_DEFLECTION, Scratch
from jansen_env.engine.tables import energy
from jansen_env.plants.base import (
    check_colliding,
    check_fixed_chassis,
    check_legs,
    check_pushes,
    divergence,
)
from jansen_env.plants.batched_plant import GRAVITY_XY, BatchedPlant
from jansen_env.plants.design_tables import DesignTables
from jansen_env.plants.kernel_arrays import KernelArrays
from jansen_env.plants.parameters import nominal, plain
from jansen_env.plants.robot_parameters import (
    check_resolved,
    check_restitution,
    check_values,
    machine_of,
)
from jansen_env.plants.robot_placement import RobotPlacement
from jansen_env.plants.robot_records import RobotRecords
from jansen_env.plants.robots_on_shapes import RobotsOnShapes
from jansen_env.plants.shape_planes import ContactPlane, ShapePlanes
from jansen_env.plants.threads import Move, Threads
from jansen_env.plants.trace import find_touchdowns, pads_in_contact, trace_forces
from jansen_env.robot import Robot
from jansen_env.terrain import Ground

TIME_STEP = 1e-3  # default time step of the integration, in s
# Time between two searches for contact planes, in s. The planes are kept in between.
DETECTION_INTERVAL = 0.01


class Batch(BatchedPlant):
    """Projection backend: n robots on their terrains.

    Each robot moves bit for bit as it would alone. For a single robot,
    :class:`jansen_env.plants.plant.ProjectionPlant` wraps a batch of one.

    The kernels move robots on height lines and distribute them among threads. After that, robots on
    pymunk's shapes are moved one after another (:mod:`jansen_env.plants.robots_on_shapes`).

    Args:
        robots: The robots. Their legs must be on the same sides; everything else may differ.
        terrains: Ground of each robot.
        time_step: Time step of the integration, in s.
        gravity: Gravitational acceleration, in m/s^2: a number that acts downwards, or a vector
            (x, y).
        threads: Largest number of threads; see :class:`jansen_env.plants.threads.Threads`.
        fixed_chassis: Whether all chassis are fixed, as in the paper's fixed model. In that case
            there is no ground, pushes have no effect, and robots are placed level with the crank
            axis at (x, 0).
        links_collide: Whether the sides of links touch vertices of the ground, as capsules with the
            radius of the pads (:func:`jansen_env.dynamics.pads.pad_sides`). In that case, joint
            forces are not known. If False, only pads touch the ground.
        records: Records to use. If None, the batch makes new ones.

    Attributes:
        toes: Number of toes of each robot.
        pads: Number of contact pads of each robot, toes included.
        records: Records of the robots; see :class:`RobotRecords`.
        machines: Robots without the parameters of an episode, ``MACHINE`` of
            :mod:`jansen_env.engine.records`, shape (n,).
        joint_gap: Widest gap of any joint in the last step, in m, shape (n,). It is always 0 in
            this backend.
        any_diverged: Whether the last step of any robot was rejected because the robot diverged.
        tracing: Whether the time steps of the first robot are traced.
        trace: Traced time steps, :func:`jansen_env.engine.integrator.trace_dtype`, shape (steps,).
        touchdowns: Whether a pad touched down in each traced time step, shape (steps,).
        in_contact: Whether each pad of the first robot was on the ground at the end of the last
            trace, shape (pads,), or None if that is not known. It is used only to detect
            touchdowns.
        knows_joint_forces: Whether :meth:`joint_forces` returns joint forces.
        joints_open: Whether joints can have gaps. It is always False in this backend.

    Raises:
        ValueError: If an argument is out of range, or the legs of the robots are on different
            sides.
        LinkageError: If a robot cannot turn its crank through a full revolution.
    """

    joints_open = False
    lookahead_steps = 1

    def __init__(
        self,
        robots: Sequence[Robot],
        terrains: Sequence[Ground],
        time_step: float = TIME_STEP,
        gravity: Gravity = GRAVITY,
        threads: int | None = None,
        fixed_chassis: bool = False,
        links_collide: bool = False,
        records: RobotRecords | None = None,
    ) -> None:
        if len(robots) != len(terrains) or not robots:
            raise ValueError(
                f"expected one terrain per robot and at least one robot, got {len(robots)} robots "
                f"and {len(terrains)} terrains"
            )
        different = {id(robot): robot for robot in robots}
        for robot in different.values():
            check_legs(robot, robots[0])
        self._arguments = (time_step, gravity, threads, fixed_chassis, links_collide)
        check_colliding(terrains, links_collide)
        super().__init__(robots, terrains, time_step, gravity, fixed_chassis, records)
        self.engine_settings["stride"] = max(1, round(DETECTION_INTERVAL / time_step))
        self.engine_settings["links_collide"] = links_collide
        self.records.status["margin"] = SPECULATIVE_MARGIN
        self.knows_joint_forces = not links_collide
        self._arrays = KernelArrays(
            robots, terrains, self.records, self.engine_settings, fixed_chassis
        )
        self._placement = RobotPlacement(self._arrays)
        self._set_machines(self._every)
        self._apply(self._every)
        # Arguments of kernels.
        self._advance = integrator.advance.bound()
        self._control_step = episode.control_step.bound()
        self._make_scratch(threads)
        n = len(robots)
        self._at_once = np.zeros(n), np.zeros(n, np.int64)  # no earlier torque
        self._ahead_torque = np.zeros(n)  # torque of :meth:`lookahead`, in N m
        self._no_pushes = np.zeros((0, 0, 2))
        self._no_trace: Rows = np.zeros(0, integrator.trace_dtype(self.pads))
        self._untraced = plain(self._no_trace)
        self._planes = np.zeros(self.engine_settings["capacity"][0], PLANE)  # for contact_planes
        self._sums = np.empty((3, 6))
        self.tracing = False
        self.trace = self._no_trace
        self.touchdowns: Bools = np.zeros(0, bool)
        self.in_contact: Bools | None = None

    def _make_scratch(self, threads: int | None) -> None:
        """Allocate the work space of each thread.

        Args:
            threads: Largest number of threads; None to choose it from the batch size.
        """
        capacity = int(self.engine_settings["capacity"][0])
        steps = int(self.engine_settings["steps"][0])

        def memory() -> Scratch:
            return integrator.work_space(capacity, self.pads, steps)

        self._threads = Threads(len(self.robots), threads, memory)
        self._on_shapes = RobotsOnShapes(self._arrays, memory())

    @override
    def set_control(
        self, steps: int, period: float, torque_rate: float = math.inf, **flags: bool
    ) -> None:
        super().set_control(steps, period, torque_rate, **flags)
        self._make_scratch(self._arguments[2])
        self._reach(period)

    @override
    def _set_machines(self, rows: Ints) -> None:
        super()._set_machines(rows)
        numbers = self.designs.number[rows]
        nominal_properties: Any = self.machines["nominal"]
        nominal_properties["design"][rows] = numbers
        self.machines["centre"][rows] = self.designs.farthest[numbers, 0]
        self.machines["pad"][rows] = self.designs.farthest[numbers, 1]

    @override
    def reconnect(self) -> None:
        self._arrays.refresh()

    @property
    def designs(self) -> DesignTables:
        """Tables of the robots' designs, which the kernels read."""
        return self._arrays.tables

    @property
    @override
    def surface(self) -> Array:
        """Vertices of all terrains, in m, shape (vertices, 2).

        The status of a robot holds the range of vertices that belong to its own terrain.
        """
        return self._arrays.grounds.surface

    # Robots, parameters and grounds.

    @override
    def set_parameters(self, rows: Ints, values: Rows) -> None:
        """Apply the parameters of an episode, from the next placement on.

        Args:
            rows: Indices of the robots, shape (k,).
            values: Parameters of each of these robots, records of
                :data:`jansen_env.plants.parameters.EPISODE`, shape (k,).

        Raises:
            ValueError: If a value is outside its limits, or a robot with compliant pads gets a
                restitution above 0.
        """
        check_values(values, self.machines["nominal"]["compliant"][rows])
        self.records.parameters[rows] = values
        self._apply(rows)

    @override
    def check_feet(self, robot: Robot, values: np.void) -> None:
        """Check that the time step is short enough for a robot's compliant feet.

        Environments reject feet that the time step does not resolve. A batch alone treats such feet
        as rigid.

        Args:
            robot: The robot.
            values: Parameters of its episode, a record of
                :data:`jansen_env.plants.parameters.EPISODE`.

        Raises:
            ValueError: If the time step is too long for the feet under these parameters.
        """
        if not self.fixed_chassis:
            check_resolved(robot, values, self.time_step)

    @override
    def check_robot(self, robot: Robot) -> None:
        """Raise the errors that :meth:`set_robots` would raise for this robot.

        Raises:
            ValueError: If the legs of the robot are on other sides than those of the batch.
            LinkageError: If the robot cannot turn its crank through a full revolution.
        """
        check_legs(robot, self.robots[0])
        compile_robot(robot)

    @override
    def set_robots(self, rows: Ints, robots: Sequence[Robot]) -> None:
        """Exchange robots and reset their parameters to the nominal values.

        The robots must be placed again afterwards. After an error, nothing has changed.

        Args:
            rows: Indices of the robots to exchange, shape (k,).
            robots: New robots, k of them.

        Raises:
            ValueError: If the legs of a new robot are on other sides than those of the batch.
            LinkageError: If a new robot cannot turn its crank through a full revolution.
        """
        for robot in robots:
            self.check_robot(robot)
        self._arrays.set_robots(rows, robots)
        for row, robot in zip(rows.tolist(), robots, strict=True):
            self.robots[row] = robot
            self.records.parameters[row] = nominal(robot, self.terrains[row])
        self._set_machines(rows)
        self._apply(rows)
        self.records.deflection[rows] = UNKNOWN_DEFLECTION

    def tables_in_force(self, row: int) -> Tables:
        """Return the tables of a robot with the parameters of its episode applied."""
        return compile_robot(machine_of(self.robots[row], self.parameters[row]))

    @override
    def set_terrain(self, row: int, terrain: Ground) -> None:
        """Replace a robot's ground, including its friction and restitution.

        The robot must be placed again afterwards.

        Args:
            row: Index of the robot.
            terrain: The new ground.

        Raises:
            ValueError: If the ground has a restitution above 0 and the pads of the robot are
                compliant, or if the ground consists of shapes and the links of the robots collide.
        """
        check_colliding([terrain], bool(self.engine_settings["links_collide"][0]))
        compliant = self.machines["nominal"]["compliant"][row : row + 1]
        check_restitution(compliant, np.array([terrain.restitution]))
        self.terrains[row] = terrain
        nominal_properties: Any = self.machines["nominal"]
        nominal_properties["steepest"][row] = terrain.steepest
        for name in ("friction", "restitution"):
            self.records.parameters[name][row] = getattr(terrain, name)
        self._apply(self._every[row : row + 1])
        self._arrays.set_terrain(row, terrain)

    def _find_ground(self, rows: Ints) -> None:
        """Find the stretch of ground again for those robots that have moved by the margin.

        Args:
            rows: Indices of the robots, shape (k,).
        """
        x = self.states[rows, 0]
        is_near = np.abs(x - self.records.status["ground_x"][rows]) <= MARGIN
        for k in np.flatnonzero(~is_near).tolist():
            self._arrays.find_ground(int(rows[k]), float(x[k]))

    @override
    def place(self, rows: Ints, crank_angles: ArrayLike, crank_speeds: ArrayLike = 0.0) -> None:
        self.place_at(rows, crank_angles)
        self.lookahead(rows=rows)
        speeds = self.states[:, 7]
        speeds[rows] = crank_speeds

    @override
    def place_at(
        self, rows: Ints, crank_angles: ArrayLike, x: float = 0.0, pitch: float | None = None
    ) -> None:
        """Place robots at rest on their lowest toes.

        The toes are 10 um deep in the ground, so that they carry the robot at once.

        Args:
            rows: Indices of the robots, shape (k,).
            crank_angles: Crank angle of each of these robots, in rad, shape (k,).
            x: Position of the crank axis, in m.
            pitch: Pitch of the chassis, in rad. None turns a robot until both its fore and its back
                feet carry it, that is, until the ground supports the robot on both sides of its
                centre of mass.

        Raises:
            ValueError: If ``x`` or ``pitch`` is not finite, the feet of a robot are too soft to
                carry it, or no shape is below a robot.
        """
        x = finite("x", x)
        pitch = math.nan if pitch is None else finite("pitch", pitch)
        for row in rows.tolist():
            self._arrays.find_ground(row, x)
        self._placement.place(rows, crank_angles, x, pitch)
        if self.in_contact is not None and 0 in rows:
            self.in_contact = None

    @override
    def set_mechanical_state(
        self, row: int, state: ArrayLike, deflection: Array | None = None
    ) -> None:
        """Set the mechanical state of a robot.

        Args:
            row: Index of the robot.
            state: x, y, theta, psi and their rates, in m, rad and s, shape (8,).
            deflection: Compression and bend of compliant pads, in m, shape (pads, 2). None if they
                are not known.

        Raises:
            ValueError: If the chassis is fixed, but moves in this state.
        """
        if self.fixed_chassis:
            check_fixed_chassis(state)
        self.states[row] = state
        self._find_ground(np.array([row]))
        self.deflection[row] = UNKNOWN_DEFLECTION if deflection is None else deflection
        if row == 0:
            self.in_contact = None

    @override
    def keep(self, rows: Ints) -> Callable[[], None]:
        robots = [(self.robots[row], self.terrains[row]) for row in rows.tolist()]
        saved = self.records.copy(rows)
        in_contact = self.in_contact
        joint_gap = self.joint_gap[rows]

        def undo() -> None:
            self.set_robots(rows, [robot for robot, _ in robots])
            for row, (_, terrain) in zip(rows.tolist(), robots, strict=True):
                if terrain is not self.terrains[row]:
                    self.set_terrain(row, terrain)
            self.records.restore(rows, saved)
            self.joint_gap[rows] = joint_gap
            self._find_ground(rows)
            self.any_diverged = bool(self.diverged.any())
            self.in_contact = in_contact

        return undo

    @override
    def step(
        self,
        torque: Array,
        steps: int,
        earlier: Array | None = None,
        switch: Ints | None = None,
        rows: Ints | None = None,
        pushes: Array | None = None,
    ) -> None:
        if pushes is None:
            pushes = self._no_pushes
        else:
            pushes = check_pushes(pushes, len(self.states), steps)
        if earlier is None:
            earlier, switch = self._at_once
        self._run(self._every if rows is None else rows, (torque, earlier, switch, pushes), steps)

    @override
    def control_step(
        self,
        rows: Ints,
        actions: Array,
        episodes: Episodes,
        observing: Observing,
        meanwhile: Callable[[], None] | None = None,
    ) -> None:
        if len(rows) == 0:  # no robot moves; other robots may be placed
            if meanwhile is not None:
                meanwhile()
            return
        trace = self._no_trace
        numbers = self._untraced
        if self.tracing:
            trace, numbers = self._new_trace(int(self.engine_settings["steps"][0]))

        lines, on_shapes = self._arrays.split(rows)

        def move(thread: int, queues: Ints, most: int, scratch: Scratch) -> tuple[bool, bool]:
            self._control_step(
                thread,
                queues,
                most,
                lines,
                actions,
                numbers,
                scratch,
                self._arrays.designs,
                self.records.motions,
                episodes,
                observing,
            )
            far, diverged = scratch.flags.tolist()
            return far, diverged

        self._move_on_lines(lines, move, meanwhile)
        for row in on_shapes:
            self._on_shapes.control_step(row, actions, numbers, episodes, observing)
            self.any_diverged |= bool(self.diverged[row])
        if self.tracing:
            self._keep_trace(trace)

    @override
    def lookahead(
        self, torque: float = 0.0, rows: Ints | None = None, pushes: Array | None = None
    ) -> None:
        """Fill the sums with those of the next time step, and restore the states afterwards.

        Args:
            torque: Commanded crank torque of all these robots, in N m.
            rows: Indices of the robots, shape (k,). None for all robots.
            pushes: Impulse on each chassis in this time step, in N s, shape (n, 1, 2), as in
                :meth:`step`. None for no impulses.
        """
        pushes = self._no_pushes if pushes is None else pushes
        rows = self._every if rows is None else rows
        in_contact = self.in_contact
        self._ahead_torque[:] = torque
        self._run(rows, (self._ahead_torque, *self._at_once, pushes), 1, True)
        self.in_contact = in_contact

    def _run(
        self, rows: Ints, torques: tuple[Array | Ints | None, ...], steps: int, ahead: bool = False
    ) -> None:
        """Simulate some time steps of some robots; see :meth:`step`.

        Args:
            rows: Indices of the robots, shape (k,).
            torques: Arguments ``torque``, ``earlier``, ``switch`` and ``pushes`` of :meth:`step`,
                all of them as arrays.
            steps: Number of time steps.
            ahead: Whether to look ahead only, and to restore the states afterwards.
        """
        if len(rows) == 0:
            return
        self._reach(steps * self.time_step)
        trace = self._no_trace
        numbers = self._untraced
        if self.tracing:
            trace, numbers = self._new_trace(steps)

        lines, on_shapes = self._arrays.split(rows)

        def move(thread: int, queues: Ints, most: int, scratch: Scratch) -> tuple[bool, bool]:
            self._advance(
                thread,
                queues,
                most,
                lines,
                steps,
                ahead,
                *torques,
                numbers,
                scratch,
                self._arrays.designs,
                self.records.motions,
            )
            far, diverged = scratch.flags.tolist()
            return far, diverged

        self._move_on_lines(lines, move, None)
        for row in on_shapes:
            self._on_shapes.step(row, steps, ahead, torques, numbers)
            self.any_diverged |= bool(self.diverged[row])
        if self.tracing or self.in_contact is not None or self.trace is not self._no_trace:
            self._keep_trace(trace)

    def _move_on_lines(self, rows: Ints, move: Move, meanwhile: Callable[[], None] | None) -> None:
        """Distribute robots on height lines among threads.

        Afterwards, :attr:`any_diverged` tells whether any of these robots has diverged.

        Args:
            rows: Indices of the robots, shape (k,).
            move: Function that moves the robots of one thread.
            meanwhile: Function that is called while these robots move. It may place robots that are
                not in ``rows``.
        """
        far = False
        diverged = False
        if len(rows) > 0:
            far, diverged = self._threads.move(len(rows), move, meanwhile)
        elif meanwhile is not None:
            meanwhile()
        self.any_diverged = diverged  # set last, because placing robots changes it too
        if far:
            self._find_ground(rows)

    @override
    def shapes(self, row: int) -> ShapePlanes | None:
        return self._arrays.grounds.shapes[row]

    @override
    def look_down(self, rows: Ints, scan: Array) -> None:
        for row in self._arrays.split(rows)[1]:
            self._arrays.look_down(row, scan)

    def _reach(self, duration: float) -> None:
        """Find stretches of ground that are long enough for a step.

        Args:
            duration: Duration of the step, in s.
        """
        if duration > self._arrays.longest_step:
            self._arrays.longest_step = duration
            self.records.status["ground_x"] = np.inf
            self._find_ground(self._every)

    def _new_trace(self, steps: int) -> tuple[Rows, Array]:
        """Return memory for a trace.

        Args:
            steps: Number of time steps.

        Returns:
            The trace as records, shape (steps,), and the same memory as numbers, shape (steps,
            numbers).
        """
        trace: Rows = np.empty(steps, self._no_trace.dtype)
        return trace, plain(trace)

    def _keep_trace(self, trace: Rows) -> None:
        """Keep the trace of a step, unless the first robot has diverged.

        Args:
            trace: The trace, shape (steps,). It has no rows if the step was not traced.
        """
        if self.any_diverged and self.diverged[0]:
            self.trace = self._no_trace
            self.touchdowns = np.zeros(0, bool)
            return
        self.trace = trace
        if len(trace) == 0:
            self.in_contact = None
            return
        self.touchdowns = find_touchdowns(trace, self.in_contact)
        self.in_contact = pads_in_contact(trace)[-1]

    @override
    def refusal(self, torque: float) -> FloatingPointError:
        return divergence(self.states[0], torque)

    @override
    def energy(self, row: int) -> float:
        """Return the kinetic plus potential energy of a robot, in J.

        The potential energy of gravity is 0 if the centre of mass is at y = 0.
        """
        robots = self.records.robots
        model = self.designs.model
        return float(energy(row, robots, model.body, model.springs, self._sums))

    @override
    def pad_centres(self, row: int) -> Array:
        return self._arrays.pad_centres(row)

    @override
    def contact_frames(self, row: int) -> tuple[Array, Array]:
        """Return the point of the ground nearest to each toe of a robot, and the tangent there.

        Returns:
            The points, in m, shape (toes, 2), and the tangents of the ground at these points, shape
            (toes, 2). If no ground is within reach of a toe, its point is the lowest point of the
            pad, and its tangent points in the +x direction.
        """
        centres = np.ascontiguousarray(self.pad_centres(row)[: self.toes])
        points = np.empty((self.toes, 2))
        tangents = np.empty((self.toes, 2))
        planes = [] if self.fixed_chassis else self.contact_planes(row, centres)
        listed = np.zeros(len(planes), PLANE)
        for name, values in zip(ContactPlane._fields, zip(*planes, strict=True), strict=False):
            listed[name] = values
        put_contact_frames(
            row, 0, len(planes), listed, self.records.robots, centres, points, tangents
        )
        return points, tangents

    def contact_planes(self, row: int, centres: Array | None = None) -> list[ContactPlane]:
        """Return the contact planes within :data:`SPECULATIVE_MARGIN` of a robot's pads.

        If the ground of the robot is a height line, the kernels derive the planes from the line.
        Otherwise pymunk lists them.

        Args:
            row: Index of the robot.
            centres: Centres of the first pads, in m, shape (pads, 2) or with fewer rows. None for
                the present centres of all pads.

        Returns:
            The planes in the order of the pads, the nearest plane of each pad first.
        """
        centres = self.pad_centres(row) if centres is None else centres
        status = self.records.status[row]
        shapes = self.shapes(row)
        if shapes is not None:
            return shapes.find(centres, float(status["pad_radius"]) + SPECULATIVE_MARGIN)
        status["margin"] = SPECULATIVE_MARGIN
        robots = self.records.robots
        collision.planes_near(
            row, centres, robots, self.surface, self.engine_settings, self._planes
        )
        planes = self._planes[status["first_plane"] : status["end_plane"]]
        return [ContactPlane(*row) for row in planes[[*ContactPlane._fields]].tolist()]

    @override
    def joint_forces(self, torque: float = 0.0, push: Array | None = None) -> JointForces:
        """Return the forces in every joint of the first robot, averaged over the next time step.

        If a toe lands in that time step, the forces include the impulse of the landing divided by
        the time step. If the chassis is fixed, the method returns the forces at this instant.

        Args:
            torque: Crank torque, in N m.
            push: Impulse on the chassis in that time step, in N s, shape (2,). None for no impulse.

        Raises:
            FloatingPointError: If the robot diverges in that time step.
            ValueError: If the links of the robots collide.
        """
        if not self.knows_joint_forces:
            raise ValueError("links_collide must be False with joint forces, got True")
        if self.fixed_chassis:
            robot = self.tables_in_force(0).robot
            q, q_dot = np.split(self.states[0], 2)
            gravity = self.properties[GRAVITY_XY][0].item()
            return joint_forces(robot, q, q_dot, torque, fixed_base=True, gravity=gravity)
        pushes = None if push is None else check_pushes(push)[None, None]
        kept = self.tracing, self.trace, self.touchdowns
        self.tracing = True
        try:
            self.lookahead(torque, self._every[:1], pushes)
            if self.diverged[0]:
                raise self.refusal(torque)
            return self._traced_forces().at(0)
        finally:
            self.tracing, self.trace, self.touchdowns = kept

    @override
    def peak_loads(self) -> tuple[float, float]:
        """Return the largest loads on joints of the first robot in its last step.

        The step must have been traced. Time steps with and without a landing are separate, because
        a rigid foot stops at once: the impulse of the landing is defined, but its force is not.

        Returns:
            The largest force in time steps without a landing, in N, and the largest impulse in time
            steps with a landing, in N s. The impulse includes that of the ordinary force in the
            same time step.
        """
        largest = self._traced_forces().bearing.max(axis=(-2, -1))
        landing = self.touchdowns
        force = largest[~landing]
        impulse = largest[landing] * self.time_step
        return float(force.max(initial=0.0)), float(impulse.max(initial=0.0))

    def _traced_forces(self) -> JointForces:
        """Return the forces in every joint in each time step of the last trace."""
        gravity = self.properties[GRAVITY_XY][0].item()
        return trace_forces(self.tables_in_force(0), self.trace, self.time_step, gravity)

    @override
    def close(self) -> None:
        self._threads.close()

    def __getstate__(self) -> dict[str, Any]:
        """Pickle only the arguments and the state; everything else is rebuilt."""
        kept = (
            "robots",
            "terrains",
            "_arguments",
            "tracing",
            "in_contact",
            "any_diverged",
            "joint_gap",
            "records",
            "engine_settings",
            "_torque_rate",
        )
        return {name: getattr(self, name) for name in kept}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        records = saved["records"]
        arguments = saved["_arguments"]
        every = np.arange(len(saved["robots"]))
        before = records.copy(every)
        self.__init__(saved["robots"], saved["terrains"], *arguments, records=records)  # type: ignore[misc]
        self.engine_settings[:] = saved["engine_settings"]
        self._torque_rate = saved["_torque_rate"]
        self._make_scratch(arguments[2])
        self._apply(every)
        records.restore(every, before)
        self.joint_gap[:] = saved["joint_gap"]
        self._find_ground(self._every)
        self.tracing = saved["tracing"]
        self.in_contact = saved["in_contact"]
        self.any_diverged = saved["any_diverged"]
