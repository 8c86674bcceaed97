"""Commands end in one line, or none, whatever stops them: signals, full disks, wrong numbers."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from importlib.machinery import ExtensionFileLoader
from pathlib import Path

import numpy as np
import pytest

from jansen_env.__main__ import main
from jansen_env.cli.loading import runs_command
from jansen_env.cli.process import guarded
from jansen_env.robot import ROBOTS
from jansen_env.robot.robot_file import robot_from_json, robot_to_json
from jansen_env.viewer.recording import Recording

ROOT = Path(__file__).parents[1]
PACKAGES = os.pathsep.join([str(ROOT), str(ROOT / "workshop")])
JANSEN = ("-m", "jansen_env")
WORKSHOP = ("-m", "jansen_workshop")
LOG = ROOT / "workshop" / "measurements" / "synthetic_economy_1.csv"
COMMANDS = [
    (*JANSEN, "mjcf", "paper"),
    (*JANSEN, "--help"),
    (*WORKSHOP, "measurements", "--help"),
    ("-m", "agents.tune", "--help"),
    (*WORKSHOP, "measurements", str(LOG)),
]
STATUSES = [("SIGTERM", 143), ("SIGHUP", 129), ("SIGINT", 130)]
"""Signals and the exit statuses of commands that they end."""
posix = pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no POSIX signals")


def start(*arguments, **kwargs):
    return subprocess.Popen(
        [sys.executable, *arguments],
        stderr=subprocess.PIPE,
        text=True,
        cwd=kwargs.pop("cwd", ROOT),
        env={
            **os.environ,
            "PYTHONPATH": PACKAGES,
            "PYTHONUNBUFFERED": "",
            "SDL_VIDEODRIVER": "dummy",
        },
        **kwargs,
    )


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_full_disk_is_told_in_one_line(command):
    with open("/dev/full", "w") as full:
        process = start(*command, stdout=full)
        told = process.communicate(timeout=120)[1]
    assert process.returncode == 1
    assert told.splitlines()[-1].endswith("error: the output: No space left on device")
    assert "Traceback" not in told and "Exception" not in told


def test_a_reader_that_ends_is_no_error():
    process = start(*JANSEN, "mjcf", "built", stdout=subprocess.PIPE)
    process.stdout.close()
    assert process.communicate(timeout=120)[1] == "" and process.returncode in (0, 1)


@pytest.mark.slow
@posix
@pytest.mark.parametrize(("name", "status"), STATUSES)
def test_a_film_that_is_stopped_leaves_nothing(name, status, tmp_path):
    command = (*JANSEN, "enjoy", "--video", "a.gif", "--episodes", "50")
    process = start(*command, stdout=subprocess.DEVNULL, cwd=tmp_path)
    until = time.monotonic() + 60.0
    while not [*tmp_path.iterdir()] and time.monotonic() < until:
        time.sleep(0.05)
    process.send_signal(getattr(signal, name))
    assert process.communicate(timeout=60)[1] == "" and process.returncode == status
    assert not [*tmp_path.iterdir()]


SLOW_IMPORT = """
import sys, time
class Slow:
    def find_spec(self, name, path=None, target=None):
        if name == "gymnasium":
            print("loading", flush=True)
            time.sleep(60)
sys.meta_path.insert(0, Slow())
sys.argv = {argv}
{run}
"""


@posix
@pytest.mark.parametrize(
    ("argv", "run"),
    [
        (["jansen-env", "mjcf", "paper"], "from jansen_env.__main__ import main; main()"),
        (
            [str(ROOT / "train.py")],
            "import runpy; runpy.run_path(sys.argv[0], run_name='__main__')",
        ),
    ],
    ids=["jansen-env", "train.py"],
)
def test_ctrl_c_during_imports_is_quiet(argv, run):
    process = start("-c", SLOW_IMPORT.format(argv=argv, run=run), stdout=subprocess.PIPE)
    assert process.stdout.readline() == "loading\n"
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=60)[1] == ""
    assert process.returncode == -signal.SIGINT  # shells show 130


def test_programs_that_import_the_package_keep_their_signals(monkeypatch, tmp_path):
    assert not runs_command()  # pytest
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "train.py")])
    assert not runs_command()  # somebody else's
    monkeypatch.setattr(sys, "argv", [str(ROOT / "train.py")])
    assert runs_command()
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    with guarded("it"):
        assert signal.getsignal(signal.SIGINT) is not before[1]
    assert (signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)) == before


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (MemoryError(), "it: error: there is not enough memory; reduce the size of the task\n"),
        (OSError(28, "Disk is full", "a.gif"), "it: error: a.gif: Disk is full\n"),
    ],
)
def test_errors_of_the_machine_are_told_in_one_line(error, told, capsys):
    with pytest.raises(SystemExit, match="1"), guarded("it"):
        raise error
    assert capsys.readouterr().err == told


def test_what_a_library_makes_of_ctrl_c_is_no_traceback():
    with pytest.raises(SystemExit, match="130"), guarded("it"):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as error:
            raise ImportError("while it was loaded") from error


@posix
@pytest.mark.parametrize(("name", "status"), STATUSES)
def test_a_signal_that_comes_in_a_destructor_is_not_lost(name, status, capsys):
    class Freed:
        def __del__(self):
            signal.raise_signal(getattr(signal, name))

    hook = sys.unraisablehook
    with pytest.raises(SystemExit) as stopped, guarded("it"):
        Freed()
        time.sleep(60)
    assert stopped.value.code == status and capsys.readouterr().err == ""
    assert sys.unraisablehook is hook


@posix
@pytest.mark.parametrize(("name", "status"), STATUSES)
def test_a_signal_that_comes_while_an_extension_is_loaded_is_not_lost(name, status):
    """Some extensions ignore exceptions of the modules that they import."""

    class Ignoring(ExtensionFileLoader):
        def create_module(self, spec):
            with contextlib.suppress(BaseException):
                signal.raise_signal(getattr(signal, name))

    with pytest.raises(SystemExit) as stopped, guarded("it"):
        Ignoring("module", "module.so").create_module(None)
        time.sleep(60)
    assert stopped.value.code == status


@pytest.mark.parametrize(
    "arguments",
    [
        ["evaluate", "--policy", "pid", "--episodes", "1e10"],
        ["evaluate", "--policy", "pid", "--random-commands", "1e10"],
        ["enjoy", "--episodes", "1e10"],
    ],
    ids=" ".join,
)
def test_numbers_are_bounded(arguments, capsys):
    with pytest.raises(SystemExit):
        main(arguments)
    assert "must be a whole number from 1 to " in capsys.readouterr().err.splitlines()[0]


@pytest.mark.parametrize(
    "arguments",
    [
        ["evaluate", "--policy", "pid", "--out", ""],
        ["paper", "--out", " "],
        ["play", "--out", ""],
        ["enjoy", "--video", ""],
        ["replay", "--out", ""],
        ["mjcf", "paper", "--out", ""],
    ],
    ids=" ".join,
)
def test_an_empty_path_is_refused(arguments, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main(arguments)
    assert "must be a path, got an empty string" in capsys.readouterr().err.splitlines()[0]
    assert not [*tmp_path.iterdir()]


def test_a_link_with_a_long_name_is_refused_when_it_is_loaded():
    content = robot_to_json(ROBOTS["klann"]())
    text = str(content).replace("'rod'", f"'{'r' * 300}'")
    with pytest.raises(ValueError, match=r"must have at most 60 bytes, .* got 300 bytes"):
        robot_from_json(eval(text))


def test_a_recording_whose_label_cannot_be_written_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    main(["replay", "--policy", "pid", "--steps", "3"])
    (file,) = tmp_path.glob("*.npz")
    arrays = dict(np.load(file))
    text = arrays["description"].tobytes().decode().replace('"label": "pid"', '"label": "\\ud800"')
    arrays["description"] = np.frombuffer(text.encode(), np.uint8)
    np.savez(file, **arrays)
    with pytest.raises(ValueError, match="half of a surrogate pair"):
        Recording.load(file)
