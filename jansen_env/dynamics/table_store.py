"""Compiled robots kept on disk, so that the next process need not compile them again.

Beside the machine code, in files of plain numbers: reading one runs no code. A file's name is a
digest of the robot and of all that its numbers come from.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import llvmlite.binding
import numpy as np
from numpy.typing import NDArray

from jansen_env.engine.jit import FOLDER
from jansen_env.files import PART, remove, remove_unused, write_whole

if TYPE_CHECKING:
    from jansen_env.robot import Robot

Arrays = dict[str, NDArray[np.float64]]
Shapes = Mapping[str, tuple[int, ...]]

SOURCES = (
    "kinematics.py",
    "robot.py",
    *(f"dynamics/{name}.py" for name in ("pads", "projection", "reduced")),
)
KEPT = 20  # files; those used longest ago make room
ABANDONED = 3600.0  # s after which nobody goes on writing a file


@lru_cache(maxsize=1)
def _origin() -> bytes:
    """Digest of the code that makes the tables, and of the processor, whose rounding they have."""
    processor = llvmlite.binding.get_host_cpu_name()
    digest = hashlib.sha256(f"{np.__version__} {processor}".encode())
    for name in SOURCES:
        digest.update((Path(__file__).parents[1] / name).read_bytes())
    return digest.digest()


def _place(robot: Robot) -> Path:
    key = hashlib.sha256(_origin() + repr(robot).encode()).hexdigest()[:24]
    return Path(FOLDER) / f"robot-{key}.npz"


def load(robot: Robot, shapes: Shapes) -> Arrays | None:
    """The arrays that :func:`save` kept for a robot, by their names and shapes.

    None if there are none, or if what is there cannot be read or is anything but finite float64
    numbers of these shapes.
    """
    if not FOLDER:
        return None
    path = _place(robot)
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as found:
            arrays = {name: found[name] for name in shapes}
    except Exception:  # missing or damaged, which NumPy and zipfile say by errors of many kinds
        return None
    for name, shape in shapes.items():
        array = arrays[name]
        if array.dtype != np.float64 or array.shape != shape or not np.isfinite(array).all():
            return None
    with contextlib.suppress(OSError):  # a folder that is read-only by now
        os.utime(path)  # it has been used
    return arrays


def save(robot: Robot, arrays: Arrays) -> None:
    """Keep arrays for a robot, if there is a folder to write to."""
    if not FOLDER:
        return
    folder, path = Path(FOLDER), _place(robot)
    try:
        if path.is_dir():
            remove(path)
        write_whole(path, lambda name: np.savez(name, **arrays))  # type: ignore[arg-type]
        remove_unused(folder.glob(f"{PART}*"), ABANDONED)
        kept = sorted(folder.glob("robot-*.npz"), key=lambda path: path.stat().st_mtime)
        for old in kept[:-KEPT]:
            remove(old)
    except OSError:
        return  # full, read-only, or another process is clearing up: it is done the next time
