"""Robots that move at once: one search for contacts, then all their time steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jansen_env.checks import positive
from jansen_env.dynamics.joint_forces import JointForces, joint_forces
from jansen_env.engine import integrator
from jansen_env.engine.collision import SPECULATIVE_MARGIN
from jansen_env.engine.records import PLANE, UNKNOWN_DEFLECTION, WORLD
from jansen_env.engine.tables import energy
from jansen_env.gravity import GRAVITY, Gravity
from jansen_env.parameters import CHANGES
from jansen_env.plants.base import check_held, check_pushes, check_time_step, divergence
from jansen_env.plants.grounds import Grounds
from jansen_env.plants.placing import PlacedRobots
from jansen_env.plants.threads import Threads
from jansen_env.plants.trace import (
    PeakLoads,
    find_touchdowns,
    pads_in_contact,
    peak_loads,
    trace_forces,
)
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

TIME_STEP = 1e-3  # s
DETECTION_INTERVAL = 0.01  # s between two looks for the ground; its planes are kept meanwhile
PLANES_PER_PAD = 4  # kept of a robot, on average over its pads
RESULTS = ("states", "accumulators", "contact_statistics", "slip", "contact_force")
CHANGING = (*RESULTS, "params", "nominal_params", "nominal", "parameters", "diverged")


class Batch(PlacedRobots):
    """Robots on their terrains, advanced together by the projected equations.

    Each moves as it would alone, bit for bit. Methods and attributes that are not documented here
    are those of :class:`jansen_env.plants.base.BatchedPlant`.

    Args:
        robots: with legs on the same sides; all else may differ. terrains: the ground of each.
        time_step: of the integration, s.
        gravity: m/s^2 downwards, or a vector (x, y).
        detection_interval: time between two looks for the ground, s.
        threads: see :class:`jansen_env.plants.threads.Threads`.
        held: whether all chassis stay where they are, as in the paper's fixed model: there is no
            ground then, pushes do nothing, and robots are placed level, the axis at (x, 0).

    Attributes:
        designs: the kernels' tables of the robots.
        params: (n,) PARAMS of :mod:`jansen_env.engine.records`, in force; nominal_params: (n,) the
            same without :meth:`set_parameters`. accumulators: (n,) ACCUMULATORS and
            contact_statistics: (n, pads) CONTACT_STATISTICS, sums over the last :meth:`step`.
        trace: (steps,) of :func:`jansen_env.engine.integrator.trace_dtype`, the first robot's last
            :meth:`step` if ``tracing``; touchdowns: (steps,) whether a pad touched down in each.
        in_contact: (pads,) the first robot's pads on the ground, as traced last; None where that is
            not known. It says what touches down next, and nothing else.

    Raises:
        ValueError: an argument out of range, or legs on other sides; LinkageError: a robot
            cannot turn its crank.
    """

    changeable = frozenset(
        {"friction", "restitution", "payload", "motor", "pad_compliance", "gravity", *CHANGES}
    )
    knows_joint_forces, joints_open = True, False
    lookahead_steps = 1

    def __init__(
        self,
        robots: Sequence[Robot],
        terrains: Sequence[Terrain],
        time_step: float = TIME_STEP,
        gravity: Gravity = GRAVITY,
        detection_interval: float = DETECTION_INTERVAL,
        threads: int | None = None,
        held: bool = False,
    ) -> None:
        self._arguments = (time_step, gravity, detection_interval, threads, held)
        super().__init__(robots, terrains, gravity, held)
        self.toes = len(robots[0].toes)
        self.accumulators = self.rows["accumulators"]
        self.deflection: Array = self.contact_statistics["deflection"]
        self.time_step = check_time_step(time_step)
        self.detection_interval = positive("detection_interval", detection_interval)
        n, pads = len(self.robots), self.pads
        capacity = PLANES_PER_PAD * pads
        stride = max(1, round(detection_interval / time_step))
        self._world = np.zeros(1, WORLD)
        self._world[0] = self.time_step, stride, self.toes, capacity
        self.planes = np.zeros(n * capacity, PLANE)
        status = self.rows["status"]
        status["margin"] = SPECULATIVE_MARGIN
        status["first_plane"] = status["end_plane"] = capacity * np.arange(n)
        self._grounds, self._longest = Grounds(terrains, status), self.time_step
        self.states = np.zeros((n, 8))
        self._centres = np.zeros((max(pads, self.toes + 1), 2))
        self.slip, self.contact_force = np.zeros((n, self.toes)), np.zeros((n, self.toes, 2))
        self.joint_gap = np.zeros(n)
        self.diverged = np.zeros(n, bool)
        self.any_diverged = False
        self.tracing = False
        self._at_once = np.zeros(n), np.zeros(n, np.int64)  # no torque from before
        self._no_pushes = np.zeros((0, 0, 2))
        self._no_trace: NDArray[Any] = np.zeros(0, integrator.trace_dtype(pads))
        self._untraced = _plain(self._no_trace)
        self.trace = self._no_trace
        self.touchdowns = np.zeros(0, bool)
        self.in_contact: NDArray[np.bool_] | None = None
        self._every = np.arange(n)
        self._threads = Threads(
            n,
            threads,
            lambda: (*integrator.work_space(capacity), np.zeros(n, np.int64), np.zeros(2, bool)),
        )
        self._advance = integrator.advance.bound()
        self._sums = np.empty((3, 6))
        self._shared = self._arguments_of_all()

    def _arguments_of_all(self) -> tuple[Any, ...]:
        """Arguments that threads share in a step."""
        model = self.designs.model
        return (
            self.states, model.body, model.pads, model.layout, model.bearings, self.surface,
            self.designs.depths, self._world, self.rows, self.planes, self.contact_statistics,
            self.slip, self.contact_force,
        )  # fmt: skip

    def set_terrain(self, row: int, terrain: Terrain) -> None:
        super().set_terrain(row, terrain)
        surface = self.surface
        self._grounds.set_terrain(row, terrain)
        if self.surface is not surface:
            self._shared = self._arguments_of_all()

    def set_robots(self, rows: Ints, robots: Sequence[Robot]) -> None:
        super().set_robots(rows, robots)
        self.rows["status"]["asked_x"][rows] = np.inf
        self._shared = self._arguments_of_all()

    def place(self, rows: Ints, crank_angles: Array) -> None:
        """Place robots (k,) at rest at x = 0, see :meth:`place_at`; then :meth:`lookahead`."""
        self.place_at(rows, crank_angles)
        self.lookahead(rows=rows)

    def place_at(
        self, rows: Ints, crank_angles: Array, x: float = 0.0, pitch: float | None = None
    ) -> None:
        """Place robots (k,) at rest on their lowest toes, 10 um deep, so that they carry at once.

        Args:
            crank_angles: (k,) rad. x: of the crank axis, m.
            pitch: rad; None turns a robot until both its fore and its back feet carry it
                (until the ground bears it on both sides of its centre of mass).

        Raises:
            ValueError: a number that is not finite, or feet too soft for their robot.
        """
        self._lower(rows, crank_angles, x, pitch)
        self.deflection[rows] = UNKNOWN_DEFLECTION
        self.diverged[rows] = False
        if self.in_contact is not None and 0 in rows:
            self.in_contact = None

    def lookahead(
        self, torque: float = 0.0, rows: Ints | None = None, pushes: Array | None = None
    ) -> None:
        """Fill sums with the next time step of some robots (all) under a torque; states stay.

        ``pushes``: (n, 1, 2) N s, as of :meth:`step`.
        """
        pushes = self._no_pushes if pushes is None else pushes
        rows = self._every if rows is None else rows
        states, deflection = self.states[rows], self.deflection[rows]  # copies
        in_contact = self.in_contact
        try:
            asked = np.full(len(self.states), torque), *self._at_once, pushes
            self._run(rows, asked, 1)
        finally:
            self.states[rows], self.deflection[rows] = states, deflection
            self.in_contact = in_contact

    def set_state(self, row: int, state: ArrayLike, deflection: Array | None = None) -> None:
        if self.held:
            check_held(state)
        self.states[row] = state
        self._ask_ground(np.array([row]))
        self.deflection[row] = UNKNOWN_DEFLECTION if deflection is None else deflection
        if row == 0:
            self.in_contact = None

    def keep(self, rows: Ints) -> Callable[[], None]:
        kept = ("states", "deflection", "slip", "contact_force", "accumulators", "diverged")
        before = [(array := getattr(self, name), array[rows]) for name in kept]  # copies
        in_contact = self.in_contact

        def undo() -> None:
            for array, values in before:
                array[rows] = values
            self._ask_ground(rows)
            self.any_diverged, self.in_contact = bool(self.diverged.any()), in_contact

        return undo

    def energy(self, row: int) -> float:
        """Kinetic plus potential energy of a robot, J (potential 0 with its mass at y = 0)."""
        return float(energy(row, self.states, self.rows, self.designs.model.body, self._sums))

    def step(
        self,
        torque: Array,
        steps: int,
        earlier: Array | None = None,
        switch: NDArray[np.int64] | None = None,
        rows: Ints | None = None,
        meanwhile: Callable[[], None] | None = None,
        pushes: Array | None = None,
        finish: Callable[[Ints], None] | None = None,
    ) -> None:
        """Hold crank torques, see :meth:`jansen_env.plants.base.BatchedPlant.step`.

        A robot that becomes faster than :data:`jansen_env.engine.integrator.DIVERGED`, or
        gets so deep into the ground that it is not found, stays as it was before, without
        entries in :attr:`accumulators` and :attr:`contact_statistics`, and is named in
        :attr:`diverged`. The others go on.
        """
        if pushes is None:
            pushes = self._no_pushes
        else:
            pushes = check_pushes(pushes, len(self.states), steps)
        asked = torque, *(self._at_once if earlier is None else (earlier, switch)), pushes
        self._run(self._every if rows is None else rows, asked, steps, meanwhile, finish)

    def _run(
        self,
        rows: Ints,
        asked: tuple[Any, ...],
        steps: int,
        meanwhile: Callable[[], None] | None = None,
        finish: Callable[[Ints], None] | None = None,
    ) -> None:
        """:meth:`step` of some robots; ``asked``: torque, earlier, switch and pushes."""
        if len(rows) == 0:  # others are placed, no more
            if meanwhile is not None:
                meanwhile()
            return
        states = self.states.take(rows, axis=0)  # quicker than an index
        before = states, self.deflection[rows] if self.any_gives else None
        if self.any_diverged:
            self.diverged[rows] = False
            self.any_diverged = bool(self.diverged.any())
        duration = steps * self.time_step
        if duration > self._longest:
            self._longest = duration
            self.rows["status"]["asked_x"] = np.inf
            self._ask_ground(self._every)
        trace, plain = self._no_trace, self._untraced
        if self.tracing:
            trace = np.empty(steps, trace.dtype)
            plain = _plain(trace)

        def move(thread: int, shares: Ints, most: int, memory: Any) -> tuple[bool, bool]:
            count = self._advance(
                thread, shares, most, rows, steps, *asked, plain, memory, self._shared
            )
            *_, moved, (far, diverged) = memory
            if finish is not None and count > 0:
                finish(moved if count == len(moved) else moved[:count])
            return bool(far), bool(diverged)

        far, diverged = self._threads.move(len(rows), move, meanwhile)
        if diverged:
            lost = self._refuse(rows, before)
            if finish is not None and len(lost) > 0:
                finish(lost)
        if far:
            self._ask_ground(rows)
        self._keep_trace(trace)

    def _keep_trace(self, trace: NDArray[np.void]) -> None:
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

    def _refuse(self, rows: Ints, before: tuple[Array, Array | None]) -> Ints:
        """Return the robots that have diverged, left as they were ``before``: state, deflection."""
        gone = self.rows["status"]["lost"][rows]
        lost = rows[gone]
        if len(lost) == 0:
            return lost
        self.diverged[lost] = self.any_diverged = True
        self.states[lost] = before[0][gone]
        if before[1] is not None:
            self.deflection[lost] = before[1][gone]
        self.accumulators[lost] = 0.0
        self.slip[lost] = self.contact_force[lost] = 0.0
        for name in ("slip", "impulse"):
            self.contact_statistics[name][lost] = 0.0
        return lost

    def joint_forces(self, torque: float = 0.0, push: Array | None = None) -> JointForces:
        if self.held:  # no impacts: forces at this instant
            robot, (q, q_dot) = self.tables_in_force(0).robot, np.split(self.states[0], 2)
            gravity = self.effective_gravity
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

    def peak_loads(self) -> PeakLoads:
        return peak_loads(self._traced_forces().bearing, self.touchdowns, self.time_step)

    def _traced_forces(self) -> JointForces:
        """Forces in every joint in each time step that was traced last."""
        tables, gravity = self.tables_in_force(0), self.effective_gravity
        return trace_forces(tables, self.trace, self.time_step, gravity)

    def refusal(self, torque: float) -> FloatingPointError:
        """Return the error of the first robot's last step, which was refused."""
        return divergence(self.states[0], torque)

    @property
    def gravity(self) -> tuple[float, float]:
        """(x, y) m/s^2, the first robot's gravity without its tilt."""
        params = self.nominal_params[0]
        return float(params["gravity_x"]), float(params["gravity_y"])

    @property
    def effective_gravity(self) -> tuple[float, float]:
        """(x, y) m/s^2, the first robot's gravity under its tilt."""
        params = self.params[0]
        return float(params["gravity_x"]), float(params["gravity_y"])

    def __getstate__(self) -> dict[str, Any]:
        """The arguments, and what has become of them: everything else is made again from them."""
        kept = ("robots", "terrains", "_arguments", "tracing", "in_contact", *CHANGING)
        return {name: getattr(self, name) for name in kept}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        pairs = zip(saved["terrains"], saved["nominal"]["restitution"].tolist(), strict=True)
        grounds = [  # as compliant pads must have them now
            terrain if terrain.restitution == own else replace(terrain, restitution=own)
            for terrain, own in pairs
        ]
        self.__init__(saved["robots"], grounds, *saved["_arguments"])  # type: ignore[misc]
        self.terrains[:] = saved["terrains"]
        for name in CHANGING:
            getattr(self, name)[:] = saved[name]
        for params in (self.params, self.nominal_params):
            params["design"] = self.designs.number  # which are numbered anew
        self._ask_ground(self._every)
        self.tracing, self.in_contact = saved["tracing"], saved["in_contact"]
        self.any_diverged = bool(self.diverged.any())

    def close(self) -> None:
        self._threads.close()


def _plain(trace: NDArray[np.void]) -> Array:
    """Return a trace as plain numbers (steps, numbers)."""
    return trace.view(float).reshape(len(trace), trace.dtype.itemsize // 8)
