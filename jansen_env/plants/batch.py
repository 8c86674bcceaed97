"""Robots of one design that move at once: one search for contacts, then all their time steps."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jansen_env.checks import finite, positive, positive_integer
from jansen_env.dynamics.reduced import body_sums, compile_robot
from jansen_env.engine import integrator
from jansen_env.engine.collision import MARGIN, PAD, STEPS_LEFT
from jansen_env.engine.contact_means import contact_means
from jansen_env.engine.jit import announce
from jansen_env.engine.tables import (
    DRIVEN,
    FRICTION,
    GRAVITY_X,
    GRAVITY_Y,
    RESTITUTION,
    STEEPEST,
    kernel_model,
    mechanical_energy,
    parameters,
)
from jansen_env.gravity import GRAVITY, Gravity, gravity_vector
from jansen_env.plants.base import check_time_step
from jansen_env.plants.detector import ContactDetector
from jansen_env.plants.initial_pose import set_down
from jansen_env.plants.trace import landings, pads_pressed
from jansen_env.robot import Payload, Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]

TIME_STEP = 1e-3  # s
DETECTION_INTERVAL = 0.01  # s between two looks for the ground; its planes are kept meanwhile
PITCHES = 256  # at which it is known how deep the bumpers reach
PLANES_PER_PAD = 4  # kept of a robot, on average over its pads
PLACEMENT_ROUNDS = 3  # Newton steps of lowering a robot onto the ground
PLACEMENT_DEPTH = 1e-9  # m, by which it is placed in the ground: its toes carry at once
CHANGING = ("states", "parameters", "totals", "record", "slip", "contact_force", "diverged")
ROBOTS_PER_THREAD = 16  # at least, or starting a thread takes longer than it saves
ROBOTS_AT_A_TIME = 32  # at most, moved by a thread before it takes the next ones


class Batch:
    """Robots on their grounds, advanced together by the projected equations.

    Each moves as it would alone, bit for bit: they share the work, not the numbers.

    Args:
        robots: of one design; their payloads may differ. terrains: the ground of each.
        time_step: of the integration, s.
        gravity: m/s^2 downwards, or a vector (x, y).
        detection_interval: time between two looks for the ground, s.
        threads: cores to use; None for as many as there are, where that pays.

    Attributes:
        robots, terrains: what walks where.
        states: (n, 8) x, y, theta, psi and their rates; x, y the crank axis, m, rad, s.
        model: the robots' tables, see :mod:`jansen_env.engine.tables`.
        parameters: (n, 14) what may differ between them, see :mod:`jansen_env.engine.tables`.
        totals: (n, 9), record: (n, pads, 3) sums over the last :meth:`step`, see
            :func:`jansen_env.engine.integrator.advance`.
        slip: (n, toes) path each toe slid while loaded, m, and contact_force: (n, toes, 2) mean
            tangential and normal force on each toe, N, over the last :meth:`step`.
        joint_gap: (n,) the widest gap of any joint, m: these cannot open, 0.
        diverged: (n,) whether the last :meth:`step` was refused, see there.
        tracing: whether :meth:`step` keeps a record of the first robot's time steps: its
            :attr:`trace`, (steps, columns) named in :mod:`jansen_env.engine.integrator`, and
            :attr:`touchdowns`, (steps,) whether a pad touched down in each.
        in_contact: (pads,) the first robot's pads on the ground, as traced last; None where that is
            not known. It says what touches down next, and nothing else.

    Raises:
        ValueError: an argument out of range, or robots of several designs; LinkageError: the robot
            cannot turn its crank.
    """

    def __init__(
        self,
        robots: Sequence[Robot],
        terrains: Sequence[Terrain],
        time_step: float = TIME_STEP,
        gravity: Gravity = GRAVITY,
        detection_interval: float = DETECTION_INTERVAL,
        threads: int | None = None,
    ) -> None:
        announce("integrator.advance")
        self.robots, self.terrains = list(robots), list(terrains)
        self._arguments = (time_step, gravity, detection_interval, threads)
        if len(robots) != len(terrains) or not robots:
            raise ValueError(
                f"there are {len(robots)} robots and {len(terrains)} terrains, must be as many, "
                "and at least one"
            )
        different = {id(robot): robot for robot in robots}.values()
        for robot in different:
            if replace(robot, payload=robots[0].payload) != robots[0]:
                raise ValueError("robots are of several designs, must differ in payload only")
        self.time_step = check_time_step(time_step)
        self.detection_interval = positive("detection_interval", detection_interval)
        self._stride = max(1, round(detection_interval / time_step))
        self.tables = compile_robot(robots[0])
        self.model = kernel_model(self.tables)
        self.toes, pads = self.tables.layout.toes, len(self.model.layout)
        vector = gravity_vector(gravity)
        rows = {id(robot): parameters(compile_robot(robot), vector) for robot in different}
        self.parameters = np.array([rows[id(robot)] for robot in robots])
        self.parameters[:, FRICTION] = [terrain.friction for terrain in terrains]
        self.parameters[:, RESTITUTION] = [terrain.restitution for terrain in terrains]
        self.parameters[:, STEEPEST] = [terrain.steepest for terrain in terrains]
        capacity = PLANES_PER_PAD * pads
        self.detector = ContactDetector(terrains, self.toes, robots[0].pad_radius, capacity)
        self._depths = self._bumper_depths(robots[0].pad_radius + MARGIN)
        n = len(robots)
        self.states = np.zeros((n, 8))
        self.totals = np.zeros((n, integrator.TOTALS))
        self.record = np.zeros((n, pads, integrator.RECORD))
        self.slip, self.contact_force = np.zeros((n, self.toes)), np.zeros((n, self.toes, 2))
        self.joint_gap = np.zeros(n)
        self.diverged = np.zeros(n, bool)
        self.any_diverged = False
        self.tracing = False
        self.trace = self._no_trace = np.zeros((0, integrator.trace_width(pads)))
        self.touchdowns = np.zeros(0, bool)
        self.in_contact: NDArray[np.bool_] | None = None
        self._scratch: dict[Any, Batch] = {}  # by the shape of the ground
        count = _threads(n, threads)
        size = min(ROBOTS_AT_A_TIME, -(-n // count))
        self._shares = [(first, min(first + size, n)) for first in range(0, n, size)]
        self._work: list[tuple[Any, ...]] = [integrator.work_space(capacity) for _ in range(count)]
        self._pool: tuple[int, ThreadPoolExecutor] | None = None

    def _bumper_depths(self, margin: float) -> Array:
        """How far below the axis a bumper may feel the ground, m, by pitch over one turn.

        The last entry is the largest of all.
        """
        rows = np.unique(self.tables.layout.table[self.toes :])
        x, y = self.tables.pads[rows][:, :, :2, 0].reshape(-1, 2).T
        farthest = float(np.hypot(x, y).max())
        pitch = 2.0 * math.pi * (np.arange(PITCHES) + 0.5) / PITCHES
        depth = -(np.outer(np.sin(pitch), x) + np.outer(np.cos(pitch), y)).min(axis=1)
        between = farthest * math.pi / PITCHES  # to the next entry
        return np.append(depth + between, farthest) + margin

    def set_payload(self, row: int, payload: Payload) -> None:
        """Change what a robot carries."""
        robot = self.robots[row] = replace(self.robots[row], payload=payload)
        kept = self.parameters[row].copy()
        self.parameters[row] = parameters(compile_robot(robot), (0.0, 0.0))
        where = [GRAVITY_X, GRAVITY_Y, DRIVEN, FRICTION, RESTITUTION, STEEPEST]
        self.parameters[row, where] = kept[where]

    @property
    def friction(self) -> Array:
        """(n,) Coulomb coefficients between robots' pads and their grounds, a copy."""
        return self.parameters[:, FRICTION].copy()

    @property
    def restitution(self) -> Array:
        """(n,) Newton's coefficients of restitution between pads and grounds, a copy."""
        return self.parameters[:, RESTITUTION].copy()

    def set_friction(self, row: int, friction: float) -> None:
        """Change the Coulomb coefficient between a robot's pads and its ground."""
        self.parameters[row, FRICTION] = friction

    def set_restitution(self, row: int, restitution: float) -> None:
        """Change Newton's coefficient of restitution between a robot's pads and its ground."""
        self.parameters[row, RESTITUTION] = restitution

    def place(self, row: int, crank_angle: float) -> None:
        """Place a robot at rest at x = 0, see :meth:`place_first`.

        :attr:`totals`, :attr:`slip` and so on then have what its next time step would do.
        """
        if len(self.states) > 1:
            scratch = self.scratch(row)
            scratch.place(0, crank_angle)
            for name in ("states", "totals", "record", "slip", "contact_force"):
                getattr(self, name)[row] = getattr(scratch, name)[0]
        else:
            self.place_first(0.0, crank_angle)
            self.lookahead()
        self.diverged[row] = False

    def place_first(self, x: float, crank_angle: float, pitch: float | None = None) -> None:
        """Place the first robot at rest on its lowest toes, 1 nm deep, so that they carry at once.

        Args:
            x: crank axis, m. crank_angle: rad.
            pitch: rad; None turns the robot until both its fore and its back feet carry it
                (until the ground bears it on both sides of its centre of mass).

        Raises:
            ValueError: a number that is not finite.
        """
        robot, state = self.robots[0], self.states[0]
        tables = compile_robot(robot)
        centre = body_sums(tables, finite("crank_angle", crank_angle)).c / robot.mass
        y, theta = set_down(robot, centre, self.terrains[0], x, crank_angle, pitch)
        self.set_state(0, (x, y, theta, crank_angle, 0.0, 0.0, 0.0, 0.0))
        for _ in range(PLACEMENT_ROUNDS):  # to the true gap, where the ground is not straight
            planes, pad, centres = self.contact_planes()
            if len(pad):
                gap = (planes[:, :2] * centres[pad]).sum(axis=1) - planes[:, 2]
                state[1] -= ((gap - robot.pad_radius) / planes[:, 1]).min()
        state[1] -= PLACEMENT_DEPTH

    def scratch(self, row: int) -> Batch:
        """A batch of one, which is that robot as it is now, to try things without the others."""
        robot, terrain = self.robots[row], self.terrains[row]
        batch = self._scratch.get(terrain.points)
        if batch is None:
            batch = Batch([robot], [terrain], *self._arguments[:-1], threads=1)
            self._scratch[terrain.points] = batch
        batch.robots[0] = robot
        batch.parameters[0] = self.parameters[row]
        batch.set_state(0, self.states[row])
        return batch

    def lookahead(self, torque: float = 0.0) -> None:
        """What the first robot's next time step would do under a torque; the state stays."""
        state, in_contact = self.states[0].copy(), self.in_contact
        try:
            self.step(np.array([torque]), 1)
        finally:
            self.states[0], self.in_contact = state, in_contact

    def set_state(self, row: int, state: ArrayLike) -> None:
        """Put a robot into a state (8,)."""
        self.states[row] = state
        if row == 0:
            self.in_contact = None

    def contact_planes(self) -> tuple[Array, NDArray[np.int64], Array]:
        """Of the first robot: planes (k, 3), the pad that each is for (k,), centres of the pads."""
        self.look()
        begin, end = self.detector.spans[0].tolist()
        pads = self.detector.contacts[begin:end, PAD]
        return self.detector.planes[begin:end], pads, self.detector.centres

    def contact_frames(self, row: int) -> tuple[Array, Array]:
        """(toes, 2) points of the ground nearest to each toe's pad and its tangents there.

        Where no ground is within reach, the pad's lowest point and +x.
        """
        if len(self.states) > 1:
            return self.scratch(row).contact_frames(0)
        radius = self.robots[0].pad_radius
        planes, pads, centres = self.contact_planes()
        points = centres[: self.toes] - np.array([0.0, radius])
        tangents = np.tile([1.0, 0.0], (self.toes, 1))
        for plane, pad in zip(planes[::-1], pads[::-1], strict=True):  # a pad's nearest comes last
            if pad < self.toes:
                normal = plane[:2]
                points[pad] = centres[pad] - radius * normal
                tangents[pad] = normal[1], -normal[0]
        return points, tangents

    def energy(self, row: int) -> float:
        """Kinetic plus potential energy of a robot, J (potential 0 with its mass at y = 0)."""
        kinetic, potential = mechanical_energy(
            self.model.body, self.parameters[row], self.states[row], np.empty((3, 6))
        )
        return float(kinetic + potential)

    def look(self, moving_only: bool = False) -> bool:
        """Find the ground where the robots are now; bumpers look where they may reach it.

        Args, returns: see :meth:`jansen_env.plants.detector.ContactDetector.look`.
        """
        _, pads, layout = self.model
        return self.detector.look(
            self.states, self.parameters, pads, layout, self._depths, self.time_step, moving_only
        )

    def step(self, torque: Array, steps: int) -> None:
        """Hold crank torques (n,), N m, for some time steps.

        A robot that becomes faster than :data:`jansen_env.engine.integrator.DIVERGED`, or
        gets so deep into the ground that it is not found, stays as it was before, without
        entries in :attr:`totals` and :attr:`record`, and is named in :attr:`diverged`.
        The others go on.
        """
        before = self.states.copy()
        if self.any_diverged:
            self.diverged[:] = self.any_diverged = False
            self.detector.status[:, STEPS_LEFT] = 0
        trace = np.empty((steps, self._no_trace.shape[1])) if self.tracing else self._no_trace
        done = 0
        while done < steps:
            count = min(self._stride, steps - done)
            rows = trace[done : done + count]
            if self.look():
                self._refuse(before)
            finished = self._advance(done == 0, count, torque, rows)
            while not finished:  # fast robots need planes found several times
                if (self.detector.status[:, STEPS_LEFT] < 0).any():
                    self._refuse(before)
                if self.look(moving_only=True):
                    self._refuse(before)
                finished = self._advance(False, 0, torque, rows)
            done += count
        if self.any_diverged:
            self.totals[self.diverged] = 0.0
            self.record[self.diverged] = 0.0
        contact_means(self.record, steps * self.time_step, self.slip, self.contact_force)
        self._keep_trace(trace)

    def _keep_trace(self, trace: Array) -> None:
        """Keep the trace of a step (no rows: of none), unless the first robot has diverged."""
        if self.any_diverged and self.diverged[0]:
            self.trace, self.touchdowns = self._no_trace, np.zeros(0, bool)
            return
        self.trace = trace
        if len(trace) == 0:
            self.in_contact = None
            return
        self.touchdowns = landings(trace, self.in_contact)
        self.in_contact = pads_pressed(trace)[-1]

    def _refuse(self, before: Array) -> None:
        """Leave the robots that have diverged as they were before the step."""
        left, _, too_deep = self.detector.status.T
        left[too_deep > 0] = -1
        self.diverged |= left < 0
        self.states[self.diverged] = before[self.diverged]
        self.any_diverged = True

    def _advance(self, fresh: bool, steps: int, torque: Array, trace: Array) -> bool:
        """:func:`jansen_env.engine.integrator.advance` of all robots, on all threads."""
        detector = self.detector
        common: tuple[Any, ...] = (
            fresh, steps, self.time_step, torque, self.states, self.parameters,
            *self.model,
            detector.spans, detector.planes, detector.contacts, detector.status,
        )  # fmt: skip
        out: tuple[Any, ...] = (self.totals, self.record, self.toes, trace)
        shares = iter(self._shares)

        def work(memory: tuple[Any, ...]) -> bool:
            finished = True
            for share in shares:  # each thread takes the next one
                finished &= integrator.advance(*share, *common, *memory, *out)
            return finished

        waiting = [self._threads().submit(work, memory) for memory in self._work[1:]]
        try:
            finished = work(self._work[0])
        finally:  # whatever happens here, nothing goes on in the background
            others = [future.result() for future in waiting]
        return finished and all(others)

    def __getstate__(self) -> dict[str, Any]:
        """The arguments, and what has become of them: everything else is made again from them."""
        kept = ("robots", "terrains", "_arguments", "tracing", "in_contact", *CHANGING)
        return {name: getattr(self, name) for name in kept}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(saved["robots"], saved["terrains"], *saved["_arguments"])  # type: ignore[misc]
        for name in CHANGING:
            getattr(self, name)[:] = saved[name]
        self.tracing, self.in_contact = saved["tracing"], saved["in_contact"]
        self.any_diverged = bool(self.diverged.any())

    def close(self) -> None:
        """End the threads; a later :meth:`step` starts new ones."""
        if self._pool is not None and self._pool[0] == os.getpid():
            self._pool[1].shutdown()
        self._pool = None

    def _threads(self) -> ThreadPoolExecutor:
        """Threads of this process: a forked one starts its own."""
        if self._pool is None or self._pool[0] != os.getpid():
            self._pool = os.getpid(), ThreadPoolExecutor(len(self._work) - 1, "jansen")
        return self._pool[1]


def _threads(robots: int, threads: int | None) -> int:
    """How many threads move so many robots."""
    if threads is not None:
        return min(positive_integer("threads", threads), robots)
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None
    return max(1, min(available or os.cpu_count() or 1, robots // ROBOTS_PER_THREAD))
