"""Disturbances of n robots: noise of their sensors, pushes on their chassis.

All is drawn from an episode's seed and counters (:mod:`jansen_env.engine.random`). They stand apart
from their arguments, so that importing the package does not import numba.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.engine.pushes import PUSHES, fill_pushes
from jansen_env.engine.sensors import add_noise, draw_errors
from jansen_env.world.argument_checks import Array, Bools, Ints
from jansen_env.world.entries import Observed
from jansen_env.world.noise import Noise
from jansen_env.world.push import MOST_PUSHES, Push

ANGLES = (
    ("cos_crank_angle", "cos_crank_angle", "sin_crank_angle"),
    ("sin_pitch", "cos_pitch", "sin_pitch"),
)
"""Entries at which the error of an angle stands, with those of its cosine and sine."""
SPEEDS = ("crank_axis_x_velocity", "crank_speed")
"""Entries whose sensors odometry goes by."""


class NoisySensors:
    """Noise in the observations of n robots.

    Args:
        num_envs: n. noise: of the sensors. observed: the columns, whose names tell the sensor.

    Attributes:
        level: (n,) factor of the noise. truth: (n, d) observations without noise.
        mean_error: (n, 2), see :func:`jansen_env.engine.sensors.draw_errors`.
    """

    def __init__(self, num_envs: int, noise: Noise, observed: Sequence[Observed]) -> None:
        self.level = np.ones(num_envs)
        self.truth = np.zeros((num_envs, len(observed)), np.float32)
        names = [entry.name for entry in observed]
        self._deviation = noise.deviations(observed)
        limits = np.array([(entry.low, entry.high) for entry in observed], np.float32)
        self._low, self._high = limits.T.copy()
        self._known = np.full(num_envs, -1)
        self._bias, self._error = np.zeros((2, *self.truth.shape))
        self.mean_error = np.zeros((num_envs, 2))
        self._angles = np.full((len(names), 2), -1)
        for first, *pair in ANGLES:
            if {first, *pair} <= {*names}:
                cos, sin = self._angles[names.index(first)] = [names.index(name) for name in pair]
                self._deviation[cos + sin - names.index(first)] = 0.0
        self._speeds = np.array([names.index(one) if one in names else -1 for one in SPEEDS])
        self.measure(np.zeros((num_envs, 0)), ())
        self._draw_errors, self._add_noise = draw_errors.bound(), add_noise.bound()

    def measure(self, measured: Array, columns: Sequence[int]) -> None:
        """Observe ``columns`` (m,) as in ``measured`` (n, m), which may change."""
        self._measured, self._columns = measured, np.array(columns, np.int64)

    def _arguments_of_errors(self, rows: Ints, elapsed: Ints, seeds: Ints) -> tuple[Any, ...]:
        return (
            rows, elapsed, seeds, self.level, self._deviation, self._speeds, self._known,
            self._bias, self._error, self.mean_error,
        )  # fmt: skip

    def _arguments_of_noise(self, rows: Ints, out: Any) -> tuple[Any, ...]:
        return (
            rows, self._error, self._angles, self._measured, self._columns, self._low, self._high,
            self.truth, out,
        )  # fmt: skip

    def draw(self, rows: Ints, elapsed: Ints, seeds: Ints) -> None:
        """Draw the errors of robots' (k,) readings and mean speeds, see :class:`Pushes`."""
        self._draw_errors(*self._arguments_of_errors(rows, elapsed, seeds))

    def add(self, rows: Ints, out: NDArray[np.float32]) -> None:
        """Add the errors drawn last to observations ``out`` (n, d) of robots (k,)."""
        self._add_noise(*self._arguments_of_noise(rows, out))


class Pushes:
    """Pushes on n robots.

    Args:
        num_envs: n. push: random ones; None for none. steps: of a control step. time_step: s.

    Attributes:
        strength: (n,) factor of the random ones. random: (n,) whether an episode has them.
    """

    def __init__(self, num_envs: int, push: Push | None, steps: int, time_step: float) -> None:
        self.strength = np.ones(num_envs)
        self._steps = steps
        self._settings = np.zeros(1, PUSHES)
        kind = push or Push(0.0)
        self._settings[0] = (*kind.impulse, kind.duration, kind.interval, time_step)  # type: ignore[misc]
        self.random = np.ones(num_envs, bool)
        self._scheduled = np.zeros(num_envs, np.int64)
        self._schedule = np.zeros((num_envs, 1, 3))
        self._impulse = np.zeros((0, steps, 2))
        self._fill = fill_pushes.bound()
        if push is not None:
            self._begin_pushing()

    def _begin_pushing(self) -> None:
        """Make room for pushes."""
        self._impulse = np.zeros((len(self.strength), self._steps, 2))

    def _arguments(self) -> tuple[Any, ...]:
        return (
            self.strength, self._settings, self.random, self._schedule, self._scheduled,
            self._impulse,
        )  # fmt: skip

    def schedule(self, row: int, pushes: Array, random: bool) -> None:
        """Give a robot's episode checked pushes (k, 3), and ``random`` ones or not."""
        if len(pushes) > self._schedule.shape[1]:
            before, self._schedule = self._schedule, np.zeros((len(self.strength), len(pushes), 3))
            self._schedule[:, : before.shape[1]] = before
        self._schedule[row, : len(pushes)], self._scheduled[row] = pushes, len(pushes)
        self.random[row] = random
        if len(pushes) > 0 and len(self._impulse) == 0:
            self._begin_pushing()

    def add(self, row: int, push: Array) -> None:
        """Add a push (3,) to a robot's own, less those that are over; ValueError: too many."""
        own = self.scheduled(row)
        going_on = own[own[:, 0] + self._settings["duration"] > push[0]]
        if len(going_on) == MOST_PUSHES:
            raise ValueError(f"there are {MOST_PUSHES} pushes, must be fewer")
        self.schedule(row, np.concatenate([going_on, push[None]]), bool(self.random[row]))

    def scheduled(self, row: int) -> Array:
        """Return a robot's own pushes (k, 3)."""
        return self._schedule[row, : self._scheduled[row]].copy()

    def of_step(self, active: Bools, elapsed: Ints, seeds: Ints) -> Array | None:
        """Return impulses (n, steps, 2) on the ``active`` (n,) robots' next step, N s; None: none.

        elapsed, seeds: (n,) control steps of the episodes so far, and their seeds.
        """
        if len(self._impulse) == 0:
            return None
        pushed = self._fill(active, elapsed, seeds, *self._arguments())
        return self._impulse if pushed else None
