"""``JansenGoal-v0`` with the goal-conditioned observations of Gymnasium-Robotics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias, cast

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from jansen_env.arrays import Array
from jansen_env.checks import invalid
from jansen_env.tasks.goal.goal_env import FARTHEST, GoalTask, JansenGoalEnv, arrived, closeness
from jansen_env.world.settings import Values

GoalObservation: TypeAlias = dict[str, NDArray[Any]]
"""Observation of :class:`GoalConditioned`, by name."""


class GoalConditioned(
    gym.ObservationWrapper[GoalObservation, NDArray[np.float32], NDArray[Any]],
    gym.utils.RecordConstructorArgs,
):
    """Wrapper that separates the goal of ``JansenGoal-v0`` from the rest of the observation.

    Hindsight experience replay learns from goals that an episode reached by chance. It needs the
    reward that a step would have for any goal; :meth:`compute_reward` returns this reward. The
    interface is that of ``GoalEnv`` in Gymnasium-Robotics
    (https://robotics.farama.org/content/multi-goal_api/), which the ``HerReplayBuffer`` of
    Stable-Baselines3 uses, too. Pass ``copy_info_dict=True`` to this buffer, because the reward
    needs the motor power of the step.

    Observations are dictionaries:

    - ``observation``: observation of ``JansenGoal-v0`` without the distance to the goal, float32;
    - ``achieved_goal``: position of the crank axis, in m, float64, shape (1,);
    - ``desired_goal``: position of the goal, in m, float64, shape (1,).

    Actions, rewards and the ends of episodes are those of ``JansenGoal-v0``.

    Args:
        env: ``JansenGoal-v0``, possibly in wrappers that do not change its observations.

    Raises:
        ValueError: If ``env`` is another environment.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self)
        goal_env = env.unwrapped
        if not isinstance(goal_env, JansenGoalEnv):
            raise invalid("env", env, "JansenGoal-v0")
        if env.observation_space != goal_env.observation_space:
            raise invalid("env", env, "JansenGoal-v0 in wrappers that keep its observations")
        super().__init__(env)
        names = [observed.name for observed in goal_env.observed]
        distance = names.index("goal_distance")
        space = cast("gym.spaces.Box", env.observation_space)
        self._others = np.delete(np.arange(len(space.low)), distance)
        position = gym.spaces.Box(-np.inf, np.inf, (1,), np.float64)
        spaces = gym.spaces.Dict(
            {
                "observation": gym.spaces.Box(space.low[self._others], space.high[self._others]),
                "achieved_goal": position,
                "desired_goal": gym.spaces.Box(-FARTHEST, FARTHEST, (1,), np.float64),
            }
        )
        self.observation_space = cast("gym.Space[GoalObservation]", spaces)

    @property
    def _task(self) -> GoalTask:
        """Task of the environment. It is looked up anew, because a copy has a task of its own."""
        return cast("JansenGoalEnv", self.unwrapped).task

    def compute_reward(
        self,
        achieved_goal: Array,
        desired_goal: Array,
        info: Mapping[str, Any] | Sequence[Mapping[str, Any]],
    ) -> Any:
        """Return the reward that a step would have with another goal.

        Args:
            achieved_goal: Positions after the steps, in m, shape (1,) or (n, 1).
            desired_goal: Goals, in m, shape (1,) or (n, 1).
            info: Information of the step, or of the n steps.

        Returns:
            The reward, or the rewards, shape (n,).

        Raises:
            ValueError: If the information lacks the energy factor of the reward.
        """
        distance = np.abs(np.asarray(desired_goal) - achieved_goal)[..., 0]
        infos = [info] if isinstance(info, Mapping) else info
        if any("reward/energy" not in step for step in infos):
            raise ValueError(
                "info must contain 'reward/energy', got none; HerReplayBuffer needs "
                "copy_info_dict=True"
            )
        near = closeness(distance) + arrived(distance, self._task.arrival_weight)
        reward = near * np.array([step["reward/energy"] for step in infos])
        return float(reward[0]) if isinstance(info, Mapping) else reward

    def compute_terminated(self, achieved_goal: Array, desired_goal: Array, info: Values) -> bool:
        """Return whether the robot has fallen. The goal has no influence on it.

        Args:
            achieved_goal: Not used.
            desired_goal: Not used.
            info: Information of the step.
        """
        return bool(info["fallen"])

    def compute_truncated(
        self, achieved_goal: Array, desired_goal: Array, info: Mapping[str, Any]
    ) -> bool:
        """Return whether the simulation has diverged. A time limit also truncates episodes.

        Args:
            achieved_goal: Not used.
            desired_goal: Not used.
            info: Information of the step.
        """
        return bool(info["diverged"])

    @override
    def observation(self, observation: NDArray[Any]) -> GoalObservation:
        """Return the observation of the wrapper.

        Args:
            observation: Observation of ``JansenGoal-v0``.
        """
        return {
            "observation": observation[self._others],
            "achieved_goal": self._task.world.x_position[:1].copy(),
            "desired_goal": self._task.info["goal"][:1].copy(),
        }
