"""Kernels: what they take, and the library that they are in."""

import multiprocessing
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from jansen_env.engine import ground_lines, integrator
from jansen_env.engine.kernel import FOLDER, PYTHON, library_path

POINTS = np.array([[3.0, 4.0], [0.0, 1.0]])
WALK = """
import gymnasium as gym, jansen_env
seen = []
for arguments in ({}, {"observe": "onboard", "noise": {}}):
    env = gym.make("JansenWalkerBuilt-v0", **arguments)
    seen.append(env.reset(seed=3)[0].tobytes().hex())
    for _ in range(4):
        observation, reward, *_ = env.step([0.4])
        seen += [observation.tobytes().hex(), float(reward).hex()]
print(seen)
"""


def run(code, folder=FOLDER.parents[1], **variables):
    """Run Python code with the package of a folder; returns the completed process."""
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
    )


@pytest.fixture
def copy(tmp_path):
    """A second checkout, in a path with a space."""
    folder = tmp_path / "a copy"
    leave_out = shutil.ignore_patterns("__pycache__", "*.zip", "*.gif")
    shutil.copytree(FOLDER.parent, folder / "jansen_env", ignore=leave_out)
    return folder


@pytest.mark.skipif(PYTHON, reason="plain Python checks no types, and raises its own errors")
def test_arguments_that_are_no_such_arrays_are_refused():
    other_axes = (POINTS[0], POINTS.T, POINTS[:, ::-1])
    for wrong in (POINTS.astype("f4"), POINTS.tolist(), *other_axes, None):
        with pytest.raises(TypeError, match=r"points must be contiguous float64 of 2 axes, got .*"):
            ground_lines.put_line(wrong, np.zeros((2, 2)))
    with pytest.raises(TypeError, match="ground_lines_put_line must have 2 arguments, got 1"):
        ground_lines.put_line(POINTS)


def test_a_kernel_is_pickled_by_its_name():
    assert pickle.loads(pickle.dumps(integrator.advance)) is integrator.advance


def walk():
    """A robot's observations in a short walk, as bytes."""
    import jansen_env  # noqa: F401 - in another process

    with gym.make("JansenWalker-v0") as env:
        env.reset(seed=1)
        return b"".join(env.step([0.5])[0].tobytes() for _ in range(5))


@pytest.mark.parametrize("method", multiprocessing.get_all_start_methods())
def test_other_processes_walk_alike(method):
    with multiprocessing.get_context(method).Pool(1) as pool:
        assert pool.apply(walk) == walk()


def test_python_itself_walks_alike():
    compiled, python = run(WALK), run(WALK, JANSEN_ENV_PYTHON="1")
    assert compiled.returncode == 0 and compiled.stdout == python.stdout, python.stderr
    assert python.stderr == ""


def test_two_checkouts_have_a_library_each(copy):
    loaded = run("from jansen_env.engine import kernel; print(kernel._libraries())", copy)
    assert str(copy) in loaded.stdout and loaded.stderr == ""
    with (copy / "jansen_env/engine/lemke.py").open("a") as file:
        file.write("# another\n")
    other = run("from jansen_env.engine.kernel import library_path; print(library_path())", copy)
    assert Path(other.stdout.strip()).name != library_path().name


def test_an_older_library_is_refused_by_name_where_none_can_be_built(copy):
    with (copy / "jansen_env/engine/lemke.py").open("a") as file:
        file.write("# changed\n")
    before = sorted(path.name for path in (copy / "jansen_env/engine").iterdir())
    without = "import importlib.util as util; util.find_spec = lambda *_: None\n"
    for load in ("_libraries()", "built_library('wasm')"):
        ended = run(f"{without}from jansen_env.engine import kernel; kernel.{load}", copy)
        last = ended.stderr.strip().splitlines()[-1]
        assert ended.returncode == 1 and "sources have changed since it was built" in last
    assert "wasm is missing" in last
    after = sorted(path.name for path in (copy / "jansen_env/engine").iterdir())
    assert [name for name in after if name != "__pycache__"] == before


def test_an_older_library_is_built_again(copy):
    """It is built once, for processor and browser, and says so in one line; the build itself is
    that of every installation.
    """
    pytest.importorskip("numba", reason="the group 'engine' is not installed")
    engine = copy / "jansen_env/engine"
    (engine / "build.py").write_text(f"""import sys
sys.path[0] = {str(copy)!r}
import shutil
from jansen_env.engine.kernel import library_path
for platform in (sys.platform, "wasm"):
    path = library_path(platform=platform)
    shutil.copy(path.with_stem({library_path().stem!r}), path)
""")
    both = "from jansen_env.engine import kernel; kernel.built_library('wasm')\n" + WALK
    ended = run(both, copy)
    assert ended.returncode == 0 and ended.stderr.count("builds its engine") == 1
    assert ended.stdout == run(WALK).stdout
    assert run(both, copy).stderr == ""


@pytest.mark.slow
def test_an_installation_builds_a_library_that_is_missing_or_of_another_machine(copy):
    code = "from jansen_env.engine.build import is_built; print(is_built())"
    assert run(code, copy).stdout == "True\n"
    for name in (library_path().name, library_path(platform="wasm").name):
        path = copy / "jansen_env/engine" / name
        content = path.read_bytes()
        path.write_bytes(b"") if path.suffix != ".wasm" else path.unlink()
        assert run(code, copy).stdout == "False\n"
        path.write_bytes(content)


def test_nothing_is_written_at_run_time(copy):
    before = sorted(copy.rglob("*"))
    assert run(WALK, copy, PYTHONDONTWRITEBYTECODE="1").returncode == 0
    assert sorted(copy.rglob("*")) == before
