"""Shared by the physics tests: the designs, their tables, seeded random numbers and states; and one
browser for the tests of pages.
"""

import os
import signal
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from browser import browser, firefox, open_window  # noqa: F401 - fixtures: once for all modules
from known_designs import DESIGNS
from numpy.typing import NDArray

from jansen_env.dynamics.reduced import Tables, compile_robot
from jansen_env.robot import Robot
from jansen_env.robot.motor import IDEAL

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # tests open no windows
os.environ.setdefault("OMP_NUM_THREADS", "1")  # as train.py has it; more spin on shared cores


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--numbers", metavar="FILE", help="table of what tests/verification measures")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--numbers") and config.getoption("numprocesses", None):
        raise pytest.UsageError("--numbers must go without -n, got both: one process notes them")


@pytest.fixture(autouse=True, scope="session")
def temporary_folder() -> Iterator[None]:
    """Remove what libraries leave in the temporary folder, such as logs of Stable-Baselines3.

    The path is short, because Ray's sockets are in it.
    """
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", folder)
        patch.setattr(tempfile, "tempdir", folder)
        yield


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240229)


@pytest.fixture(params=DESIGNS.values(), ids=DESIGNS.keys())
def robot(request: pytest.FixtureRequest) -> Robot:
    """Each design in turn."""
    return request.param


@pytest.fixture
def linkage(robot: Robot) -> Robot:
    """Each design with an ideal motor and no dry friction: what the paper's equations know."""
    return replace(robot, motor=IDEAL, bearing_friction=(0.0,) * len(robot.linkage.bearings))


@pytest.fixture
def tables(robot: Robot) -> Tables:
    """The design's tables; equal robots are compiled once."""
    return compile_robot(robot)


@pytest.fixture
def random_state(rng: np.random.Generator) -> Callable[[], NDArray[np.float64]]:
    """Draw (8,) x, y, theta, psi anywhere, and rates of a few m/s and rad/s."""
    return lambda: np.concatenate([rng.uniform(-3.0, 3.0, 4), rng.normal(0.0, 2.0, 4)])


@pytest.fixture
def no_waiting():
    """Fail a test that waits for longer than 20 s, as for a fifo's writer."""

    def fail(number, frame):
        pytest.fail("it waits for ever")

    before = signal.signal(signal.SIGALRM, fail)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)
