"""Arguments that type checkers know are those that environments take; mypy finds wrong calls."""

import inspect
import subprocess
import sys
from pathlib import Path

import pytest
from gymnasium.envs.registration import load_env_creator, registry

from jansen_env.envs import typed
from jansen_env.scoring.benchmarks import BENCHMARKS

OWN = {"num_envs", "autoreset_mode", "threads", "info_keys"}  # of JansenVectorEnv's constructor
ROOT = Path(__file__).parents[2]


def named(entry):
    return {*inspect.signature(load_env_creator(entry)).parameters}


def test_typed_arguments_are_those_of_environments():
    every = set()
    for env_id in BENCHMARKS:
        family = {"JansenCrank-v0": "Crank", "JansenGoal-v0": "Goal"}.get(env_id, "Walker")
        single = {*getattr(typed, f"{family}Arguments").__annotations__}
        assert named(registry[env_id].entry_point) == single
        every |= named(registry[env_id].vector_entry_point)
    assert every == {*typed.ManyArguments.__annotations__} | OWN


@pytest.mark.slow
def test_mypy_finds_wrong_calls():
    pytest.importorskip("mypy")
    files = ["examples/typed_walk.py", "tests/typed/wrong_calls.py"]
    command = [sys.executable, "-m", "mypy", "--strict", *files]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout
