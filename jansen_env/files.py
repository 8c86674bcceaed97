"""Files written atomically, and the removal of folders that nobody uses any more."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

_FLAT = re.compile(r'\[\n([^][{}"]*)\]')  # a list in JSON; strings have no line breaks there
PART = ".part-"  # how the names of files begin that are being written


def write_whole(path: str | Path, write: Callable[[str], object]) -> Path:
    """Let ``write`` fill a temporary file beside ``path``, then move it there in one go.

    It is on the disk before it is moved, so that a crash leaves the old file or the new one. The
    temporary name keeps the suffix of ``path``, which some writers look at.

    Raises:
        OSError: it cannot be written; names ``path``.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=PART, suffix=path.suffix)
        os.close(handle)
        try:
            write(name)
            os.chmod(name, 0o644)  # mkstemp's files are private
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
    """Whether a folder can be written to: it is made, and a file in it, which is removed again.

    Permissions tell too little: root ignores them, and file systems may be read-only or full.
    """
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


def remove_unused(paths: Iterable[Path], seconds: float) -> None:
    """Remove the folders that were last changed more than ``seconds`` ago."""
    for path in paths:
        with contextlib.suppress(OSError):  # gone already, or not ours
            if time.time() - path.stat().st_mtime > seconds:
                shutil.rmtree(path, ignore_errors=True)
