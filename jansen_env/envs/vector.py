"""Gymnasium's vector environment of many robots, of any task."""

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
from typing_extensions import TypedDict

from jansen_env.arrays import Array, Bools, Ints
from jansen_env.checks import one_of, positive_integer, robot_index
from jansen_env.envs import arguments as checks
from jansen_env.envs.copies import WholeCopies, exclusive
from jansen_env.envs.single import ATask, SingleEnv
from jansen_env.robot import Robot
from jansen_env.world.settings import Values, entries_of, optional

Observations = NDArray[np.float32]
METHODS = ("get_state", "push", "render", "set_parameters", "set_state")
"""Methods of single robots, see :meth:`TaskVectorEnv.call_one`."""


class VectorArguments(TypedDict, total=False):
    """Arguments of all vector environments by keyword, see :class:`TaskVectorEnv`."""

    max_episode_steps: int | Sequence[int | None] | None
    autoreset_mode: AutoresetMode | str
    threads: int | None
    info_keys: Sequence[str] | None


class TaskVectorEnv(
    WholeCopies, VectorEnv[Observations, NDArray[np.float32], NDArray[Any]], Generic[ATask]
):
    """``num_envs`` robots that do a task together.

    Trajectories are those of the single environment, bit for bit: robot i of ``reset(seed=s)`` does
    what the single environment does after ``reset(seed=s + i)``. A robot whose simulation diverges
    ends its own episode, no other's.

    Methods for one robot take its index i, a whole number from 0 to ``num_envs`` - 1 of Python or
    NumPy. They raise ValueError for anything else, before anything changes.

    Args:
        num_envs: robots. max_episode_steps: after which an episode is truncated, one number or one
            for each robot; None for never.
        autoreset_mode: ``NEXT_STEP`` (Gymnasium's default: the step after an episode's last one
            resets and ignores the action), ``SAME_STEP`` (that very step returns the next
            episode's first observation; ``infos["final_obs"]`` has the last one) or ``DISABLED``.
        threads: cores to use; None: chosen by batch size. render_mode: None or ``"rgb_array"``.
        info_keys: keys of ``infos``, such as ``("slip",)``; None for all, which takes some per cent
            of a step.
        Others: as for one robot; those that are ``PerRobot`` may be one for each.

    Attributes:
        SINGLE: the environment of one robot, whose task and preset are used.
        task: the task of all robots. dt, control_dt: s for which an action is held.
        observed: name, unit, limits and noise of each number of an observation.

    Raises:
        ValueError: an argument out of range, or not one for each robot.
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
        self._done = np.ones(n, bool)  # must be reset before it goes on
        self._begun = np.zeros(n, bool)
        self._generators: list[np.random.Generator | None] = [None] * n
        self._seeds = [-1] * n

    @property
    def robot(self) -> Robot:
        """The first robot."""
        return self.task.world.robots[0]

    @property
    def torque_limit(self) -> float:
        """Torque of action 1 of the first robot, N m."""
        return self.robot.motor.torque_limit

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Values | None = None
    ) -> tuple[Observations, Values]:
        """Start episodes: of all robots, or of those in ``options["reset_mask"]`` (num_envs,).

        Args:
            seed: robot i gets seed + i, or entry i. options: of the single environment, for all or
                one for each.

        Raises:
            ValueError: a seed or option out of range. TypeError: a mask that is no array of bools.
                Nothing has changed then.
        """
        options = checks.reset_options(options)
        mask = checks.reset_mask(self.num_envs, options.pop("reset_mask", None))
        seeds = checks.broadcast_seeds(self.num_envs, seed)
        return self.reset_each(seeds, checks.broadcast_options(self.num_envs, options), mask)

    @exclusive
    def reset_each(
        self, seeds: Sequence[int | None], options: Sequence[Values], mask: Bools | None = None
    ) -> tuple[Observations, Values]:
        """:meth:`reset` with a seed and options for each robot; ``mask`` (num_envs,) names some."""
        n = self.num_envs
        mask = checks.reset_mask(n, mask)
        for name, values in (("seeds", seeds), ("options", options)):
            if len(values) != n:
                raise ValueError(f"{name} must have {n} entries, got {len(values)}")
        which, before = np.flatnonzero(mask), (self._generators[:], self._seeds[:])
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
        """Start the next episodes of some robots."""
        self.task.reset(which, [self._generator(i) for i in which.tolist()], options)
        self._elapsed[which] = 0
        self._done[which] = False

    @exclusive
    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Observations, Array, Bools, Bools, Values]:
        """Hold each robot's action for ``control_dt`` seconds.

        Raises:
            ValueError: the actions are not one finite number for each robot.
            gymnasium.error.ResetNeeded: before the first :meth:`reset`, and with
                ``AutoresetMode.DISABLED`` while an episode is over.
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
        """Step without starting episodes of ``SAME_STEP``; returns (terminated, truncated)."""
        if (waiting := self._awaiting_reset()).any():
            late = np.flatnonzero(waiting).tolist()
            raise gym.error.ResetNeeded(f"robots {late} must be reset before the next step()")
        task, active, over = self.task, ~self._done, self._done.nonzero()[0]
        values = checks.vector_actions(actions, active)
        if len(over) == 0:
            task.step(values, None)
        else:  # NEXT_STEP: those whose episode is over only start again
            task.step(values, active.nonzero()[0], partial(self.restart, over))
        self._elapsed += active
        terminated = task.ended.copy()
        truncated = task.truncated | (self._elapsed >= self.max_episode_steps)
        self._done = terminated | truncated
        return terminated, truncated

    def _restart_in_step(self, done: Bools) -> Values:
        """Start the next episodes where ``done``; the information has the last observations."""
        final = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(done).tolist():
            final[i] = self.task.observation[i].copy()
        last = self._infos(done)
        self.restart(np.flatnonzero(done))
        infos = self._infos(np.ones(self.num_envs, bool))
        infos["final_obs"], infos["_final_obs"] = final, done.copy()
        infos["final_info"], infos["_final_info"] = last, done.copy()
        return infos

    def _infos(self, known: Bools) -> Values:
        return self.task.information.batched(known, self.info_keys)

    def _awaiting_reset(self) -> Bools:
        """Return which robots (num_envs,) cannot take a step before :meth:`reset`."""
        disabled = self.autoreset_mode == AutoresetMode.DISABLED
        return ~self._begun | self._done if disabled else ~self._begun

    def set_parameters(self, i: int, **changes: object) -> None:
        """Change robot ``i`` from now on, see :meth:`jansen_env.tasks.task.Task.set_parameters`."""
        self.task.set_parameters(i, **changes)

    @exclusive
    def push(self, i: int, impulse: object) -> None:
        """Push robot ``i`` from now on, see :meth:`jansen_env.world.world.World.push`.

        With ``NEXT_STEP`` a robot whose episode is over is not pushed: its next step resets it.

        Raises:
            gymnasium.error.ResetNeeded: before the robot's first :meth:`reset`, and with
                ``AutoresetMode.DISABLED`` while its episode is over.
        """
        i = robot_index(i, self.num_envs)
        if self._awaiting_reset()[i]:
            raise gym.error.ResetNeeded(f"robot {i} must be reset before push()")
        self.task.push(i, impulse)

    @exclusive
    def get_state(self, i: int) -> Values:
        """Return all that the future of robot ``i`` depends on, as of the single environment."""
        i = robot_index(i, self.num_envs)
        generator = self._generator(i).bit_generator.state
        return {**self.task.get_state(i), "generator": generator}

    @exclusive
    def set_state(self, i: int, state: Values) -> Observations:
        """Let robot ``i`` go on from a state of :meth:`get_state`; returns its observation.

        Its count towards ``max_episode_steps`` stays.
        """
        i = robot_index(i, self.num_envs)
        checks.complete_state(state, self.get_state(i))
        self.task.set_state(i, state)
        self._generator(i).bit_generator.state = state["generator"]
        self._begun[i], self._done[i] = True, False
        return self.task.observation[i].copy()

    def _generator(self, i: int) -> np.random.Generator:
        """Return a robot's generator, seeded by the system where :meth:`reset` got no seed."""
        generator = self._generators[i]
        if generator is None:
            generator, self._seeds[i] = seeding.np_random()
            self._generators[i] = generator
        return generator

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Every robot's random numbers."""
        return tuple(self._generator(i) for i in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Every robot's seed; -1 where it has none yet."""
        return tuple(self._seeds)

    def call_one(self, i: int, name: str, *args: object, **kwargs: object) -> Any:
        """Call one of :data:`METHODS` of robot ``i``."""
        if name not in METHODS:
            raise AttributeError(f"a method of one robot must be in {METHODS}, got {name!r}")
        i = robot_index(i, self.num_envs)
        if name == "render":
            return self._renderers.draw(self, i)
        return getattr(self, name)(i, *args, **kwargs)

    def call(self, name: str, *args: object, **kwargs: object) -> tuple[Any, ...]:
        """Call one of :data:`METHODS` of each robot, or return its attribute of that name."""
        if name in METHODS:
            return tuple(self.call_one(i, name, *args, **kwargs) for i in range(self.num_envs))
        return self.get_attr(name)

    @exclusive
    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each robot: its own, or the common one."""
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
            raise AttributeError(f"a method of one robot must be in {METHODS}, got {name!r}")
        return (value,) * self.num_envs

    @exclusive
    def set_attr(self, name: str, values: object) -> None:
        """Set a parameter of all robots: to one value, or to the entries of a list."""
        values = values if isinstance(values, (list, tuple)) else [values] * self.num_envs
        if len(values) != self.num_envs:
            raise ValueError(f"values must have {self.num_envs} entries, got {len(values)}")
        for change in [self.task.checked(i, **{name: value}) for i, value in enumerate(values)]:
            change()  # all or nothing

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture (H, W, 3) of each robot; None without a ``render_mode``."""
        pictures = [self._renderers.draw(self, 0)]
        if self.render_mode is None:
            return None
        return (*pictures, *(self._renderers.draw(self, i) for i in range(1, self.num_envs)))

    def close_extras(self, **kwargs: object) -> None:
        """Let go of pictures and threads."""
        if hasattr(self, "task"):  # Gymnasium closes what was refused, too
            self._renderers.close()
            self.task.world.close()
