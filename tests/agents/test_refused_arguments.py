"""Commands refuse arguments in one line, before they run or write anything."""

from pathlib import Path

import pytest

from agents import export, tune
from benchmarks import speed
from jansen_env.cli import enjoy, evaluate, replay
from jansen_env.policies import pretrained
from jansen_workshop.commands import drawings, predict

HASHES = Path(__file__).parents[2] / "jansen_env" / "scoring" / "walk_hashes.json"
POLICY = pretrained.shipped("JansenCrank-v0")
REFUSED = {
    (evaluate, "--policy", "constant", "--out", "out"): [
        (["--env-kwargs", "{max_episode_steps: -1}"], "max_episode_steps"),
        (["--env-kwargs", "{fricton: 1}"], "fricton"),
        (["--env-kwargs", "{friction: 1, friction: 2}"], "friction"),
        (["--env-kwargs", "{speed_command: 0.3}"], "speed_command"),
        (["--env-kwargs", "{render_mode: human}"], "render_mode must be None or 'rgb_array'"),
        (["--policy", "dog"], "dog"),
        (["--policy", "constant"], "constant"),
        (["--episodes", "0"], "0"),
        (["--episodes", "many"], "many"),
        (["--seed", "-1"], "-1"),
        (["--commands", "9"], "must be between"),
        (["--out", f"{__file__}/out"], "must be a folder that can be written to, got"),
        (["--env", "JansenCrank-v0", "--plant", "rigid_body"], "which has only one plant"),
        (["--env", "JansenCrank-v0", "--levels", "1"], "--env must be one of"),
        (["--levels", "1", "--robustness"], "--levels cannot be combined with --robustness"),
    ],
    (export, "--to", "c", "--out", "out"): [
        ([str(POLICY), "--env", "JansenCrank-v0"], "ppo.json, whose files name the environment"),
        (["none"], "must be the file of a model"),
        (["pretrained:none"], "policy must be one of"),
        (["pretrained", "--name", "a b"], "name must be a letter"),
    ],
    (tune, "pid"): [
        (["--out", f"{__file__}/out"], "must be a folder that can be written to, got"),
    ],
    (predict, "built"): [
        *((["--speeds", value], "--speeds") for value in ("0", "20", "nan")),
        (["--out", f"{__file__}/p.json"], "--out's folder must be"),
    ],
    (speed,): [
        (["--rounds", "0"], "0"),
        (["--only", "x"], "x"),
        (["--out", f"{__file__}/out"], "out"),
    ],
    (drawings,): [
        (["nobody"], "ROBOT must be a robot file (.json) or one of"),
        ([str(HASHES)], "walk_hashes.json is not a robot file"),
        (["built", "--sheet", "400x300"], "--sheet must hold foot of 453x226 mm"),
        (["built", "--sheet", "wide"], "--sheet: must be WIDTHxHEIGHT in mm"),
        (["built", "--sheet", "nanx1"], "--sheet: must be WIDTHxHEIGHT in mm"),
        (["built", "--fit", "1,2"], "--fit: must be one of ["),
        (["klann", "--as-robot-file", "k.txt"], "must end in .json"),
        (["klann", "--as-robot-file", f"{__file__}/k.json"], "its folder must be"),
    ],
    (enjoy, "--env", "JansenCrank-v0"): [
        (["--policy", "nobody"], "policy must be a run's folder, "),
        (["--policy", "pretrained:none"], "policy must be one of"),
        (["--command", "99"], "must be between"),
        (["--env-kwargs", "{speed_command: 2}"], "speed_command has no effect in --env-kwargs"),
        (["--env-kwargs", "{render_mode: human}"], "render_mode must be None or 'rgb_array'"),
        (["--env-kwargs", "{robot: none}"], "robot must be a robot file (.json) or one of"),
        (["--video", "a.avi"], "the video must end in one of ['.gif', '.mp4'], got a.avi"),
        (["--video", f"{__file__}/a.gif"], "a.gif"),
    ],
    (enjoy, "--env", "JansenGoal-v0"): [
        (["--command", "5"], "options['goal'] must be between -3.0 and 3.0")
    ],
    (replay,): [
        (["--policy", "pid"] * 3, "must be given once or twice in all, got 3"),
        (["--policy", "pid", "--policy", "pid"], "must be given only once"),
        (["--policy", "pid", "--out", "walk.htm"], "must end in .html"),
        (["--policy", "pid", "--steps", "20001"], "must be at most 20000"),
        (
            ["--policy", "pid", "--env-kwargs", "{speed_command: 1}"],
            "has no effect in --env-kwargs; give --command",
        ),
        (["--recording", "nowhere.npz"], "nowhere.npz is not a recording"),
    ],
}


@pytest.mark.parametrize(
    ("command", "given", "message"),
    [(command, *row) for command, rows in REFUSED.items() for row in rows],
    ids=lambda value: value[0].__name__ if isinstance(value, tuple) else str(value),
)
def test_arguments_are_refused(command, given, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    module, *before = command
    with pytest.raises(SystemExit) as error:
        module.main([*before, *given])
    assert error.value.code == 2
    assert message in capsys.readouterr().err.splitlines()[0]
    assert not list(tmp_path.iterdir())
