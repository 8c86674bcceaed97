"""Numba's compiler without what this package has no use for: in half of the time.

Left out are the passes for closures, array expressions, literals and ``with``. Stages get no
machine code: they are optimised in the kernels that they are linked into.
"""

from __future__ import annotations

import contextlib
import gc
import threading
from collections.abc import Callable, Iterator
from typing import Any

import llvmlite.binding as llvm
import numba
from numba.core import compiler, typed_passes, untyped_passes
from numba.core.caching import CompileResultCacheImpl
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import LoweringPass, PassManager, register_pass

OPTIMISATION = 1  # level of LLVM: up to 3 it takes longer, and its code is no faster
PASSES = (
    untyped_passes.TranslateByteCode,
    untyped_passes.FixupArgs,
    untyped_passes.IRProcessing,
    untyped_passes.GenericRewrites,
    untyped_passes.InlineInlinables,
    untyped_passes.ReconstructSSA,
    typed_passes.NopythonTypeInference,
    typed_passes.PreLowerStripPhis,
    typed_passes.AnnotateTypes,
    typed_passes.NativeLowering,
    typed_passes.NoPythonBackend,
)
_config: Any = numba.config
_function_type: Any = numba.types.BaseFunction
_lock = threading.RLock()


class StageLibrary(JITCodeLibrary):
    """The intermediate code of a stage."""

    def _optimize_final_module(self) -> None:
        """Leave that to kernels."""

    def _finalize_final_module(self) -> None:
        self._finalized = True


class KernelCompiler(compiler.CompilerBase):
    """Compiles what Python calls."""

    def define_pipelines(self) -> list[Any]:
        manager = PassManager("kernel")
        for each in PASSES:
            manager.add_pass(each, each.__name__)
        manager.finalize()
        return [manager]


@register_pass(mutates_CFG=False, analysis_only=True)
class _StageEntry(LoweringPass):
    """Gives a stage the entry point by which numba tells functions apart."""

    _name = "stage_entry"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        lowered = state["cr"]._replace(cfunc=_entry(state.func_id.func_name))
        linked = [state["library"]]
        state.targetctx.insert_user_function(lowered.cfunc, lowered.fndesc, linked)
        state["cr"] = lowered
        return True


def _entry(name: str) -> Any:
    """Return a function in C unlike any other, whose error tells who calls a stage from Python."""
    return f"{{{name} is a stage, which compiled functions alone can call}}".format


class StageCompiler(KernelCompiler):
    """Compiles what only compiled functions call."""

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        stage = StageLibrary(self.state.targetctx.codegen(), func.__qualname__)
        self.state["library"] = stage
        return super().compile_extra(func)

    def define_pipelines(self) -> list[Any]:
        self.state.flags.no_compile = self.state.flags.no_cpython_wrapper = True
        (manager,) = super().define_pipelines()
        manager.add_pass_after(_StageEntry, typed_passes.NativeLowering)
        manager.finalize()
        return [manager]


class StageFile(CompileResultCacheImpl):
    """What is kept of a stage on the disk."""

    def reduce(self, cres: Any) -> Any:
        cres.fndesc.typemap = cres.fndesc.calltypes = None  # large, and of no use to others
        stage = cres._asdict()["library"]
        code = stage._get_module_for_linking().as_bitcode()
        return stage.name, code, cres.fndesc, cres.signature

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        name, code, fndesc, signature = payload
        library = StageLibrary(target_context.codegen(), name)
        library._final_module = llvm.parse_bitcode(code)
        library._finalized = True
        return compiler.compile_result(
            target_context=target_context, typing_context=target_context.typing_context,
            library=library, entry_point=_entry(name), fndesc=fndesc, signature=signature,
            objectmode=False, lifted=(), reload_init=[],
        )  # fmt: skip


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Compile fast: what is set meanwhile is set for the whole process.

    Types that functions return are looked up once: numba tries ten signatures at every ``+``. There
    is no garbage collection, which takes a tenth of the time and finds next to nothing, and no code
    for long loops.
    """
    known = dict[Any, Any]()

    def known_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        key = id(self), *map(id, args)  # there are no two equal types
        if kws or key not in known:
            known[key] = call_type(self, context, args, kws), self, args
        return known[key][0]

    with _lock:
        collects, call_type = gc.isenabled(), _function_type.get_call_type
        level, vectors = _config.OPT, _config.LOOP_VECTORIZE
        gc.disable()
        _config.OPT, _config.LOOP_VECTORIZE = type(level)(min(level, OPTIMISATION)), 0
        _function_type.get_call_type = known_type
        try:
            yield
        finally:
            _function_type.get_call_type = call_type
            _config.OPT, _config.LOOP_VECTORIZE = level, vectors
            if collects:
                gc.enable()
