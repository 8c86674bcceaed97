"""Save a model together with the state of its training, so that training can resume exactly.

The state consists of the state and the random number generator of each robot, the observations with
which the next rollout begins, the memory of a recurrent policy, the global random number
generators, the exploration noise if it lasts for a whole rollout, and the replay buffer. The replay
buffer is a separate file; the rest is stored in the file of the model. At the beginning of a
rollout, this state is complete. It contains only numbers, and reading it does not execute any code.
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

MATRICES = ("exploration_mat", "exploration_matrices")  # noise of state-dependent exploration
ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def save_model(model: BaseAlgorithm, path: Path, notes: Arguments) -> None:
    """Save a model atomically in the format of Stable-Baselines3, with notes in the same file.

    Args:
        model: Model to save.
        path: File to write.
        notes: Values that are stored as JSON.
    """
    buffer = io.BytesIO()
    model.save(buffer)
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr(NOTES, json.dumps(notes))
    write_bytes(path, buffer.getvalue())


def restore(model: BaseAlgorithm, saved: SavedModel) -> None:
    """Restore all parameters of a model, including those of its optimisers.

    Args:
        model: Model to change.
        saved: Contents of a saved model.

    Raises:
        ValueError: If the saved parameters do not fit the model.
    """
    with named_errors("the saved model does not fit its configuration", Exception):
        model.set_parameters(saved.parameters, exact_match=True)
        for name in model._get_torch_save_params()[1]:  # for example the entropy coefficient of SAC
            variable = getattr(model, name)
            variable.data.copy_(saved.variables[name].reshape(variable.shape))
        model.num_timesteps = saved.steps
        if hasattr(model, "weights"):  # ARS, which copies these weights into its policy
            model.weights = torch.nn.utils.parameters_to_vector(model.policy.parameters()).detach()


def collect_state(model: BaseAlgorithm) -> Arguments:
    """Return the state of the training, in types that JSON supports.

    Call this function at the beginning of a rollout. The state of environments that are simulated
    one by one is not included.

    Args:
        model: Model whose next rollout is about to begin.
    """
    venv, monitor = _envs(model)
    states = venv.get_states() if isinstance(venv, BatchVecEnv) else []
    return {
        "updates": model._n_updates,
        "episodes": model._episode_num,
        "observations": plain(model._last_obs),
        "starts": plain(model._last_episode_starts),
        "returns": plain(monitor.episode_returns) if monitor else [],
        "lengths": plain(monitor.episode_lengths) if monitor else [],
        "robots": [plain(state) for state in states],
        "generators": _collect_generators(model),
        "memory": [part.tolist() for part in _memory(model)],
    }


def restore_state(model: BaseAlgorithm, state: Arguments) -> None:
    """Restore the state of the training that :func:`collect_state` returned.

    Before the next rollout begins, Stable-Baselines3 samples exploration noise. Therefore call
    :func:`restore_generators` again at the beginning of the rollout.

    Args:
        model: Model to change.
        state: State to restore.

    Raises:
        ValueError: If the state does not fit the model.
    """
    venv, monitor = _envs(model)
    n = venv.num_envs
    with named_errors("the training state does not fit", Exception):  # any type of error
        model._n_updates = int(state["updates"])
        model._episode_num = int(state["episodes"])
        if isinstance(venv, BatchVecEnv) and monitor:
            observations = np.array(state["observations"], np.float32)
            model._last_obs = observations.reshape((n, *venv.env.single_observation_space.shape))
            model._last_episode_starts = np.array(state["starts"], bool).reshape(n)
            monitor.episode_returns = np.array(state["returns"], np.float32).reshape(n)
            monitor.episode_lengths = np.array(state["lengths"], np.int32).reshape(n)
            if len(states := state["robots"]) != n:
                raise ValueError(f"there must be states of {n} robots, got {len(states)}")
            venv.set_states(states)
            for part, values in zip(_memory(model), state.get("memory", []), strict=True):
                part.copy_(torch.tensor(values))
        else:
            print(
                "environments that are simulated one by one begin new episodes, so the run "
                "continues almost, but not exactly, as it would have"
            )
        restore_generators(model, state)
    model.ep_info_buffer = deque(maxlen=model._stats_window_size)
    model.ep_success_buffer = deque(maxlen=model._stats_window_size)


def _envs(model: BaseAlgorithm) -> tuple[VecEnv, VecMonitor | None]:
    """Return the environments of a model, and the monitor if they are a batch, else None."""
    venv = model.get_env()
    assert venv is not None
    monitor = unwrap_vec_wrapper(venv, VecMonitor)
    assert monitor is None or isinstance(monitor, VecMonitor)
    return venv.unwrapped, monitor


def _memory(model: BaseAlgorithm) -> list[torch.Tensor]:
    """Return the memory of a recurrent policy and its critic; empty for other policies."""
    return [part for pair in getattr(model, "_last_lstm_states", ()) for part in pair]


def plain(value: object) -> object:
    """Convert a value to types that JSON supports, without loss of precision.

    Args:
        value: Value to convert.
    """
    if isinstance(value, dict):
        return {name: plain(entry) for name, entry in value.items()}
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def _collect_generators(model: BaseAlgorithm) -> Arguments:
    """Return the state of all random number generators and of exploration noise that lasts."""
    noise = _lasting_noise(model)
    return {
        "torch": torch.get_rng_state().tolist(),
        "numpy": plain(np.random.get_state(legacy=False)),  # noqa: NPY002
        "actions": plain(model.action_space.np_random.bit_generator.state),
        "noise": {name: getattr(noise, name).tolist() for name in MATRICES} if noise else {},
    }


def restore_generators(model: BaseAlgorithm, state: Arguments) -> None:
    """Restore the random number generators of rollouts and updates, except those of the robots.

    Args:
        model: Model to change.
        state: State that :func:`collect_state` returned.
    """
    saved = state["generators"]
    twister = saved["numpy"]["state"]
    words = np.array(twister["key"], np.uint32)
    place = whole_number("pos", twister["pos"], 624)
    np.random.set_state({**saved["numpy"], "state": {"key": words, "pos": place}})  # noqa: NPY002
    torch.set_rng_state(torch.tensor(saved["torch"], dtype=torch.uint8))
    model.action_space.np_random.bit_generator.state = saved["actions"]
    if (noise := _lasting_noise(model)) is not None:
        for name in MATRICES:
            setattr(noise, name, torch.tensor(saved["noise"][name], device=model.device))


def _lasting_noise(model: BaseAlgorithm) -> StateDependentNoiseDistribution | None:
    """Return the distribution whose noise lasts for a whole rollout; None if there is none."""
    noise = getattr(getattr(model, "actor", model.policy), "action_dist", None)
    if isinstance(noise, StateDependentNoiseDistribution) and model.sde_sample_freq <= 0:
        return noise
    return None


def save_replay_buffer(buffer: ReplayBuffer, path: Path) -> None:
    """Write the contents of a replay buffer to an .npz file, atomically.

    Args:
        buffer: Buffer to save.
        path: File to write.
    """
    arrays = {name: getattr(buffer, name)[: _used(buffer)] for name in ARRAYS}
    write_whole(path, lambda part: np.savez(part, pos=buffer.pos, full=buffer.full, **arrays))


def load_replay_buffer(buffer: ReplayBuffer, path: Path) -> None:
    """Fill a new replay buffer from a file that :func:`save_replay_buffer` has written.

    Args:
        buffer: Buffer to fill.
        path: File to read.

    Raises:
        ValueError: If the file is not a replay buffer, or if the buffer in it has another size or
            belongs to other environments.
    """
    # NumPy raises errors of nearly every type.
    valid = named_errors(f"{path} is not a replay buffer", Exception)
    with valid, open_regular(path) as file, np.load(file, allow_pickle=False) as archive:
        size = sum(member.file_size for member in archive.zip.infolist())
        most = sum(getattr(buffer, name).nbytes for name in ARRAYS) + 10_000  # including headers
        if size > most:
            raise ValueError(f"it must unpack to at most {most} bytes, got {size}")
        buffer.pos = whole_number("pos", archive["pos"].item(), buffer.buffer_size - 1)
        buffer.full = bool(archive["full"])
        for name in ARRAYS:
            getattr(buffer, name)[: _used(buffer)] = archive[name]


def _used(buffer: ReplayBuffer) -> int:
    """Return the number of steps to save.

    If the buffer is not full, this is one more than ``pos``, because a memory-efficient buffer
    stores the last next observation there.
    """
    return int(buffer.buffer_size) if buffer.full else buffer.pos + 1
