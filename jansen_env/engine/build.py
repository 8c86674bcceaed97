"""Build the engine: compile every kernel of this folder into one library for one platform.

    python jansen_env/engine/build.py [TARGET]

The command also builds the same kernels as WebAssembly, for browsers; the target ``wasm32`` builds
WebAssembly only. Numba infers the types of the Python code and lowers it, LLVM optimises it, and
Zig links it. The library depends on no other library, because it has its own mathematical functions
(:mod:`jansen_env.engine.mathematics`). Operations are never contracted to fused ones, so the
results are bit-for-bit the same on every platform.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from types import ModuleType

# Run as a script without importing the package, because the package needs Gymnasium.
if __name__ in ("__main__", "__mp_main__"):
    ROOT = Path(__file__).resolve().parents[2]
    sys.path[0] = str(ROOT)
    sys.modules["jansen_env"] = ModuleType("jansen_env")
    sys.modules["jansen_env"].__path__ = [str(ROOT / "jansen_env")]
# Numba must not optimise: the LLVM code must not contain anything specific to the host.
os.environ["NUMBA_OPT"] = "0"

import argparse
import ctypes
import importlib
import itertools
import platform
import re
import subprocess
import tempfile
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any, NamedTuple, TypeAlias, get_type_hints

import llvmlite.binding as llvm
import numba
from numba.core import cgutils, types
from numba.core.bytecode import FunctionIdentity
from numba.core.codegen import JITCodeLibrary
from numba.core.cpu import CPUContext
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from jansen_env.engine import kernel as kernel_module
from jansen_env.engine.kernel import FOLDER, Function, Kernel, Parameter, library_path

Numba: TypeAlias = Any
"""Type of the objects of Numba and llvmlite, which have no type annotations."""
NJIT: Numba = numba.njit  # The type annotations of `numba.njit` lack some of its options.
OPTIONS: dict[str, object] = {
    "error_model": "numpy",
    "_nrt": False,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}
"""Options of Numba.

A division by zero gives inf or NaN. Stages have no wrappers, because Python does not call them.
References to arrays are not counted (``_nrt``, an undocumented option), because no array is
allocated. With reference counting, every array would cost atomic instructions.
"""
SPEED_LEVEL = 3  # optimisation level of LLVM
STEPPING = ("episode", "integrator")
"""Modules whose kernels contain the time step.

One process lowers all of these kernels, so that the time step is lowered only once. Meanwhile, a
second process lowers all other kernels.
"""
NUMBERS_APART = 1_000_000
"""Distance between the first function numbers of two processes that lower kernels."""

MEMSET = """
define hidden ptr @memset(ptr %to, i32 %value, {size} %count) "no-builtins" {{
  %byte = trunc i32 %value to i8
  %none = icmp eq {size} %count, 0
  br i1 %none, label %end, label %loop
loop:
  %i = phi {size} [ 0, %0 ], [ %next, %loop ]
  %place = getelementptr i8, ptr %to, {size} %i
  store i8 %byte, ptr %place
  %next = add {size} %i, 1
  %done = icmp eq {size} %next, %count
  br i1 %done, label %end, label %loop
end:
  ret ptr %to
}}
"""
"""LLVM code of ``memset``, a function of the C library.

LLVM generates calls of this function by itself. The library contains its own copy, so that it does
not depend on the C library.
"""

ENTRY = "define i32 @DllMainCRTStartup(ptr %0, i32 %1, ptr %2) {\n  ret i32 1\n}\n"
"""LLVM code of the function that Windows calls when it loads the library; it does nothing."""


class Target(NamedTuple):
    """A platform for which the engine can be built.

    Attributes:
        triple: Target triple of LLVM.
        zig: Name of the platform in Zig.
        system: Name of the operating system as in ``sys.platform``, or "wasm".
        tag: Platform tag of the wheel; "" for WebAssembly, which has no wheel.
    """

    triple: str
    zig: str
    system: str
    tag: str


TARGETS = {
    "linux-x86_64": Target(
        "x86_64-unknown-linux-gnu", "x86_64-linux-none", "linux", "manylinux2014_x86_64"
    ),
    "linux-aarch64": Target(
        "aarch64-unknown-linux-gnu", "aarch64-linux-none", "linux", "manylinux2014_aarch64"
    ),
    "macos-x86_64": Target(
        "x86_64-apple-macosx11.0", "x86_64-macos", "darwin", "macosx_11_0_x86_64"
    ),
    "macos-arm64": Target("arm64-apple-macosx11.0", "aarch64-macos", "darwin", "macosx_11_0_arm64"),
    "windows-x86_64": Target("x86_64-pc-windows-gnu", "x86_64-windows-gnu", "win32", "win_amd64"),
    "wasm32": Target("wasm32-unknown-unknown", "wasm32-freestanding", "wasm", ""),
}
# Linker options of each system. An undefined symbol must be an error; Linux needs an option for it.
# On Windows, compiler-rt contains the function that touches the pages of a large stack frame.
LINKED_AS = {
    "linux": ["-shared", "-Wl,-z,defs"],
    "darwin": ["-shared"],
    "win32": ["-shared", "-rtlib=compiler-rt"],
    "wasm": [f"-Wl,{a}" for a in ("--no-entry", "--export-dynamic", "--export=__heap_base", "-s")],
}


def host() -> str:
    """Return the name of this computer's platform in :data:`TARGETS`."""
    system = {"darwin": "macos", "win32": "windows"}.get(sys.platform, sys.platform)
    machine = platform.machine().lower().replace("amd64", "x86_64")
    return f"{system}-{machine}"


def _make_array(context: Numba, builder: Numba, kind: Numba, address: Numba, shape: Numba) -> Numba:
    """Create an empty Numba array struct for an array at an address.

    Args:
        context: Target context of Numba.
        builder: Builder of LLVM instructions.
        kind: Numba type of the array.
        address: Address of the first element.
        shape: Lengths of the axes.

    Returns:
        The array struct, the pointer to its data, its lengths, its strides, and the size of an
        element in bytes.
    """
    array = context.make_array(kind)(context, builder)
    data_type = context.get_data_type(kind.dtype)
    size = context.get_constant(types.intp, context.get_abi_sizeof(data_type))
    lengths = cgutils.unpack_tuple(builder, shape)
    strides = [size]
    for length in lengths[:0:-1]:
        strides.insert(0, builder.mul(strides[0], length))
    data = builder.inttoptr(address, array.data.type)
    return array, data, lengths, strides, size


@intrinsic
def array_at(_: Numba, address: Numba, shape: Numba, dtype: Numba) -> Numba:
    """Return a contiguous array of a shape at an address.

    Numba's own ``carray`` cannot be used, because it counts references.
    """
    kind = types.Array(dtype.dtype, len(shape), "C")

    def generate(context: Numba, builder: Numba, _: Numba, arguments: Numba) -> Numba:
        made = _make_array(context, builder, kind, arguments[0], arguments[1])
        array, data, lengths, strides, size = made
        populate_array(array, data, lengths, strides, size, None)
        return array._getvalue()

    return kind(types.int64, shape, dtype), generate


@intrinsic
def rows_at(_: Numba, address: Numba, shape: Numba, stride: Numba, dtype: Numba) -> Numba:
    """Return an array at an address whose rows lie ``stride`` bytes apart.

    Each row is contiguous. Otherwise the function works like :func:`array_at`.
    """
    kind = types.Array(dtype.dtype, len(shape), "A")

    def generate(context: Numba, builder: Numba, _: Numba, arguments: Numba) -> Numba:
        made = _make_array(context, builder, kind, arguments[0], arguments[1])
        array, data, lengths, strides, size = made
        strides[0] = arguments[2]
        populate_array(array, data, lengths, strides, size, None)
        return array._getvalue()

    return kind(types.int64, shape, types.int64, dtype), generate


@intrinsic
def _fetch_add(_: Numba, place: Numba) -> Numba:
    """Implement :func:`jansen_env.engine.kernel.fetch_add` by an atomic instruction."""

    def generate(context: Numba, builder: Numba, _: Numba, arguments: Numba) -> Numba:
        array = context.make_array(place)(context, builder, arguments[0])
        increment = context.get_constant(types.int64, 1)
        return builder.atomic_rmw("add", array.data, increment, "monotonic")

    return types.int64(place), generate


def _not_executable(_: Numba, library: Numba, *__: Numba) -> Numba:
    """Replace Numba's method that compiles a stage for the host and returns a Python function."""
    library._ensure_finalized()
    return [].append  # Numba uses this as the key of the stage: a builtin, different in each call.


def _lower(function: Function, inline: bool) -> Numba:
    """Return a stage as an object that Numba compiles."""
    return NJIT(forceinline=inline, **OPTIONS)(function)


def _import_kernels() -> list[Kernel]:
    """Import the modules of this folder with stages that Numba compiles, and return all kernels."""
    kernel_module.fetch_add, kernel_module.lower = _fetch_add, _lower
    CPUContext.get_executable = _not_executable
    for name in ("_optimize_functions", "_optimize_final_module", "_finalize_specific"):
        # `compile_code` optimises and finalises the code, once for each target.
        setattr(JITCodeLibrary, name, lambda *_: None)
    for path in sorted(FOLDER.glob("*.py")):
        if path.stem not in ("__init__", "build", "kernel"):
            importlib.import_module(f"jansen_env.engine.{path.stem}")
    return kernel_module.kernels


def _source_of(parameter: Parameter, names: dict[str, object]) -> str:
    """Return Python code that reads an argument from its slots.

    Args:
        parameter: The argument.
        names: Names that the code uses, and their values; the function adds its own.
    """
    slot, dtype, ndim = parameter.slot, parameter.dtype, parameter.ndim
    assert dtype.names is None or dtype.isalignedstruct, parameter.name
    if ndim == 0:
        words = {"f": "floats[{}]", "b": "bool(words[{}])", "i": "words[{}]"}
        return words[dtype.kind].format(slot)
    lengths = "".join(f"words[{slot + axis}], " for axis in range(1, ndim + 1))
    names[f"dtype_{slot}"] = dtype
    if parameter.apart:
        return f"rows_at(words[{slot}], ({lengths}), words[{slot + ndim + 1}], dtype_{slot})"
    return f"array_at(words[{slot}], ({lengths}), dtype_{slot})"


def _entry(kernel: Kernel) -> tuple[str, str]:
    """Return the LLVM code of a kernel's entry point, and the entry point's symbol in this code.

    The only argument of the entry point is the address of the kernel's slots.
    """
    names: dict[str, object] = {"array_at": array_at, "rows_at": rows_at}
    names |= {"compiled": _lower(kernel.function, True)}
    names |= {"integer": types.int64, "real": types.float64}
    hints = get_type_hints(kernel.function)
    arguments = dict[str, list[str]]()  # code of each argument, and of each entry of a named tuple
    for parameter in kernel.parameters:
        name = parameter.group or parameter.name
        arguments.setdefault(name, []).append(_source_of(parameter, names))
    calls = list[str]()
    for name, entries in arguments.items():
        if hasattr(hints[name], "_fields"):
            names[f"{name}_class"] = hints[name]
            calls.append(f"{name}_class({', '.join(entries)})")
        else:
            calls += entries
    call = f"compiled({', '.join(calls)})"
    result = f"return {call}"
    if kernel.returns in (None, bool):
        result = f"{call}\n    return 0" if kernel.returns is None else f"return 1 if {call} else 0"
    source = (
        f"def {kernel.symbol}(slots):\n"
        f"    words = array_at(slots, ({kernel.slots},), integer)\n"
        f"    floats = array_at(slots, ({kernel.slots},), real)\n"
        f"    {result}\n"
    )
    exec(source, names)
    function: Numba = names[kernel.symbol]  # Its name becomes part of the symbol in the LLVM code.
    entry = NJIT(**OPTIONS)(function)
    entry.compile((types.int64,))
    name = entry.overloads[types.int64,].fndesc.mangled_name
    return entry.inspect_llvm((types.int64,)), name


def _lower_group(symbols: list[str], first_number: int) -> dict[str, str]:
    """Return the LLVM code of kernels and their entry points for any platform, by symbol.

    Args:
        symbols: Symbols of the kernels.
        first_number: Number of the first function. The number is part of the function's name in the
            LLVM code, and the linker merges functions of the same name.
    """
    FunctionIdentity._unique_ids = itertools.count(first_number)
    kernels = {kernel.symbol: kernel for kernel in kernel_module.kernels}
    codes = dict[str, str]()
    for symbol in symbols:
        kernel = kernels[symbol]
        code, name = _entry(kernel)
        kind = "double" if kernel.returns is float else "i64"
        code += (
            f"\ndefine {kind} @{symbol}(i64 %slots) {{\n"
            f"  %result = alloca {kind}\n  %error = alloca ptr\n"
            f"  call i32 @{name}(ptr %result, ptr %error, i64 %slots)\n"
            f"  %value = load {kind}, ptr %result\n  ret {kind} %value\n}}\n"
        )
        code = re.sub(r"(?m)^target (datalayout|triple) = .*$", "", code)
        codes[symbol] = re.sub(r"(?m)^(@\S+ = )common ", r"\1linkonce_odr ", code)
        print(f"jansen_env compiled {symbol}", file=sys.stderr)
    return codes


def lower_kernels(pool: ProcessPoolExecutor) -> list[str]:
    """Return the LLVM code of each kernel and its entry point, for any platform.

    Args:
        pool: Processes that lower the kernels.
    """
    symbols = [kernel.symbol for kernel in _import_kernels()]
    stepping = [symbol for symbol in symbols if symbol.startswith(STEPPING)]
    others = [symbol for symbol in symbols if not symbol.startswith(STEPPING)]
    codes = dict[str, str]()
    for lowered in pool.map(_lower_group, (stepping, others), (1, NUMBERS_APART)):
        codes |= lowered
    return [codes[symbol] for symbol in symbols]


def compile_code(codes: list[str], target: Target) -> bytes:
    """Optimise all kernels as one module, and return the object file.

    Args:
        codes: LLVM code of the kernels, see :func:`lower_kernels`.
        target: Platform of the object file.
    """
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(target.triple).create_target_machine(
        cpu="", features="", opt=SPEED_LEVEL, reloc="pic", codemodel="default"
    )
    layout = str(machine.target_data)
    exported = {kernel.symbol for kernel in kernel_module.kernels} | {"memset"}
    size = "i32" if "p:32" in layout else "i64"
    head = f'target datalayout = "{layout}"\ntarget triple = "{target.triple}"\n'
    whole = llvm.parse_assembly(head + MEMSET.format(size=size))
    for code in codes:
        whole.link_in(llvm.parse_assembly(head + code))
    if target.system == "win32":
        whole.link_in(llvm.parse_assembly(ENTRY))
        exported.add("DllMainCRTStartup")
    for value in (*whole.functions, *whole.global_variables):
        if not value.is_declaration and value.name not in exported:
            value.linkage = "internal"
    whole.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=SPEED_LEVEL)
    options.loop_vectorization = False  # Loops are short; vectorised, they would be slower.
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(whole, builder)
    return bytes(machine.emit_object(whole))


def build(name: str, folder: Path = FOLDER, alone: bool = False) -> Path:
    """Build the library for a platform of :data:`TARGETS`, and return its path.

    Args:
        name: Name of the platform.
        folder: Folder for the library.
        alone: Whether to build the library without WebAssembly.

    Raises:
        RuntimeError: If the sources change during the build.
    """
    names = (name,) if alone else (name, "wasm32")
    targets = [TARGETS[each] for each in dict.fromkeys(names)]
    paths = [library_path(folder, target.system) for target in targets]
    with ProcessPoolExecutor(2, initializer=_import_kernels) as pool:
        objects = [*pool.map(partial(compile_code, lower_kernels(pool)), targets)]
    if library_path(folder, targets[0].system) != paths[0]:
        raise RuntimeError(f"the engine's sources in {FOLDER} have changed while they compiled")
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        for target, path, content in zip(targets, paths, objects, strict=True):
            code, made = Path(scratch, "engine.o"), Path(scratch, path.name)
            code.write_bytes(content)
            link(target, code, made)
            made.replace(path)
    return paths[0]


def is_built() -> bool:
    """Return whether this computer can load its library and the WebAssembly library exists.

    Both libraries must be built from the current sources.
    """
    try:
        ctypes.CDLL(str(library_path()))
    except OSError:  # There is no library, or it was built for another platform.
        return False
    return library_path(platform="wasm").exists()


def link(target: Target, code: Path, library: Path) -> None:
    """Link an object file to a shared library by Zig, which can link for every platform.

    Args:
        target: Platform of the library.
        code: Path of the object file.
        library: Path of the shared library.
    """
    command = "-m", "ziglang", "cc", "-target", target.zig, "-nostdlib", *LINKED_AS[target.system]
    caches = dict.fromkeys(("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"), str(code.parent))
    subprocess.run(
        [sys.executable, *command, "-o", str(library), str(code)],
        check=True,
        env={**os.environ, **caches},
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("target", nargs="?", default=host(), choices=TARGETS)
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where it goes")
    parser.add_argument("--alone", action="store_true", help="without WebAssembly")
    parser.add_argument("--missing", action="store_true", help="only if this folder lacks it")
    parser.add_argument("--tag", action="store_true", help="print the tag of its wheel alone")
    chosen = parser.parse_args()
    if chosen.tag:
        print(TARGETS[chosen.target].tag)
    else:
        there = chosen.missing and is_built()
        if there:
            print(library_path())
        else:
            print(build(chosen.target, chosen.folder, chosen.alone))
