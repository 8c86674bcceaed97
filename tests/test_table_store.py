"""Compiled robots on disk: read again bit for bit, made anew where damaged, and cleared up."""

from __future__ import annotations

import errno
import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jansen_env import Payload, files, paper_robot
from jansen_env.dynamics import reduced as rd
from jansen_env.dynamics import table_store
from jansen_env.files import PART, write_text, write_whole

ROBOTS = [replace(paper_robot(), pad_radius=1.0, damping=(0.1 + 0.01 * i,) * 10) for i in range(4)]
SHAPES = {"a": (2, 3), "b": ()}
ARRAYS = {"a": np.arange(6.0).reshape(2, 3), "b": np.array(0.5)}


@pytest.fixture
def folder(monkeypatch, tmp_path) -> Path:
    monkeypatch.setattr(table_store, "FOLDER", str(tmp_path))
    return tmp_path


def compile_robot(robot):
    """As in a new process."""
    return rd._compile.__wrapped__(robot)


def test_tables_are_kept_on_disk(folder, monkeypatch):
    """The next process reads the same bits, with another load too; without a folder nothing is."""
    made = [compile_robot(robot) for robot in ROBOTS[:2]]
    assert len(list(folder.glob("robot-*.npz"))) == len(list(folder.iterdir())) == 2
    with monkeypatch.context() as patched:
        patched.setattr(rd, "_tabulate", None)
        for robot, one in zip(ROBOTS, made, strict=False):
            other = compile_robot(robot)
            assert np.array_equal(one.body, other.body) and np.array_equal(one.pads, other.pads)
            assert one.tail == other.tail and other.body.shape == rd.SHAPES["body"]
    monkeypatch.setattr(table_store, "FOLDER", "")
    assert table_store.load(ROBOTS[0], rd.SHAPES) is None
    table_store.save(ROBOTS[0], {})


def damaged(path, how):
    """Spoil a file of tables."""
    content = path.read_bytes()
    if how == "empty":
        path.write_bytes(b"")
    elif how == "truncated":
        path.write_bytes(content[: len(content) // 2])
    elif how == "a bit flipped":
        path.write_bytes(content[:200] + bytes([content[200] ^ 1]) + content[201:])
    elif how == "text":
        path.write_text("no numbers")
    elif how == "another kind of file":
        with path.open("wb") as file:
            np.save(file, np.zeros(3))
    elif how == "a folder":
        path.unlink()
        (path / "deeper").mkdir(parents=True)
    else:
        changes = {
            "one missing": {"b": None},
            "another shape": {"a": np.zeros((3, 2))},
            "another type": {"a": np.zeros((2, 3), np.float32)},
            "objects": {"b": np.array([None])},
            "not finite": {"a": np.full((2, 3), np.nan)},
        }
        changed = {**ARRAYS, **changes[how]}
        np.savez(path, **{name: array for name, array in changed.items() if array is not None})


@pytest.mark.parametrize(
    "how",
    [
        "empty", "truncated", "a bit flipped", "text", "another kind of file", "a folder",
        "one missing", "another shape", "another type", "objects", "not finite",
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_made_anew(folder, how):
    """Nothing is loaded from it, and what is saved next takes its place."""
    table_store.save(ROBOTS[0], ARRAYS)
    assert table_store.load(ROBOTS[0], SHAPES) is not None
    (path,) = folder.iterdir()
    damaged(path, how)
    assert table_store.load(ROBOTS[0], SHAPES) is None
    table_store.save(ROBOTS[0], ARRAYS)
    found = table_store.load(ROBOTS[0], SHAPES)
    assert all(np.array_equal(found[name], ARRAYS[name]) for name in ARRAYS)


def test_a_robot_with_a_damaged_file_is_compiled(folder):
    """And the file is whole again."""
    made = compile_robot(ROBOTS[0])
    (path,) = folder.iterdir()
    content = path.read_bytes()
    path.write_bytes(b"")
    assert np.array_equal(compile_robot(ROBOTS[0]).body, made.body)
    assert len(path.read_bytes()) == len(content)


def test_the_robot_used_longest_ago_makes_room(folder, monkeypatch):
    """Not the one written first, if it was read since."""
    monkeypatch.setattr(table_store, "KEPT", 3)
    for age, robot in zip((300, 200, 100), ROBOTS, strict=False):
        table_store.save(robot, ARRAYS)
        then = time.time() - age
        os.utime(table_store._place(robot), (then, then))
    table_store.load(ROBOTS[0], SHAPES)
    table_store.save(ROBOTS[3], ARRAYS)
    left = [table_store.load(robot, SHAPES) is not None for robot in ROBOTS]
    assert left == [True, False, True, True]


def test_reading_does_not_need_to_write(folder, monkeypatch):
    """A folder that has become read-only."""
    table_store.save(ROBOTS[0], ARRAYS)

    def refuse(*_):
        raise PermissionError(errno.EROFS, "read-only")

    monkeypatch.setattr(os, "utime", refuse)
    monkeypatch.setattr(table_store, "write_whole", refuse)
    assert table_store.load(ROBOTS[0], SHAPES) is not None
    table_store.save(ROBOTS[1], ARRAYS)
    assert table_store.load(ROBOTS[1], SHAPES) is None


def test_what_killed_processes_left_is_removed(folder):
    """Files being written that are older than an hour; younger ones have a writer."""
    for name, age in (("old.npz", 2 * 3600), ("new.npz", 60)):
        path = folder / f"{PART}{name}"
        path.touch()
        os.utime(path, (time.time() - age, time.time() - age))
    table_store.save(ROBOTS[0], ARRAYS)
    assert [path.name for path in folder.glob(f"{PART}*")] == [f"{PART}new.npz"]


def test_many_at_once_do_not_trip_over_each_other(folder, monkeypatch):
    """Eight writers and readers with room for two files: whole ones or none are read."""
    monkeypatch.setattr(table_store, "KEPT", 2)

    def work(index):
        robot, read = replace(ROBOTS[0], payload=Payload(float(index % 4))), 0
        for _ in range(20):
            table_store.save(robot, ARRAYS)
            found = table_store.load(robot, SHAPES)
            read += found is not None and np.array_equal(found["a"], ARRAYS["a"])
        return read

    with ThreadPoolExecutor(8) as pool:
        assert min(pool.map(work, range(8))) > 0
    assert not list(folder.glob(f"{PART}*"))


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
