"""What a walking policy's actions may mean beside raw torque; for one robot and for many at once.

A map turns a policy's actions into the environment's, and reads nothing but the observation the
policy has seen. Wrapped around an environment it is for whoever trains
(:class:`MappedAction`, :class:`MappedVectorAction`, :class:`agents.vec_env.MappedVecEnv`); wrapped
around the policy (:class:`MappedPolicy`) it makes one that acts on the environment as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorWrapper
from numpy.typing import NDArray

from agents.policy import Policy
from agents.profile import load_profile
from agents.walker_observation import COMMAND, COS_CRANK, CRANK_SPEED, SIN_CRANK, place
from jansen_env.kinematics import advance_per_turn
from jansen_env.policy_network import CrankSpeedAction, ResidualAction, TorqueMap

ActionMap: TypeAlias = TorqueMap
"""Observations (n, d) and a policy's actions (n, 1) in [-1, 1] to the environment's (n, 1)."""

SPEED_RANGE = 4.0  # by how much an action of 1 hurries the crank; -1 slows it down as much
GAIN = 6.0  # N m s/rad, of the loop that makes the crank turn so
SHARE = 0.2  # of the torque limit, what an action of 1 adds to the profile's torque


def crank_speed(env: Any) -> CrankSpeedAction:
    """Actions as target crank speeds: n_target = n_command 4^action, torque = gain (n_target - n).

    n_command is the crank speed at which the robot would walk as commanded, were there no slip
    (:func:`jansen_env.kinematics.advance_per_turn`); the loop is closed once a step.

    Args:
        env: the unwrapped environment, of one robot or many alike.
    """
    per_metre = 2.0 * math.pi / abs(advance_per_turn(env.task.robots[0]))
    return CrankSpeedAction(COMMAND, CRANK_SPEED, per_metre, SPEED_RANGE, GAIN, env.torque_limit)


def residual(env: Any) -> ResidualAction:
    """Actions as what is added to the baseline ``profile``'s: at most a fifth of the torque limit.

    Args:
        env: the unwrapped environment, of one robot or many alike.
    """
    places = (COS_CRANK, SIN_CRANK, CRANK_SPEED, COMMAND, place(env, "lag"))
    return ResidualAction(places, load_profile(), SHARE, env.torque_limit)


ACTION_MAPS: dict[str, Callable[[Any], ActionMap]] = {
    "crank_speed": crank_speed, "residual": residual,
}  # fmt: skip
"""Beside "torque", which needs none. Each is made for an unwrapped JansenWalker-v0."""


def make_map(name: str, env: Any) -> ActionMap:
    """One of :data:`ACTION_MAPS`.

    Raises:
        ValueError: no map has this name.
    """
    if name not in ACTION_MAPS:
        raise ValueError(f"action is {name!r}, must be one of {sorted(ACTION_MAPS)}")
    return ACTION_MAPS[name](env.unwrapped)


class MappedAction(gym.Wrapper[Any, Any, Any, Any]):
    """A JansenWalker-v0 whose actions are a map's.

    Args:
        env: the environment. name: of the map, in :data:`ACTION_MAPS`.

    Raises:
        ValueError: no map has this name.
    """

    def __init__(self, env: gym.Env[Any, Any], name: str) -> None:
        super().__init__(env)
        self._map = make_map(name, env)

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:
        """As the environment's."""
        self._seen, info = self.env.reset(**arguments)
        return self._seen, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """As the environment's, with the mapped action."""
        mapped = self._map(self._seen[None], np.reshape(action, (1, 1)))[0]
        self._seen, *rest = self.env.step(mapped)
        return (self._seen, *rest)


class MappedVectorAction(VectorWrapper[Any, Any, Any, Any, Any]):
    """A vector environment of JansenWalker-v0 whose actions are a map's.

    Args:
        env: of robots that are alike in what the map goes by, linkage and torque limit.
        name: of the map, in :data:`ACTION_MAPS`.

    Raises:
        ValueError: no map has this name.
    """

    def __init__(self, env: Any, name: str) -> None:
        super().__init__(env)
        self._map = make_map(name, env)

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:
        """As the environment's."""
        self._seen, info = self.env.reset(**arguments)
        return self._seen, info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """As the environment's, with the mapped actions."""
        self._seen, *rest = self.env.step(self._map(self._seen, np.asarray(actions)))
        return (self._seen, *rest)


class MappedPolicy:
    """A policy whose actions a map turns into the environment's own.

    Args:
        policy: of observations (n, d) or (d,). action_map: what its actions mean.

    Attributes:
        policy, action_map: as given; the policy's other attributes are this one's, too.
    """

    def __init__(self, policy: Policy, action_map: ActionMap) -> None:
        self.policy, self.action_map = policy, action_map

    def __getattr__(self, name: str) -> Any:
        return getattr(self.policy, name)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (n, 1) or (1,) on the environment, and the state to pass back."""
        action, state = self.policy.predict(observation, state, episode_start, deterministic)
        mapped = self.action_map(np.atleast_2d(observation), np.reshape(action, (-1, 1)))
        return (mapped if np.ndim(observation) > 1 else mapped[0]), state
