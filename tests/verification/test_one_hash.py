"""A walk has the same bits on every processor: ``jansen_env/scoring/walk_hashes.json``."""

import json
import os
import platform
import subprocess
import sys

import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

from jansen_env.registration import IDS
from jansen_env.scoring.walk_hashes import WALKS, hash_walk, published_hashes

OPTIONAL = " ".join(name for name in __cpu_dispatch__ if __cpu_features__[name])
CODE_FOR = {
    "this processor": {},
    "the C library's oldest": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-AVX,-FMA"},
    "NumPy's oldest": {"NPY_DISABLE_CPU_FEATURES": OPTIONAL},
    "BLAS's oldest": {"OPENBLAS_CORETYPE": "Nehalem"},
}
ADVICE = """\
{walk} is another walk than the published one, so results of {env_id} no longer compare with earlier
ones. If you did not mean to change it, find out why it changed. If you did, register the changed
environment under a new id, such as -v1, with hashes of its own, and keep the old id as it was. Only
before the first release may hashes be replaced: python -m jansen_env.scoring.walk_hashes"""


@pytest.mark.parametrize("name", WALKS)
def test_environments_have_not_changed(name):
    """Observations, rewards and ends of one robot, under random actions and pretrained policies."""
    walk, (published, _) = WALKS[name], published_hashes()[name]
    assert hash_walk(walk) == published, ADVICE.format(walk=repr(name), env_id=walk.env_id)


@pytest.mark.parametrize("random", [False, True])
def test_every_environment_has_a_published_walk(random):
    of_package = {env_id for env_id in IDS if env_id.startswith("Jansen")}
    walked = {
        walk.env_id for walk in WALKS.values() if not walk.arguments and walk.random is random
    }
    assert of_package <= walked, "add the new environment to WALKS, and its hashes to the file"
    assert published_hashes().keys() == WALKS.keys()


@pytest.mark.slow
@pytest.mark.parametrize("kind", CODE_FOR)
def test_walks_have_their_hashes_with_code_for(kind):
    """Walks of one robot and of batches."""
    if CODE_FOR[kind] and platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("these variables choose among code for x86-64")
    environment = {**os.environ, **CODE_FOR[kind]}
    command = [sys.executable, "-m", "jansen_env.scoring.walk_hashes"]
    printed = subprocess.check_output(command, env=environment)
    assert json.loads(printed) == published_hashes()
