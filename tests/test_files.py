"""Files are written atomically: the old one or the new one, and nothing beside it."""

import errno
import os
from pathlib import Path

import pytest

from jansen_env import files
from jansen_env.files import PART, plain_yaml, write_text, write_whole
from jansen_env.policies import pretrained
from jansen_env.sb3.trained import read_model
from jansen_env.viewer.recording import Recording
from jansen_env.viewer.saved_walk import walk_again


def test_files_are_on_the_disk_before_they_are_moved(tmp_path, monkeypatch):
    """The file is synced under its temporary name, then moved, then the folder is synced."""
    events = []
    sync, move = files._sync, os.replace
    monkeypatch.setattr(files, "_sync", lambda p, f: (events.append(Path(p).name), sync(p, f)))
    monkeypatch.setattr(os, "replace", lambda a, b: (events.append("moved"), move(a, b)))
    path = write_text(tmp_path / "note.txt", "whole")
    assert path.read_text() == "whole"
    assert events[0].startswith(PART) and events[1:] == ["moved", tmp_path.name]


def test_a_file_that_fails_leaves_the_old_one(tmp_path):
    path = write_text(tmp_path / "note.txt", "old")

    def fail(name):
        Path(name).write_text("half")
        raise OSError(errno.ENOSPC, "full")

    with pytest.raises(OSError, match="full"):
        write_whole(path, fail)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


READERS = [Recording.load, walk_again, pretrained.load_file, plain_yaml.read_yaml, read_model]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no fifos")
@pytest.mark.parametrize("read", READERS, ids=lambda read: read.__name__)
def test_a_fifo_is_refused(read, tmp_path, no_waiting):
    """All who read users' files refuse it by its name; opening it would wait for a writer."""
    os.mkfifo(tmp_path / "fifo")
    with pytest.raises(ValueError, match=r"fifo.* regular file"):
        read(tmp_path / "fifo")


@pytest.mark.skipif(os.name != "posix", reason="POSIX has a umask")
@pytest.mark.parametrize("umask", [0o022, 0o077, 0o002])
def test_files_follow_the_umask(umask, tmp_path):
    before = os.umask(umask)
    try:
        for _ in range(2):
            path = write_text(tmp_path / "note.txt", "whole")
            assert path.stat().st_mode & 0o777 == 0o666 & ~umask
    finally:
        os.umask(before)
