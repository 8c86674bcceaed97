"""A program in C walks with the engine's library alone, and with the same bits as in Python."""

import platform
import subprocess
import sys
from pathlib import Path

import pytest
from library_walk import WALKS, write_walk

from jansen_env.engine.kernel import built_library

SOURCE = Path(__file__).with_name("walk_library.c")


@pytest.fixture(scope="module")
def walker(tmp_path_factory):
    """Compile the program in C and return its path."""
    pytest.importorskip("ziglang")
    if sys.platform != "linux":
        pytest.skip("compiled for Linux, and by .ci/windows for Windows")
    program = tmp_path_factory.mktemp("walk") / "walk_library"
    target = f"{platform.machine()}-linux-gnu"
    compiler = [sys.executable, "-m", "ziglang", "cc", "-target", target, "-O1", "-ldl"]
    subprocess.run([*compiler, "-o", str(program), str(SOURCE)], check=True)
    return program


@pytest.mark.slow
@pytest.mark.parametrize("name", WALKS)
def test_a_program_in_c_walks_with_the_same_bits(name, walker, tmp_path):
    expected = write_walk(tmp_path / "walk", *WALKS[name])
    command = [str(walker), str(built_library()), str(tmp_path / "walk")]
    told = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    assert told.strip() == expected


@pytest.mark.slow
def test_a_walk_that_is_cut_short_is_refused(walker, tmp_path):
    write_walk(tmp_path / "walk", *WALKS["built"])
    content = (tmp_path / "walk").read_bytes()
    (tmp_path / "walk").write_bytes(content[: len(content) // 2])
    command = [str(walker), str(built_library()), str(tmp_path / "walk")]
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1 and done.stderr == "walk_library: the walk is cut short\n"
