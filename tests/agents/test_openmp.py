"""OpenMP's threads of a training: what train.py sets for them, and what the user has set."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from agents import SPINS, WAITING

ROOT = Path(__file__).parents[2]
GNU = "gomp" in "".join(path.name for path in Path(torch.__file__).parents[1].rglob("libgomp*"))


def started(module, **given):
    """What OpenMP says of its settings when ``module`` is imported."""
    others = {k: v for k, v in os.environ.items() if k not in ("OMP_NUM_THREADS", *WAITING)}
    env = {**others, **given, "OMP_DISPLAY_ENV": "VERBOSE", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", f"import {module}"],
        env=env,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stderr


@pytest.mark.slow
@pytest.mark.skipif(not GNU, reason="torch has no OpenMP of GNU's here")
@pytest.mark.parametrize(
    ("given", "spins", "threads"),
    [
        ({}, SPINS, "1"),
        ({"GOMP_SPINCOUNT": "5"}, "5", "1"),
        ({"OMP_WAIT_POLICY": "active", "OMP_NUM_THREADS": "2"}, "30000000000", "2"),
        ({"OMP_WAIT_POLICY": "passive"}, "0", "1"),
    ],
)
def test_waiting_threads_sleep_soon_unless_the_user_says_otherwise(given, spins, threads):
    """The variables are set before torch is loaded; otherwise GNU's OpenMP would not read them."""
    said = started("train", **given)
    assert f"GOMP_SPINCOUNT = '{spins}'" in said
    assert f"OMP_NUM_THREADS = '{threads}'" in said
