"""Gymnasium vector environment of many robots, for any task."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar, Generic

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from typing_extensions import TypedDict, override

from jansen_env.arrays import Array, Bools, Ints
from jansen_env.checks import one_of, positive_integer, robot_index
from jansen_env.envs import arguments as checks
from jansen_env.envs.copies import WholeCopies, exclusive
from jansen_env.envs.single import ATask, SingleEnv
from jansen_env.robot import Robot
from jansen_env.world.settings import Values, entries_of, optional

Observations = NDArray[np.float32]
METHODS = ("get_state", "push", "render", "set_parameters", "set_state")
"""Methods for one robot that :meth:`TaskVectorEnv.call_one` can call."""


class VectorArguments(TypedDict, total=False):
    """Keyword arguments of all vector environments; see :class:`TaskVectorEnv`."""

    max_episode_steps: int | Sequence[int | None] | None
    autoreset_mode: AutoresetMode | str
    threads: int | None
    info_keys: Sequence[str] | None


class TaskVectorEnv(
    WholeCopies, VectorEnv[Observations, NDArray[np.float32], NDArray[Any]], Generic[ATask]
):
    """Vector environment whose robots perform the same task and are simulated together.

    Trajectories are those of the single environment, bit for bit: after ``reset(seed=s)``, robot i
    moves as the robot of the single environment does after ``reset(seed=s + i)``. If the simulation
    of a robot diverges, only the episode of this robot ends.

    Methods for one robot take its index i, an integer of Python or NumPy from 0 to
    ``num_envs - 1``. For any other index they raise ValueError before anything changes.

    Args:
        num_envs: Number of robots.
        max_episode_steps: Number of steps after which an episode is truncated: one number, or one
            number per robot. None for no limit.
        autoreset_mode: ``NEXT_STEP`` (the default of Gymnasium), ``SAME_STEP`` or ``DISABLED``.
            With ``NEXT_STEP``, the step after the last step of an episode resets the robot and
            ignores its action. With ``SAME_STEP``, the last step itself returns the first
            observation of the next episode, and ``infos["final_obs"]`` contains the last
            observation. With ``DISABLED``, you reset the robots yourself.
        threads: Number of CPU cores to use. If None, it is chosen from the batch size.
        info_keys: Keys of ``infos``, such as ``("slip",)``. None for all keys, which makes a step a
            few per cent slower.
        arguments: Other arguments, which are those of the environment of one robot. ``render_mode``
            is None or ``"rgb_array"``. Arguments of the type ``PerRobot`` may have one value per
            robot.

    Attributes:
        SINGLE: Environment of one robot, whose task and preset are used.
        task: Task of all robots.
        dt: Duration for which an action is held, in s.
        control_dt: Same as ``dt``.
        observed: Name, unit, limits and noise of each number of an observation.

    Raises:
        ValueError: If an argument is out of range, or does not have one value per robot.
    """

    metadata: Values = {"render_modes": ["rgb_array"], "render_fps": 50}
    SINGLE: ClassVar[type[SingleEnv[Any]]]

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | Sequence[int | None] | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        info_keys: Sequence[str] | None = None,
        **arguments: object,
    ) -> None:
        self._renderers = checks.Renderers()
        self.num_envs = n = positive_integer("num_envs", num_envs, checks.MOST_ROBOTS)
        limits = entries_of("max_episode_steps", max_episode_steps, n)
        limits = [checks.time_limit("max_episode_steps", limit) for limit in limits]
        self.max_episode_steps: Array = np.array(limits, float)
        self.autoreset_mode = checks.autoreset_mode("autoreset_mode", autoreset_mode)
        one_of("render_mode", arguments.get("render_mode"), (None, "rgb_array"))
        threads = optional(positive_integer)("threads", threads)
        settings = checks.make_settings(self, self.SINGLE, arguments, n)
        self.render_mode: str | None = settings.render_mode
        task: ATask = self.SINGLE.TASK(settings, threads)
        self.task = task
        self.info_keys = checks.info_keys(info_keys, task.information.keys)
        self.dt = self.control_dt = task.control_dt
        self.observed = task.observed
        more = {"render_fps": max(1, round(1.0 / self.dt)), "autoreset_mode": self.autoreset_mode}
        self.metadata = {**self.metadata, **more}
        self.single_observation_space: spaces.Box = task.observation_space
        self.single_action_space: spaces.Box = task.action_space
        self.observation_space = batch_space(self.single_observation_space, n)
        self.action_space = batch_space(self.single_action_space, n)
        self._elapsed = np.zeros(n, np.int64)  # steps of each episode
        self._done = np.ones(n, bool)  # whether a robot must be reset before it continues
        self._begun = np.zeros(n, bool)
        self._generators: list[np.random.Generator | None] = [None] * n
        self._seeds = [-1] * n

    @property
    def robot(self) -> Robot:
        """The first robot."""
        return self.task.world.robots[0]

    @property
    def torque_limit(self) -> float:
        """Torque of the action 1 of the first robot, in N m."""
        return self.robot.motor.torque_limit

    @override
    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Values | None = None
    ) -> tuple[Observations, Values]:
        """Start new episodes of all robots, or of some robots.

        After an error, nothing has changed.

        Args:
            seed: Seed of the random numbers. From one number, robot i gets seed + i; from a
                sequence, it gets entry i. None to continue with the present generators.
            options: Options of the single environment: one value for all robots, or one value per
                robot. ``options["reset_mask"]``, shape (num_envs,), selects the robots to reset;
                without it, all robots are reset.

        Returns:
            The observations, shape (num_envs, d), and the information.

        Raises:
            ValueError: If a seed or an option is out of range.
            TypeError: If the mask is not an array of bools.
        """
        options = checks.reset_options(options)
        mask = checks.reset_mask(self.num_envs, options.pop("reset_mask", None))
        seeds = checks.broadcast_seeds(self.num_envs, seed)
        return self.reset_each(seeds, checks.broadcast_options(self.num_envs, options), mask)

    @exclusive
    def reset_each(
        self, seeds: Sequence[int | None], options: Sequence[Values], mask: Bools | None = None
    ) -> tuple[Observations, Values]:
        """Reset robots with a seed and options for each; see :meth:`reset`.

        Args:
            seeds: Seed of each robot. None to continue with its present generator.
            options: Options of each robot, by name.
            mask: Whether to reset each robot, shape (num_envs,). None for all robots.

        Returns:
            The observations, shape (num_envs, d), and the information.
        """
        n = self.num_envs
        mask = checks.reset_mask(n, mask)
        for name, values in (("seeds", seeds), ("options", options)):
            if len(values) != n:
                raise ValueError(f"{name} must have {n} entries, got {len(values)}")
        which = np.flatnonzero(mask)
        before = (self._generators[:], self._seeds[:])
        for i in which.tolist():
            if seeds[i] is not None:
                self._generators[i], self._seeds[i] = seeding.np_random(seeds[i])
        try:
            self.restart(which, [options[i] for i in which.tolist()])
        except Exception:
            self._generators, self._seeds = before
            raise
        self._begun |= mask
        return self.task.observation.copy(), self._infos(mask)

    @exclusive
    def restart(self, which: Ints, options: Sequence[Values] | None = None) -> None:
        """Start the next episodes of some robots.

        Args:
            which: Indices of the robots, shape (k,).
            options: Reset options of each of these robots. None for no options.
        """
        self.task.reset(which, [self._generator(i) for i in which.tolist()], options)
        self._elapsed[which] = 0
        self._done[which] = False

    @exclusive
    @override
    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observations, Array, Bools, Bools, Values]:
        """Hold the action of each robot for ``control_dt`` seconds.

        Args:
            actions: Torques as fractions of the torque limit, shape (num_envs, 1).

        Returns:
            The observations, the rewards, whether each episode is terminated, whether it is
                truncated, and the information.

        Raises:
            ValueError: If the actions are not one finite number per robot.
            gymnasium.error.ResetNeeded: If :meth:`reset` has not been called yet. With
                ``AutoresetMode.DISABLED``, also if the episode of a robot is over.
        """
        terminated, truncated = self.advance(actions)
        rewards = self.task.rewards.copy()
        if self.autoreset_mode == AutoresetMode.SAME_STEP and self._done.any():
            infos = self._restart_in_step(terminated | truncated)
        else:
            infos = self._infos(np.ones(self.num_envs, bool))
        return self.task.observation.copy(), rewards, terminated, truncated, infos

    @exclusive
    def advance(self, actions: NDArray[np.float32]) -> tuple[Bools, Bools]:
        """Simulate a step, but do not start the new episodes of ``SAME_STEP``.

        Args:
            actions: Torques as fractions of the torque limit, shape (num_envs, 1).

        Returns:
            Whether each episode is terminated, and whether it is truncated. Both have shape
                (num_envs,).
        """
        if (waiting := self._awaiting_reset()).any():
            late = np.flatnonzero(waiting).tolist()
            raise gym.error.ResetNeeded(f"robots {late} must be reset before the next step()")
        task = self.task
        active = ~self._done
        over = self._done.nonzero()[0]
        values = checks.vector_actions(actions, active)
        if len(over) == 0:
            task.step(values, None)
        else:  # NEXT_STEP: robots whose episode is over are reset and do not move
            task.step(values, active.nonzero()[0], partial(self.restart, over))
        self._elapsed += active
        terminated = task.ended.copy()
        truncated = task.truncated | (self._elapsed >= self.max_episode_steps)
        self._done = terminated | truncated
        return terminated, truncated

    def _restart_in_step(self, done: Bools) -> Values:
        """Start the next episodes of the robots that are ``done``.

        The returned information contains the last observations and the last information.
        """
        final = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(done).tolist():
            final[i] = self.task.observation[i].copy()
        last = self._infos(done)
        self.restart(np.flatnonzero(done))
        infos = self._infos(np.ones(self.num_envs, bool))
        infos["final_obs"] = final
        infos["_final_obs"] = done.copy()
        infos["final_info"] = last
        infos["_final_info"] = done.copy()
        return infos

    def _infos(self, known: Bools) -> Values:
        return self.task.information.batched(known, self.info_keys)

    def _awaiting_reset(self) -> Bools:
        """Return which robots cannot take a step before :meth:`reset`, shape (num_envs,)."""
        disabled = self.autoreset_mode == AutoresetMode.DISABLED
        return ~self._begun | self._done if disabled else ~self._begun

    def set_parameters(self, i: int, **changes: object) -> None:
        """Change parameters of a robot from now on.

        See :meth:`jansen_env.tasks.task.Task.set_parameters`.

        Args:
            i: Index of the robot.
            changes: New values, by name.
        """
        self.task.set_parameters(i, **changes)

    @exclusive
    def push(self, i: int, impulse: object) -> None:
        """Push a robot from now on.

        See :meth:`jansen_env.world.world.World.push`. With ``NEXT_STEP``, a robot whose episode is
        over is not pushed, because its next step resets it.

        Args:
            i: Index of the robot.
            impulse: Impulse in x and y, in N s.

        Raises:
            gymnasium.error.ResetNeeded: If the robot has not been reset yet. With
                ``AutoresetMode.DISABLED``, also if its episode is over.
        """
        i = robot_index(i, self.num_envs)
        if self._awaiting_reset()[i]:
            raise gym.error.ResetNeeded(f"robot {i} must be reset before push()")
        self.task.push(i, impulse)

    @exclusive
    def get_state(self, i: int) -> Values:
        """Return the state of a robot, from which :meth:`set_state` continues its episode.

        The state has the same form as that of the single environment.

        Args:
            i: Index of the robot.
        """
        i = robot_index(i, self.num_envs)
        generator = self._generator(i).bit_generator.state
        return {**self.task.get_state(i), "generator": generator}

    @exclusive
    def set_state(self, i: int, state: Values) -> Observations:
        """Restore a robot to a state saved by :meth:`get_state`, and return its observation.

        The number of steps that count towards ``max_episode_steps`` does not change.

        Args:
            i: Index of the robot.
            state: The complete state.
        """
        i = robot_index(i, self.num_envs)
        checks.complete_state(state, self.get_state(i))
        self.task.set_state(i, state)
        self._generator(i).bit_generator.state = state["generator"]
        self._begun[i] = True
        self._done[i] = False
        return self.task.observation[i].copy()

    def _generator(self, i: int) -> np.random.Generator:
        """Return the random number generator of a robot.

        If :meth:`reset` got no seed, the operating system provides the seed.
        """
        generator = self._generators[i]
        if generator is None:
            generator, self._seeds[i] = seeding.np_random()
            self._generators[i] = generator
        return generator

    @property  # type: ignore[misc]
    @override
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The random number generator of each robot."""
        return tuple(self._generator(i) for i in range(self.num_envs))

    @property
    @override
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each robot; -1 for a robot without a seed."""
        return tuple(self._seeds)

    def call_one(self, i: int, name: str, *args: object, **kwargs: object) -> Any:
        """Call a method of one robot.

        Args:
            i: Index of the robot.
            name: Name of the method, in :data:`METHODS`.
            args: Positional arguments of the method.
            kwargs: Keyword arguments of the method.
        """
        if name not in METHODS:
            raise AttributeError(
                f"a method that is called on one robot must be one of {METHODS}, got {name!r}"
            )
        i = robot_index(i, self.num_envs)
        if name == "render":
            return self._renderers.draw(self, i)
        return getattr(self, name)(i, *args, **kwargs)

    def call(self, name: str, *args: object, **kwargs: object) -> tuple[Any, ...]:
        """Call a method of each robot, or return an attribute of each robot.

        Args:
            name: Name of a method in :data:`METHODS`, or of an attribute.
            args: Positional arguments of the method.
            kwargs: Keyword arguments of the method.
        """
        if name in METHODS:
            return tuple(self.call_one(i, name, *args, **kwargs) for i in range(self.num_envs))
        return self.get_attr(name)

    @exclusive
    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each robot.

        If robots have no individual values, the value of the environment is repeated.

        Args:
            name: Name of the attribute.
        """
        values = self.task.world.get_attr(name)
        if name in self.task.SETTABLE:
            each = getattr(self.task, name).tolist()
            values = [tuple(value) if isinstance(value, list) else value for value in each]
        if values is not None:
            return tuple(values)
        if name in ("max_episode_steps", "np_random", "np_random_seed"):
            return tuple(getattr(self, name))
        common = f"single_{name}" if name in ("observation_space", "action_space") else name
        value = getattr(self, common)
        if callable(value):
            raise AttributeError(
                f"a method that is called on one robot must be one of {METHODS}, got {name!r}"
            )
        return (value,) * self.num_envs

    @exclusive
    def set_attr(self, name: str, values: object) -> None:
        """Set a parameter of all robots.

        If a value is not allowed, no robot changes.

        Args:
            name: Name of the parameter.
            values: One value for all robots, or a list or tuple with one value per robot.
        """
        values = values if isinstance(values, (list, tuple)) else [values] * self.num_envs
        if len(values) != self.num_envs:
            raise ValueError(f"values must have {self.num_envs} entries, got {len(values)}")
        for change in [self.task.checked(i, **{name: value}) for i, value in enumerate(values)]:
            change()  # only after all values have been checked

    @override
    def render(self) -> tuple[Any, ...] | None:
        """Return a picture of each robot, shape (H, W, 3), or None without a ``render_mode``."""
        pictures = [self._renderers.draw(self, 0)]
        if self.render_mode is None:
            return None
        return (*pictures, *(self._renderers.draw(self, i) for i in range(1, self.num_envs)))

    @override
    def close_extras(self, **kwargs: object) -> None:
        """Close the renderers and stop the threads.

        Args:
            kwargs: Have no effect.
        """
        if hasattr(
            self, "task"
        ):  # Gymnasium also closes environments whose arguments were rejected
            self._renderers.close()
            self.task.world.close()
