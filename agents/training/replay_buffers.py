"""Replay buffers of off-policy algorithms as files: plain arrays, read without running code."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.buffers import ReplayBuffer

from jansen_env.checks import shown
from jansen_env.files import open_regular, write_whole

ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
MEMBERS = sorted(f"{name}.npy" for name in (*ARRAYS, "pos", "full"))


def save_replay_buffer(buffer: ReplayBuffer, path: Path) -> None:
    """Write what the buffer holds as .npz, atomically."""
    used = _used(buffer, buffer.pos, buffer.full)
    arrays = {name: getattr(buffer, name)[:used] for name in ARRAYS}
    place = {"pos": np.int64(buffer.pos), "full": np.bool_(buffer.full)}
    write_whole(path, lambda part: np.savez(part, **place, **arrays))


def load_replay_buffer(buffer: ReplayBuffer, path: Path) -> None:
    """Fill a fresh buffer with what :func:`save_replay_buffer` has written.

    Raises:
        ValueError: not such a file, or one of a buffer of another size or other environments.
    """
    with _opened(path) as archive:
        pos = int(_read_array(archive, "pos", (), np.dtype(np.int64)))
        full = bool(_read_array(archive, "full", (), np.dtype(bool)))
        if not 0 <= pos < buffer.buffer_size:
            raise ValueError(f"pos is {pos}, must be in [0, {buffer.buffer_size})")
        used = _used(buffer, pos, full)
        arrays = {}
        for name in ARRAYS:
            own = getattr(buffer, name)
            arrays[name] = _read_array(archive, name, (used, *own.shape[1:]), own.dtype)
    for name, array in arrays.items():
        getattr(buffer, name)[:used] = array
    buffer.pos, buffer.full = pos, full


def _read_array(
    archive: zipfile.ZipFile, name: str, shape: tuple[int, ...], dtype: np.dtype[Any]
) -> NDArray[Any]:
    """An array of this shape and type; nothing is allocated for another that the file promises."""
    with archive.open(f"{name}.npy") as member:
        if (version := np.lib.format.read_magic(member)) != (1, 0):
            raise ValueError(f"{name} has version {version}, must have (1, 0)")
        found = np.lib.format.read_array_header_1_0(member)
        if found != (shape, False, dtype):
            raise ValueError(
                f"{name} has shape {shown(found[0])} and type {found[2]}, must have {shape} and "
                f"{dtype}"
            )
        array = np.frombuffer(member.read(), dtype).reshape(shape)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} has numbers that are not finite")
    return array


def check_replay_file(path: Path) -> None:
    """Check that a file is whole: nothing packed, nothing missing.

    Raises:
        ValueError: it is not.
    """
    with _opened(path):
        pass


@contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
    """Open a whole file; anything wrong in it or in reading it is one ValueError that names it."""
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            members = archive.infolist()
            if sorted(info.filename for info in members) != MEMBERS:
                raise ValueError(
                    f"it has {len(members)} arrays, must have {len(MEMBERS)}: {MEMBERS}"
                )
            if packed := [info.filename for info in members if info.compress_type]:
                raise ValueError(f"{packed[0]} is packed, must be stored")
            if (damaged := archive.testzip()) is not None:
                raise ValueError(f"{damaged} is damaged")
            yield archive
    except Exception as error:  # of a damaged file zipfile and NumPy raise nearly every kind
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path} is no replay buffer: {reason}") from error


def _used(buffer: ReplayBuffer, pos: int, full: bool) -> int:
    """Rows in a file; one past ``pos``, where a buffer that saves memory has the last next
    observation."""
    return int(buffer.buffer_size) if full else pos + 1
