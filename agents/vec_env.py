"""Stable-Baselines3's ``VecEnv`` over robots that move together."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices

from agents.rollout import make_env
from jansen_env.envs import arguments
from jansen_env.envs.walker_vector import JansenWalkerVectorEnv, Moved
from jansen_env.envs.walking import FASTEST_COMMAND
from jansen_env.terrain import make_terrain

PER_ROBOT = ("friction", "max_episode_steps", "payload", "reset_noise_scale", "restitution",
             "speed_command", "terrain")  # fmt: skip
"""Arguments in which the robots of one batch may differ."""


def make_vec_env(
    env_id: str,
    num_envs: int,
    env_kwargs: dict[str, Any] | None = None,
    variants: Sequence[dict[str, Any]] = ({},),
    info_keys: Sequence[str] | None = (),
) -> VecEnv:
    """``num_envs`` environments for Stable-Baselines3, moved together where that is possible.

    Args:
        env_id: ``"JansenWalker-v0"``, or another task, of which single environments take turns.
        env_kwargs: arguments of all of them.
        variants: further ones; environment i takes number i, counted around.
        info_keys: as of :class:`BatchVecEnv`; single environments give all of their information.

    Raises:
        ValueError: an argument out of range.
    """
    if not variants:
        raise ValueError("variants is empty, must have at least one entry, such as {}")
    kwargs = dict(env_kwargs or {})
    each = [{**kwargs, **variants[i % len(variants)]} for i in range(num_envs)]
    if can_move_together(env_id, kwargs, variants):
        return BatchVecEnv(_together(num_envs, kwargs, each), info_keys)

    def make(index: int) -> Any:
        return lambda: make_env(env_id, each[index])

    return DummyVecEnv([make(i) for i in range(num_envs)])


def can_move_together(
    env_id: str, env_kwargs: dict[str, Any], variants: Sequence[dict[str, Any]] = ({},)
) -> bool:
    """Whether one batch can hold environments with these arguments."""
    return (
        env_id == "JansenWalker-v0"
        and env_kwargs.get("plant", "projection") == "projection"
        and not env_kwargs.get("track_joint_forces", False)
        and env_kwargs.get("render_mode") in (None, "rgb_array")
        and all(set(variant) <= set(PER_ROBOT) for variant in variants)
    )


def _together(
    count: int, kwargs: dict[str, Any], each: Sequence[dict[str, Any]]
) -> JansenWalkerVectorEnv:
    """One batch with the arguments of each environment."""
    shared = {name: value for name, value in kwargs.items() if name not in PER_ROBOT}
    own: dict[str, Any] = {}
    for name in PER_ROBOT:
        if not any(name in one for one in each):
            continue
        values = [one.get(name, _default(name)) for one in each]
        if name == "terrain":  # which may be points, in YAML a list
            made = {id(value): make_terrain(value) for value in values}
            values = [made[id(value)] for value in values]
        elif name == "speed_command":  # numbers and ranges, as ranges
            values = [arguments.command_range(value, FASTEST_COMMAND) for value in values]
        own[name] = values
    env: Any = gym.make_vec(
        "JansenWalker-v0", num_envs=count, autoreset_mode=AutoresetMode.DISABLED, **shared, **own
    )
    batched: JansenWalkerVectorEnv = env.unwrapped
    return batched


def _default(name: str) -> Any:
    """What an argument is where a variant leaves it out."""
    return inspect.signature(JansenWalkerVectorEnv).parameters[name].default


class BatchVecEnv(VecEnv):
    """Robots that move together, as Stable-Baselines3 wants its environments.

    An episode that ends is followed by the next one's first observation in the same step; its
    information has the last one, a copy, as ``terminal_observation``, and
    ``TimeLimit.truncated``. ``env_method``, ``get_attr`` and ``set_attr`` speak to
    :class:`jansen_env.envs.walker_member.Member`.

    Args:
        env: the robots.
        info_keys: what each step's information has of the single environment's, such as
            ``"slip"``; None for all. Dictionaries for every robot and step cost more than the
            steps do; the last step of an episode always has all, and alone
            ``TimeLimit.truncated``.
    """

    def __init__(self, env: JansenWalkerVectorEnv, info_keys: Sequence[str] | None = ()) -> None:
        self.env = env
        self.info_keys = info_keys
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        nothing, every = np.zeros(env.num_envs), np.ones(env.num_envs, bool)
        known = sorted(key for key in env.infos(nothing, nothing, stepped=every) if key[0] != "_")
        unknown = sorted(set(info_keys or ()) - set(known))
        if unknown:
            raise ValueError(f"info_keys has {unknown}, must be of {known}")
        self._actions: NDArray[np.float32] = np.zeros((env.num_envs, 1), np.float32)

    def reset(self) -> NDArray[np.float32]:
        """Start all episodes; returns their first observations (n, d)."""
        seeds, options = self._seeds, self._options
        self._reset_seeds()
        self._reset_options()
        observations, infos = self.env.reset_each(seeds, options)
        self.reset_infos = [_of_one(infos, i) for i in range(self.num_envs)]
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Keep the actions (n, 1) for :meth:`step_wait`."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], list[dict[str, Any]]]:
        """Take the step: observations (n, d), rewards (n,), dones (n,), and n dictionaries."""
        env = self.env
        moved = env.move(self._actions)
        dones = moved.terminated | moved.truncated
        infos = self._infos(moved)
        if dones.any():
            ended = np.flatnonzero(dones)
            final = env.infos(moved.speed, moved.torque, known=dones, stepped=dones)
            for i in ended.tolist():
                infos[i] = _of_one(final, i)
                infos[i]["terminal_observation"] = env.task.observation[i].copy()
                infos[i]["TimeLimit.truncated"] = bool(
                    moved.truncated[i] and not moved.terminated[i]
                )
            env.restart(ended)
            first = env.infos(env.batch.states[:, 4], np.zeros(self.num_envs), known=dones)
            for i in ended.tolist():
                self.reset_infos[i] = _of_one(first, i)
        return env.task.observation.copy(), moved.rewards, dones, infos

    def _infos(self, moved: Moved) -> list[dict[str, Any]]:
        """What each robot's step tells, of :attr:`info_keys`."""
        if self.info_keys is not None and not self.info_keys:
            return [{} for _ in range(self.num_envs)]
        every = np.ones(self.num_envs, bool)
        whole = self.env.infos(moved.speed, moved.torque, stepped=every)
        if self.info_keys is not None:
            whole = {name: whole[name] for key in self.info_keys for name in (key, f"_{key}")}
        return [_of_one(whole, i) for i in range(self.num_envs)]

    def close(self) -> None:
        """Let go of threads and pictures."""
        self.env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """A picture (H, W, 3) of each robot."""
        return self.env.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of each robot."""
        return [getattr(self.env.members[i], attr_name) for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of robots; a new command counts from the next episode on."""
        for i in self._get_indices(indices):
            setattr(self.env.members[i], attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method of each robot."""
        members = [self.env.members[i] for i in self._get_indices(indices)]
        return [getattr(member, method_name)(*method_args, **kwargs) for member in members]

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """False for each: robots that move together have no wrappers of their own."""
        return [False for _ in self._get_indices(indices)]


def _of_one(infos: dict[str, Any], index: int) -> dict[str, Any]:
    """One robot's part of vector information, as the single environment gives it."""
    one: dict[str, Any] = {}
    for key, value in infos.items():
        if key.startswith("_") or not infos[f"_{key}"][index]:
            continue
        if isinstance(value, dict):
            one[key] = _of_one(value, index)
        else:
            entry = value[index]
            one[key] = entry.copy() if isinstance(entry, np.ndarray) else entry.item()
    return one
