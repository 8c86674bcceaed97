"""A walk under a policy has the same bits on every processor: its hash is written here.

Whoever changes the physics on purpose writes down what ``python tests/walk_hashes.py`` prints.
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
HASHES = {  # of one robot, and of a batch
    "walker": ["c22a45786bfe13b4", "4da2dc410502997e"],
    "built": ["e0f7b797626f4a1a", "7c807f7378eabf10"],
    "rough": ["f6419c5991647665", "93f338396766b3b4"],
    "hardcore": ["443992c6d639cdcf", "4f10393c2b218905"],
    "goal": ["00c8e0bcb7303740", "7caa39eb1f5e17ba"],
    "crank": ["c456f9d36ae7eaa8", "96b4406658f6a800"],
    "strider on a slope": ["6dbd1ccda1c0b140", "ccf05f40751cdd56"],
    "waves": ["93203febaec3cb95", "021552f3d9933238"],
}
OPTIONAL = " ".join(name for name in __cpu_dispatch__ if __cpu_features__[name])
CODE_FOR = {
    "this processor": {},
    "the C library's oldest": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-AVX,-FMA"},
    "NumPy's oldest": {"NPY_DISABLE_CPU_FEATURES": OPTIONAL},
    "BLAS's oldest": {"OPENBLAS_CORETYPE": "Nehalem"},
}


@pytest.mark.parametrize("kind", CODE_FOR)
def test_walks_have_their_hashes_with_code_for(kind):
    """Observations, rewards and ends of all environments, alone and in batches."""
    if CODE_FOR[kind] and platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("these variables choose among code for x86-64")
    environment = {**os.environ, **CODE_FOR[kind]}
    done = subprocess.run(
        [sys.executable, str(SCRIPT)], env=environment, capture_output=True, text=True, check=True
    )
    assert json.loads(done.stdout) == HASHES
