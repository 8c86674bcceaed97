"""Arguments that type checkers know are those that environments take; mypy finds wrong calls."""

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

from jansen_env.scoring.benchmarks import BENCHMARKS, single_env, vector_env

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("env_id", BENCHMARKS)
def test_arguments_are_the_settings(env_id):
    """Type checkers see those of the settings' constructors; at run time they are the same."""
    single, many = single_env(env_id), vector_env(env_id)
    known = inspect.signature(single).parameters
    assert {*known} == {*inspect.signature(single.SETTINGS).parameters}
    own = {"num_envs", "max_episode_steps", "autoreset_mode", "threads", "info_keys"}
    assert {*inspect.signature(many).parameters} == {*known} | own
    assert many.PRESET == single.PRESET and {*single.PRESET} <= {*known}


@pytest.mark.slow
def test_mypy_finds_wrong_calls():
    pytest.importorskip("mypy")
    files = ["examples/typed_walk.py", "tests/typed/wrong_calls.py"]
    command = [sys.executable, "-m", "mypy", "--strict", *files]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout
