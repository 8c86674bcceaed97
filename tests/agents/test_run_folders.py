"""Run folders that are in use, full, read-only or damaged: one line, and nothing good is lost."""

import errno
import os
import shutil
import subprocess
import sys

import pytest
from small_runs import go_on, outcome, same, small_run

import train
from agents.training import callbacks, runs
from jansen_env.files import PART

resource = pytest.importorskip("resource")


@pytest.fixture(autouse=True, scope="module")
def few_episodes():
    """One episode for each evaluation's command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(callbacks, "EPISODES", 1)
        yield


@pytest.fixture(scope="module", params=["ppo", "sac"])
def killed(request, tmp_path_factory):
    """Settings, a run killed with two checkpoints, and what comes of it if it is not."""
    settings = small_run(request.param)
    whole, folder = (tmp_path_factory.mktemp(request.param) for _ in range(2))
    go_on(settings, whole)
    go_on(settings, folder, killed_after=400)
    return settings, folder, outcome(whole)


@pytest.fixture
def run(killed, tmp_path):
    return shutil.copytree(killed[1], tmp_path / "run")


def checkpoints(run):
    found = (run / "checkpoints").glob("model_*_steps.zip")
    return sorted(found, key=lambda path: int(path.stem.split("_")[1]))


@pytest.mark.parametrize("part", [0.0, 0.001, 0.3, 0.7, 0.999])
def test_a_checkpoint_cut_short_gives_way_to_the_one_before(part, killed, run, capsys):
    before, last = checkpoints(run)[-2:]
    for damaged in (last, *run.glob(f"replay_buffer_{last.stem.split('_')[1]}.npz")):
        shutil.copytree(killed[1], run, dirs_exist_ok=True)
        os.truncate(damaged, int(part * damaged.stat().st_size))
        capsys.readouterr()
        assert runs.last_state(run) == before
        out = capsys.readouterr().out
        assert out.count("\n") == 1 and str(damaged) in out and "the checkpoint before" in out
    go_on(killed[0], run)
    assert same(outcome(run), killed[2])


def test_a_full_disk(killed, run):
    """Files that may not become larger: training ends in one line, and goes on with room."""
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


def test_two_runs_in_one_folder(killed, run):
    """The second is told who is there; it has changed nothing. A killed one leaves no lock."""
    hold = (
        "import sys, pathlib; from agents.training.runs import locked\n"
        "with locked(pathlib.Path(sys.argv[1])): print('held', flush=True); sys.stdin.read()"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", hold, str(run)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert holder.stdout.readline() == b"held\n"
    commands = (run / "command.txt").read_bytes()
    with pytest.raises(SystemExit, match=f"is in use by process {holder.pid} on "):
        train.main(["--resume", str(run)])
    assert (run / "command.txt").read_bytes() == commands
    (run / f"{PART}1.zip").touch()
    holder.kill()
    holder.communicate()
    with runs.locked(run):
        assert not list(run.glob(f"{PART}*"))


def test_what_is_not_ours_stays(run):
    """A folder called as half-written files are, and a command.txt that is no UTF-8."""
    (run / f"{PART}x").mkdir()
    (run / "command.txt").write_bytes(b"\xff\n")
    with runs.locked(run):
        runs.record_run(run, {}, "python train.py")
    assert (run / f"{PART}x").is_dir()
    assert (run / "command.txt").read_bytes() == b"\xff\npython train.py\n"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no fifos")
def test_a_fifo_among_the_checkpoints(run, capsys, no_waiting):
    fifo = run / "checkpoints" / "model_999999_steps.zip"
    os.mkfifo(fifo)
    assert runs.last_state(run) == checkpoints(run)[-2]
    out = capsys.readouterr().out
    assert out.count("\n") == 1 and f"{fifo} is no Stable-Baselines3 model" in out
    assert "not a regular file" in out


def test_a_read_only_folder(run, monkeypatch):
    def refuse(lock, timeout):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(run / ".lock"))

    monkeypatch.setattr(runs.FileLock, "acquire", refuse)
    with pytest.raises(SystemExit, match=r"run cannot be written to: .*Read-only file system"):
        train.main(["--resume", str(run)])


def test_no_run_in_a_folder(tmp_path):
    with pytest.raises(SystemExit, match=r"config\.yml cannot be read"):
        train.main(["--resume", str(tmp_path / "none")])
    assert not list(tmp_path.iterdir())
