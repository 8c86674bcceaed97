"""Run Python with code for another processor than this one, so that rounding differs:

    python tests/processor.py generic -m pytest -m processor
    python tests/processor.py avx2 -m pytest -n auto --dist loadfile

``generic`` is any x86-64 processor, ``avx2`` one with AVX2 and FMA but without AVX-512. Numba,
PyTorch, NumPy, OpenBLAS, MKL, oneDNN and the C library choose their code by these variables; what
this processor or NumPy's build lacks is left out.
"""

import os
import platform
import sys

from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

WIDE = ("X86_V4", "AVX512")  # groups of AVX-512 begin so
VARIABLES = {
    "generic": {
        "NUMBA_CPU_NAME": "generic",
        "ATEN_CPU_CAPABILITY": "default",
        "OPENBLAS_CORETYPE": "Nehalem",
        "MKL_ENABLE_INSTRUCTIONS": "SSE4_2",
        "ONEDNN_MAX_CPU_ISA": "SSE41",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-AVX,-FMA",
    },
    "avx2": {
        "NUMBA_CPU_NAME": "haswell",
        "ATEN_CPU_CAPABILITY": "avx2",
        "OPENBLAS_CORETYPE": "Haswell",
        "MKL_ENABLE_INSTRUCTIONS": "AVX2",
        "ONEDNN_MAX_CPU_ISA": "AVX2",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F",
    },
}


def variables(kind: str) -> dict[str, str]:
    """Return the environment variables of a kind of processor."""
    optional = [name for name in __cpu_dispatch__ if __cpu_features__[name]]
    off = [name for name in optional if kind == "generic" or name.startswith(WIDE)]
    return {
        **VARIABLES[kind],
        "NUMBA_CPU_FEATURES": "",  # those of the processor's name
        "NPY_DISABLE_CPU_FEATURES": " ".join(off),
    }


def main() -> None:
    """Replace this process by Python with these variables."""
    kind, *arguments = sys.argv[1:] or [""]
    if kind not in VARIABLES:
        sys.exit(f"processor is {kind!r}, must be one of {[*VARIABLES]}")
    if platform.machine() not in ("x86_64", "AMD64"):
        sys.exit(f"processor is {platform.machine()}, must be x86_64")
    os.execve(sys.executable, [sys.executable, *arguments], {**os.environ, **variables(kind)})


if __name__ == "__main__":
    main()
