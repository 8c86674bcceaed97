"""Pushes: forces on the chassis at the crank axis, at random or at scheduled times.

The force of a push is a half sine over the duration T of the push. A push with the impulse J that
starts at the time t0 has

    F(t) = J pi / (2 T) sin(pi (t - t0) / T)
    impulse from t to t + h = J / 2 (cos(pi (t - t0) / T) - cos(pi (t + h - t0) / T))

The impulse in a time step is computed by the second equation, not as a sum of forces, so the
impulses of all time steps add up to J. Random pushes are sampled from the seed of the episode and
counters (:mod:`jansen_env.engine.random`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from jansen_env import checks
from jansen_env.arrays import Array, Rows
from jansen_env.engine import pushes as engine
from jansen_env.engine.episode import look_up_pushes
from jansen_env.engine.pushes import PUSHES
from jansen_env.plants.robot_records import RobotRecords

SHORTEST, LONGEST = 1e-3, 1e6  # limits of durations and intervals, in s
MOST_PUSHES = 1000  # largest number of scheduled pushes per episode
NO_PUSHES = np.zeros((0, 3))


@dataclass(frozen=True)
class Push:
    """Random pushes on the chassis, one per interval.

    The start of a push is sampled such that the push ends within its interval. Each component of
    the impulse is uniform between minus and plus the largest impulse.

    By default, the largest impulse changes the speed of a robot of 3.2 kg by 0.4 m/s, which is half
    of the fastest command. The ratio is that of Isaac Lab's velocity tasks (0.5 m/s for commands up
    to 1 m/s, every 10 to 15 s). In legged_gym (Rudin et al. 2022), pushes change the speed by up to
    1 m/s every 15 s. An episode of 10 s has two pushes by default.

    Args:
        impulse: Largest impulse, in N s: horizontal, or a pair (horizontal, vertical).
        duration: Duration of a push, in s, at least 0.001.
        interval: Duration of an interval, in s, at least ``duration``.

    Raises:
        ValueError: If an argument is out of range.
    """

    impulse: float | tuple[float, float] = 1.3
    duration: float = 0.1
    interval: float = 5.0

    def __post_init__(self) -> None:
        checks.set_checked(self, checks.one_or_two, "impulse")
        time = partial(checks.within, low=SHORTEST)
        checks.set_checked(self, partial(time, high=LONGEST), "interval")
        checks.set_checked(self, partial(time, high=self.interval), "duration")


def check_schedule(name: str, pushes: object) -> Array:
    """Return the checked schedule of an episode's pushes.

    Args:
        name: Name of the argument, for error messages.
        pushes: List of (t, Jx, Jy): start in s, and impulse in x and y in N s.

    Returns:
        The same values, shape (k, 3).

    Raises:
        ValueError: If there are more than :data:`MOST_PUSHES` pushes, or a value is out of range.
    """
    allowed = f"a list of at most {MOST_PUSHES} tuples (t, Jx, Jy)"
    rows = checks.entries(name, pushes, allowed)
    triples = [checks.entries(name, row, allowed, 3) for row in rows]
    if len(triples) > MOST_PUSHES:
        raise checks.invalid(name, pushes, allowed)
    for i, (time, *impulse) in enumerate(triples):
        checks.non_negative(f"{name}[{i}] time", time)
        for part, number in zip(("Jx", "Jy"), impulse, strict=True):
            checks.finite(f"{name}[{i}] {part}", number)
    return np.array(triples, float).reshape(-1, 3)


def push_settings(push: Push | None, time_step: float) -> Rows:
    """Return the engine's settings of random pushes.

    Args:
        push: Random pushes. None for no random pushes.
        time_step: Time step of the integration, in s.

    Returns:
        The settings, a record of :data:`jansen_env.engine.pushes.PUSHES`, shape (1,).
    """
    settings = np.zeros(1, PUSHES)
    kind = push or Push(0.0)
    settings[0] = (*kind.impulse, kind.duration, kind.interval, time_step)  # type: ignore[misc]
    return settings


def add_push(pushes: Array, push: Array, settings: Rows) -> Array:
    """Return a schedule with one more push, without the pushes that are over when it starts.

    Args:
        pushes: Schedule of an episode, shape (k, 3); see :func:`check_schedule`.
        push: The new push, shape (3,).
        settings: Result of :func:`push_settings`.

    Raises:
        ValueError: If there are already :data:`MOST_PUSHES` pushes that are not over.
    """
    schedule = np.zeros((min(len(pushes) + 1, MOST_PUSHES), 3))
    schedule[: len(pushes)] = pushes
    count = engine.add_push(*push.tolist(), settings, len(pushes), schedule)
    if count < 0:
        allowed = f"at most {MOST_PUSHES} pushes that are not over"
        raise ValueError(f"a robot must have {allowed}, got {MOST_PUSHES + 1}")
    return schedule[:count]


class Pushes:
    """Scheduled and random pushes of n robots.

    Args:
        records: Records of the robots, which contain the scheduled pushes.
        push: Random pushes. None for no random pushes.
        time_step: Time step of the integration, in s.
        steps: Number of time steps per control step.

    Attributes:
        settings: Settings of random pushes, a record of
            :data:`jansen_env.engine.pushes.PUSHES`, shape (1,).
    """

    def __init__(
        self, records: RobotRecords, push: Push | None, time_step: float, steps: int
    ) -> None:
        self._records = records
        self._steps = steps
        self.settings = push_settings(push, time_step)

    def scheduled(self, i: int) -> Array:
        """Return the scheduled pushes of a robot.

        Returns:
            Start in s, and impulse in x and y in N s, of each push, shape (k, 3).
        """
        count = int(self._records.robots["scheduled"][i])
        return self._records.schedule[i, :count].copy()

    def has_random(self, i: int) -> bool:
        """Return whether random pushes act on a robot in addition to its scheduled pushes."""
        return bool(self._records.robots["random_pushes"][i])

    def schedule(self, i: int, pushes: Array, random: bool) -> None:
        """Set the pushes of a robot's episode, for which the records must have room.

        Args:
            i: Index of the robot.
            pushes: Scheduled pushes, shape (k, 3); see :meth:`scheduled`.
            random: Whether random pushes act in addition.
        """
        records = self._records
        records.schedule[i, : len(pushes)] = pushes
        records.robots["scheduled"][i] = len(pushes)
        records.robots["random_pushes"][i] = random

    def with_push(self, i: int, start: float, impulse: object) -> Array:
        """Return a robot's schedule with one more push, without the pushes that are then over.

        Args:
            i: Index of the robot.
            start: Start of the new push, in s.
            impulse: Impulse in x and y, in N s.

        Raises:
            ValueError: If ``impulse`` is not two finite numbers, or there are already
                :data:`MOST_PUSHES` pushes that are not over.
        """
        push = check_schedule("impulse", [(start, *checks.entries("impulse", impulse, "(Jx, Jy)"))])
        return add_push(self.scheduled(i), push[0], self.settings)

    def next_impulse(self) -> Array | None:
        """Return the impulse on the first robot's chassis in its next time step.

        Returns:
            The impulse in x and y, in N s, shape (2,), or None if no push acts in the next control
            step.
        """
        impulses = np.zeros((self._steps, 2))
        robots = self._records.robots
        schedule = self._records.schedule
        return impulses[0] if look_up_pushes(robots, schedule, self.settings, impulses) else None
