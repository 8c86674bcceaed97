"""Gymnasium environment of one robot, for any task."""

from __future__ import annotations

from typing import Any, ClassVar, Generic, TypeVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from jansen_env.envs.arguments import (
    Renderers,
    complete_state,
    make_settings,
    reset_options,
    single_action,
)
from jansen_env.envs.copies import WholeCopies, exclusive
from jansen_env.plants.plant import Plant
from jansen_env.robot import Robot
from jansen_env.tasks.task import Task
from jansen_env.world.settings import RENDER_MODES, Values

Observation = NDArray[np.float32]
ATask = TypeVar("ATask", bound=Task)

ROBOT = np.zeros(1, np.int64)  # index of the only robot
RIGHT, LEFT = 1073741903, 1073741904  # pygame's K_RIGHT and K_LEFT


class SingleEnv(WholeCopies, gym.Env[Observation, NDArray[np.float32]], Generic[ATask]):
    """Environment of one robot that performs a task.

    Args:
        arguments: Arguments of the task's ``SETTINGS``. They replace the defaults and the values of
            :attr:`PRESET`.

    Attributes:
        TASK: Class of the task.
        PRESET: Argument values that replace the defaults of the settings.
        BENCHMARK: Rules by which policies are scored, as "module:NAME". If it is "", policies are
            scored by their return alone.
        task: Task of this robot.
        dt: Duration for which an action is held, in s.
        control_dt: Same as ``dt``.
        observed: Name, unit, limits and noise of each number of the observation.
    """

    metadata: Values = {"render_modes": RENDER_MODES, "render_fps": 50}
    TASK: ClassVar[type[Any]]
    PRESET: ClassVar[Values] = {}
    BENCHMARK: ClassVar[str] = ""

    def __init__(self, **arguments: object) -> None:
        settings = make_settings(self, type(self), arguments)
        task: ATask = self.TASK(settings)
        self.task = task
        self.render_mode = settings.render_mode
        self.observation_space: Any = task.observation_space
        self.action_space: Any = task.action_space
        self.dt = self.control_dt = task.control_dt
        self.observed = task.observed
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / self.dt))}
        self._begun = False
        self._renderers = Renderers()

    @classmethod
    def defaults(cls) -> Values:
        """Return the default values of all arguments, by name."""
        return {**cls.TASK.SETTINGS.defaults(), **cls.PRESET}

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.task.world.robots[0]

    @property
    def plant(self) -> Plant:
        """The simulation backend that moves the robot."""
        return Plant(self.task.world.plant)

    @property
    def torque_limit(self) -> float:
        """Torque of the action 1, in N m."""
        return self.robot.motor.torque_limit

    @property
    def window_closed(self) -> bool:
        """Whether the window was closed, or could not be opened because there is no display."""
        return 0 in self._renderers and self._renderers[0].dismissed

    @override
    def reset(
        self, *, seed: int | None = None, options: Values | None = None
    ) -> tuple[Observation, Values]:
        """Start an episode.

        ``docs/life_of_a_step.md`` lists the functions that a reset calls. After an error, nothing
        has changed.

        Args:
            seed: Seed of the random number generator. None to continue with the present generator.
            options: Options by name. The section Starting State of each environment lists them.

        Returns:
            The first observation and the information.

        Raises:
            ValueError: If an option is unknown or its value is out of range.
            FloatingPointError: If a robot of the rigid-body plant diverges at its initial position.
        """
        options = reset_options(options)
        task = self.task
        with task.lock:
            before = self._np_random, self._np_random_seed
            super().reset(seed=seed)
            try:
                task.reset(ROBOT, [self.np_random], [options])
            except Exception:
                self._np_random, self._np_random_seed = before
                raise
            self._begun = True
            started = task.observation[0].copy(), task.information.single(0)
        if self.render_mode == "human":
            self.render()
        return started

    @override
    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, Values]:
        """Hold an action for ``control_dt`` seconds.

        ``docs/life_of_a_step.md`` lists the functions that a step calls. The kernel
        :func:`jansen_env.engine.episode.control_step` does most of the work. With the environment
        variable ``JANSEN_ENV_PYTHON=1`` it runs as plain Python, so that you can use a debugger.

        Args:
            action: Torque as a fraction of the torque limit, shape (1,).

        Returns:
            The observation, the reward, whether the episode is terminated, whether it is truncated,
                and the information.

        Raises:
            ValueError: If the action is not one finite number.
            gymnasium.error.ResetNeeded: If :meth:`reset` has not been called yet.
        """
        task = self.task
        with task.lock:
            self._check_begun()
            task.step(single_action(action), None)
            reward = task.rewards.item(0)
            over = task.ended.item(0), task.truncated.item(0)
            observation = task.observation[0].copy()
            info = task.information.single(0)
        if self.render_mode == "human":
            self.render()
        return observation, reward, *over, info

    def _check_begun(self) -> None:
        if not self._begun:
            raise gym.error.ResetNeeded("reset() must be called first")

    def set_parameters(self, **changes: object) -> None:
        """Change parameters of the robot from now on.

        See :meth:`jansen_env.tasks.task.Task.set_parameters`.

        Args:
            changes: New values, by name.
        """
        self.task.set_parameters(0, **changes)

    @exclusive
    def push(self, impulse: object) -> None:
        """Push the robot from now on.

        See :meth:`jansen_env.world.world.World.push`.

        Args:
            impulse: Impulse in x and y, in N s.

        Raises:
            gymnasium.error.ResetNeeded: If :meth:`reset` has not been called yet.
        """
        self._check_begun()
        self.task.push(0, impulse)

    @exclusive
    def get_state(self) -> Values:
        """Return the state of the robot and of its random generator.

        The state does not contain the arguments of the environment. After :meth:`set_state` with
        this state, an environment with the same arguments continues bit for bit as before. With
        ``plant="rigid_body"`` it continues only approximately, because that plant closes the gaps
        of the joints and restarts its solver. Pins and gears with play start from the middle of
        their play.
        """
        return {**self.task.get_state(0), "generator": self.np_random.bit_generator.state}

    @exclusive
    def set_state(self, state: Values) -> Observation:
        """Restore a state saved by :meth:`get_state`, and return its observation.

        A time limit outside the environment (the wrapper ``TimeLimit``) keeps its own count of
        steps.

        Args:
            state: The complete state.

        Raises:
            ValueError: If an entry is missing or out of range.
        """
        complete_state(state, self.get_state())
        self.task.set_state(0, state)
        self.np_random.bit_generator.state = state["generator"]
        self._begun = True
        return self.task.observation[0].copy()

    def get_keys_to_action(self) -> dict[tuple[int, ...], NDArray[np.float32]]:
        """Return the keys of :func:`gymnasium.utils.play.play`: the arrow keys turn the crank."""
        torques = {(RIGHT,): 1.0, (LEFT,): -1.0, (RIGHT, LEFT): 0.0}
        return {keys: np.full(1, torque, np.float32) for keys, torque in torques.items()}

    @override
    def render(self) -> NDArray[np.uint8] | None:
        """Draw the robot in its present state.

        Returns:
            The picture, uint8, shape (H, W, 3), in the mode ``rgb_array``; otherwise None.
        """
        return self._renderers.draw(self, 0)

    @override
    def close(self) -> None:
        """Close the window, if there is one."""
        self._renderers.close()
