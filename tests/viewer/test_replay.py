"""``jansen-env replay``: what it writes, and what it refuses."""

import json
import re

from jansen_env.cli.replay import main
from jansen_env.viewer.recording import Recording


def data_of(page):
    text = page.read_text(encoding="utf-8")
    return json.loads(re.search(r'id="data">(.*?)</script>', text)[1])


def test_two_policies_start_alike(tmp_path, capsys):
    out = tmp_path / "walk.html"
    command = "--policy pid --policy constant --command 0.1 --seed 3 --steps 5"
    main([*command.split(), "--out", str(out)])
    pid, other = (Recording.load(tmp_path / f"walk_{name}.npz") for name in ("pid", "constant"))
    assert (pid.label, pid.steps, pid.seed, pid.command[0]) == ("pid", 5, 3, 0.1)
    assert pid.state[0].tolist() == other.state[0].tolist()
    assert pid.state[5].tolist() != other.state[5].tolist()
    assert [track["label"] for track in data_of(out)["recordings"]] == ["pid", "constant"]
    assert capsys.readouterr().out.count("written: ") == 3


def test_saved_ones_are_shown_again(tmp_path):
    out = tmp_path / "a.html"
    main(["--policy", "pid", "--env", "JansenCrank-v0", "--steps", "3", "--out", str(out)])
    saved = str(tmp_path / "a_pid.npz")
    main(["--recording", saved, "--recording", saved, "--out", str(tmp_path / "b.html")])
    data = data_of(tmp_path / "b.html")
    assert [track["label"] for track in data["recordings"]] == ["pid (1)", "pid (2)"]
    assert data["recordings"][0]["arrays"] == data_of(out)["recordings"][0]["arrays"]
