"""A walk under a policy has the same bits on every processor: ``tests/walk_hashes.json``.

Whoever changes the physics on purpose writes there what ``python tests/walk_hashes.py`` prints.
"""

import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

SCRIPT = Path(__file__).parents[1] / "walk_hashes.py"
HASHES = SCRIPT.with_suffix(".json")
OPTIONAL = " ".join(name for name in __cpu_dispatch__ if __cpu_features__[name])
CODE_FOR = {
    "this processor": {},
    "the C library's oldest": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-AVX,-FMA"},
    "NumPy's oldest": {"NPY_DISABLE_CPU_FEATURES": OPTIONAL},
    "BLAS's oldest": {"OPENBLAS_CORETYPE": "Nehalem"},
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", CODE_FOR)
def test_walks_have_their_hashes_with_code_for(kind):
    """Observations, rewards and ends of all environments, alone and in batches."""
    if CODE_FOR[kind] and platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("these variables choose among code for x86-64")
    environment = {**os.environ, **CODE_FOR[kind]}
    printed = subprocess.check_output([sys.executable, SCRIPT], env=environment)
    assert json.loads(printed) == json.loads(HASHES.read_text())
