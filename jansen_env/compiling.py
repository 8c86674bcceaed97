"""``compiled``: numba's njit with a cache that notices a change in any of the compiled files.

Numba's own cache looks at the file of the function alone: after a change in a function that it
calls from another file, it would go on running the old machine code. Here the cache's folder is
named after the contents of all compiled files.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

_config: Any = numba.config

SOURCES = (
    "envs/rewards.py",
    "envs/walking.py",
    "compiling.py",
    "contact.py",
    "contact_solver.py",
    "kernels.py",
    "model.py",
    "pinned_kernel.py",
    "plants/stance.py",
)


def _cache_folder() -> str:
    """Beside the package, or in NUMBA_CACHE_DIR; "" (numba's choice) where that is not writable."""
    here = Path(__file__).parent
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update((here / name).read_bytes())
    folder = Path(_config.CACHE_DIR or here / "__pycache__") / f"jansen-{digest.hexdigest()[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return ""
    return str(folder) if os.access(folder, os.W_OK) else ""


FOLDER = _cache_folder()
_announced: set[str] = set()


def compiled(
    function: Callable[..., Any] | None = None, *, allocates: bool = False, **options: Any
) -> Any:
    """Decorator: compile with numba, cached on disk, dividing by zero as numpy does.

    Args:
        allocates: whether it makes arrays. Where nothing does, numba need not count references to
            arrays: done by atomic instructions, that took half the time of a time step.
    """
    if function is None:
        return lambda f: compiled(f, allocates=allocates, **options)
    before = _config.CACHE_DIR
    if FOLDER:
        _config.CACHE_DIR = FOLDER
    try:
        chosen: dict[str, Any] = {"cache": True, "error_model": "numpy", "_nrt": allocates}
        return numba.njit(**chosen, **options)(function)
    finally:
        _config.CACHE_DIR = before


def announce(kernel: str) -> None:
    """Say, once in a process, that a kernel is going to be compiled if it is not on disk yet.

    Args:
        kernel: file and function, such as ``"kernels.advance"``.
    """
    if kernel in _announced or _config.DISABLE_JIT:
        return
    _announced.add(kernel)
    if not (FOLDER and any(Path(FOLDER).rglob(f"{kernel}-*.nbc"))):
        kept = f"and keeps it in {FOLDER}" if FOLDER else "and cannot keep it: no folder to write"
        logging.getLogger("jansen_env").warning(
            "jansen_env compiles its time step for this machine, which takes a minute or so, %s",
            kept,
        )
