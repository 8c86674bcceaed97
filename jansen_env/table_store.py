"""Compiled robots kept on disk, so that the next process need not compile them again.

Beside the machine code, in files of plain numbers: reading one runs no code. A file's name is a
digest of the robot and of all that its numbers come from.
"""

from __future__ import annotations

import hashlib
import zipfile
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import llvmlite.binding
import numpy as np
from numpy.typing import NDArray

from jansen_env.compiling import FOLDER
from jansen_env.files import write_whole

if TYPE_CHECKING:
    from jansen_env.robot import Robot

Arrays = dict[str, NDArray[np.float64]]

SOURCES = ("linkage.py", "pads.py", "projection.py", "reduced.py", "robot.py")
KEPT = 20  # files; the oldest make room


@lru_cache(maxsize=1)
def _origin() -> bytes:
    """Digest of the code that makes the tables, and of the processor, whose rounding they have."""
    processor = llvmlite.binding.get_host_cpu_name()
    digest = hashlib.sha256(f"{np.__version__} {processor}".encode())
    for name in SOURCES:
        digest.update((Path(__file__).parent / name).read_bytes())
    return digest.digest()


def _place(robot: Robot) -> Path:
    key = hashlib.sha256(_origin() + repr(robot).encode()).hexdigest()[:24]
    return Path(FOLDER) / f"robot-{key}.npz"


def load(robot: Robot) -> Arrays | None:
    """The arrays that :func:`save` kept for a robot; None if there are none that can be read."""
    if not FOLDER:
        return None
    try:
        with _place(robot).open("rb") as file, np.load(file, allow_pickle=False) as found:
            return {name: found[name] for name in found.files}
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None


def save(robot: Robot, arrays: Arrays) -> None:
    """Keep arrays for a robot, if there is a folder to write to."""
    if not FOLDER:
        return
    try:
        write_whole(_place(robot), lambda name: np.savez(name, **arrays))  # type: ignore[arg-type]
        kept = sorted(Path(FOLDER).glob("robot-*.npz"), key=lambda path: path.stat().st_mtime)
        for path in kept[:-KEPT]:
            path.unlink(missing_ok=True)
    except OSError:  # full or read-only: it is compiled again the next time
        return
