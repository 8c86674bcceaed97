"""Files written whole or not at all."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any


def write_whole(path: str | Path, write: Callable[[str], object]) -> Path:
    """Let ``write`` fill a temporary file beside ``path``, then move it there in one go.

    The temporary name keeps the suffix of ``path``, which some writers look at.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".part-", suffix=path.suffix)
    os.close(handle)
    try:
        write(name)
        os.chmod(name, 0o644)  # mkstemp's files are private
        os.replace(name, path)
    finally:
        if os.path.exists(name):
            os.unlink(name)
    return path


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file whole or not at all."""
    return write_whole(path, lambda name: Path(name).write_text(text, encoding="utf-8"))


def write_json(path: str | Path, value: Any) -> Path:
    """Write a JSON file whole or not at all."""
    return write_text(path, json.dumps(value, indent=1) + "\n")
