"""What a user is told while the kernels are compiled."""

from __future__ import annotations

import logging

from jansen_env import Terrain, compiling, paper_robot
from jansen_env.plants.projection import ProjectionPlant


def test_compilation_is_announced_once(monkeypatch, tmp_path, caplog):
    """Where no compiled kernel lies on disk, with the folder; not again, and not where one lies."""
    monkeypatch.setattr(compiling, "_announced", set())
    monkeypatch.setattr(compiling, "FOLDER", str(tmp_path))
    with caplog.at_level(logging.WARNING, logger="jansen_env"):
        for _ in range(2):
            ProjectionPlant(paper_robot(), Terrain.flat())
        assert len(caplog.records) == 1 and str(tmp_path) in caplog.text
        (tmp_path / "numba").mkdir()
        (tmp_path / "numba" / "kernels.advance-7.py311.1.nbc").touch()
        monkeypatch.setattr(compiling, "_announced", set())
        compiling.announce("kernels.advance")
        assert len(caplog.records) == 1
        monkeypatch.setattr(compiling, "FOLDER", "")
        compiling.announce("pinned_kernel.turn")
    assert "cannot keep it" in caplog.records[-1].message
