"""Replay buffers of off-policy algorithms as files: plain arrays, read without running code."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.buffers import ReplayBuffer

from jansen_env.checks import shown
from jansen_env.files import open_regular, write_whole

ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
MEMBERS = sorted((*ARRAYS, "pos", "full"))


def save_replay_buffer(buffer: ReplayBuffer, path: Path) -> None:
    """Write what the buffer holds as .npz, atomically."""
    used = _used(buffer, buffer.pos, buffer.full)
    arrays = {name: getattr(buffer, name)[:used] for name in ARRAYS}
    place = {"pos": np.int64(buffer.pos), "full": np.bool_(buffer.full)}
    write_whole(path, lambda part: np.savez(part, **place, **arrays))


def load_replay_buffer(buffer: ReplayBuffer, path: Path) -> None:
    """Fill a new buffer with what :func:`save_replay_buffer` has written.

    Raises:
        ValueError: not such a file, or one of a buffer of another size or other environments.
    """
    with _opened(path) as archive:
        pos, full = int(archive["pos"]), bool(archive["full"])
        if not 0 <= pos < buffer.buffer_size:
            raise ValueError(f"pos is {pos}, must be in [0, {buffer.buffer_size})")
        used, arrays = _used(buffer, pos, full), {}
        for name in ARRAYS:
            own, array = getattr(buffer, name), archive[name]
            shape = (used, *own.shape[1:])
            if array.shape != shape or array.dtype != own.dtype:
                raise ValueError(f"{name} has shape {shown(array.shape)} and type {array.dtype}, "
                                 f"must have {shape} and {own.dtype}")  # fmt: skip
            if not np.isfinite(array).all():
                raise ValueError(f"{name} has numbers that are not finite")
            arrays[name] = array
    for name, array in arrays.items():
        getattr(buffer, name)[:used] = array
    buffer.pos, buffer.full = pos, full


def check_replay_file(path: Path) -> None:
    """Check that a file is whole, nothing packed, nothing missing; else raise a ValueError."""
    with _opened(path):
        pass


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a whole file; anything wrong in it or in reading it is one ValueError that names it."""
    try:
        with open_regular(path) as file, np.load(file, allow_pickle=False) as archive:
            if sorted(archive.files) != MEMBERS:
                raise ValueError(
                    f"it has {len(archive.files)} arrays, must have {len(MEMBERS)}: {MEMBERS}"
                )
            if packed := [i.filename for i in archive.zip.infolist() if i.compress_type]:
                raise ValueError(f"{packed[0]} is packed, must be stored")
            if (damaged := archive.zip.testzip()) is not None:
                raise ValueError(f"{damaged} is damaged")
            yield archive
    except Exception as error:  # of a damaged file zipfile and NumPy raise nearly every kind
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path} is no replay buffer: {reason}") from error


def _used(buffer: ReplayBuffer, pos: int, full: bool) -> int:
    """Return the rows in a file; one past ``pos`` where a buffer that saves memory has the last
    next observation."""
    return int(buffer.buffer_size) if full else pos + 1
