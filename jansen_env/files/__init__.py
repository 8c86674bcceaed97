"""Functions that write files atomically and read regular files."""

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

_FLAT = re.compile(r'\[\n([^][{}"]*)\]')  # a list of numbers in JSON that spans several lines
PART = ".part-"  # prefix of the names of temporary files, which are being written


def open_regular(path: str | Path) -> BufferedReader:
    """Open a regular file to read its bytes.

    Raises:
        OSError: If the file is not a regular file or cannot be read.
    """

    def opener(name: str, flags: int) -> int:
        handle = os.open(name, flags | getattr(os, "O_NONBLOCK", 0))
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            os.close(handle)
            raise OSError(errno.EINVAL, "not a regular file", str(path))
        return handle

    return open(path, "rb", opener=opener)


def read_bounded(path: str | Path, most: int) -> bytes:
    """Return the content of a regular file.

    Args:
        path: Path of the file.
        most: Largest allowed size of the file, in bytes.

    Raises:
        ValueError: If the file cannot be read, or is larger than ``most``.
    """
    try:
        with open_regular(path) as file:
            data = file.read(most + 1)
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}") from error
    if len(data) > most:
        raise ValueError(f"{path} must have at most {most} bytes, got more")
    return data


def write_whole(path: str | Path, write: Callable[[str], object]) -> Path:
    """Write a file atomically: write a temporary file in the same folder, then rename it.

    A crash leaves either the complete old file or the complete new file.

    Args:
        path: Path of the file. Missing folders are created.
        write: Function that writes the content to the file with a given name. The name has the
            same suffix as ``path``.

    Returns:
        The path of the file.

    Raises:
        OSError: If the file cannot be written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        name = str(path.with_name(f"{PART}{secrets.token_hex(8)}{path.suffix}"))
        try:
            # The mode of this file follows the umask. mkstemp would create a private file.
            os.close(os.open(name, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            write(name)
            _sync(name, os.O_RDWR)
            os.replace(name, path)
        finally:
            if os.path.exists(name):
                os.unlink(name)
    except OSError as error:  # the error may name the temporary file or no file
        raise type(error)(error.errno, error.strerror or str(error), str(path)) from error
    with contextlib.suppress(OSError):  # Windows cannot open folders
        _sync(path.parent, os.O_RDONLY)
    return path


def _sync(path: str | Path, flags: int) -> None:
    """Wait until the content of a file or folder is on the disk."""
    handle = os.open(path, flags)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_bytes(path: str | Path, data: bytes) -> Path:
    """Write bytes to a file atomically, and return its path."""
    return write_whole(path, lambda name: Path(name).write_bytes(data))


def write_text(path: str | Path, text: str) -> Path:
    """Write text to a file atomically, encoded as UTF-8, and return its path."""
    return write_bytes(path, text.encode("utf-8"))


def write_json(path: str | Path, value: object) -> Path:
    """Write a value to a JSON file atomically, and return its path.

    Each list of numbers is written on a single line.
    """
    text = json.dumps(value, indent=1)
    text = _FLAT.sub(lambda match: f"[{' '.join(match[1].split())}]", text)
    return write_text(path, text + "\n")


def check_writable(name: str, folder: Path) -> None:
    """Create a folder, and check that files can be written to it.

    Args:
        name: Name of the argument, for the error message.
        folder: The folder.

    Raises:
        ValueError: If the folder cannot be created or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, prefix=PART) as file:
            file.write(b"0")
    except OSError:
        raise ValueError(f"{name} must be a folder that can be written to, got {folder}") from None
