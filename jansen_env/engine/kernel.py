"""Kernels: functions of this folder that are compiled when the package is built.

Their Python is the source; :mod:`jansen_env.engine.build` lowers it to a shared library, which is
called here. ``JANSEN_ENV_PYTHON=1`` runs the Python itself: slowly, for a debugger, with the same
results bit for bit.

The library has one entry point per kernel, whose only argument is the address of its slots: 8 bytes
for each number; for each array its address and its lengths, and for an array whose rows lie apart
(a field of the robots' records) also the distance between two rows in bytes.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import importlib.util
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from operator import is_
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias, get_type_hints

import numpy as np
from numpy.typing import NDArray

PYTHON = os.environ.get("JANSEN_ENV_PYTHON", "") not in ("", "0")
FOLDER = Path(__file__).parent
ENDINGS = {"win32": "dll", "darwin": "dylib", "wasm": "wasm"}
RESULTS: dict[type | None, type | None] = {
    None: None, bool: ctypes.c_bool, int: ctypes.c_int64, float: ctypes.c_double,
}  # fmt: skip
BUILDERS = ("llvmlite", "numba", "ziglang")

# Arguments of kernels; the digit is the number of axes.
Bools1 = Annotated[NDArray[np.bool_], np.dtype(bool), 1]
Ints1 = Annotated[NDArray[np.int64], np.dtype("i8"), 1]
Ints2 = Annotated[NDArray[np.int64], np.dtype("i8"), 2]
Words1 = Annotated[NDArray[np.uint64], np.dtype("u8"), 1]
Singles1 = Annotated[NDArray[np.float32], np.dtype("f4"), 1]
Singles2 = Annotated[NDArray[np.float32], np.dtype("f4"), 2]
Singles4 = Annotated[NDArray[np.float32], np.dtype("f4"), 4]
Floats1 = Annotated[NDArray[np.float64], np.dtype("f8"), 1]
Floats2 = Annotated[NDArray[np.float64], np.dtype("f8"), 2]
Floats3 = Annotated[NDArray[np.float64], np.dtype("f8"), 3]
Floats4 = Annotated[NDArray[np.float64], np.dtype("f8"), 4]
Floats5 = Annotated[NDArray[np.float64], np.dtype("f8"), 5]

APART = "apart"
"""Marks an array whose rows may lie apart, each of them contiguous: a field of records."""

Function: TypeAlias = Callable[..., Any]


class Parameter(NamedTuple):
    """An argument of a kernel, or an entry of an argument that is a named tuple.

    Attributes:
        name: Name of the argument or entry.
        slot: Number of the first of its slots.
        dtype: Type of the number, or of the array's elements.
        ndim: Number of axes of the array; 0 for a number.
        apart: Whether the rows of the array may lie apart, see :data:`APART`.
        group: Name of the argument that this is an entry of; "" for an argument itself.
    """

    name: str
    slot: int
    dtype: np.dtype[np.generic]
    ndim: int
    apart: bool = False
    group: str = ""

    @property
    def slots(self) -> int:
        """Number of slots: value or address, lengths, and distance between rows."""
        return 1 + self.ndim + self.apart


class Kernel:
    """A compiled function, called like the Python function that it is made from.

    It remembers the arguments of its last calls, as most are the same again.

    Args:
        function: Annotated with ``int``, ``float``, ``bool``, the arrays above, rows
            ``Annotated[NDArray[np.void], DTYPE, ndim]``, the same with :data:`APART`, or a
            ``NamedTuple`` class whose entries are annotated so. It returns a number or None.
        nogil: whether other threads may run Python meanwhile.
    """

    __name__: str

    def __init__(self, function: Function, nogil: bool) -> None:
        functools.update_wrapper(self, function)
        self.function, self.nogil = function, nogil
        self.symbol = f"{function.__module__.rpartition('.')[2]}_{function.__name__}"
        # As many as calls have been under way at once: quicker than one for each thread.
        self._spare = list[tuple[Slots, tuple[object, ...]]]()

    @functools.cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The arguments, in their order."""
        return _parameters(self.function)

    @property
    def slots(self) -> int:
        """How many slots the arguments take."""
        return sum(parameter.slots for parameter in self.parameters)

    @property
    def returns(self) -> type | None:
        """``int``, ``float``, ``bool`` or None."""
        result = get_type_hints(self.function)["return"]
        return None if result is type(None) else result

    @functools.cached_property
    def entry(self) -> Function:
        """The library's entry point."""
        library = _libraries()[0 if self.nogil else 1]
        entry = getattr(library, self.symbol)
        entry.argtypes = [ctypes.c_int64]
        entry.restype = RESULTS[self.returns]
        return entry

    def bound(self) -> Kernel:
        """Return a copy that remembers its own arguments, for an object that calls it often."""
        return Kernel(self.function, self.nogil)

    def __call__(self, *arguments: object) -> Any:
        """Run it; an argument may be a tuple of several, looked at again only if it is another.

        Raises TypeError: an argument is no such array or number.
        """
        if PYTHON:
            with np.errstate(all="ignore"):  # a compiled kernel does not warn, either
                return self.function(*flat(arguments, named=False))
        try:
            last = self._spare.pop()
        except IndexError:
            last = Slots(self), ()
        slots, known = last
        if len(arguments) != len(known) or not all(map(is_, arguments, known)):
            slots.fill(flat(arguments))
            last = slots, arguments
        result = self.entry(slots.address)
        self._spare.append(last)
        return result

    def __reduce__(self) -> str | tuple[Function, tuple[Kernel]]:
        named: Kernel = getattr(sys.modules[self.function.__module__], self.__name__)
        return self.__name__ if named is self else (Kernel.bound, (named,))


@functools.cache
def _parameters(function: Function) -> tuple[Parameter, ...]:
    """Return the arguments of a kernel's function."""
    parameters = list[Parameter]()
    slot = 0
    for name, hint in get_type_hints(function, include_extras=True).items():
        if name == "return":
            continue
        is_group = hasattr(hint, "_fields")
        entries = get_type_hints(hint, include_extras=True) if is_group else {name: hint}
        for entry, kind in entries.items():
            is_array = hasattr(kind, "__metadata__")
            dtype, ndim, *marks = kind.__metadata__ if is_array else (np.dtype(kind), 0)
            made = Parameter(entry, slot, dtype, ndim, APART in marks, name if is_group else "")
            parameters.append(made)
            slot += made.slots
    return tuple(parameters)


class Slots:
    """Memory of a kernel's arguments."""

    def __init__(self, kernel: Kernel) -> None:
        self._symbol, self._parameters = kernel.symbol, kernel.parameters
        self.words = np.zeros(kernel.slots, np.int64)
        self._known: list[object] = [self] * len(self._parameters)
        self.address = ctypes.c_int64(self.words.ctypes.data)  # which is quicker than a number

    def fill(self, arguments: list[object]) -> None:
        """Put those arguments into their slots that are not there yet."""
        known, count = self._known, len(self._known)
        if len(arguments) != count:
            raise TypeError(f"{self._symbol} must have {count} arguments, got {len(arguments)}")
        for i, argument in enumerate(arguments):
            if argument is not known[i]:
                self._put(self._parameters[i], argument)
                known[i] = argument

    def _put(self, parameter: Parameter, argument: Any) -> None:
        """Put an argument into its slots."""
        name, slot, dtype, ndim, apart, _ = parameter
        if ndim == 0:
            words = self.words.view(np.float64) if dtype.kind == "f" else self.words
            words[slot] = argument
            return
        if (
            not isinstance(argument, np.ndarray)
            or (argument.dtype is not dtype and argument.dtype != dtype)
            or argument.ndim != ndim
            or not (argument[:1] if apart else argument).flags.c_contiguous
        ):
            kind = getattr(argument, "dtype", type(argument).__name__)
            shape = getattr(argument, "shape", ())
            raise TypeError(f"{name} must be contiguous {dtype} of {ndim} axes, got {kind} {shape}")
        try:  # the quickest way
            address = ctypes.addressof(ctypes.c_char.from_buffer(argument))  # type: ignore[arg-type]
        except (TypeError, ValueError, BufferError):  # read only, empty, or with rows apart
            address = argument.ctypes.data
        self.words[slot] = address
        for axis in range(ndim):
            self.words[slot + 1 + axis] = argument.shape[axis]
        if apart:
            self.words[slot + 1 + ndim] = argument.strides[0]


def flat(arguments: Iterable[object], named: bool = True) -> list[object]:
    """Return the arguments, with the entries of tuples in their places.

    Args:
        arguments: Arrays, numbers and tuples of them.
        named: Whether to open named tuples, too.
    """
    items = list[object]()
    for argument in arguments:
        is_open = isinstance(argument, tuple) and (named or not hasattr(argument, "_fields"))
        if is_open:
            items += flat(argument, named)  # type: ignore[arg-type]
        else:
            items.append(argument)
    return items


lower: Callable[[Function, bool], Any] | None = None
"""Makes a stage what numba compiles; set by :mod:`jansen_env.engine.build` alone."""
kernels: list[Kernel] = []
"""All kernels of the modules imported so far."""


def kernel(function: Function | None = None, *, nogil: bool = False) -> Any:
    """Decorator: make a function a :class:`Kernel`."""
    if function is None:
        return lambda f: kernel(f, nogil=nogil)
    made = Kernel(function, nogil)
    kernels.append(made)
    return made


def stage(function: Function | None = None, *, inline: bool = True) -> Any:
    """Decorator: part of kernels; called from Python it is plain Python.

    Args:
        inline: whether it is put into their machine code wherever it is called.
    """
    if function is None:
        return lambda f: stage(f, inline=inline)
    return function if lower is None else lower(function, inline)


@stage
def fetch_add(place: NDArray[np.int64]) -> int:
    """Return ``place[0]``, of (1 or more,) int64, and add 1 to it.

    Compiled, no other thread gets the same.
    """
    place[0] += 1
    return place[0] - 1


def library_path(folder: Path = FOLDER, platform: str = sys.platform) -> Path:
    """The library of these sources: its name has their digest, so that no other one is loaded."""
    digest = hashlib.sha256()
    for path in sorted(FOLDER.glob("*.py")):
        digest.update(path.read_bytes())
    return folder / f"engine-{digest.hexdigest()[:16]}.{ENDINGS.get(platform, 'so')}"


def built_library(platform: str = sys.platform) -> Path:
    """:func:`library_path`, built first where it is missing; ``"wasm"`` is for browsers.

    Raises:
        ImportError: it is missing or older than its sources, and cannot be built here.
    """
    path = library_path(platform=platform)
    if not path.exists():
        missing = [name for name in BUILDERS if importlib.util.find_spec(name) is None]
        if missing:
            raise ImportError(
                f"{path.name} is missing in {FOLDER}: the engine's sources have changed since it "
                f"was built, and {', '.join(missing)} to build it are not installed; "
                "run: python -m pip install -e ."
            )
        logging.getLogger("jansen_env").warning("jansen_env builds its engine, %s", path.name)
        targets = ["wasm32"] if platform == "wasm" else []
        build = [sys.executable, str(FOLDER / "build.py"), *targets]
        subprocess.run(build, check=True, stdout=subprocess.DEVNULL)
    return path


@functools.cache
def _libraries() -> tuple[ctypes.CDLL, ctypes.PyDLL]:
    """The library, called without and with Python's lock. Raises ImportError: there is none."""
    path = str(built_library())
    return ctypes.CDLL(path), ctypes.PyDLL(path)
