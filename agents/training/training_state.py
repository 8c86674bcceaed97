"""State of training besides parameters and optimiser, as plain numbers, to go on exactly from.

That is: each robot's state and generator, the observations the next rollout begins with, the global
generators, and the exploration noise where rollouts keep it. Taken when a rollout begins, the
normaliser updated and the update before complete, it leaves nothing out.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecMonitor, unwrap_vec_wrapper

from jansen_env.checks import whole_number
from jansen_env.sb3 import BatchVecEnv

WORDS = 624  # of a Mersenne twister's state
MATRICES = ("exploration_mat", "exploration_matrices")  # of state-dependent exploration


def read_state(model: BaseAlgorithm) -> dict[str, Any]:
    """Return the state of a model whose next rollout begins now, in types that JSON knows."""
    venv: Any = model.get_env()
    monitor: Any = unwrap_vec_wrapper(venv, VecMonitor)
    return {
        "updates": int(model._n_updates), "episodes": int(model._episode_num),
        "observations": _plain(model._last_obs),
        "episode_starts": _plain(model._last_episode_starts),
        "returns": _plain(monitor.episode_returns), "lengths": _plain(monitor.episode_lengths),
        "robots": _read_robots(venv), "generators": _read_generators(model),
    }  # fmt: skip


def restore_state(model: BaseAlgorithm, state: dict[str, Any]) -> None:
    """Let a model go on from a state of :func:`read_state`; a ValueError where it does not fit.

    Stable-Baselines3 draws exploration noise between here and the next rollout's beginning:
    :class:`GeneratorsRestored` is due there.
    """
    venv: Any = model.get_env()
    monitor: Any = unwrap_vec_wrapper(venv, VecMonitor)
    n = venv.num_envs
    try:
        observations = _array(state, "observations", (n, *venv.observation_space.shape), np.float32)
        starts = _array(state, "episode_starts", (n,), bool)
        returns = _array(state, "returns", (n,), np.float32)
        lengths = _array(state, "lengths", (n,), np.int32)
        counts = [whole_number(name, state[name]) for name in ("updates", "episodes")]
        _restore_robots(venv, state["robots"])
        restore_generators(model, state)
    except Exception as error:  # of what does not fit, whatever the parts of it raise
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"the training state does not fit: {reason}") from error
    model._last_obs, model._last_episode_starts = observations, starts
    model._n_updates, model._episode_num = counts
    monitor.episode_returns, monitor.episode_lengths = returns, lengths
    model.ep_info_buffer = deque(maxlen=model._stats_window_size)
    model.ep_success_buffer = deque(maxlen=model._stats_window_size)


class GeneratorsRestored(BaseCallback):
    """Set the generators once more when the first rollout begins, see :func:`restore_state`."""

    def __init__(self, state: dict[str, Any]) -> None:
        super().__init__()
        self._state: dict[str, Any] | None = state

    def _on_rollout_start(self) -> None:
        if self._state is not None:
            restore_generators(self.model, self._state)
            self._state = None

    def _on_step(self) -> bool:
        return True


def _plain(value: Any) -> Any:
    """Return a value in types that JSON knows, no digit lost."""
    if isinstance(value, dict):
        return {name: _plain(entry) for name, entry in value.items()}
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def _array(state: dict[str, Any], name: str, shape: tuple[int, ...], dtype: Any) -> Any:
    """Return an entry as an array of finite numbers of a shape, or raise a ValueError."""
    array = np.array(state[name], dtype)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{name} has shape {array.shape}, must be {shape} finite numbers")
    return array


def _read_robots(venv: Any) -> list[dict[str, Any]]:
    """Return of each robot its state, generator included, and the steps of its episode."""
    inner = venv.unwrapped
    if isinstance(inner, BatchVecEnv):
        return [_plain(state) for state in inner.get_states()]
    elapsed = inner.get_attr("_elapsed_steps")  # of TimeLimit
    states = zip(inner.env_method("get_state"), elapsed, strict=True)
    return [{**_plain(state), "elapsed": steps} for state, steps in states]


def _restore_robots(venv: Any, states: list[dict[str, Any]]) -> None:
    """Put each robot into its state of :func:`_read_robots`."""
    if len(states) != venv.num_envs:
        raise ValueError(f"there are states of {len(states)} robots, must be of {venv.num_envs}")
    inner = venv.unwrapped
    if isinstance(inner, BatchVecEnv):
        inner.set_states(states)
        return
    for env, state in zip(inner.envs, states, strict=True):
        own = dict(state)
        elapsed = whole_number("elapsed", own.pop("elapsed"))
        env.reset()  # wrappers ask for it
        env.unwrapped.set_state(own)
        env.set_wrapper_attr("_elapsed_steps", elapsed, force=False)


def _read_generators(model: BaseAlgorithm) -> dict[str, Any]:
    """Return the generators of torch, NumPy and the action space, and the noise that is kept."""
    _, key, position, has_normal, next_normal = np.random.get_state(legacy=True)  # noqa: NPY002
    noise = _kept_noise(model)
    return {
        "torch": torch.get_rng_state().numpy().tobytes().hex(),
        "numpy": [_plain(key), int(position), int(has_normal), float(next_normal)],
        "actions": _plain(model.action_space.np_random.bit_generator.state),
        "noise": [getattr(noise, name).flatten().tolist() for name in MATRICES] if noise else None,
    }


def restore_generators(model: BaseAlgorithm, state: dict[str, Any]) -> None:
    """Set what rollouts and updates draw from next, but for the robots."""
    saved = state["generators"]
    key, position, has_normal, next_normal = saved["numpy"]
    position = whole_number("position", position, WORDS)  # NumPy does not check it
    words = _array({"numpy": key}, "numpy", (WORDS,), np.uint32)
    np.random.set_state(("MT19937", words, position, int(has_normal), float(next_normal)))  # noqa: NPY002
    torch.set_rng_state(torch.frombuffer(bytearray.fromhex(saved["torch"]), dtype=torch.uint8))
    model.action_space.np_random.bit_generator.state = saved["actions"]
    if (noise := _kept_noise(model)) is not None:
        size = noise.exploration_mat.shape
        shapes = size, (model.n_envs, *size)
        for name, values, shape in zip(MATRICES, saved["noise"], shapes, strict=True):
            matrix = _array({name: values}, name, (math.prod(shape),), np.float32)
            setattr(noise, name, torch.from_numpy(matrix).reshape(shape))


def _kept_noise(model: Any) -> Any:
    """Return the distribution whose noise lasts for a whole rollout; None without one."""
    if not model.use_sde or model.sde_sample_freq > 0:
        return None
    return (model.actor if isinstance(model, OffPolicyAlgorithm) else model.policy).action_dist
