"""Motions are the same, bit for bit, in every version of Python."""

import re
from pathlib import Path

import jansen_env

MOVING = ("baselines", "dynamics", "plants", "robot", "tasks", "terrain", "world")


def test_no_motion_depends_on_the_built_in_sum():
    """It compensates its rounding from Python 3.12 on: ``math.fsum`` is to be used."""
    folders = [Path(jansen_env.__file__).with_name(name) for name in MOVING]
    sources = [path for folder in folders for path in folder.rglob("*.py")]
    assert len(sources) > 40
    for path in sources:
        assert not re.search(r"(?<![\w.])sum\(", path.read_text(encoding="utf-8")), path
