"""Robots that move at once by the projected equations, on the ground or with their chassis held."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jansen_env.arrays import Array, Bools, Ints, Rows
from jansen_env.checks import finite
from jansen_env.dynamics.joint_forces import JointForces, joint_forces
from jansen_env.dynamics.reduced import Tables, compile_robot
from jansen_env.engine import collision, episode, integrator
from jansen_env.engine.collision import MARGIN, SPECULATIVE_MARGIN
from jansen_env.engine.episode import Episodes, Observing
from jansen_env.engine.records import PLANE, UNKNOWN_DEFLECTION, Scratch
from jansen_env.engine.tables import energy
from jansen_env.gravity import GRAVITY, Gravity
from jansen_env.parameters import nominal, plain
from jansen_env.plants.base import (
    check_colliding,
    check_held,
    check_legs,
    check_pushes,
    divergence,
)
from jansen_env.plants.batched_plant import GRAVITY_XY, BatchedPlant
from jansen_env.plants.design_tables import DesignTables
from jansen_env.plants.kernel_arrays import KernelArrays
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

TIME_STEP = 1e-3  # s
DETECTION_INTERVAL = 0.01  # s between two looks for the ground; its planes are kept meanwhile


class Batch(BatchedPlant):
    """n robots on their terrains; each moves as it would alone, bit for bit.

    The kernels move robots on height lines, shared among threads. Robots on pymunk's shapes are
    moved after them (:mod:`jansen_env.plants.robots_on_shapes`).

    Args:
        robots: The robots, with legs on the same sides; all else may differ.
        terrains: The ground of each robot.
        time_step: Time step of the integration in s.
        gravity: In m/s^2 downwards, or a vector (x, y).
        threads: See :class:`jansen_env.plants.threads.Threads`.
        held: Whether all chassis stay where they are, as in the paper's fixed model: there is no
            ground then, pushes do nothing, and robots are placed level, the axis at (x, 0).
        links_collide: Whether sides of links touch vertices of the ground, as capsules of the pads'
            radius (:func:`jansen_env.dynamics.pads.pad_sides`); else only pads touch. Joint forces
            are not known then.
        records: Records to use; None for new ones.

    Attributes:
        toes: Number of toes of each robot.
        pads: Number of contact pads of each robot, toes included.
        records: The robots, see :class:`RobotRecords`.
        machines: Shape (n,), ``MACHINE`` of :mod:`jansen_env.engine.records`: the robots without
            parameters.
        joint_gap: Shape (n,), widest gap of any joint in the last step in m: 0 here.
        any_diverged: Whether a robot's last step was refused.
        tracing: Whether the first robot's steps are recorded.
        trace: Shape (steps,), :func:`jansen_env.engine.integrator.trace_dtype` of its time steps.
        touchdowns: Shape (steps,), whether a pad touched down in each of them.
        in_contact: Shape (pads,), the first robot's pads on the ground, as traced last; None where
            that is not known. It says what touches down next, and nothing else.
        knows_joint_forces: Whether :meth:`joint_forces` returns them.
        joints_open: Whether joints can gap.

    Raises:
        ValueError: If an argument is out of range, or legs are on other sides.
        LinkageError: If a robot cannot turn its crank.
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
        held: bool = False,
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
        self._arguments = (time_step, gravity, threads, held, links_collide)
        check_colliding(terrains, links_collide)
        super().__init__(robots, terrains, time_step, gravity, held, records)
        self.world["stride"] = max(1, round(DETECTION_INTERVAL / time_step))
        self.world["links_collide"] = links_collide
        self.records.status["margin"] = SPECULATIVE_MARGIN
        self.knows_joint_forces = not links_collide
        self._arrays = KernelArrays(robots, terrains, self.records, self.world, held)
        self._placement = RobotPlacement(self._arrays)
        self._set_machines(self._every)
        self._apply(self._every)
        # Arguments of kernels.
        self._advance = integrator.advance.bound()
        self._control_step = episode.control_step.bound()
        self._make_scratch(threads)
        n = len(robots)
        self._at_once = np.zeros(n), np.zeros(n, np.int64)  # no torque from before
        self._ahead_torque = np.zeros(n)  # N m, of :meth:`lookahead`
        self._no_pushes = np.zeros((0, 0, 2))
        self._no_trace: Rows = np.zeros(0, integrator.trace_dtype(self.pads))
        self._untraced = plain(self._no_trace)
        self._planes = np.zeros(self.world["capacity"][0], PLANE)  # of :meth:`contact_planes`
        self._sums = np.empty((3, 6))
        self.tracing = False
        self.trace = self._no_trace
        self.touchdowns: Bools = np.zeros(0, bool)
        self.in_contact: Bools | None = None

    def _make_scratch(self, threads: int | None) -> None:
        """Make the memory of threads."""
        capacity = int(self.world["capacity"][0])
        steps = int(self.world["steps"][0])

        def memory() -> Scratch:
            return integrator.work_space(capacity, self.pads, steps)

        self._threads = Threads(len(self.robots), threads, memory)
        self._on_shapes = RobotsOnShapes(self._arrays, memory())

    def set_control(
        self, steps: int, period: float, torque_rate: float = math.inf, **flags: bool
    ) -> None:
        super().set_control(steps, period, torque_rate, **flags)
        self._make_scratch(self._arguments[2])
        self._reach(period)

    def _set_machines(self, rows: Ints) -> None:
        """Note robots (k,) as they are without parameters, with the tables of their designs."""
        super()._set_machines(rows)
        numbers = self.designs.number[rows]
        nominal_params: Any = self.machines["nominal"]
        nominal_params["design"][rows] = numbers
        self.machines["centre"][rows] = self.designs.farthest[numbers, 0]
        self.machines["pad"][rows] = self.designs.farthest[numbers, 1]

    def reconnect(self) -> None:
        """Take other views of the records, which have been made anew."""
        self._arrays.refresh()

    @property
    def designs(self) -> DesignTables:
        """The kernels' tables of the robots."""
        return self._arrays.tables

    @property
    def surface(self) -> Array:
        """Vertices of all terrains in m, shape (vertices, 2); a robot's are in its status."""
        return self._arrays.grounds.surface

    # Robots, parameters and grounds.

    def set_parameters(self, rows: Ints, values: Rows) -> None:
        """Apply ``values`` (k,) of :data:`jansen_env.parameters.EPISODE`, from the next placing on.

        Raises:
            ValueError: one is out of its limits, or restitution with compliant pads.
        """
        check_values(values, self.machines["nominal"]["compliant"][rows])
        self.records.parameters[rows] = values
        self._apply(rows)

    def check_feet(self, robot: Robot, values: np.void) -> None:
        """Check that the time step resolves a robot's compliant feet under parameters.

        Environments refuse feet that it does not resolve; a batch takes them for rigid ones.

        Raises:
            ValueError: If it does not resolve them.
        """
        if not self.held:
            check_resolved(robot, values, self.time_step)

    def check_robot(self, robot: Robot) -> None:
        """Raise what :meth:`set_robots` would for a robot in place of any other."""
        check_legs(robot, self.robots[0])
        compile_robot(robot)

    def set_robots(self, rows: Ints, robots: Sequence[Robot]) -> None:
        """Exchange robots (k,), with parameters that change nothing; they must be placed again.

        Raises:
            ValueError: legs on other sides; LinkageError: a robot cannot turn its crank. Nothing
                has changed then.
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
        """Return the tables of a robot under its parameters."""
        return compile_robot(machine_of(self.robots[row], self.parameters[row]))

    def set_terrain(self, row: int, terrain: Ground) -> None:
        """Change a robot's ground, with friction and restitution: it must be placed again.

        Raises:
            ValueError: restitution with compliant pads, or shapes where links collide.
        """
        check_colliding([terrain], bool(self.world["links_collide"][0]))
        compliant = self.machines["nominal"]["compliant"][row : row + 1]
        check_restitution(compliant, np.array([terrain.restitution]))
        self.terrains[row] = terrain
        nominal_params: Any = self.machines["nominal"]
        nominal_params["steepest"][row] = terrain.steepest
        for name in ("friction", "restitution"):
            self.records.parameters[name][row] = getattr(terrain, name)
        self._apply(self._every[row : row + 1])
        self._arrays.set_terrain(row, terrain)

    def _ask_ground(self, rows: Ints) -> None:
        """Note the stretch of ground of those robots (k,) that have moved by the margin."""
        x = self.states[rows, 0]
        is_near = np.abs(x - self.records.status["asked_x"][rows]) <= MARGIN
        for k in np.flatnonzero(~is_near).tolist():
            self._arrays.ask_ground(int(rows[k]), float(x[k]))

    def place(self, rows: Ints, crank_angles: ArrayLike, crank_speeds: ArrayLike = 0.0) -> None:
        """Place robots (k,) at x = 0, see :meth:`place_at`, and :meth:`lookahead`; then they move.

        ``crank_speeds``: (k,) rad/s, from which they go on.
        """
        self.place_at(rows, crank_angles)
        self.lookahead(rows=rows)
        speeds = self.states[:, 7]
        speeds[rows] = crank_speeds

    def place_at(
        self, rows: Ints, crank_angles: ArrayLike, x: float = 0.0, pitch: float | None = None
    ) -> None:
        """Place robots (k,) at rest on their lowest toes, 10 um deep, so that they carry at once.

        Args:
            crank_angles: (k,) rad. x: of the crank axis, m.
            pitch: rad; None turns a robot until both its fore and its back feet carry it
                (until the ground bears it on both sides of its centre of mass).

        Raises:
            ValueError: a number that is not finite, feet too soft for their robot, or no shapes
                below it.
        """
        x = finite("x", x)
        pitch = math.nan if pitch is None else finite("pitch", pitch)
        for row in rows.tolist():
            self._arrays.ask_ground(row, x)
        self._placement.place(rows, crank_angles, x, pitch)
        if self.in_contact is not None and 0 in rows:
            self.in_contact = None

    def set_state(self, row: int, state: ArrayLike, deflection: Array | None = None) -> None:
        """Put a robot into a state (8,), with ``deflection`` (pads, 2) m, or None if unknown.

        Raises:
            ValueError: the chassis moves although it is held.
        """
        if self.held:
            check_held(state)
        self.states[row] = state
        self._ask_ground(np.array([row]))
        self.deflection[row] = UNKNOWN_DEFLECTION if deflection is None else deflection
        if row == 0:
            self.in_contact = None

    def keep(self, rows: Ints) -> Callable[[], None]:
        """Return a function that makes robots (k,), and their grounds, what they are now."""
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
            self._ask_ground(rows)
            self.any_diverged = bool(self.diverged.any())
            self.in_contact = in_contact

        return undo

    def step(
        self,
        torque: Array,
        steps: int,
        earlier: Array | None = None,
        switch: Ints | None = None,
        rows: Ints | None = None,
        pushes: Array | None = None,
    ) -> None:
        """Hold crank torques (n,), N m, for some time steps, as far as the motors go.

        A robot that becomes faster than :data:`jansen_env.engine.integrator.DIVERGED`, leaves the
        stretch of ground that is known for the step or gets too deep into the ground stays as it
        was before, without sums, and is named in :attr:`diverged`. The others continue.

        Args:
            earlier: (n,) N m, held instead in the first ``switch`` (n,) of them.
            rows: (k,) of the robots that move; None for all.
            pushes: (n, steps, 2) N s, the impulse on each chassis at the crank axis in each time
                step, world x and y; None for none.

        Raises:
            ValueError: pushes of another shape.
        """
        if pushes is None:
            pushes = self._no_pushes
        else:
            pushes = check_pushes(pushes, len(self.states), steps)
        if earlier is None:
            earlier, switch = self._at_once
        self._run(self._every if rows is None else rows, (torque, earlier, switch, pushes), steps)

    def control_step(
        self,
        rows: Ints,
        actions: Array,
        episodes: Episodes,
        observing: Observing,
        meanwhile: Callable[[], None] | None = None,
    ) -> None:
        """Let robots (k,) take a control step, see :mod:`jansen_env.engine.episode`.

        Args:
            rows: Shape (k,), the robots.
            actions: Shape (n, 1), finite for each of them.
            episodes: Other parts of their records.
            observing: How they are observed.
            meanwhile: Called while others move, to place robots that do not.
        """
        if len(rows) == 0:  # others are placed, no more
            if meanwhile is not None:
                meanwhile()
            return
        trace = self._no_trace
        numbers = self._untraced
        if self.tracing:
            trace, numbers = self._new_trace(int(self.world["steps"][0]))

        lines, on_shapes = self._arrays.split(rows)

        def move(thread: int, shares: Ints, most: int, scratch: Scratch) -> tuple[bool, bool]:
            self._control_step(
                thread,
                shares,
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

    def lookahead(
        self, torque: float = 0.0, rows: Ints | None = None, pushes: Array | None = None
    ) -> None:
        """Fill sums with the next time step of some robots (all) under a torque; states stay.

        ``pushes``: (n, 1, 2) N s, as of :meth:`step`.
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
        """:meth:`step` of some robots.

        Args:
            rows: Shape (k,), the robots.
            torques: Torque, earlier, switch and pushes.
            steps: Number of time steps.
            ahead: Whether states stay.
        """
        if len(rows) == 0:
            return
        self._reach(steps * self.time_step)
        trace = self._no_trace
        numbers = self._untraced
        if self.tracing:
            trace, numbers = self._new_trace(steps)

        lines, on_shapes = self._arrays.split(rows)

        def move(thread: int, shares: Ints, most: int, scratch: Scratch) -> tuple[bool, bool]:
            self._advance(
                thread,
                shares,
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
        """Share robots on height lines among threads; :attr:`any_diverged` tells of them alone.

        Args:
            rows: Shape (k,), the robots.
            move: Moves a thread's share of them.
            meanwhile: Called while they move, to place robots that do not.
        """
        far, diverged = False, False
        if len(rows) > 0:
            far, diverged = self._threads.move(len(rows), move, meanwhile)
        elif meanwhile is not None:
            meanwhile()
        self.any_diverged = diverged  # at the end, as placing robots sets it, too
        if far:
            self._ask_ground(rows)

    def shapes(self, row: int) -> ShapePlanes | None:
        return self._arrays.grounds.shapes[row]

    def look_down(self, rows: Ints, scan: Array) -> None:
        for row in self._arrays.split(rows)[1]:
            self._arrays.look_down(row, scan)

    def _reach(self, duration: float) -> None:
        """Ask for as much ground as robots can reach in a step of ``duration``, s."""
        if duration > self._arrays.longest_step:
            self._arrays.longest_step = duration
            self.records.status["asked_x"] = np.inf
            self._ask_ground(self._every)

    def _new_trace(self, steps: int) -> tuple[Rows, Array]:
        """Return a trace of so many time steps, and its numbers."""
        trace: Rows = np.empty(steps, self._no_trace.dtype)
        return trace, plain(trace)

    def _keep_trace(self, trace: Rows) -> None:
        """Keep the trace of a step (no rows: of none), unless the first robot has diverged."""
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

    def refusal(self, torque: float) -> FloatingPointError:
        """Return the error of the first robot's last step, which was refused."""
        return divergence(self.states[0], torque)

    def energy(self, row: int) -> float:
        """Kinetic plus potential energy of a robot, J (potential 0 with its mass at y = 0)."""
        robots = self.records.robots
        body = self.designs.model.body
        return float(energy(row, robots, body, self._sums))

    def pad_centres(self, row: int) -> Array:
        """(pads, 2) centres of a robot's pads, toes first, m."""
        return self._arrays.pad_centres(row)

    def contact_frames(self, row: int) -> tuple[Array, Array]:
        """(toes, 2) points of the ground nearest to a robot's toes and its tangents there.

        Where no ground is within reach, the pad's lowest point and +x.
        """
        centres = self.pad_centres(row)[: self.toes]
        radius = self.robots[row].pad_radius
        points = centres - np.array([0.0, radius])
        tangents = np.tile([1.0, 0.0], (self.toes, 1))
        if self.held:
            return points, tangents
        for plane in self.contact_planes(row, centres)[::-1]:  # a pad's nearest comes last
            normal = np.array([plane.normal_x, plane.normal_y])
            points[plane.pad] = centres[plane.pad] - radius * normal
            tangents[plane.pad] = normal[1], -normal[0]
        return points, tangents

    def contact_planes(self, row: int, centres: Array | None = None) -> list[ContactPlane]:
        """Return the contact planes within :data:`SPECULATIVE_MARGIN` of a robot's pads.

        Kernels derive them where the robot's ground is a height line; else they are pymunk's.

        Args:
            row: The robot.
            centres: Shape (pads, 2) or fewer, m, taken for its pads; None for where they are.

        Returns:
            In the order of the pads, the nearest first.
        """
        centres = self.pad_centres(row) if centres is None else centres
        status = self.records.status[row]
        shapes = self.shapes(row)
        if shapes is not None:
            return shapes.find(centres, float(status["pad_radius"]) + SPECULATIVE_MARGIN)
        status["margin"] = SPECULATIVE_MARGIN
        robots = self.records.robots
        collision.planes_near(row, centres, robots, self.surface, self.world, self._planes)
        planes = self._planes[status["first_plane"] : status["end_plane"]]
        return [ContactPlane(*row) for row in planes[[*ContactPlane._fields]].tolist()]

    def joint_forces(self, torque: float = 0.0, push: Array | None = None) -> JointForces:
        """Mean forces in every joint of the first robot in the next time step.

        They contain a landing toe's impulse / time step; of a held robot, forces at this instant.

        Args:
            torque: N m, of the crank. push: (2,) N s, the impulse on the chassis in that step.

        Raises:
            FloatingPointError: it diverges in that step. ValueError: links collide.
        """
        if not self.knows_joint_forces:
            raise ValueError("for joint forces links_collide is True, must be False")
        if self.held:
            robot = self.tables_in_force(0).robot
            q, q_dot = np.split(self.states[0], 2)
            gravity = self.params[GRAVITY_XY][0].item()
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

    def peak_loads(self) -> tuple[float, float]:
        """The largest loads on joints of the first robot in its last step, if it was traced.

        The force in time steps without a landing, N; the impulse in those with one, N s: a rigid
        foot stops at once, with an impulse that is defined and a force that is not. The ordinary
        force in that step is included.
        """
        largest = self._traced_forces().bearing.max(axis=(-2, -1))
        landing = self.touchdowns
        force = largest[~landing]
        impulse = largest[landing] * self.time_step
        return float(force.max(initial=0.0)), float(impulse.max(initial=0.0))

    def _traced_forces(self) -> JointForces:
        """Forces in every joint in each time step that was traced last."""
        gravity = self.params[GRAVITY_XY][0].item()
        return trace_forces(self.tables_in_force(0), self.trace, self.time_step, gravity)

    def close(self) -> None:
        """Let go of threads."""
        self._threads.close()

    def __getstate__(self) -> dict[str, Any]:
        """Return the arguments and what has become of them; everything else is made again."""
        kept = (
            "robots",
            "terrains",
            "_arguments",
            "tracing",
            "in_contact",
            "any_diverged",
            "joint_gap",
            "records",
            "world",
            "_torque_rate",
        )
        return {name: getattr(self, name) for name in kept}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        records = saved["records"]
        arguments = saved["_arguments"]
        every = np.arange(len(saved["robots"]))
        before = records.copy(every)
        self.__init__(saved["robots"], saved["terrains"], *arguments, records=records)  # type: ignore[misc]
        self.world[:] = saved["world"]
        self._torque_rate = saved["_torque_rate"]
        self._make_scratch(arguments[2])
        self._apply(every)
        records.restore(every, before)
        self.joint_gap[:] = saved["joint_gap"]
        self._ask_ground(self._every)
        self.tracing = saved["tracing"]
        self.in_contact = saved["in_contact"]
        self.any_diverged = saved["any_diverged"]
