"""Kernels: functions of this folder that are compiled when the package is built.

Their Python code is the source. :mod:`jansen_env.engine.build` compiles it to a shared library,
which this module calls. With ``JANSEN_ENV_PYTHON=1``, the Python code itself runs instead: slowly,
but in a debugger, and with the same results bit for bit.

The library has one entry point per kernel. Its only argument is the address of the kernel's slots,
which have 8 bytes each. A number takes one slot. An array takes one slot for its address and one
for each of its lengths. An array whose rows lie apart (a field of the robots' records) takes
another slot for the distance between two rows in bytes.
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
"""Whether kernels run as Python code instead of compiled code."""
FOLDER = Path(__file__).parent
"""Folder of the engine's sources and libraries."""
ENDINGS = {"win32": "dll", "darwin": "dylib", "wasm": "wasm"}
"""File name extension of the library on each platform; "so" on all others."""
RESULTS: dict[type | None, type | None] = {
    None: None,
    bool: ctypes.c_bool,
    int: ctypes.c_int64,
    float: ctypes.c_double,
}
"""Type of ctypes for each type that a kernel may return."""
BUILDERS = ("llvmlite", "numba", "ziglang")
"""Packages that are needed to build the library."""

# Types of the array arguments of kernels. The digit is the number of axes.
Bools1 = Annotated[NDArray[np.bool_], np.dtype(bool), 1]
Bools2 = Annotated[NDArray[np.bool_], np.dtype(bool), 2]
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
"""Mark of an array whose rows may lie apart, such as a field of records; each row is contiguous."""

Function: TypeAlias = Callable[..., Any]


class Parameter(NamedTuple):
    """An argument of a kernel, or an entry of an argument that is a named tuple.

    Attributes:
        name: Name of the argument or entry.
        slot: Number of its first slot.
        dtype: Type of the number, or of the elements of the array.
        ndim: Number of axes of the array; 0 for a number.
        apart: Whether the rows of the array may lie apart, see :data:`APART`.
        group: Name of the argument to which the entry belongs; "" for an argument itself.
    """

    name: str
    slot: int
    dtype: np.dtype[np.generic]
    ndim: int
    apart: bool = False
    group: str = ""

    @property
    def slots(self) -> int:
        """Number of slots: for the value or address, the lengths, and the distance between rows."""
        return 1 + self.ndim + self.apart


class Kernel:
    """A compiled function, which is called like the Python function from which it is made.

    A kernel stores the arguments of its last calls, because most arguments are the same in the next
    call.

    Args:
        function: Python function. Its arguments are annotated with ``int``, ``float``, ``bool``,
            the array types of this module, ``Annotated[NDArray[np.void], DTYPE, ndim]`` for
            records, the same with :data:`APART`, or a ``NamedTuple`` class whose entries have such
            annotations. It returns a number or None.
        nogil: Whether the kernel releases Python's global interpreter lock while it runs.

    Attributes:
        function: Python function from which the kernel is made.
        nogil: Whether the kernel releases Python's global interpreter lock while it runs.
        symbol: Name of the kernel's entry point in the library.
    """

    __name__: str

    def __init__(self, function: Function, nogil: bool) -> None:
        functools.update_wrapper(self, function)
        self.function, self.nogil = function, nogil
        self.symbol = f"{function.__module__.rpartition('.')[2]}_{function.__name__}"
        # Pool of slots and their arguments, one entry per concurrent call. It is faster than
        # thread-local storage.
        self._spare = list[tuple[Slots, tuple[object, ...]]]()

    @functools.cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Arguments of the kernel, in order."""
        return _parameters(self.function)

    @property
    def slots(self) -> int:
        """Number of slots that all arguments take together."""
        return sum(parameter.slots for parameter in self.parameters)

    @property
    def returns(self) -> type | None:
        """Type of the result: ``int``, ``float``, ``bool`` or None."""
        result = get_type_hints(self.function)["return"]
        return None if result is type(None) else result

    @functools.cached_property
    def entry(self) -> Function:
        """Entry point of the kernel in the library."""
        library = _libraries()[0 if self.nogil else 1]
        entry = getattr(library, self.symbol)
        entry.argtypes = [ctypes.c_int64]
        entry.restype = RESULTS[self.returns]
        return entry

    def bound(self) -> Kernel:
        """Return a copy with its own stored arguments, for an object that calls it often."""
        return Kernel(self.function, self.nogil)

    def __call__(self, *arguments: object) -> Any:
        """Run the kernel.

        Args:
            *arguments: Arguments of the function. A tuple stands for several arguments. Its entries
                are examined again only if the tuple is another object than in the last call.

        Returns:
            The result of the function.

        Raises:
            TypeError: If the number of arguments is wrong, or if an argument is not an array of the
                required type.
        """
        if PYTHON:
            with np.errstate(all="ignore"):  # A compiled kernel does not warn, either.
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
        """Pickle the kernel by its name, or as a bound copy of the kernel of this name."""
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
    """Memory for the arguments of a kernel.

    Args:
        kernel: The kernel.

    Attributes:
        words: The slots, shape (slots,).
        address: Address of the slots.
    """

    def __init__(self, kernel: Kernel) -> None:
        self._symbol, self._parameters = kernel.symbol, kernel.parameters
        self.words = np.zeros(kernel.slots, np.int64)
        self._known: list[object] = [self] * len(self._parameters)
        # An object of ctypes is faster to pass than an int.
        self.address = ctypes.c_int64(self.words.ctypes.data)

    def fill(self, arguments: list[object]) -> None:
        """Write the arguments that differ from the last call into their slots.

        Args:
            arguments: All arguments, with tuples opened, see :func:`flat`.

        Raises:
            TypeError: If the number of arguments is wrong, or if an argument is not an array of the
                required type.
        """
        known, count = self._known, len(self._known)
        if len(arguments) != count:
            raise TypeError(f"{self._symbol} must have {count} arguments, got {len(arguments)}")
        for i, argument in enumerate(arguments):
            if argument is not known[i]:
                self._put(self._parameters[i], argument)
                known[i] = argument

    def _put(self, parameter: Parameter, argument: Any) -> None:
        """Write an argument into its slots."""
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
        try:  # This is the fastest way to get the address.
            address = ctypes.addressof(ctypes.c_char.from_buffer(argument))  # type: ignore[arg-type]
        except (TypeError, ValueError, BufferError):  # Read-only, empty, or with rows apart.
            address = argument.ctypes.data
        self.words[slot] = address
        for axis in range(ndim):
            self.words[slot + 1 + axis] = argument.shape[axis]
        if apart:
            self.words[slot + 1 + ndim] = argument.strides[0]


def flat(arguments: Iterable[object], named: bool = True) -> list[object]:
    """Return the arguments as a flat list in which the entries of tuples replace the tuples.

    Args:
        arguments: Arrays, numbers, and tuples of these.
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
"""Function that turns a stage into an object that Numba compiles.

Only :mod:`jansen_env.engine.build` sets it. If it is None, stages stay Python functions.
"""
kernels: list[Kernel] = []
"""All kernels of the modules imported so far."""


def kernel(function: Function | None = None, *, nogil: bool = False) -> Any:
    """Turn a function into a :class:`Kernel`; for use as a decorator.

    Args:
        function: The function. If None, return a decorator.
        nogil: Whether the kernel releases Python's global interpreter lock while it runs.
    """
    if function is None:
        return lambda f: kernel(f, nogil=nogil)
    made = Kernel(function, nogil)
    kernels.append(made)
    return made


def stage(function: Function | None = None, *, inline: bool = True) -> Any:
    """Declare a function as part of kernels; for use as a decorator.

    If a stage is called from Python, it runs as plain Python.

    Args:
        function: The function. If None, return a decorator.
        inline: Whether to insert the machine code of the stage wherever a kernel calls it.
    """
    if function is None:
        return lambda f: stage(f, inline=inline)
    return function if lower is None else lower(function, inline)


@stage
def fetch_add(place: NDArray[np.int64]) -> int:
    """Return ``place[0]`` and add 1 to it.

    In compiled code this is atomic: no two threads get the same value.

    Args:
        place: Counter, an int64 array of shape (k,) with k >= 1.
    """
    place[0] += 1
    return place[0] - 1


def library_path(folder: Path = FOLDER, platform: str = sys.platform) -> Path:
    """Return the path of the library that is built from the present sources.

    The name of the library contains a digest of the sources, so that a library of other sources is
    never loaded.

    Args:
        folder: Folder of the library.
        platform: Platform as in ``sys.platform``, or "wasm".
    """
    digest = hashlib.sha256()
    for path in sorted(FOLDER.glob("*.py")):
        digest.update(path.read_bytes())
    return folder / f"engine-{digest.hexdigest()[:16]}.{ENDINGS.get(platform, 'so')}"


def built_library(platform: str = sys.platform) -> Path:
    """Return the path of the library, and build the library first if it does not exist.

    Args:
        platform: Platform as in ``sys.platform``, or "wasm" for browsers.

    Raises:
        ImportError: If the library is missing or older than its sources, and cannot be built here.
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
    """Return the library twice: to be called without and with Python's global interpreter lock.

    Raises:
        ImportError: If the library does not exist and cannot be built.
    """
    path = str(built_library())
    return ctypes.CDLL(path), ctypes.PyDLL(path)
