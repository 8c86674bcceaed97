"""Run folders that are in use, full, read-only or damaged: one line, and nothing good is lost."""

import errno
import os
import shutil
import subprocess
import sys

import pytest
from small_runs import go_on, outcome, same, small_run

import train
from agents.training import runs
from jansen_env.files import PART

resource = pytest.importorskip("resource")
pytestmark = pytest.mark.usefixtures("few_episodes")


@pytest.fixture(scope="module")
def killed(tmp_path_factory, few_episodes):
    """Settings, a run killed with two checkpoints, and what comes of it if it is not."""
    settings = small_run("sac")
    whole, folder = (tmp_path_factory.mktemp("sac") for _ in range(2))
    go_on(settings, whole)
    go_on(settings, folder, killed_after=400)
    return settings, folder, outcome(whole)


@pytest.fixture
def run(killed, tmp_path):
    return shutil.copytree(killed[1], tmp_path / "run")


@pytest.mark.slow
def test_a_full_disk(killed, run):
    """Where files may not become larger, training ends in one line, and continues once there is
    room.
    """
    before = {path: path.read_bytes() for path in run.rglob("*.zip")}
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    try:
        with pytest.raises(SystemExit, match="training stopped at") as stopped:
            go_on(killed[0], run)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    reason = str(stopped.value)
    assert os.strerror(errno.EFBIG) in reason and f"--resume {run} goes on" in reason
    assert "\n" not in reason and not list(run.rglob(f"{PART}*"))
    assert before == {path: path.read_bytes() for path in run.rglob("*.zip")}
    go_on(killed[0], run)
    assert same(outcome(run), killed[2])


@pytest.mark.slow
def test_other_files_among_the_checkpoints_are_left_alone(run):
    known = runs.last_state(run)
    for name in ("model_9x_steps.zip", "model__steps.zip", f"model_{'9' * 5000}_steps.zip"[:200]):
        (run / "checkpoints" / name).write_bytes(b"")
    assert runs.last_state(run) == known


@pytest.mark.slow
def test_two_runs_in_one_folder(killed, run):
    """The second run is refused and changes nothing. A killed run leaves no lock."""
    hold = (
        "import sys, pathlib; from agents.training.runs import locked\n"
        "with locked(pathlib.Path(sys.argv[1])): print('held', flush=True); sys.stdin.read()"
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    holder = subprocess.Popen([sys.executable, "-c", hold, str(run)], **pipes)
    assert holder.stdout.readline() == b"held\n"
    commands = (run / "command.txt").read_bytes()
    with pytest.raises(SystemExit, match="is in use by another process"):
        train.main(["--resume", str(run)])
    assert (run / "command.txt").read_bytes() == commands
    (run / f"{PART}1.zip").touch()
    holder.kill()
    holder.communicate()
    with runs.locked(run):
        assert not list(run.glob(f"{PART}*"))


def test_no_run_in_a_folder(tmp_path):
    with pytest.raises(SystemExit, match=r"config\.yml cannot be read"):
        train.main(["--resume", str(tmp_path / "none")])
    assert not list(tmp_path.iterdir())
