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
from jansen_env.dynamics.pads import pad_sides
from jansen_env.dynamics.reduced import Tables, compile_robot
from jansen_env.engine import collision, integrator, placement
from jansen_env.engine.collision import MARGIN, SPECULATIVE_MARGIN
from jansen_env.engine.records import CONTACT_STATISTICS, PLANE, ROBOT, UNKNOWN_DEFLECTION, WORLD
from jansen_env.engine.tables import energy
from jansen_env.gravity import GRAVITY, Gravity, gravity_vector
from jansen_env.parameters import ROBOT_PARAMETERS, nominal, plain
from jansen_env.plants.base import (
    check_held,
    check_legs,
    check_pushes,
    check_time_step,
    divergence,
    resting_depth,
)
from jansen_env.plants.design_tables import DesignTables
from jansen_env.plants.grounds import Grounds
from jansen_env.plants.robot_parameters import (
    apply_to_kernels,
    check_restitution,
    check_values,
    kernel_row,
    machine_of,
)
from jansen_env.plants.threads import Memory, Threads
from jansen_env.plants.trace import find_touchdowns, pads_in_contact, trace_forces
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

TIME_STEP = 1e-3  # s
DETECTION_INTERVAL = 0.01  # s between two looks for the ground; its planes are kept meanwhile
PLANES_PER_PAD = 4  # kept of a robot, on average over its pads
GRAVITY_XY = ["gravity_x", "gravity_y"]  # fields of PARAMS
NOT_THE_ROBOT = [*GRAVITY_XY, "steepest", "design", "held"]
RESULTS = ("states", "accumulators", "contact_statistics", "slip", "contact_force", "diverged")
PARAMETERS = ("params", "nominal_params", "parameters")


class Batch:
    """n robots on their terrains; each moves as it would alone, bit for bit.

    Args:
        robots: with legs on the same sides; all else may differ. terrains: the ground of each.
        time_step: of the integration, s.
        gravity: m/s^2 downwards, or a vector (x, y).
        threads: see :class:`jansen_env.plants.threads.Threads`.
        links_collide: whether sides of links touch vertices of the ground, as capsules of the pads'
            radius (:func:`jansen_env.dynamics.pads.pad_sides`); else only pads touch. Joint forces
            are not known then.
        held: whether all chassis stay where they are, as in the paper's fixed model: there is no
            ground then, pushes do nothing, and robots are placed level, the axis at (x, 0).

    Attributes:
        toes, pads: of a robot. designs: the kernels' tables of the robots.
        surface: (vertices, 2) m, of all terrains: a robot's are in its row's status.
        states: (n, 8) x, y, theta, psi and rates, x, y the crank axis, m, rad, s; to be read.
        rows: (n,) ROBOT of :mod:`jansen_env.engine.records`: params, PARAMS in force; status;
            accumulators, sums over the last :meth:`step`. nominal_params: (n,) PARAMS without
            :meth:`set_parameters`.
        contact_statistics: (n, pads) CONTACT_STATISTICS, sums of the same; deflection: (n, pads, 2)
            compression and bend of compliant pads, m; to be read.
        slip: (n, toes) m, contact_force: (n, toes, 2) N, joint_gap: (n,) m, of the last step.
        diverged: (n,) whether the last step was refused. any_diverged: whether one was.
        parameters: (n,) ROBOT_PARAMETERS in force.
        tracing: whether the first robot's steps are recorded: trace, (steps,) of
            :func:`jansen_env.engine.integrator.trace_dtype`, and touchdowns, (steps,) whether a pad
            touched down in each.
        in_contact: (pads,) the first robot's pads on the ground, as traced last; None where that is
            not known. It says what touches down next, and nothing else.
        knows_joint_forces: whether :meth:`joint_forces` does. joints_open: whether joints gap.

    Raises:
        ValueError: an argument out of range, or legs on other sides; LinkageError: a robot
            cannot turn its crank.
    """

    joints_open = False
    lookahead_steps = 1

    def __init__(
        self,
        robots: Sequence[Robot],
        terrains: Sequence[Terrain],
        time_step: float = TIME_STEP,
        gravity: Gravity = GRAVITY,
        threads: int | None = None,
        held: bool = False,
        links_collide: bool = False,
    ) -> None:
        if len(robots) != len(terrains) or not robots:
            raise ValueError(
                f"there are {len(robots)} robots and {len(terrains)} terrains, must be as many, "
                "and at least one"
            )
        different = {id(robot): robot for robot in robots}
        for robot in different.values():
            check_legs(robot, robots[0])
        self._arguments = (time_step, gravity, threads, held, links_collide)
        self.robots, self.terrains, self.held = list(robots), list(terrains), held
        self.time_step = check_time_step(time_step)
        self.designs, n = DesignTables(robots), len(robots)
        self._sides = pad_sides(robots[0])
        self.toes, self.pads = len(robots[0].toes), len(self.designs.model.layout[0])
        toes, pads, self._every = self.toes, self.pads, np.arange(n)
        # Parameters.
        kernel_rows = {key: kernel_row(robot) for key, robot in different.items()}
        self.nominal_params = np.concatenate([kernel_rows[id(robot)] for robot in robots])
        self.nominal_params[GRAVITY_XY] = gravity_vector(gravity)
        self.nominal_params["steepest"] = [terrain.steepest for terrain in terrains]
        self.nominal_params["design"], self.nominal_params["held"] = self.designs.number, held
        values = [nominal(*pair) for pair in zip(robots, terrains, strict=True)]
        self.parameters = np.array(values, ROBOT_PARAMETERS)
        check_restitution(self.nominal_params["compliant"], self.parameters["restitution"])
        self._links_mass = np.array([robot.links_mass for robot in robots])
        self.any_gives = bool(self.nominal_params["compliant"].any())
        # Motion.
        self.rows, self.states = np.zeros(n, ROBOT), np.zeros((n, 8))
        self.params, self._status = self.rows["params"], self.rows["status"]
        self.accumulators = self.rows["accumulators"]
        self._apply(self._every)
        self.contact_statistics = np.zeros((n, pads), CONTACT_STATISTICS)
        self.deflection: Array = self.contact_statistics["deflection"]
        self.deflection[:] = UNKNOWN_DEFLECTION
        self.slip, self.contact_force = np.zeros((n, toes)), np.zeros((n, toes, 2))
        self.joint_gap = np.zeros(n)
        self.diverged, self.any_diverged = np.zeros(n, bool), False
        # The ground.
        capacity = PLANES_PER_PAD * pads
        self._world, self.planes = np.zeros(1, WORLD), np.zeros(n * capacity, PLANE)
        stride = max(1, round(DETECTION_INTERVAL / time_step))
        self._world[0] = self.time_step, stride, toes, capacity, links_collide
        self.knows_joint_forces = not links_collide
        self._status["margin"] = SPECULATIVE_MARGIN
        self._status["first_plane"] = self._status["end_plane"] = capacity * self._every
        self._grounds, self._longest = Grounds(terrains, self._status), self.time_step
        # Arguments of kernels.
        self._advance = integrator.advance.bound()
        self._threads = Threads(
            n,
            threads,
            lambda: (*integrator.work_space(capacity), np.zeros(n, np.int64), np.zeros(2, bool)),
        )
        self._place = placement.place.bound()
        self._at_once = np.zeros(n), np.zeros(n, np.int64)  # no torque from before
        self._ahead_torque = np.zeros(n)  # N m, of :meth:`lookahead`
        self._no_pushes = np.zeros((0, 0, 2))
        self._no_trace: Rows = np.zeros(0, integrator.trace_dtype(pads))
        self._untraced = plain(self._no_trace)
        self._centres = np.zeros((max(pads, toes + 1), 2))  # of toes and centre of mass, or pads
        self._sums = np.empty((3, 6))
        self.tracing, self.trace, self.touchdowns = False, self._no_trace, np.zeros(0, bool)
        self.in_contact: Bools | None = None
        self._share_arrays()

    def _share_arrays(self) -> None:
        """Note the arguments that threads share in a step."""
        model, self.surface = self.designs.model, self._grounds.surface
        self._shared = (
            self.states, model.body, model.pads, model.layout, model.bearings, self._sides,
            self.surface, self.designs.depths, self._world, self.rows, self.planes,
            self.contact_statistics, self.slip, self.contact_force,
        )  # fmt: skip
        self._placed = (
            self.states, model.body, model.pads, model.layout, self.rows, self.surface,
            self._world, self._centres, self.planes,
        )  # fmt: skip

    def set_parameters(self, rows: Ints, values: Rows) -> None:
        """Put ``values`` (k,) of ROBOT_PARAMETERS in force, from the robots' next placing on.

        Raises:
            ValueError: one is out of its limits, or restitution with compliant pads.
        """
        check_values(values, self.nominal_params["compliant"][rows])
        self.parameters[rows] = values
        self._apply(rows)

    def _apply(self, rows: Ints) -> None:
        """Make the kernels' rows of robots those of their :attr:`parameters`."""
        params = self.nominal_params[rows]  # a copy
        centre, pad = self.designs.farthest[self.designs.number[rows]].swapaxes(0, 1)
        apply_to_kernels(params, self.parameters[rows], self._links_mass[rows], centre, pad)
        params["prescribed_speed"] = self.params["prescribed_speed"][rows]
        self.params[rows] = params
        self._status["pad_radius"][rows] = params["pad_radius"]

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
        self.designs.set(rows, robots)
        for row, robot in zip(rows.tolist(), robots, strict=True):
            params = kernel_row(robot)
            params[NOT_THE_ROBOT] = self.nominal_params[NOT_THE_ROBOT][[row]]
            self.robots[row], self._links_mass[row] = robot, robot.links_mass
            self.nominal_params[row] = params[0]
            self.parameters[row] = nominal(robot, self.terrains[row])
        self.nominal_params["design"][rows] = self.designs.number[rows]
        self.any_gives = bool(self.nominal_params["compliant"].any())
        self._apply(rows)
        self.deflection[rows] = UNKNOWN_DEFLECTION
        self._status["asked_x"][rows] = np.inf
        self._share_arrays()

    def tables_in_force(self, row: int) -> Tables:
        """Return the tables of a robot under its parameters."""
        return compile_robot(machine_of(self.robots[row], self.parameters[row]))

    def set_terrain(self, row: int, terrain: Terrain) -> None:
        """Change a robot's ground, with friction and restitution: it must be placed again.

        Raises:
            ValueError: restitution with compliant pads.
        """
        compliant = self.nominal_params["compliant"][row : row + 1]
        check_restitution(compliant, np.array([terrain.restitution]))
        self.terrains[row] = terrain
        self.nominal_params["steepest"][row] = self.params["steepest"][row] = terrain.steepest
        for name in ("friction", "restitution"):
            for numbers in (self.parameters, self.params):
                numbers[name][row] = getattr(terrain, name)
        self._grounds.set_terrain(row, terrain)
        if self.surface is not self._grounds.surface:
            self._share_arrays()

    def _ask_ground(self, rows: Ints) -> None:
        """Ask pymunk for the ground of those robots (k,) that have moved by the margin."""
        if self.held:
            return
        moved = np.abs(self.states[rows, 0] - self._status["asked_x"][rows])
        for row in rows[~(moved <= MARGIN)].tolist():
            extent = float(self.designs.extent[self.designs.number[row]])
            self._grounds.find_stretch(row, float(self.states[row, 0]), extent, self._longest)

    def place(self, rows: Ints, crank_angles: ArrayLike, crank_speeds: ArrayLike = 0.0) -> None:
        """Place robots (k,) at x = 0, see :meth:`place_at`, and :meth:`lookahead`; then they move.

        ``crank_speeds``: (k,) rad/s, from which they go on.
        """
        self.place_at(rows, crank_angles)
        self.lookahead(rows=rows)
        self.states[rows, 7] = crank_speeds

    def place_at(
        self, rows: Ints, crank_angles: ArrayLike, x: float = 0.0, pitch: float | None = None
    ) -> None:
        """Place robots (k,) at rest on their lowest toes, 10 um deep, so that they carry at once.

        Args:
            crank_angles: (k,) rad. x: of the crank axis, m.
            pitch: rad; None turns a robot until both its fore and its back feet carry it
                (until the ground bears it on both sides of its centre of mass).

        Raises:
            ValueError: a number that is not finite, or feet too soft for their robot.
        """
        x, pitch = finite("x", x), None if pitch is None else finite("pitch", pitch)
        states = np.zeros((len(rows), 8))
        states[:, 0], states[:, 3] = x, crank_angles
        states[:, 2] = pitch if pitch is not None else 0.0 if self.held else math.nan
        if self.any_gives and not self.held:
            for row in rows.tolist():
                params = self.params[row]
                resting_depth(params["mass"], params["stiffness"][0], -params["gravity_y"])
        self.states[rows] = states
        if not self.held:
            self._ask_ground(rows)
            self._place(rows, self._placed)
        self.deflection[rows] = UNKNOWN_DEFLECTION
        self.diverged[rows] = False
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
        # Copies; an index would take longer.
        before = [(array := getattr(self, name), array.take(rows, axis=0)) for name in RESULTS]
        parameters, in_contact = self.parameters[rows], self.in_contact

        def undo() -> None:
            self.set_robots(rows, [robot for robot, _ in robots])
            for row, (_, terrain) in zip(rows.tolist(), robots, strict=True):
                if terrain is not self.terrains[row]:
                    self.set_terrain(row, terrain)
            self.parameters[rows] = parameters
            self._apply(rows)
            for array, values in before:
                array[rows] = values
            self._ask_ground(rows)
            self.any_diverged, self.in_contact = bool(self.diverged.any()), in_contact

        return undo

    def step(
        self,
        torque: Array,
        steps: int,
        earlier: Array | None = None,
        switch: Ints | None = None,
        rows: Ints | None = None,
        meanwhile: Callable[[], None] | None = None,
        pushes: Array | None = None,
        finish: Callable[[Ints], None] | None = None,
    ) -> None:
        """Hold crank torques (n,), N m, for some time steps, as far as the motors go.

        A robot that becomes faster than :data:`jansen_env.engine.integrator.DIVERGED`, leaves the
        stretch of ground that is known for the step or gets too deep into the ground stays as it
        was before, without sums, and is named in :attr:`diverged`. The others go on.

        Args:
            earlier: (n,) N m, held instead in the first ``switch`` (n,) of them.
            rows: (k,) of the robots that move; None for all. meanwhile: may place the others.
            pushes: (n, steps, 2) N s, the impulse on each chassis at the crank axis in each time
                step, world x and y; None for none.
            finish: called with robots (k,) that have moved, each once, on the thread that did it.

        Raises:
            ValueError: pushes of another shape.
        """
        if pushes is None:
            pushes = self._no_pushes
        else:
            pushes = check_pushes(pushes, len(self.states), steps)
        if earlier is None:
            earlier, switch = self._at_once
        torques = torque, earlier, switch, pushes
        self._run(self._every if rows is None else rows, torques, steps, meanwhile, finish)

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
        states, deflection = self._run(rows, (self._ahead_torque, *self._at_once, pushes), 1)
        self.states[rows], self.in_contact = states, in_contact
        if deflection is not None:
            self.deflection[rows] = deflection

    def _run(
        self,
        rows: Ints,
        torques: tuple[Array | Ints | None, ...],
        steps: int,
        meanwhile: Callable[[], None] | None = None,
        finish: Callable[[Ints], None] | None = None,
    ) -> tuple[Array, Array | None]:
        """:meth:`step` of some robots; ``torques``: torque, earlier, switch and pushes.

        Returns their states before and, of a batch with compliant pads, their deflections.
        """
        states = self.states.take(rows, axis=0)  # quicker than an index
        before = states, self.deflection.take(rows, axis=0) if self.any_gives else None
        if len(rows) == 0:  # others are placed, no more
            if meanwhile is not None:
                meanwhile()
            return before
        if self.any_diverged:
            self.diverged[rows] = False
            self.any_diverged = bool(self.diverged.any())
        duration = steps * self.time_step
        if duration > self._longest:
            self._longest = duration
            self._status["asked_x"] = np.inf
            self._ask_ground(self._every)
        trace, numbers = self._no_trace, self._untraced
        if self.tracing:
            trace = np.empty(steps, trace.dtype)
            numbers = plain(trace)

        def move(thread: int, shares: Ints, most: int, memory: Memory) -> tuple[bool, bool]:
            count = self._advance(
                thread, shares, most, rows, steps, *torques, numbers, memory, self._shared
            )
            moved, flags = memory[-2:]
            if finish is not None and count > 0:
                finish(moved if count == len(moved) else moved[:count])
            far, diverged = flags.tolist()
            return far, diverged

        far, diverged = self._threads.move(len(rows), move, meanwhile)
        if diverged:
            lost = self._refuse(rows, before)
            if finish is not None:
                finish(lost)
        if far:
            self._ask_ground(rows)
        if self.tracing or self.in_contact is not None or self.trace is not self._no_trace:
            self._keep_trace(trace)
        return before

    def _refuse(self, rows: Ints, before: tuple[Array, Array | None]) -> Ints:
        """Return the robots that have diverged, left as they were ``before``: state, deflection."""
        gone = self._status["lost"][rows]
        lost = rows[gone]
        self.diverged[lost] = self.any_diverged = True
        self.states[lost] = before[0][gone]
        if before[1] is not None:
            self.deflection[lost] = before[1][gone]
        self.accumulators[lost] = 0.0
        self.slip[lost] = self.contact_force[lost] = 0.0
        for name in ("slip", "impulse"):
            self.contact_statistics[name][lost] = 0.0
        return lost

    def _keep_trace(self, trace: Rows) -> None:
        """Keep the trace of a step (no rows: of none), unless the first robot has diverged."""
        if self.any_diverged and self.diverged[0]:
            self.trace, self.touchdowns = self._no_trace, np.zeros(0, bool)
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
        return float(energy(row, self.states, self.rows, self.designs.model.body, self._sums))

    def pad_centres(self, row: int) -> Array:
        """(pads, 2) centres of a robot's pads, toes first, m."""
        model, design = self.designs.model, self.designs.number[row]
        collision.pad_centres(
            self.states[row], model.pads[design], model.layout[design], self._centres
        )
        return self._centres[: self.pads].copy()

    def contact_frames(self, row: int) -> tuple[Array, Array]:
        """(toes, 2) points of the ground nearest to a robot's toes and its tangents there.

        Where no ground is within reach, the pad's lowest point and +x.
        """
        centres, radius = self.pad_centres(row)[: self.toes], self.robots[row].pad_radius
        points = centres - np.array([0.0, radius])
        tangents = np.tile([1.0, 0.0], (self.toes, 1))
        if self.held:
            return points, tangents
        status = self._status[row]
        status["margin"] = SPECULATIVE_MARGIN
        collision.planes_near(row, centres, self.rows, self.surface, self._world, self.planes)
        planes = self.planes[status["first_plane"] : status["end_plane"]]
        for plane in planes[::-1]:  # a pad's nearest comes last
            pad, normal = plane["pad"], np.array([plane["normal_x"], plane["normal_y"]])
            points[pad] = centres[pad] - radius * normal
            tangents[pad] = normal[1], -normal[0]
        return points, tangents

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
            robot, (q, q_dot) = self.tables_in_force(0).robot, np.split(self.states[0], 2)
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
        largest, landing = self._traced_forces().bearing.max(axis=(-2, -1)), self.touchdowns
        force, impulse = largest[~landing], largest[landing] * self.time_step
        return float(force.max(initial=0.0)), float(impulse.max(initial=0.0))

    def _traced_forces(self) -> JointForces:
        """Forces in every joint in each time step that was traced last."""
        gravity = self.params[GRAVITY_XY][0].item()
        return trace_forces(self.tables_in_force(0), self.trace, self.time_step, gravity)

    def close(self) -> None:
        """Let go of threads."""
        self._threads.close()

    def __getstate__(self) -> dict[str, Any]:
        """The arguments, and what has become of them: everything else is made again from them."""
        kept = ("robots", "terrains", "_arguments", "tracing", "in_contact", *RESULTS, *PARAMETERS)
        return {name: getattr(self, name) for name in kept}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(saved["robots"], saved["terrains"], *saved["_arguments"])  # type: ignore[misc]
        for name in (*RESULTS, *PARAMETERS):
            getattr(self, name)[:] = saved[name]
        for params in (self.params, self.nominal_params):
            params["design"] = self.designs.number  # which are numbered again
        self._ask_ground(self._every)
        self.tracing, self.in_contact = saved["tracing"], saved["in_contact"]
        self.any_diverged = bool(self.diverged.any())
