"""``jansen-env benchmark`` runs policies, writes result files, and reproduces them."""

import json
from dataclasses import replace

import pytest

from jansen_env.__main__ import main
from jansen_env.cli import benchmark
from jansen_env.scoring import result_files
from jansen_env.scoring.protocol import TRACKS, Part
from jansen_env.scoring.result_files import read_result


@pytest.fixture(autouse=True)
def few_episodes(monkeypatch, tmp_path):
    """Give each track two episodes, and work in a temporary folder."""
    for name, track in TRACKS.items():
        part = Part("part", commands=(0.2, 0.3), levels=track.parts[0].levels[:1])
        monkeypatch.setitem(TRACKS, name, replace(track, parts=(part,)))
    hashes = {"projection": "0" * 16, "rigid_body": "0" * 16}
    monkeypatch.setattr(result_files, "plant_hashes", lambda: hashes)
    monkeypatch.chdir(tmp_path)


def refused(capsys, *arguments):
    """Return the error of a command that must refuse its arguments."""
    with pytest.raises(SystemExit) as ended:
        main(["benchmark", *arguments])
    assert ended.value.code == 2
    return capsys.readouterr().err.splitlines()[0]


def test_a_policy_is_scored_and_reproduced(tmp_path, capsys):
    main(["benchmark", "--policy", "pretrained", "--out", "x.json", "--all"])
    printed = capsys.readouterr().out
    assert "| pretrained " in printed and "| return of " in printed
    result = read_result(tmp_path / "x.json")
    assert [*result.tracks] == [*TRACKS] and result.name == "pretrained"
    assert result.tracks["onboard"].policy == "pretrained:onboard"
    assert len({track.sha256 for track in result.tracks.values()}) == 5  # flat and transfer share
    main(["benchmark", "--reproduce", "x.json", "--tracks", "flat", "terrain"])
    assert capsys.readouterr().out.count("2 of 2 episodes equal") == 2


def test_a_difference_is_the_exit_status(tmp_path, capsys):
    main(["benchmark", "--policy", "pid", "--tracks", "flat", "--out", "x.json"])
    content = json.loads((tmp_path / "x.json").read_text())
    content["tracks"]["flat"]["episodes"]["return"][0] += 1.0
    (tmp_path / "x.json").write_text(json.dumps(content))
    with pytest.raises(SystemExit) as ended:
        main(["benchmark", "--reproduce", "x.json"])
    assert ended.value.code == 1 and "1 of 2 episodes equal" in capsys.readouterr().out


def test_two_algorithms_are_compared(capsys):
    main(["benchmark", "--policy", "pid", "--tracks", "flat", "--out", "pid.json"])
    main(["benchmark", "--policy", "stand", "--tracks", "flat", "--out", "stand.json"])
    capsys.readouterr()
    main(["benchmark", "pid.json", "stand.json"])
    printed = capsys.readouterr().out
    assert "P(pid > stand)" in printed and "1.00 [1.00, 1.00]" in printed


def test_a_function_makes_a_policy(tmp_path, monkeypatch, capsys):
    (tmp_path / "mine.py").write_text(
        "import numpy as np\n\n\nclass Push:\n"
        "    def predict(self, observation, state=None, episode_start=None, deterministic=False):\n"
        "        return np.full((len(observation), 1), 0.2, np.float32), state\n\n\n"
        "def policy(env):\n    return Push()\n\n\ndef nothing(env):\n    return None\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    main(["benchmark", "--policy", "mine:policy", "--tracks", "flat", "--out", "x.json"])
    track = read_result(tmp_path / "x.json").tracks["flat"]
    assert track.policy == "mine:policy" and len(track.sha256 or "") == 64
    error = refused(capsys, "--reproduce", "x.json")  # a file must not choose code that runs
    assert "must get results of policies of the package, got 'mine:policy'" in error
    for name, message in (
        ("mine:nothing", "must return an object with the method predict, got None"),
        ("mine:other", "module mine has no function other"),
        ("none_such:policy", "module none_such cannot be imported"),
    ):
        assert message in refused(capsys, "--policy", name, "--tracks", "flat", "--out", "y.json")


def test_a_policy_for_each_track(tmp_path):
    arguments = [
        "--policy",
        "pid",
        "--policy",
        "terrain=stand",
        "--name",
        "both",
        "--out",
        "x.json",
    ]
    main(["benchmark", *arguments, "--tracks", "flat", "terrain"])
    result = read_result(tmp_path / "x.json")
    assert result.name == "both"
    assert {name: track.policy for name, track in result.tracks.items()} == {
        "flat": "pid",
        "terrain": "stand",
    }


def test_tracks_that_a_policy_cannot_play_are_left_out(tmp_path, capsys):
    main(["benchmark", "--policy", "pretrained:robust", "--out", "x.json"])
    assert [*read_result(tmp_path / "x.json").tracks] == ["flat", "transfer"]
    assert "left out terrain: policy must be one of" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give --policy to run a policy, or result files"),
        (["--policy", "pid"], "--policy must come with --out"),
        (["--reproduce", "x.json", "--policy", "pid"], "--reproduce cannot be combined"),
        (["--policy", "fat=pid", "--out", "x.json"], "did you mean 'flat'?"),
        (["--policy", "pid", "--policy", "profile", "--out", "x.json"], "was given twice"),
        (["--policy", "dog", "--out", "x.json"], "'dog'"),
        (
            ["--policy", "flat=pid", "--tracks", "robust", "--out", "x.json"],
            "--policy must name a policy",
        ),
        (["--policy", "pid", "--name", "a|b", "--out", "x.json"], "--name must be text"),
        (["--policy", "pid", "--out", f"{__file__}/x.json"], "--out must be a folder"),
        (["none.json"], "none.json cannot be read"),
        ([__file__], "is not a result file"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message, capsys, tmp_path):
    assert message in refused(capsys, *arguments)
    assert not [*tmp_path.iterdir()]


def test_a_changed_policy_is_not_reproduced(monkeypatch, capsys):
    main(["benchmark", "--policy", "pretrained", "--tracks", "flat", "--out", "x.json"])
    monkeypatch.setattr(benchmark, "policy_sha256", lambda *_: "0" * 64)
    assert "must have the SHA-256" in refused(capsys, "--reproduce", "x.json")
