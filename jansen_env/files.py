"""Files written atomically, and regular files to read."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import secrets
import stat
import tempfile
from collections.abc import Callable
from io import BufferedReader
from pathlib import Path

_FLAT = re.compile(r'\[\n([^][{}"]*)\]')  # a list in JSON; strings have no line breaks there
PART = ".part-"  # how the names of files begin that are being written


def open_regular(path: str | Path) -> BufferedReader:
    """Open a file to read its bytes. Raises OSError: it is no regular file, or cannot be read."""

    def opener(name: str, flags: int) -> int:
        handle = os.open(name, flags | getattr(os, "O_NONBLOCK", 0))
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            os.close(handle)
            raise OSError(errno.EINVAL, "not a regular file", str(path))
        return handle

    return open(path, "rb", opener=opener)


def read_bounded(path: str | Path, most: int) -> bytes:
    """Read a regular file. Raises ValueError: it cannot be read, or has over ``most`` bytes."""
    try:
        with open_regular(path) as file:
            data = file.read(most + 1)
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}") from error
    if len(data) > most:
        raise ValueError(f"{path} is larger than {most} bytes, the most allowed")
    return data


def write_whole(path: str | Path, write: Callable[[str], object]) -> Path:
    """Let ``write`` fill a temporary file of the same suffix beside ``path``, then move it there.

    A crash leaves the old file or the new one. Raises OSError: it cannot be written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        name = str(path.with_name(f"{PART}{secrets.token_hex(8)}{path.suffix}"))
        try:
            # Not by mkstemp, whose files are private: this one's mode follows the umask.
            os.close(os.open(name, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            write(name)
            _sync(name, os.O_RDWR)
            os.replace(name, path)
        finally:
            if os.path.exists(name):
                os.unlink(name)
    except OSError as error:  # of the temporary file, or of none
        raise type(error)(error.errno, error.strerror or str(error), str(path)) from error
    with contextlib.suppress(OSError):  # Windows opens no folders
        _sync(path.parent, os.O_RDONLY)
    return path


def _sync(path: str | Path, flags: int) -> None:
    """Wait until a file or folder is on the disk."""
    handle = os.open(path, flags)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_bytes(path: str | Path, data: bytes) -> Path:
    """Write a file atomically."""
    return write_whole(path, lambda name: Path(name).write_bytes(data))


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file atomically."""
    return write_bytes(path, text.encode("utf-8"))


def write_json(path: str | Path, value: object) -> Path:
    """Write a JSON file atomically; a list of numbers is one line."""
    text = json.dumps(value, indent=1)
    text = _FLAT.sub(lambda match: f"[{' '.join(match[1].split())}]", text)
    return write_text(path, text + "\n")


def check_writable(name: str, folder: Path) -> None:
    """Make a folder, and a file in it, which is removed again. Raises ValueError: it cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, prefix=PART) as file:
            file.write(b"0")
    except OSError:
        raise ValueError(f"{name} is {folder}, must be a folder that can be written to") from None
