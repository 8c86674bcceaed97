"""Replay buffers of off-policy algorithms as files: plain arrays, read without running code."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
from stable_baselines3.common.buffers import ReplayBuffer

from jansen_env.files import write_whole

HEADERS = 4096  # bytes, more than the headers of all arrays take
ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def save_replay_buffer(buffer: ReplayBuffer, path: Path) -> None:
    """Write what the buffer holds as .npz, atomically."""
    used = _used(buffer, buffer.pos, buffer.full)
    arrays = {name: getattr(buffer, name)[:used] for name in ARRAYS}
    write_whole(path, lambda part: np.savez(part, pos=buffer.pos, full=buffer.full, **arrays))


def load_replay_buffer(buffer: ReplayBuffer, path: Path) -> None:
    """Fill a fresh buffer with what :func:`save_replay_buffer` has written.

    Raises:
        ValueError: not such a file, or one of a buffer of another size or other environments.
    """
    unpacked = check_replay_file(path)
    try:
        largest = HEADERS + sum(getattr(buffer, name).nbytes for name in ARRAYS)
        if unpacked > largest:
            raise ValueError(f"it has {unpacked} bytes, must have {largest} at most")
        with np.load(path, allow_pickle=False) as file:
            pos, full = int(file["pos"]), bool(file["full"])
            arrays = {name: file[name] for name in ARRAYS}
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is no replay buffer: {error}") from error
    if not 0 <= pos < buffer.buffer_size:
        raise ValueError(f"{path} has pos {pos}, must be in [0, {buffer.buffer_size})")
    used = _used(buffer, pos, full)
    for name, array in arrays.items():
        own = getattr(buffer, name)
        if array.shape != (used, *own.shape[1:]) or array.dtype != own.dtype:
            raise ValueError(
                f"{path} has {name} of shape {array.shape} and type {array.dtype}, must be "
                f"{(used, *own.shape[1:])} and {own.dtype}"
            )
    for name, array in arrays.items():
        getattr(buffer, name)[:used] = array
    buffer.pos, buffer.full = pos, full


def check_replay_file(path: Path) -> int:
    """Check that a file is whole: nothing packed, nothing missing. Returns its arrays' bytes.

    Raises:
        ValueError: it is not.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if any(member.compress_type != zipfile.ZIP_STORED for member in members):
                raise ValueError("it is packed, must be stored")
            if (damaged := archive.testzip()) is not None:
                raise ValueError(f"{damaged} in it is damaged")
    except (
        OSError,
        EOFError,
        NotImplementedError,
        RuntimeError,
        ValueError,
        zipfile.BadZipFile,
    ) as error:
        raise ValueError(f"{path} is no replay buffer: {error}") from error
    return sum(member.file_size for member in members)


def _used(buffer: ReplayBuffer, pos: int, full: bool) -> int:
    """Rows in a file; one past ``pos``, where a buffer that saves memory has the last next
    observation."""
    return int(buffer.buffer_size) if full else pos + 1
