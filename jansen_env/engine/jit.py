"""``compiled``: numba's njit with a cache that notices a change in any file of this folder.

Numba's own cache looks at the file of the function alone: after a change in a function that it
calls from another file, it would go on running the old machine code. Here the cache's folder is
named after the contents of all files beside this one, so all that is compiled stands here.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numba.core.caching
import numba.extending

from jansen_env.engine.compiler import KernelCompiler, StageCompiler, StageFile, compiling
from jansen_env.engine.second_process import Task, compile_all
from jansen_env.files import own_folder, remove_unused, writable

_config: Any = numba.config
_intrinsic: Any = numba.extending.intrinsic
_njit: Any = numba.njit  # _nrt and what spares wrappers are no documented options
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
_FunctionCache: Any = numba.core.caching.FunctionCache
_log = logging.getLogger("jansen_env")

UNUSED = 30 * 24 * 3600.0  # s after which the folder of other sources is removed
_DIGEST = 16  # hexadecimal digits of it in a folder's name


def _user_cache() -> Path | None:
    """The folder in which the system keeps a user's caches; None where a user has none."""
    with contextlib.suppress(RuntimeError):  # no home
        home, variables = Path.home(), os.environ
        if sys.platform == "win32":
            folder = Path(variables.get("LOCALAPPDATA") or home / "AppData" / "Local")
        elif sys.platform == "darwin":
            folder = home / "Library" / "Caches"
        else:
            folder = Path(variables.get("XDG_CACHE_HOME") or home / ".cache")
        if folder.is_absolute() and (os.path.isdir(folder) or os.path.isdir(home)):
            return folder
    return None


def _cache_folder() -> str:
    """Return the folder of machine code; "" where none is fit for it.

    The first that can be written to of NUMBA_CACHE_DIR, the package and the user's caches, and in
    there a folder named after the sources. Whoever writes there has code run, as numba unpickles
    what it finds: where another user could, the next one is taken, and who compiles is told. A new
    folder makes room: those that other sources have not used for long are removed.
    """
    here = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted(here.glob("*.py")):
        digest.update(path.read_bytes())
    user = _user_cache()
    parents = [here.parent / "__pycache__"]
    if _config.CACHE_DIR:
        parents.insert(0, Path(_config.CACHE_DIR).absolute())
    if user is not None:
        parents.append(user / "jansen_env")
    for parent in parents:
        folder = parent / f"jansen-{digest.hexdigest()[:_DIGEST]}"
        new = not os.path.exists(folder)
        try:
            folder = own_folder(folder)
        except OSError:
            continue
        except ValueError as error:
            if new:
                with contextlib.suppress(OSError):
                    folder.rmdir()
            _refused.append(f"jansen_env keeps no machine code in {folder}: {error}")
            continue
        if writable(folder):  # which also marks it as used now
            if new:
                others = set(folder.parent.glob("jansen-" + _DIGEST * "[0-9a-f]")) - {folder}
                remove_unused(others, UNUSED)
            return str(folder)
    return ""


_refused: list[str] = []  # folders that are not fit for machine code, with the reasons
FOLDER = _cache_folder()
DISABLED = bool(_config.DISABLE_JIT)  # numba is told to compile nothing
NOT_KEPT = "and cannot keep it: there is no folder for it, NUMBA_CACHE_DIR can name one"
_waiting = threading.local()
_told: set[str] = set()  # what has been said in this process


class _Cache(_FunctionCache):  # type: ignore[misc]
    """Numba's cache of a function: what cannot be read is compiled again, and no error is raised.

    A file may be damaged, or be for other types where two processes wrote at once; the disk may be
    full, the folder gone. When sources were written does not matter: the folder is named after what
    is in them, so that copies of both go together, as in layers of containers.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file._source_stamp = None

    def holds(self, types: tuple[Any, ...], codegen: Any) -> bool:
        """Whether there is machine code for arguments of these types."""
        file = self._cache_file
        with contextlib.suppress(Exception):  # as above
            name = file._load_index().get(self._index_key(types, codegen))
            return name is not None and os.path.exists(file._data_path(name))
        return False

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            found = super().load_overload(sig, target_context)
            if found is None or found.signature.args == getattr(sig, "args", sig):
                return found
        except Exception:  # unpickling damaged files raises errors of many kinds
            pass
        with contextlib.suppress(OSError):
            self.flush()  # or saving would read them again
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except Exception as error:
            _tell(
                "saving", "jansen_env cannot keep its machine code in %s: %s", FOLDER, repr(error)
            )


class _StageCache(_Cache):
    """The same of a stage."""

    _impl_class = StageFile


def _cached(made: Any, kind: type[_Cache] = _Cache) -> Any:
    """Give a compiled function a cache in :data:`FOLDER`, where numba finds it fit."""
    if not FOLDER or _config.DISABLE_JIT:
        return made
    before = _config.CACHE_DIR
    _config.CACHE_DIR = FOLDER
    with contextlib.suppress(RuntimeError, OSError):
        cache = kind(made.py_func)
        if Path(cache.cache_path).is_relative_to(FOLDER):  # elsewhere old code is not noticed
            made._cache = cache  # as numba's cache=True does with its own
    _config.CACHE_DIR = before
    return made


def compiled(
    function: Callable[..., Any] | None = None, *, allocates: bool = False, **options: Any
) -> Any:
    """Decorator: compile with numba, cached on disk if possible, dividing by zero as numpy does.

    Args:
        allocates: whether it makes arrays. Where nothing does, numba need not count references to
            arrays: done by atomic instructions, that took half the time of a time step.
    """
    if function is None:
        return lambda f: compiled(f, allocates=allocates, **options)
    options |= {"pipeline_class": KernelCompiler, "_nrt": allocates}
    return _cached(_njit(**_OPTIONS, **options)(function))


def stage(
    function: Callable[..., Any] | None = None, *, inline: bool = True, cached: bool = False
) -> Any:
    """Decorator: part of compiled functions, not to be called from Python.

    Args:
        inline: whether it is put into their machine code wherever it is called.
        cached: whether it is kept on the disk, because it is compiled before what it is part of.
    """
    if function is None:
        return lambda f: stage(f, inline=inline, cached=cached)
    options = {"pipeline_class": StageCompiler, "forceinline": inline, "_nrt": False}
    made = _njit(**_OPTIONS, **options)(function)
    return _cached(made, _StageCache) if cached else made


def macro(function: Callable[..., Any]) -> Any:
    """Decorator: part of compiled functions, put into their source; for what is short or used once.

    That spares the machine code in between, but its types are inferred again at every place.
    """
    return _njit(inline="always", **_OPTIONS, _nrt=False)(function)


def _take(place: Any) -> Any:
    place[0] += 1
    return place[0] - 1


@_intrinsic
def _take_atomically(_: Any, place: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(place)(context, builder, arguments[0])
        one = context.get_constant(numba.int64, 1)
        return builder.atomic_rmw("add", array.data, one, "monotonic")

    return numba.int64(place), generate


take = _take if DISABLED else _take_atomically
"""Return ``place[0]``, of (1 or more,) int64, and add 1 to it: no other thread gets the same."""


class Kernel(NamedTuple):
    """A compiled function that Python calls: what it does, and arguments like those it gets.

    ``parts``: returns stages of it that are compiled before it, first what takes longest.
    """

    subject: str
    function: Any
    arguments: Sequence[Any]
    parts: Callable[[], Sequence[Kernel]] | None = None


@contextlib.contextmanager
def together() -> Iterator[None]:
    """Prepare at its end, all at once, what is prepared inside."""
    if hasattr(_waiting, "kernels"):
        yield
        return
    _waiting.kernels = kernels = list[Kernel]()
    try:
        yield
    finally:
        del _waiting.kernels
    prepare(*kernels)


def prepare(*kernels: Kernel) -> None:
    """Compile kernels for the types of their arguments, or read them from the disk.

    What is not there is compiled, and it is said how far that is.
    """
    if hasattr(_waiting, "kernels"):
        _waiting.kernels += kernels
    elif not _config.DISABLE_JIT:
        with compiling():
            _prepare(kernels)


def _prepare(kernels: Sequence[Kernel]) -> None:
    tasks = [_task(kernel) for kernel in kernels]
    parts, others, last = list[Task](), list[Task](), list[Task]()
    for kernel, task in zip(kernels, tasks, strict=True):
        if task.types in task.function.overloads or _kept(task):
            continue
        (others if kernel.parts is None else last).append(task)
        if kernel.parts is not None and FOLDER:
            parts += map(_task, kernel.parts())
    if others or last:
        for line in _refused:
            _tell(line, "%s", line)
        place = f"and keeps it in {FOLDER}" if FOLDER else NOT_KEPT
        _tell("compiling", "jansen_env compiles its time step for this machine, %s", place)
        say = partial(_log.warning, "jansen_env compiles %d of %d: %s")
        compile_all(parts, others, last, _kept, say)
    for task in tasks:
        task.function.compile(task.types)


def _task(kernel: Kernel) -> Task:
    return Task(kernel.subject, kernel.function, tuple(map(numba.typeof, kernel.arguments)))


def _kept(task: Task) -> bool:
    """Whether the machine code is on the disk."""
    cache = task.function._cache
    return isinstance(cache, _Cache) and cache.holds(task.types, task.function.targetctx.codegen())


def failed_to_keep() -> bool:
    """Whether machine code could not be saved in this process."""
    return "saving" in _told


def _tell(subject: str, message: str, *values: str) -> None:
    """Warn, once in a process."""
    if subject not in _told:
        _told.add(subject)
        _log.warning(message, *values)
