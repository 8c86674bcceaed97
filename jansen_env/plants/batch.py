"""Robots of one design that move at once: one look at the ground, then all their time steps."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import positive, positive_integer
from jansen_env.dynamics.reduced import compile_robot
from jansen_env.engine import integrator
from jansen_env.engine.collision import MARGIN, STEPS_LEFT
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
from jansen_env.robot import Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]

TIME_STEP = 1e-3  # s
DETECTION_INTERVAL = 0.01  # s between two looks for the ground; its planes are kept meanwhile
PITCHES = 256  # at which it is known how deep the bumpers reach
PLANES_PER_PAD = 4  # kept of a robot, on average over its pads
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
        states: (n, 8) x, y, theta, psi and their rates; x, y the crank axis, m, rad, s.
        model: the robots' tables, see :mod:`jansen_env.engine.tables`.
        parameters: (n, 14) what may differ between them, see :mod:`jansen_env.engine.tables`.
        totals: (n, 9), record: (n, pads, 3) sums over the last :meth:`step`, see
            :func:`jansen_env.engine.integrator.advance`.
        diverged: (n,) whether the last :meth:`step` was refused, see there.

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
        self._arguments = (
            list(robots), list(terrains), time_step, gravity, detection_interval, threads,
        )  # fmt: skip
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
        self.diverged = np.zeros(n, bool)
        self._any_diverged = False
        self._no_trace = np.zeros((0, integrator.trace_width(pads)))
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

    def exchange(self, row: int, robot: Robot) -> None:
        """Make a robot another one, which differs in its payload only."""
        kept = self.parameters[row].copy()
        self.parameters[row] = parameters(compile_robot(robot), (0.0, 0.0))
        where = [GRAVITY_X, GRAVITY_Y, DRIVEN, FRICTION, RESTITUTION, STEEPEST]
        self.parameters[row, where] = kept[where]

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

    def step(self, torque: Array, steps: int, trace: Array | None = None) -> None:
        """Hold crank torques (n,), N m, for some time steps.

        A robot that becomes faster than :data:`jansen_env.engine.integrator.DIVERGED`, or
        gets so deep into the ground that it is not found, stays as it was before, without
        entries in :attr:`totals` and :attr:`record`, and is named in :attr:`diverged`.
        The others go on.

        Args:
            trace: (steps, :func:`jansen_env.engine.integrator.trace_width`) what the first robot
                does in each time step, filled in; None for no trace.
        """
        before = self.states.copy()
        if self._any_diverged:
            self.diverged[:] = self._any_diverged = False
            self.detector.status[:, STEPS_LEFT] = 0
        done = 0
        while done < steps:
            count = min(self._stride, steps - done)
            rows = self._no_trace if trace is None else trace[done : done + count]
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
        if self._any_diverged:
            self.totals[self.diverged] = 0.0
            self.record[self.diverged] = 0.0

    def _refuse(self, before: Array) -> None:
        """Leave the robots that have diverged as they were before the step."""
        left, _, too_deep = self.detector.status.T
        left[too_deep > 0] = -1
        self.diverged |= left < 0
        self.states[self.diverged] = before[self.diverged]
        self._any_diverged = True

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
        """The arguments, and what has become of them: everything else is made anew from them."""
        return {
            "arguments": self._arguments, "states": self.states, "parameters": self.parameters,
            "totals": self.totals, "record": self.record, "diverged": self.diverged,
        }  # fmt: skip

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(*saved["arguments"])  # type: ignore[misc]
        for name in ("states", "parameters", "totals", "record", "diverged"):
            getattr(self, name)[:] = saved[name]
        self._any_diverged = bool(self.diverged.any())

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
