"""The baseline of ``JansenGoal-v0``: from the distance to a speed, from the speed to a torque."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.baselines.policy import Memory, columns
from jansen_env.robot.kinematics import advance_per_turn

GAIN, FASTEST, RAMP = 1.3, 0.42, 0.3  # 1/s of the distance; m/s; m/s^2: faster starts make it fall
PROPORTIONAL, INTEGRAL = 0.16, 1.2  # action per rad/s of crank speed, and per rad
MOST_INTEGRAL = 0.6  # of the action


class GoalPid:
    """PI control of the crank's speed, which is asked for in proportion to the distance.

    Args:
        env: an unwrapped ``JansenGoal-v0``, single or vector.
    """

    def __init__(self, env: Any) -> None:
        self._columns = columns(env, "goal_distance", "crank_speed")
        self._per_radian = abs(advance_per_turn(env.task.world.robots[0])) / (2.0 * math.pi)  # m
        self._dt = env.control_dt

    def predict(
        self,
        observation: Any,
        state: Memory = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Memory]:
        """Return actions (n, 1) or (1,) for observations (n, d) or (d,), and the state."""
        distance, crank_speed = np.asarray(observation, float)[..., self._columns].T
        before, integral = (np.zeros_like(distance),) * 2 if state is None else state
        if episode_start is not None:
            started = np.reshape(episode_start, np.shape(distance))
            before, integral = np.where(started, 0.0, before), np.where(started, 0.0, integral)
        wanted = np.clip(GAIN * distance, -FASTEST, FASTEST)
        speed = before + np.clip(wanted - before, -RAMP * self._dt, RAMP * self._dt)
        error = speed / self._per_radian - crank_speed
        integral = np.clip(integral + INTEGRAL * self._dt * error, -MOST_INTEGRAL, MOST_INTEGRAL)
        action = np.clip(PROPORTIONAL * error + integral, -1.0, 1.0)
        return action[..., None].astype(np.float32), (speed, integral)
