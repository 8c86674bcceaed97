"""Files are written atomically: the old one or the new one, and nothing beside it."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import pytest

from jansen_env import files
from jansen_env.files import PART, write_json, write_text, write_whole


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
    """And nothing beside it."""
    path = write_text(tmp_path / "note.txt", "old")

    def fail(name):
        Path(name).write_text("half")
        raise OSError(errno.ENOSPC, "full")

    with pytest.raises(OSError, match="full"):
        write_whole(path, fail)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_a_list_of_numbers_is_one_line_of_json(tmp_path):
    """Whatever brackets and line breaks strings have; values stay as they are."""
    value = {"a": [1, -2.5e-3, None], "b": [[], [3]], "c": ["[\n 1,\n 2]", "x"], "d": [{"e": [4]}]}
    text = write_json(tmp_path / "value.json", value).read_text()
    assert json.loads(text) == value
    assert ' "a": [1, -0.0025, null],\n' in text and '"e": [4]\n' in text and '"x"\n' in text
