"""Files written atomically, folders that are a user's own, and the removal of unused ones."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import secrets
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, BinaryIO

_FLAT = re.compile(r'\[\n([^][{}"]*)\]')  # a list in JSON; strings have no line breaks there
PART = ".part-"  # how the names of files begin that are being written


def open_regular(path: str | Path) -> BinaryIO:
    """Open a file to read its bytes. Raises OSError: it is no regular file, or cannot be read."""

    def opener(name: str, flags: int) -> int:
        handle = os.open(name, flags | getattr(os, "O_NONBLOCK", 0))
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            os.close(handle)
            raise OSError(errno.EINVAL, "not a regular file", str(path))
        return handle

    return open(path, "rb", opener=opener)


def write_whole(path: str | Path, write: Callable[[str], object]) -> Path:
    """Let ``write`` fill a temporary file of the same suffix beside ``path``, then move it there.

    A crash leaves the old file or the new one. Raises OSError: it cannot be written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        name = str(path.with_name(f"{PART}{secrets.token_hex(8)}{path.suffix}"))
        # Not by mkstemp, whose files are private: this one's mode follows the umask.
        os.close(os.open(name, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        try:
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


def write_json(path: str | Path, value: Any) -> Path:
    """Write a JSON file atomically; a list of numbers is one line."""
    text = json.dumps(value, indent=1)
    text = _FLAT.sub(lambda found: f"[{' '.join(found[1].split())}]", text)
    return write_text(path, text + "\n")


def writable(folder: Path) -> bool:
    """Whether a folder can be written to: it is made, and a file in it, which is removed again."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=folder, prefix=PART)
        try:
            os.write(handle, b"0")
        finally:
            os.close(handle)
            os.unlink(name)
    except OSError:
        return False
    return True


def own_folder(folder: Path) -> Path:
    """Make a folder whose files no other user but root can change; return its real path.

    All folders above it count, but those with the sticky bit. The folder must not be a link. In a
    container root's own folders may appear as those of the root folder's owner. On Windows
    nothing is checked: permissions are not in a file's mode there.

    Raises:
        OSError: it cannot be made. ValueError: others could change its files; says where.
    """
    for place in reversed([place for place in (folder, *folder.parents) if not place.exists()]):
        place.mkdir(0o700 if place == folder else 0o755, exist_ok=True)
    real = Path(os.path.realpath(folder.parent)) / folder.name
    if not stat.S_ISDIR(real.lstat().st_mode):
        raise ValueError(f"{real} is a link or a file, must be a folder")
    if hasattr(os, "geteuid"):
        ours = {0, os.geteuid()}
        above = ours | {Path(real.anchor).lstat().st_uid}
        for place in (*reversed(real.parents), real):
            status = place.lstat()
            if status.st_uid not in (ours if place == real else above):
                raise ValueError(f"{place} belongs to user {status.st_uid}, must be ours or root's")
            sticky = place != real and status.st_mode & stat.S_ISVTX
            if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not sticky:
                # Files in the folder itself may be theirs already.
                way = "remove it" if place == real else "'chmod go-w' would end that"
                raise ValueError(f"others can write to {place} ({way})")
        with contextlib.suppress(OSError):  # some file systems know no modes
            real.chmod(0o700)  # or what is made in there could be open to others, by the umask
    return real


def remove_unused(paths: Iterable[Path], seconds: float) -> None:
    """Remove the folders that were last changed more than ``seconds`` ago."""
    for path in paths:
        with contextlib.suppress(OSError):  # gone already, or not ours
            if time.time() - path.stat().st_mtime > seconds:
                shutil.rmtree(path, ignore_errors=True)
