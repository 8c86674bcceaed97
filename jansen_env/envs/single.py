"""Gymnasium's environment of one robot, of any task."""

from __future__ import annotations

from typing import Any, ClassVar, Generic, TypeVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

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

ROBOT = np.zeros(1, np.int64)
RIGHT, LEFT = 1073741903, 1073741904  # pygame's K_RIGHT and K_LEFT


class SingleEnv(WholeCopies, gym.Env[Observation, NDArray[np.float32]], Generic[ATask]):
    """One robot that does a task.

    Args:
        arguments: of the task's ``SETTINGS``, in place of their defaults and of :attr:`PRESET`.

    Attributes:
        TASK: the task's class. PRESET: values of arguments in place of the settings' defaults.
        BENCHMARK: "module:NAME" of the rules by which policies are scored; "" for the return alone.
        task: the task of this one robot. dt, control_dt: s for which an action is held.
        observed: name, unit, limits and noise of each number of the observation.
    """

    metadata: Values = {"render_modes": RENDER_MODES, "render_fps": 50}
    TASK: ClassVar[type[Any]]
    PRESET: ClassVar[Values] = {}
    BENCHMARK: ClassVar[str] = ""

    def __init__(self, **arguments: object) -> None:
        settings = make_settings(self, type(self), arguments)
        task: ATask = self.TASK(settings)
        self.task, self.render_mode = task, settings.render_mode
        self.observation_space: Any = task.observation_space
        self.action_space: Any = task.action_space
        self.dt = self.control_dt = task.control_dt
        self.observed = task.observed
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / self.dt))}
        self._begun, self._renderers = False, Renderers()

    @classmethod
    def defaults(cls) -> Values:
        """Return all arguments by name, with their defaults."""
        return {**cls.TASK.SETTINGS.defaults(), **cls.PRESET}

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.task.world.robots[0]

    @property
    def plant(self) -> Plant:
        """The plant that moves it."""
        return Plant(self.task.world.plant)

    @property
    def torque_limit(self) -> float:
        """Torque of action 1, N m."""
        return self.robot.motor.torque_limit

    @property
    def window_closed(self) -> bool:
        """Whether the window was closed, or could not be opened for want of a display."""
        return 0 in self._renderers and self._renderers[0].dismissed

    def reset(
        self, *, seed: int | None = None, options: Values | None = None
    ) -> tuple[Observation, Values]:
        """Start an episode; Starting State lists the ``options``.

        ``docs/life_of_a_step.md`` lists the functions that a reset passes through.

        Raises:
            ValueError: If an option is unknown or its value is out of range.
            FloatingPointError: If a robot of the rigid-body plant diverges where it is placed.
                Nothing has changed after an error.
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

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, Values]:
        """Hold an action for ``control_dt`` seconds.

        ``docs/life_of_a_step.md`` lists the functions that a step passes through. The kernel
        :func:`jansen_env.engine.episode.control_step` does most of it; with the environment
        variable ``JANSEN_ENV_PYTHON=1`` it runs as plain Python, for a debugger.

        Raises:
            ValueError: the action is not one finite number.
            gymnasium.error.ResetNeeded: before the first :meth:`reset`.
        """
        task = self.task
        with task.lock:
            self._check_begun()
            task.step(single_action(action), None)
            reward = task.rewards.item(0)
            over = task.ended.item(0), task.truncated.item(0)
            observation, info = task.observation[0].copy(), task.information.single(0)
        if self.render_mode == "human":
            self.render()
        return observation, reward, *over, info

    def _check_begun(self) -> None:
        if not self._begun:
            raise gym.error.ResetNeeded("reset() must be called first")

    def set_parameters(self, **changes: object) -> None:
        """Change the robot from now on, see :meth:`jansen_env.tasks.task.Task.set_parameters`."""
        self.task.set_parameters(0, **changes)

    @exclusive
    def push(self, impulse: object) -> None:
        """Push the robot from now on, see :meth:`jansen_env.world.world.World.push`.

        Raises:
            gymnasium.error.ResetNeeded: before the first :meth:`reset`.
        """
        self._check_begun()
        self.task.push(0, impulse)

    @exclusive
    def get_state(self) -> Values:
        """Return all that the future of this robot depends on; :meth:`set_state` continues bit for
        bit.

        With ``plant="rigid_body"`` only nearly: it closes gaps and restarts the solver.
        """
        return {**self.task.get_state(0), "generator": self.np_random.bit_generator.state}

    @exclusive
    def set_state(self, state: Values) -> Observation:
        """Go on from a state of :meth:`get_state`; returns its observation.

        A time limit outside the environment (``TimeLimit``) keeps its own count.

        Raises:
            ValueError: an entry is missing, or out of range.
        """
        complete_state(state, self.get_state())
        self.task.set_state(0, state)
        self.np_random.bit_generator.state = state["generator"]
        self._begun = True
        return self.task.observation[0].copy()

    def get_keys_to_action(self) -> dict[tuple[int, ...], NDArray[np.float32]]:
        """Return :func:`gymnasium.utils.play.play`'s keys: the arrow keys turn the crank."""
        torques = {(RIGHT,): 1.0, (LEFT,): -1.0, (RIGHT, LEFT): 0.0}
        return {keys: np.full(1, torque, np.float32) for keys, torque in torques.items()}

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the robot as it stands; (H, W, 3) uint8 in ``rgb_array`` mode, else None."""
        return self._renderers.draw(self, 0)

    def close(self) -> None:
        """Close the window, if there is one."""
        self._renderers.close()
