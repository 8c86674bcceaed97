"""n robots whose cranks are turned by torques that may come late: what worlds have in common."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import positive, shown, within
from jansen_env.plants.base import numbers_of
from jansen_env.robot import Robot
from jansen_env.robot.motor import Motor
from jansen_env.robot.robot_file import robot_from_json, robot_to_json
from jansen_env.uniform import uniform
from jansen_env.world import argument_checks as arguments
from jansen_env.world.argument_checks import Array, Bools, Ints
from jansen_env.world.entries import Observed
from jansen_env.world.episode_lengths import Build, EpisodeLengths
from jansen_env.world.settings import equip, load_motor, load_robot

Draw = Callable[[int, np.random.Generator, dict[str, Any]], Any]
"""Draws a task's own numbers of a robot's episode, with the options of its reset."""

MOST_DELAYED = 10_000  # control periods in a delay: torques that are kept


class ActuatedRobots:
    """n robots and their delayed torques; a world knows no commands, rewards or ends of episodes.

    Attributes:
        RECORDS: its keyword arguments, see :mod:`jansen_env.world.argument_checks`.
        TAKE_ACTIONS: the engine's kernel that keeps actions in ``rows``.
        OPTIONS: of a reset. SETTABLE: of a change. entries: numbers for observations.
        robots: of these episodes, before parameters. control_dt: s for which an action is held.
        rows: (n,) with fields ``action``, ``action_before``, ``info`` and ``energy``.
        lengths: of the present episodes.
        arrays, groups: see :class:`jansen_env.tasks.information.InfoBuilder`.
        full_torque: (n,) N m, the torque of action 1, with its sign.
        elapsed: (n,) control steps since the reset.
        torque: (n,) that the last step ended with, N m; earlier: (n,) that of its first ``switch``
            (n,) time steps. asked: (n, steps) N m, torques asked for, latest first. delay: (n, 2)
            control steps and time steps by which they come late.
        delay_range: (n, 2) s, of episodes to come. truncated: (n,) whether the simulation diverged.
    """

    RECORDS: ClassVar[dict[str, type]]
    TAKE_ACTIONS: ClassVar[Any]
    OPTIONS: ClassVar[tuple[str, ...]]
    SETTABLE: ClassVar[tuple[str, ...]]
    entries: list[Observed]
    plant: Any
    rows: NDArray[Any]
    lengths: EpisodeLengths

    def __init__(
        self,
        robots: Sequence[Robot],
        row: np.dtype[Any],
        control_dt: float,
        time_step: float,
        delay_range: Array,
        longest_delay: float = 0.0,
    ) -> None:
        """Allocate arrays. Raises ValueError: a period or delay out of range."""
        self.robots, self.num_envs = list(robots), len(robots)
        self.control_dt, self.time_step = arguments.control_period(control_dt, time_step)
        self.steps = round(self.control_dt / self.time_step)
        n, self.delay_range = self.num_envs, delay_range
        longest_delay = max(float(delay_range.max()), longest_delay)
        if longest_delay > MOST_DELAYED * self.control_dt:
            raise ValueError(
                f"delay is {longest_delay} s, must be at most {MOST_DELAYED} times "
                f"control_dt, {self.control_dt}"
            )
        longest = math.ceil(longest_delay / self.control_dt)
        self.asked, self.delay = np.zeros((n, longest + 2)), np.zeros((n, 2), np.int64)
        self.earlier, self.switch = np.zeros(n), np.zeros(n, np.int64)
        self.rows, self.torque = np.zeros(n, row), np.zeros(n)
        self._actions, self._keep_actions = np.zeros((n, 1)), self.TAKE_ACTIONS.bound()
        self.elapsed = np.zeros(n, np.int64)
        self.full_torque = np.array([robot.motor.torque_limit for robot in self.robots])
        self._delayed = (
            self.elapsed, self.full_torque, self.rows, self.asked, self.delay, self.torque,
            self.earlier, self.switch,
        )  # fmt: skip
        self.truncated, self._any_truncated = np.zeros(n, bool), False
        self.groups: dict[str, NDArray[Any]] = {}
        self.arrays: dict[str, NDArray[Any]] = {}

    @classmethod
    def driven_robot(
        cls, robot: Robot | str, motor: Motor | str | None, torque_limit: float | None
    ) -> Robot:
        """Return the robot that such arguments give. Raises ValueError: one is not allowed."""
        return equip(
            load_robot("robot", robot),
            motor=arguments.optional(load_motor)("motor", motor),
            torque_limit=arguments.optional(positive)("torque_limit", torque_limit),
        )

    def push(self, row: int, impulse: Any) -> None:
        """Raise ValueError: a robot that is held cannot be pushed."""
        raise ValueError("the robot is held, must be free to be pushed")

    def disturb(self, rows: Ints | None = None) -> None:
        """Add noise to observations after a step, or of some robots between two steps."""

    def close(self) -> None:
        """Let go of threads."""

    def begin_delay(self, rows: Ints, delays: Array, asked: Array | None = None) -> None:
        """Begin episodes with ``delays`` (k,) s, and earlier torques ``asked`` (k, steps) N m."""
        steps = np.rint(delays / self.time_step).astype(np.int64)
        whole, rest = np.divmod(steps, self.steps)
        self.delay[rows, 0], self.delay[rows, 1] = whole, rest
        self.asked[rows] = 0.0 if asked is None else asked
        self.torque[rows], self.earlier[rows] = self.asked[rows, whole], self.asked[rows, whole + 1]
        self.switch[rows] = rest

    @property
    def _longest_delay(self) -> float:
        return (self.asked.shape[1] - 2) * self.control_dt

    def _draw_delay(self, row: int, rng: np.random.Generator, options: Mapping[str, Any]) -> float:
        low, high = self.delay_range[row].tolist()
        drawn = uniform(rng, low, high) if high > low else low
        return arguments.option(options, "delay", drawn, 0.0, self._longest_delay)

    def checked_delay_range(self, name: str, value: Any) -> tuple[float, float]:
        """Return a range of delays, s; ValueError: out of range."""
        return arguments.number_range(name, value, 0.0, self._longest_delay)

    def delay_of(self, row: int) -> float:
        """Return by how much a robot's torques come late, s."""
        whole, rest = self.delay[row].tolist()
        return float(whole * self.control_dt + rest * self.time_step)

    def _plan_robots(
        self, each: Iterable[tuple[int, Any, Mapping[str, Any]]], seeds: Sequence[int | None]
    ) -> dict[int, Build]:
        """Return the robots of resets, each (row, generator, options), where they do not stay."""
        builds = {}
        for (row, _, own), seed in zip(each, seeds, strict=True):
            robot = load_robot("options['robot']", own["robot"]) if "robot" in own else None
            if robot is not None:
                self.plant.check_robot(robot)  # with its own lengths, which later episodes have
            build = self.lengths.plan(row, own.get("lengths", {}), seed, robot)
            if build is not None:
                builds[row] = build
        return builds

    def exchange(self, builds: Mapping[int, Build]) -> Ints:
        """Put robots in the place of others, by their rows; return the rows of other designs.

        Raises:
            ValueError: a robot that the plant refuses; nothing has changed then.
        """
        others = {row: one.robot for row, one in builds.items() if one.robot != self.robots[row]}
        if others:
            self.plant.set_robots(np.array([*others]), [*others.values()])
        for row, robot in others.items():
            self.robots[row] = robot
        self.lengths.take(builds)
        return np.array([*others], np.int64)

    def get_state(self, row: int) -> dict[str, Any]:
        """Return all that a robot's future depends on but the task and random numbers."""
        changed, exchanged = self.lengths.changed[row], self.lengths.exchanged(row)
        return {
            **({"robot": robot_to_json(self.lengths.nominal[row])} if exchanged else {}),
            **({"lengths": dict(changed)} if changed else {}),
            "plant": self.plant.states[row].copy(),
            "delay": self.delay_of(row),
            "asked": self.asked[row].copy(),
            "action": float(self.rows[row]["action"]),
        }

    def checked_state(self, row: int, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return a state, ready for ``restore``; ValueError: an entry is out of range."""
        longest, asked = self.asked.shape[1], numbers_of(state["asked"])
        if asked.shape != (longest,) or not np.isfinite(asked).all():
            raise ValueError(
                f"state['asked'] is {shown(state['asked'])}, must be {longest} finite numbers"
            )
        delay = within("state['delay']", state["delay"], 0.0, self._longest_delay)
        action = within("state['action']", state["action"], -1.0, 1.0)
        robot = self.lengths.own[row]
        if "robot" in state:
            if "robot" not in self.OPTIONS:
                raise ValueError("state has 'robot', must have none: this robot is not exchanged")
            try:
                robot = robot_from_json(state["robot"])
            except (ValueError, RecursionError) as error:
                raise ValueError(f"state['robot'] is no robot: {error}") from error
        other = robot if robot != self.lengths.nominal[row] else None
        if other is not None:
            self.plant.check_robot(other)
        build = self.lengths.plan(row, state.get("lengths", {}), None, other)
        builds = {} if build is None else {row: build}
        return {"delay": delay, "asked": asked, "action": action, "builds": builds}

    def get_attr(self, name: str) -> list[Any] | None:
        """Return ``delay`` (s, of this episode), ``robot`` or ``state`` of each robot."""
        if name == "delay":
            return [self.delay_of(row) for row in range(self.num_envs)]
        if name == "robot":
            return list(self.robots)
        return list(self.plant.states.copy()) if name == "state" else None

    def _take_actions(self, actions: Any, active: Bools) -> None:
        count = self.num_envs
        try:
            values: Array = np.asarray(actions, dtype=float)
        except (TypeError, ValueError, OverflowError):
            allowed = f"must be numbers, shape ({count}, 1)"
            raise ValueError(f"actions are {shown(actions)}, {allowed}") from None
        if values.shape != (count, 1):
            raise ValueError(f"actions have shape {values.shape}, must have ({count}, 1)")
        self._actions[:] = values
        bad = self._keep_actions(self._actions, active, self._delayed)
        if bad >= 0:
            raise ValueError(f"actions[{bad}] is {values[bad, 0]}, must be finite")

    def _truncate(self, diverged: Bools) -> None:
        """End episodes whose simulation has just diverged, if any."""
        self.truncated[:] = self.rows["info"]["diverged"] = diverged
        self._any_truncated = bool(diverged.any())
        if self._any_truncated:
            gym.logger.warn(
                f"the episodes of robots {np.flatnonzero(diverged).tolist()} end: their simulation "
                f"diverged under torques of {self.torque[diverged].tolist()} N m; "
                "try a smaller time_step"
            )
