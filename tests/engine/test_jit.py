"""Where machine code is kept, what happens if it cannot be, and what a user is told."""

import logging
import os
import pickle
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from jansen_env.engine.jit import Kernel, compiled, prepare
from jansen_env.engine.parts import parts
from jansen_env.engine.second_process import Task, compile_all
from numba import float64, njit, typeof

from jansen_env import Terrain, paper_robot
from jansen_env.commands.compile import main as compile_ahead
from jansen_env.engine import jit, second_process
from jansen_env.plants.fixed_base import FixedBasePlant
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.tasks.walking import WalkerTask

PACKAGE = Path(jit.__file__).parents[1]
NAME = re.compile("jansen-[0-9a-f]{16}")
on_posix = pytest.mark.skipif(os.name != "posix", reason="folders' modes are POSIX's")


@pytest.fixture
def silent(monkeypatch):
    """Nothing has been said in this process yet."""
    monkeypatch.setattr(jit, "_told", set())


@pytest.fixture
def places(monkeypatch, tmp_path):
    """NUMBA_CACHE_DIR, the package and the user's caches: three empty folders, none refused yet."""
    monkeypatch.setattr(jit, "_refused", [])
    package, numba_cache, user = (tmp_path / name for name in ("package", "numba", "user"))
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    numba_cache.mkdir(), user.mkdir()
    monkeypatch.setattr(jit, "__file__", str(package / "engine" / "jit.py"))
    monkeypatch.setattr(jit, "_user_cache", lambda: user)
    monkeypatch.setattr(jit._config, "CACHE_DIR", str(numba_cache))
    return numba_cache, package / "__pycache__", user / "jansen_env"


def block(folder):
    """Let a file stand where a folder should be: not even root can write there."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.touch()


def successor(x):
    return x + 1


def predecessor(x):
    return x - 1


def magnitude(x):
    return abs(x)


def test_preparing_says_how_far_it_is(silent, monkeypatch, tmp_path, caplog):
    """Where machine code is kept, once, and what is compiled; nothing where all is on disk."""
    monkeypatch.setattr(jit, "FOLDER", str(tmp_path))

    def messages():
        caplog.clear()
        kernels = compiled(successor), compiled(predecessor)
        prepare(*(Kernel(f"number {k}", kernels[k], (0.5,)) for k in (0, 1)))
        assert all(len(kernel.overloads) == 1 for kernel in kernels)
        assert kernels[0](1.5) == 2.5 and len(kernels[0].overloads) == 1
        return [record.message for record in caplog.records]

    with caplog.at_level(logging.WARNING, logger="jansen_env"):
        where, first, second = messages()
        assert str(tmp_path) in where
        assert first.endswith("compiles 1 of 2: number 0")
        assert second.endswith("compiles 2 of 2: number 1")
        assert messages() == []
        monkeypatch.setattr(jit, "FOLDER", "")
        assert len(messages()) == 2
        monkeypatch.setattr(jit, "_told", set())
        assert "cannot keep it" in messages()[0]


def test_parts_have_the_types_that_the_time_step_gives_them():
    """Or they would be compiled twice, and not side by side."""
    ProjectionPlant(paper_robot(), Terrain.flat())
    for part in parts():
        kept = part.function._cache._cache_file._load_index()
        assert {key[0] for key in kept} == {tuple(map(typeof, part.arguments))}, part.subject


@pytest.mark.parametrize("code", ["raise SystemExit(1)", "import time; time.sleep(60)"])
def test_without_the_second_process_all_is_compiled_here(code, monkeypatch):
    """It fails, or does nothing; what only it would do is waited for, and then done here."""
    monkeypatch.setattr(second_process, "_CODE", code)
    monkeypatch.setattr(second_process, "PATIENCE", 0.5)
    monkeypatch.setattr(second_process, "available_cores", lambda: 2)
    one, other, last = (Task("", njit(f), (float64,)) for f in (successor, predecessor, magnitude))
    said = []
    compile_all([one], [other], [last], lambda task: False, lambda *line: said.append(line[:2]))
    assert all(task.function.overloads for task in (one, other, last))
    assert said == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.parametrize("where", ["one core", "a frozen program", "Python in a program"])
def test_no_second_process(where, monkeypatch):
    """There is none where it has no core, or would be another program than Python."""
    monkeypatch.setattr(second_process, "available_cores", lambda: 1 if where == "one core" else 2)
    monkeypatch.setattr(sys, "frozen", where == "a frozen program", raising=False)
    if where == "Python in a program":
        monkeypatch.setattr(sys, "executable", "/usr/bin/blender")
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: pytest.fail("a process was started"))
    assert second_process._start([]) is None


@pytest.mark.slow
def test_everything_is_compiled_ahead(tmp_path):
    """By ``jansen-env compile``: nothing is left to say, and every part was found."""
    tmp_path.chmod(0o700)
    command = [sys.executable, "-W", "ignore", "-m", "jansen_env", "compile"]
    there = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    for again in (False, True):
        ended = subprocess.run(command, env=there, capture_output=True, text=True, timeout=600)
        assert ended.returncode == 0, ended.stderr
        assert ("compiles" in ended.stdout) != again
        assert f"MB in {tmp_path.resolve()}" in ended.stdout


def test_nothing_is_compiled_ahead_where_it_cannot_be_kept(monkeypatch):
    """The command ends with one line, and an exit status that is not 0."""
    monkeypatch.setattr(jit, "FOLDER", "")
    with pytest.raises(SystemExit, match="NUMBA_CACHE_DIR can name one"):
        compile_ahead(["JansenCrank-v0"])
    with pytest.raises(SystemExit, match="2"):
        compile_ahead(["JansenWalk-v0"])


def test_nothing_is_compiled_after_make():
    """Nor read from the disk: reset and step, alone and batched, on both plants and the crank.

    In a process of its own: other tests may have left machine code for more types.
    """
    code = """
import gc
import gymnasium as gym
from numba.core.dispatcher import Dispatcher
import jansen_env

def known():
    functions = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    return {f"{each.__module__}.{each.__name__}": len(each.overloads) for each in functions}

for make, name, more in (
    (gym.make, "JansenWalker-v0", {}),
    (gym.make, "JansenWalker-v0", {"terrain": "slope:0.1", "payload": 1.0, "robot": "holy"}),
    (gym.make_vec, "JansenWalker-v0", {"num_envs": 3, "terrain": ["flat", "slope:0.1", "flat"]}),
    (gym.make, "JansenWalker-v0", {"plant": "rigid_body"}),
    (gym.make, "JansenCrank-v0", {}),
):
    env = make(name, **more)
    made = known()
    env.reset(seed=0)
    for _ in range(100):
        env.step(env.action_space.sample())
    assert known() == made, {*known().items()} - {*made.items()}
print("done")
"""
    assert python(code)[0] == "done\n"


def test_kernels_that_allocate_nothing_count_no_references():
    """No NRT_incref or NRT_decref in their machine code: ``_nrt=False`` works. Others have them."""
    ProjectionPlant(paper_robot(), Terrain.flat())
    FixedBasePlant(paper_robot())
    WalkerTask()
    counting = {"runge_kutta.turn_each"}
    for name in {
        "integrator.advance",
        "collision.planes_near",
        "placement.lower",
        "walk_reward.finish_step",
    } | counting:
        files = list(Path(jit.FOLDER).rglob(f"{name}-*.nbc"))
        assert files
        for file in files:
            assert (b"NRT_" in file.read_bytes()) == (name in counting), name


def test_the_first_folder_that_can_be_written_to(places):
    """NUMBA_CACHE_DIR, the package, the user's caches, none; named after the sources in each."""
    names = set()
    for place in places:
        folder = Path(jit._cache_folder())
        assert folder.parent == place.resolve() and folder.is_dir() and not any(folder.iterdir())
        names.add(folder.name)
        block(place)
    assert jit._cache_folder() == ""
    assert len(names) == 1 and NAME.fullmatch(names.pop())


RECALL = """
import numpy as np
from jansen_env.engine.collision import recall
from jansen_env.engine.jit import FOLDER, Kernel, prepare
from jansen_env.engine.records import ROBOT
none = np.arange(0), np.zeros((0, 8)), np.zeros(0, ROBOT)
for _ in range(2): prepare(Kernel("candidates", recall, none))
print(recall(*none), FOLDER)
"""


def python(code, **variables):
    """Output and errors of a process with these environment variables."""
    ended = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code], env={**os.environ, **variables},
        cwd=variables.get("PYTHONPATH"), capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    return ended.stdout, ended.stderr


class Planted:
    """Makes a file when it is unpickled."""

    def __init__(self, file):
        self.file = str(file)

    def __reduce__(self):
        return open, (self.file, "w")


@on_posix
def test_machine_code_that_others_may_have_planted_is_not_run(tmp_path):
    """In a NUMBA_CACHE_DIR where everybody may write: a line, and the next folder."""
    shutil.copytree(PACKAGE, tmp_path / "jansen_env", ignore=shutil.ignore_patterns("__pycache__"))
    shared = tmp_path / "shared"

    def run():
        found, said = python(RECALL, PYTHONPATH=str(tmp_path), NUMBA_CACHE_DIR=str(shared))
        recalled, folder = found.split()
        assert recalled == "False"
        return Path(folder), said

    folder, said = run()
    assert folder.parent == shared.resolve() and "keeps no machine code" not in said
    indices = list(folder.rglob("*.nbi"))
    assert indices
    for path in indices:
        path.write_bytes(pickle.dumps(Planted(tmp_path / "stolen")))
    folder.chmod(0o777)
    other, said = run()
    assert not (tmp_path / "stolen").exists()
    assert other.parent == (tmp_path / "jansen_env" / "__pycache__").resolve()
    assert said.count(f"keeps no machine code in {folder}: others can write") == 1
    assert "remove it" in said and run() == (other, "")  # nothing to compile, nothing to say


@on_posix
@pytest.mark.parametrize("mode", [0o770, 0o702, 0o1777])
@pytest.mark.parametrize("place", ["the folder", "above it", "above what it is a link to"])
def test_folders_where_others_may_write(place, mode, places):
    """Are refused in one line, at any level; a sticky bit above keeps everybody's own safe."""
    if place == "above what it is a link to":
        (places[0].parent / "far").mkdir()
        places[0].rmdir()
        places[0].symlink_to(places[0].parent / "far" / "near")
        (places[0].parent / "far" / "near").mkdir()
        open_to_all = places[0].parent / "far"
    elif place == "above it":
        open_to_all = places[0]
    else:
        open_to_all = Path(jit._cache_folder())
    open_to_all.chmod(mode)
    found = Path(jit._cache_folder())
    safe = mode & 0o1000 and place != "the folder"
    assert found.parent == places[0 if safe else 1].resolve()
    assert len(jit._refused) == (0 if safe else 1)
    if not safe:
        assert f"others can write to {open_to_all.resolve()}" in jit._refused[0]
        assert NAME.search(jit._refused[0])
        left = [path for path in places[0].iterdir() if path != open_to_all]
        assert left == []  # nothing new is left behind


@on_posix
@pytest.mark.parametrize("level", ["the folder", "above it", "the root folder"])
def test_folders_of_another_user(level, places, monkeypatch):
    """Are refused, also to root; not root's, nor the root folder's owner's, as in containers."""
    first = Path(jit._cache_folder())
    theirs = {"the folder": [first], "above it": [places[0].resolve()]}.get(
        level, first.parents[1:]
    )
    lstat, owner = Path.lstat, first.stat().st_uid
    other = 65534 if level == "the root folder" else owner + 1

    def of_another(path):
        fields = list(lstat(path))
        fields[4] = other if path in theirs else fields[4]
        return os.stat_result(fields)

    monkeypatch.setattr(Path, "lstat", of_another)
    if level == "the root folder":
        assert Path(jit._cache_folder()) == first and jit._refused == []
        return
    assert Path(jit._cache_folder()).parent == places[1].resolve()
    (line,) = jit._refused
    assert f"{theirs[0]} belongs to user {other}" in line
    monkeypatch.setattr(os, "geteuid", lambda: other)
    assert (Path(jit._cache_folder()) == first) == (owner == 0)


@on_posix
def test_a_link_in_the_folders_place_is_refused(places):
    """What it leads to keeps its mode."""
    folder, elsewhere = Path(jit._cache_folder()), places[0].parent / "elsewhere"
    folder.rmdir()
    elsewhere.mkdir()
    elsewhere.chmod(0o755)
    folder.symlink_to(elsewhere)
    assert Path(jit._cache_folder()).parent == places[1].resolve()
    assert f"{folder} is a link or a file" in jit._refused[0]
    assert elsewhere.stat().st_mode & 0o777 == 0o755


@on_posix
def test_a_folder_is_a_users_own_whatever_the_umask(places):
    """With a umask that lets a group write, in a NUMBA_CACHE_DIR that is not there yet."""
    shutil.rmtree(places[0])
    before = os.umask(0o002)
    try:
        folder = Path(jit._cache_folder())
    finally:
        os.umask(before)
    assert folder.parent == places[0].resolve()
    assert folder.stat().st_mode & 0o777 == 0o700 and places[0].stat().st_mode & 0o777 == 0o755


def test_folders_of_other_sources_are_removed_when_unused(places):
    """Those not used for 30 days, when a new one is made; all others stay."""
    long_ago = time.time() - 31 * 24 * 3600
    names = {"jansen-0123456789abcdef": long_ago, "jansen-thesis": long_ago, "other": long_ago}
    names["jansen-fedcba9876543210"] = time.time()
    for name, used in names.items():
        (places[0] / name / "deeper").mkdir(parents=True)
        (places[0] / name / "deeper" / "code.nbc").touch()
        os.utime(places[0] / name, (used, used))
    new = Path(jit._cache_folder())
    left = {path.name for path in places[0].iterdir()}
    assert left == {*names, new.name} - {"jansen-0123456789abcdef"}
    os.utime(new, (long_ago, long_ago))
    assert Path(jit._cache_folder()) == new
    assert time.time() - new.stat().st_mtime < 3600.0  # marked as used


def test_machine_code_is_read_again(monkeypatch, tmp_path):
    """By the next process; a damaged file is compiled again and replaced."""
    monkeypatch.setattr(jit, "FOLDER", str(tmp_path))

    def hits():
        function = compiled(successor)
        assert function(1) == 2
        return sum(function.stats.cache_hits.values())

    assert hits() == 0 and hits() == 1
    for pattern in ("*.nbi", "*.nbc"):
        for damage in (b"", b"garbage"):
            (path,) = tmp_path.rglob(pattern)
            path.write_bytes(damage)
            assert hits() == 0 and hits() == 1, (pattern, damage)


def test_machine_code_goes_with_copies_of_the_sources(tmp_path):
    """Whose times are others, as after an installation and in layers of containers."""
    tmp_path.chmod(0o700)
    shutil.copytree(PACKAGE, tmp_path / "jansen_env", ignore=shutil.ignore_patterns("__pycache__"))
    place = {"PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    assert "compiles 1 of 1: candidates" in python(RECALL, **place)[1]
    for path in (tmp_path / "jansen_env").rglob("*.py"):
        os.utime(path, (0, 0))
    assert python(RECALL, **place)[1] == ""


def test_machine_code_for_other_types_is_not_run(monkeypatch, tmp_path):
    """Two processes that write at once may leave an index that names the other's file."""
    monkeypatch.setattr(jit, "FOLDER", str(tmp_path))
    function = compiled(successor)
    assert function(1) == 2 and function(0.5) == 1.5
    one, other = tmp_path.rglob("*.nbc")
    content = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(content)
    for _ in range(2):
        function = compiled(successor)
        assert function(0.5) == 1.5 and function(1) == 2


def test_a_folder_that_cannot_be_written_to_later_does_no_harm(
    silent, monkeypatch, tmp_path, caplog
):
    """It has become a file since: the function runs, and it is said once."""
    folder = tmp_path / "cache"
    folder.mkdir()
    monkeypatch.setattr(jit, "FOLDER", str(folder))
    with caplog.at_level(logging.WARNING, logger="jansen_env"):
        first, second = compiled(successor), compiled(successor)
        block(folder)
        assert first(1) == second(1) == 2
    assert len(caplog.records) == 1 and "cannot keep its machine code" in caplog.text
    assert compiled(successor)(1) == 2  # nor where it is so from the beginning


def test_the_package_runs_where_nothing_can_be_written(tmp_path):
    """A process with no folder for machine code imports, runs, and says so once."""
    shutil.copytree(PACKAGE, tmp_path / "jansen_env", ignore=shutil.ignore_patterns("__pycache__"))
    block(tmp_path / "jansen_env" / "__pycache__")
    nowhere = str(tmp_path / "jansen_env" / "__pycache__" / "cache")
    names = ("HOME", "LOCALAPPDATA", "NUMBA_CACHE_DIR", "USERPROFILE", "XDG_CACHE_HOME")
    found, said = python(RECALL, PYTHONPATH=str(tmp_path), **dict.fromkeys(names, nowhere))
    assert found == "False \n"
    assert said.count("cannot keep it") == 1


def test_what_is_not_compiled_does_the_same():
    """With NUMBA_DISABLE_JIT, which debuggers want, to the last bit of an observation."""
    code = (
        "import gymnasium as gym, jansen_env, numpy as np\n"
        "for name in ('JansenWalker-v0', 'JansenCrank-v0'):\n"
        "    more = {} if 'Crank' in name else {'noise': {}, 'push': {}}\n"
        "    env = gym.make_vec(name, num_envs=2, **more)\n"
        "    env.reset(seed=0)\n"
        "    print(env.step(np.full((2, 1), 0.5, np.float32))[0].tobytes().hex())\n"
    )
    seen = {python(code, NUMBA_DISABLE_JIT=disabled)[0] for disabled in ("0", "1")}
    assert len(seen) == 1
