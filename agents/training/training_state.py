"""Models saved with the state of training besides their parameters, to resume exactly from.

The state is each robot's state and generator, the observations the next rollout begins with, a
recurrent policy's memory, the global generators, the exploration noise where rollouts keep it, and
the replay buffer. Taken when a rollout begins, it leaves nothing out. All of it is numbers, read
without running code.
"""

import io
import json
import zipfile
from collections import deque
from pathlib import Path

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.distributions import StateDependentNoiseDistribution
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, unwrap_vec_wrapper

from jansen_env.checks import named_errors, whole_number
from jansen_env.files import open_regular, write_bytes, write_whole
from jansen_env.sb3 import BatchVecEnv
from jansen_env.sb3.run_config import Arguments
from jansen_env.sb3.trained import NOTES, SavedModel

MATRICES = ("exploration_mat", "exploration_matrices")  # of state-dependent exploration
ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def save_model(model: BaseAlgorithm, path: Path, notes: Arguments) -> None:
    """Save as Stable-Baselines3 does, with ``notes`` as JSON in the same file; atomic."""
    buffer = io.BytesIO()
    model.save(buffer)
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr(NOTES, json.dumps(notes))
    write_bytes(path, buffer.getvalue())


def restore(model: BaseAlgorithm, saved: SavedModel) -> None:
    """Set all parameters of a model, its optimisers' too; a ValueError where they do not fit."""
    with named_errors("the saved model does not fit its configuration", Exception):
        model.set_parameters(saved.parameters, exact_match=True)
        for name in model._get_torch_save_params()[1]:  # such as SAC's entropy coefficient
            variable = getattr(model, name)
            variable.data.copy_(saved.variables[name].reshape(variable.shape))
        model.num_timesteps = saved.steps
        if hasattr(model, "weights"):  # ARS, which loads them into its policy
            model.weights = torch.nn.utils.parameters_to_vector(model.policy.parameters()).detach()


def read_state(model: BaseAlgorithm) -> Arguments:
    """Return the state of a model whose next rollout begins now, in types that JSON knows.

    Environments that are simulated one by one have no state in it.
    """
    venv, monitor = _envs(model)
    states = venv.get_states() if isinstance(venv, BatchVecEnv) else []
    return {
        "updates": model._n_updates, "episodes": model._episode_num,
        "observations": plain(model._last_obs), "starts": plain(model._last_episode_starts),
        "returns": plain(monitor.episode_returns) if monitor else [],
        "lengths": plain(monitor.episode_lengths) if monitor else [],
        "robots": [plain(state) for state in states], "generators": _read_generators(model),
        "memory": [part.tolist() for part in _memory(model)],
    }  # fmt: skip


def restore_state(model: BaseAlgorithm, state: Arguments) -> None:
    """Let a model go on from a state of :func:`read_state`; a ValueError where it does not fit.

    Stable-Baselines3 draws exploration noise between here and the next rollout's beginning, where
    :func:`restore_generators` is due once more.
    """
    venv, monitor = _envs(model)
    n = venv.num_envs
    with named_errors("the training state does not fit", Exception):  # of whatever kind
        model._n_updates, model._episode_num = int(state["updates"]), int(state["episodes"])
        if isinstance(venv, BatchVecEnv) and monitor:
            observations = np.array(state["observations"], np.float32)
            model._last_obs = observations.reshape((n, *venv.env.single_observation_space.shape))
            model._last_episode_starts = np.array(state["starts"], bool).reshape(n)
            monitor.episode_returns = np.array(state["returns"], np.float32).reshape(n)
            monitor.episode_lengths = np.array(state["lengths"], np.int32).reshape(n)
            if len(states := state["robots"]) != n:
                raise ValueError(f"there are states of {len(states)} robots, must be of {n}")
            venv.set_states(states)
            for part, values in zip(_memory(model), state.get("memory", []), strict=True):
                part.copy_(torch.tensor(values))
        else:
            print("environments simulated one by one begin new episodes: the run goes on nearly, "
                  "but not exactly, as it would have")  # fmt: skip
        restore_generators(model, state)
    model.ep_info_buffer = deque(maxlen=model._stats_window_size)
    model.ep_success_buffer = deque(maxlen=model._stats_window_size)


def _envs(model: BaseAlgorithm) -> tuple[VecEnv, VecMonitor | None]:
    """Return a model's environments and the monitor of a batch; None for single environments."""
    venv = model.get_env()
    assert venv is not None
    monitor = unwrap_vec_wrapper(venv, VecMonitor)
    assert monitor is None or isinstance(monitor, VecMonitor)
    return venv.unwrapped, monitor


def _memory(model: BaseAlgorithm) -> list[torch.Tensor]:
    """Return what a recurrent policy and its critic remember; nothing of another policy."""
    return [part for pair in getattr(model, "_last_lstm_states", ()) for part in pair]


def plain(value: object) -> object:
    """Return a value in types that JSON knows, no digit lost."""
    if isinstance(value, dict):
        return {name: plain(entry) for name, entry in value.items()}
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def _read_generators(model: BaseAlgorithm) -> Arguments:
    """Return the generators of torch, NumPy and the action space, and the noise that is kept."""
    noise = _kept_noise(model)
    return {
        "torch": torch.get_rng_state().tolist(),
        "numpy": plain(np.random.get_state(legacy=False)),  # noqa: NPY002
        "actions": plain(model.action_space.np_random.bit_generator.state),
        "noise": {name: getattr(noise, name).tolist() for name in MATRICES} if noise else {},
    }


def restore_generators(model: BaseAlgorithm, state: Arguments) -> None:
    """Set what rollouts and updates draw from next, but for the robots."""
    saved = state["generators"]
    twister = saved["numpy"]["state"]
    words, place = np.array(twister["key"], np.uint32), whole_number("pos", twister["pos"], 624)
    np.random.set_state({**saved["numpy"], "state": {"key": words, "pos": place}})  # noqa: NPY002
    torch.set_rng_state(torch.tensor(saved["torch"], dtype=torch.uint8))
    model.action_space.np_random.bit_generator.state = saved["actions"]
    if (noise := _kept_noise(model)) is not None:
        for name in MATRICES:
            setattr(noise, name, torch.tensor(saved["noise"][name], device=model.device))


def _kept_noise(model: BaseAlgorithm) -> StateDependentNoiseDistribution | None:
    """Return the distribution whose noise lasts for a whole rollout; None without one."""
    noise = getattr(getattr(model, "actor", model.policy), "action_dist", None)
    if isinstance(noise, StateDependentNoiseDistribution) and model.sde_sample_freq <= 0:
        return noise
    return None


def save_replay_buffer(buffer: ReplayBuffer, path: Path) -> None:
    """Write what the buffer holds as .npz, atomically."""
    arrays = {name: getattr(buffer, name)[: _used(buffer)] for name in ARRAYS}
    write_whole(path, lambda part: np.savez(part, pos=buffer.pos, full=buffer.full, **arrays))


def load_replay_buffer(buffer: ReplayBuffer, path: Path) -> None:
    """Fill a new buffer with what :func:`save_replay_buffer` has written. Raises ValueError: not
    such a file, or one of a buffer of another size or other environments."""
    valid = named_errors(f"{path} is no replay buffer", Exception)  # NumPy raises nearly every kind
    with valid, open_regular(path) as file, np.load(file, allow_pickle=False) as archive:
        size = sum(member.file_size for member in archive.zip.infolist())
        most = sum(getattr(buffer, name).nbytes for name in ARRAYS) + 10_000  # for headers
        if size > most:
            raise ValueError(f"it unpacks to {size} bytes, must be {most} at most")
        buffer.pos = whole_number("pos", archive["pos"].item(), buffer.buffer_size - 1)
        buffer.full = bool(archive["full"])
        for name in ARRAYS:
            getattr(buffer, name)[: _used(buffer)] = archive[name]


def _used(buffer: ReplayBuffer) -> int:
    """Return how many steps a file has; one past ``pos`` where a buffer that saves memory has the
    last next observation."""
    return int(buffer.buffer_size) if buffer.full else buffer.pos + 1
