"""What a task is: n robots, arrays in and arrays out. The environments translate it, no more."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from jansen_env.checks import within
from jansen_env.engine.actions import take_actions
from jansen_env.engine.jit import Kernel
from jansen_env.envs import arguments
from jansen_env.envs.arguments import actions_of_each, option
from jansen_env.motor import Motor
from jansen_env.rendering import Frame
from jansen_env.robot import Robot

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


class Observed(NamedTuple):
    """A number of the observation: its name, as in ``info`` where it is there too; its unit, limits."""

    name: str
    unit: str
    low: float
    high: float


class Information:
    """What an environment's ``info`` tells of n robots: the task's own arrays, put into dictionaries.

    Args:
        rows: (n,) a task's structured rows. Their field ``info`` has numbers and flags, ``energy``
            becomes a dictionary of its own, ``reward`` has the reward's terms, which only a step has.
        arrays: (n, ...) more of it. step_arrays: (n,) more numbers that only a step has.
        parameters: (n,) structured rows that become a dictionary of that name; None for none.
    """

    def __init__(
        self,
        rows: NDArray[Any],
        arrays: dict[str, NDArray[Any]],
        step_arrays: dict[str, NDArray[Any]],
        parameters: NDArray[Any] | None = None,
    ) -> None:
        self._rows, self._arrays, self._step_arrays = rows, arrays, step_arrays
        self._parameters = parameters
        fields: Any = rows.dtype.names
        self._place = {name: fields.index(name) for name in ("info", "energy", "reward")}
        self._info, self._energy, self._reward = (
            tuple(rows.dtype[name].names or ()) for name in self._place
        )
        self._terms = tuple(f"reward/{name}" for name in self._reward)
        more = () if parameters is None else ("parameters",)
        self.keys = (*self._info, "energy", *arrays, *self._terms, *step_arrays, *more)
        """All that a step's information has."""

    def of_one(self, row: int, stepped: bool) -> dict[str, Any]:
        """Of one robot, in Python's own types; ``stepped``: whether of a step, not of a reset."""
        values, place = self._rows[row].item(), self._place
        info = dict(zip(self._info, values[place["info"]], strict=True))
        info["energy"] = dict(zip(self._energy, values[place["energy"]], strict=True))
        for name, array in self._arrays.items():
            info[name] = array[row].copy()
        if self._parameters is not None:
            names = self._parameters.dtype.names or ()
            info["parameters"] = dict(zip(names, self._parameters[row].item(), strict=True))
        if stepped:
            info.update(zip(self._terms, values[place["reward"]], strict=True))
            for name, array in self._step_arrays.items():
                info[name] = array[row].item()
        return info

    def of_all(
        self, known: Bools, stepped: Bools, keys: Sequence[str] | None = None
    ) -> dict[str, Any]:
        """Gymnasium's vector information: arrays, 0 where not ``known``, each with a mask.

        Args:
            known, stepped: (n,) of which robots there is any, and of which that of a step.
            keys: of :attr:`keys` those wanted, None for all.
        """
        wanted = self.keys if keys is None else keys
        if not wanted:
            return {}
        info, energy, reward = (self._rows[name] for name in self._place)
        of_any = {name: info[name] for name in self._info} | self._arrays
        infos = _masked({name: of_any[name] for name in wanted if name in of_any}, known)
        groups = {"energy": energy, "parameters": self._parameters}
        for group, own in groups.items():
            if group in wanted and own is not None:
                infos[group] = _masked({name: own[name] for name in own.dtype.names or ()}, known)
                infos[f"_{group}"] = known.copy()
        if stepped.any():
            terms = zip(self._terms, self._reward, strict=True)
            of_step = {name: reward[term] for name, term in terms} | self._step_arrays
            infos |= _masked({name: of_step[name] for name in wanted if name in of_step}, stepped)
        return infos


def _masked(arrays: dict[str, NDArray[Any]], known: Bools) -> dict[str, Any]:
    """Copies, 0 where not ``known``, each with its mask."""
    every = bool(known.all())
    infos: dict[str, Any] = {}
    for name, array in arrays.items():
        infos[name], infos[f"_{name}"] = array.copy(), known.copy()
        if not every:
            infos[name][~known] = 0
    return infos


class Task(ABC):
    """A task of ``num_envs`` robots: arguments, reset, physics, observation, reward, end of episode.

    Environments of one robot and of many are made of it (:mod:`jansen_env.envs.single`,
    :mod:`jansen_env.envs.vector`); what is added here appears in all of them.

    Attributes:
        OF_EACH: arguments that may be one for all robots or one for each.
        ONE_ALONE: arguments with which, unless they have this value, there is but one robot.
        SETTABLE: what :meth:`set_parameters` changes.
        robots: what moves. observation_space, action_space: of one robot.
        observed: what each number of the observation is.
        control_dt: s for which an action is held.
        observation: (n, d) the last ones. reward: (n,) of the last step. terminated: (n,) whether
            the episode is over. truncated: (n,) whether the simulation diverged.
        information: of the last step.
        full_torque: (n,) N m, the torque of action 1, with its sign.
        torque: (n,) that the last step ended with, N m, and earlier: (n,) the one that held in its
            first ``switch`` (n,) time steps. asked: (n, steps) N m, torques asked for, latest
            first. delay: (n, 2) after how many control steps and time steps they hold.
        delay_range: (n, 2) s, of episodes to come.
        rows: (n,) what is kept of each robot's episode, and what its last step was.
    """

    OF_EACH: ClassVar[tuple[str, ...]]
    ONE_ALONE: ClassVar[Mapping[str, Any]] = {}
    SETTABLE: ClassVar[tuple[str, ...]]
    num_envs: int
    robots: list[Robot]
    observed: tuple[Observed, ...]
    observation_space: spaces.Box
    action_space: spaces.Box
    control_dt: float
    observation: NDArray[np.float32]
    reward: Array
    terminated: Bools
    truncated: Bools
    information: Information
    full_torque: Array
    torque: Array
    earlier: Array
    switch: Ints
    asked: Array
    delay: Ints
    delay_range: Array
    rows: NDArray[Any]

    @classmethod
    def driven_robot(
        cls, robot: Robot | str, motor: Motor | str | None, torque_limit: float | None
    ) -> Robot:
        """Return the robot that such arguments give, with the motor that turns its crank.

        Raises:
            ValueError: one of them is not allowed.
        """
        return arguments.robot_of_each(1, robot, motor=motor, torque_limit=torque_limit)[0]

    def _allocate(
        self,
        row: np.dtype[Any],
        observed: Sequence[Observed],
        delay: Any,
        time_step: float,
        longest_delay: float = 0.0,
    ) -> None:
        """Make the arrays of a task with such rows; delay: s, of each robot, a number or a range.

        No delay is longer than the longest of these and ``longest_delay``, s.
        """
        n = self.num_envs
        self.delay_range = arguments.delay_of_each(n, delay)
        self._time_step = time_step
        longest_delay = max(float(self.delay_range.max()), longest_delay)
        if longest_delay > arguments.MOST_DELAYED * self.control_dt:
            raise ValueError(
                f"delay is {longest_delay} s, must be at most {arguments.MOST_DELAYED} times "
                f"control_dt, {self.control_dt}"
            )
        longest = math.ceil(longest_delay / self.control_dt)
        self.asked, self.delay = np.zeros((n, longest + 2)), np.zeros((n, 2), np.int64)
        self.earlier, self.switch = np.zeros(n), np.zeros(n, np.int64)
        self.observed = tuple(observed)
        low, high = np.array([(entry.low, entry.high) for entry in observed], np.float32).T
        self.observation_space = spaces.Box(low, high, dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation = np.zeros((n, len(observed)), np.float32)
        self.rows = np.zeros(n, row)
        self.torque, self.reward = np.zeros((2, n))
        self.full_torque = np.array([robot.motor.torque_limit for robot in self.robots])
        self.terminated, self.truncated = np.zeros((2, n), bool)
        self._any_truncated = False

    def reset(
        self,
        rows: Ints,
        generators: Sequence[np.random.Generator],
        options: Sequence[dict[str, Any]] | None = None,
    ) -> None:
        """Start episodes of some robots.

        Args:
            rows: indices of the robots. generators: the random numbers of each of them.
            options: of ``reset`` for each of them.

        Raises:
            ValueError: an unknown option, or a value out of range.
        """
        self._start(rows, generators, [{}] * len(rows) if options is None else options)
        self.terminated[rows] = self.truncated[rows] = False
        self._describe(rows)

    @abstractmethod
    def _start(
        self,
        rows: Ints,
        generators: Sequence[np.random.Generator],
        options: Sequence[dict[str, Any]],
    ) -> None:
        """Start episodes of some robots: all that may be refused is, before anything changes."""

    @abstractmethod
    def _describe(self, rows: Ints) -> None:
        """Fill observations and information of some robots with what is the case now."""

    @abstractmethod
    def step(
        self, actions: Any, active: Bools, meanwhile: Callable[[], None] | None = None
    ) -> None:
        """Hold actions (n, 1) of the ``active`` robots (n,) for ``control_dt`` seconds.

        Args:
            meanwhile: called while they move, to :meth:`reset` others.

        Raises:
            ValueError: the actions are not one finite number for each active robot.
        """

    @abstractmethod
    def _inform(self) -> Information:
        """Make :attr:`information`."""

    @abstractmethod
    def set_parameters(self, row: int, **changes: Any) -> None:
        """Change some of :attr:`SETTABLE` of one robot.

        Raises:
            ValueError: a value out of range. TypeError: another name.
        """

    def push(self, row: int, impulse: Any) -> None:
        """Push a robot from now on, N s in x and y.

        Raises:
            ValueError: it cannot be pushed.
        """
        raise ValueError("the robot is held, must be free to be pushed")

    @abstractmethod
    def of_each(self, name: str) -> list[Any] | None:
        """What robots have of their own by that name, an entry for each; None for anything else."""

    @abstractmethod
    def get_state(self, row: int) -> dict[str, Any]:
        """All that a robot's future depends on but its random numbers."""

    @abstractmethod
    def set_state(self, row: int, state: Mapping[str, Any]) -> None:
        """Go on from a state of :meth:`get_state`; fills :attr:`observation`.

        Raises:
            ValueError: an entry is missing or out of range.
        """

    @abstractmethod
    def scene(self, row: int) -> dict[str, Any]:
        """Arguments of :class:`jansen_env.rendering.Renderer` to draw a robot."""

    @abstractmethod
    def frame(self, row: int) -> Frame:
        """What is to be drawn of a robot as it stands."""

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "information": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.information = self._inform()  # of this copy's arrays

    @abstractmethod
    def close(self) -> None:
        """Let go of threads."""

    def _kernels(self) -> list[Kernel]:
        """What is compiled of any task."""
        n = self.num_envs
        actions, active = np.zeros((n, 1)), np.ones(n, bool)
        return [Kernel("actions", take_actions, (actions, active, *self._delayed()))]

    @property
    def torque_limit(self) -> float:
        """N m, the first robot's torque of action 1."""
        return self.robots[0].motor.torque_limit

    def _delayed(self) -> tuple[Any, ...]:
        return (
            self.full_torque, self.rows, self.asked, self.delay, self.torque, self.earlier,
            self.switch,
        )  # fmt: skip

    def _begin_delay(self, rows: Ints, delays: Array, asked: Array | None = None) -> None:
        """Begin episodes of robots (k,) whose torques come late.

        Args:
            delays: (k,) s. asked: (k, steps) N m, torques asked for before; None: 0.
        """
        steps = np.rint(delays / self._time_step).astype(np.int64)
        whole, rest = np.divmod(steps, round(self.control_dt / self._time_step))
        self.delay[rows] = np.stack([whole, rest], axis=-1)
        self.asked[rows] = 0.0 if asked is None else asked
        self.torque[rows], self.earlier[rows] = self.asked[rows, whole], self.asked[rows, whole + 1]
        self.switch[rows] = rest

    def _draw_delay(self, row: int, rng: np.random.Generator, options: Mapping[str, Any]) -> float:
        """By how much a robot's torques come late in an episode, s."""
        low, high = self.delay_range[row].tolist()
        longest = (self.asked.shape[1] - 2) * self.control_dt
        drawn = rng.uniform(low, high) if high > low else low
        return option(options, "delay", drawn, 0.0, longest)

    def _checked_delay_range(self, value: Any) -> tuple[float, float]:
        """A range of delays, s. Raises ValueError: out of range."""
        longest = (self.asked.shape[1] - 2) * self.control_dt
        return arguments.number_range("delay", value, 0.0, longest)

    def _delay_state(self, row: int) -> dict[str, Any]:
        """Of :meth:`get_state`: what a robot's delay is, s, and torques on their way, N m."""
        whole, rest = self.delay[row].tolist()
        return {
            "delay": whole * self.control_dt + rest * self._time_step,
            "asked": self.asked[row].copy(),
        }

    def _checked_delay(self, state: Mapping[str, Any]) -> tuple[float, Array]:
        """What :meth:`_begin_delay` needs, of a state. Raises ValueError: out of range."""
        longest, asked = self.asked.shape[1], np.array(state["asked"], dtype=float)
        if asked.shape != (longest,) or not np.isfinite(asked).all():
            raise ValueError(f"state['asked'] is {asked}, must be {longest} finite numbers")
        return within("state['delay']", state["delay"], 0.0, (longest - 2) * self.control_dt), asked

    def _take_actions(self, actions: Any, active: Bools) -> None:
        """Actions (n, 1) into the rows and as torques, see :meth:`step`."""
        values = actions_of_each(self.num_envs, actions)
        bad = take_actions(values, active, *self._delayed())
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
