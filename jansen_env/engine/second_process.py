"""Kernels compiled by two processes, which share the cache on the disk.

Threads would not do: numba compiles one function at a time. The second process is a new
interpreter that imports the engine alone, never the program that runs here. It begins at one end of
the tasks, this one at the other; what it does not do, because it fails or hangs, is done here.
"""

from __future__ import annotations

import contextlib
import importlib
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jansen_env.cores import available_cores

PATIENCE = 60.0  # s for one task of the second process
_CODE = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from jansen_env.engine.second_process import serve; serve()"
)


class Task(NamedTuple):
    """A function to compile for arguments of these types."""

    subject: str
    function: Any
    types: tuple[Any, ...]


def compile_all(
    parts: Sequence[Task],
    others: Sequence[Task],
    last: Sequence[Task],
    kept: Callable[[Task], bool],
    say: Callable[[int, int, str], None],
) -> None:
    """Compile ``parts``, then ``last``, which they are part of; ``others`` at any time.

    Args:
        kept: whether a task's machine code is on the disk. say: takes number, count and subject of
            a task that begins here.
    """
    theirs, done = [*parts, *reversed(others)], list[Task]()
    helper = _start(theirs) if parts else None
    every = [*theirs, *last]

    def left(tasks: Sequence[Task]) -> list[Task]:
        done.extend(one for one in tasks if one not in done and kept(one))
        return [one for one in tasks if one not in done]

    def work(wanted: Sequence[Task], meanwhile: Sequence[Task] = ()) -> None:
        patience = time.monotonic() + PATIENCE
        while left(wanted):
            running = helper is not None and helper.poll() is None
            busy = left(theirs)[:1] if running else []
            mine = [one for one in left([*wanted, *meanwhile]) if one not in busy]
            if mine:
                say(len(every) - len(left(every)) + 1, len(every), mine[0].subject)
                mine[0].function.compile(mine[0].types)
                done.append(mine[0])
                patience = time.monotonic() + PATIENCE
            elif time.monotonic() < patience:
                time.sleep(0.01)
            elif helper is not None:
                helper.kill()

    try:
        work(parts[::-1], others)
        work(last)
        work(others)
    finally:
        if helper is not None:
            helper.kill()
            helper.wait()


def _start(tasks: Sequence[Task]) -> subprocess.Popen[bytes] | None:
    """Start a process that compiles; None without a core for it, or with Python in a program."""
    name = Path(sys.executable or "").name.lower()
    if available_cores() < 2 or getattr(sys, "frozen", False) or not name.startswith("python"):
        return None
    functions = [(one.function.py_func, one.types) for one in tasks]
    with contextlib.suppress(OSError), tempfile.TemporaryFile() as file:
        pickle.dump(sys.path, file)
        pickle.dump([(one.__module__, one.__name__, types) for one, types in functions], file)
        file.seek(0)
        return subprocess.Popen(
            [sys.executable, "-c", _CODE], stdin=file, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )  # fmt: skip
    return None


def serve() -> None:
    """Compile what standard input names."""
    from jansen_env.engine.compiler import compiling

    with compiling():
        for module, name, types in pickle.load(sys.stdin.buffer):
            getattr(importlib.import_module(module), name).compile(types)
