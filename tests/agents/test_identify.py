"""Logs of machines: bad ones are refused, clocks corrected, machines compared and identified."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from machine_logs import MEASUREMENTS, TRUTH, drawn_machine, mujoco, rigid_body, write_log

import train
from agents import identify
from agents.measurements import published, read_log, table
from jansen_env import ROBOTS
from jansen_env.sb3.run_config import load_config

EXAMPLES = sorted(MEASUREMENTS.glob("synthetic_*.csv"))
FAST = EXAMPLES[-1]
ECONOMY = ROBOTS["economy"]()


def changed(tmp_path, change):
    """A log whose head and rows of numbers ``change`` has changed."""
    lines = FAST.read_text().splitlines()
    comments = [line for line in lines if line.startswith("#")]
    head, *rows = lines[len(comments) :]
    head, rows = change(head, np.array([row.split(",") for row in rows], float))
    path = tmp_path / "log.csv"
    rows = [",".join(f"{value:.6f}" for value in row) for row in rows]
    path.write_text("\n".join([*comments, head, *rows]))
    return path


@pytest.mark.parametrize(("change", "message"), [
    (lambda head, rows: (head, np.delete(rows, range(200, 210), 0)),
     r"line 205: gap \(s\) after 3\.98 s"),
    (lambda head, rows: (head, rows[::4]), r"lines 6 to \d+: median time .s. between samples"),
    (lambda head, rows: (head, rows[::-1]), "line 7: time_s must rise, got"),
    (lambda head, rows: (head, rows[:2]), "line 7: 3 rows must follow or more, got 2"),
    (lambda head, rows: (head, rows[:0]), "line 5: 3 rows must follow or more, got 0"),
    (lambda head, rows: (head, rows[:80]), r"line 85: the log must be 9\.85 s long"),
    (lambda head, rows: (head, rows[:300]), "line 305: the log must be 9.85 s long"),
    (lambda head, rows: (head, rows * [1.0, 57.3, 1.0, 1.0, 1.0]), "lines 6 to .* crank must turn"),
    (lambda head, rows: (head, rows * [1.05, 1.0, 1.0, 1.0, 1.0]), "the clock is wrong"),
    (lambda head, rows: (head, rows * [1.0, 1.0, -1.0, 1.0, 1.0]), "mean torque must have the"),
    (lambda head, rows: (head.replace("torque_Nm", "current_A"), rows), "line 5: current_A needs"),
])  # fmt: skip
def test_logs_that_cannot_be_right_are_refused(change, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        read_log(changed(tmp_path, change))


def test_what_is_mended_is_the_same_walk(tmp_path):
    """Degrees, a wrapped crank, a clock that is 2 % fast and a lost sample, with a note of both."""

    def change(head, rows):
        rows = np.delete(rows, 300, 0) * [1.02, 180.0 / np.pi, 1.0, 180.0 / np.pi, 1.0]
        rows[:, 1] %= 360.0
        return head.replace("_rad", "_deg"), rows

    right, mended = read_log(FAST), read_log(changed(tmp_path, change))
    assert [note.split()[0] for note in mended.notes] == ["1", "the"] and not right.notes
    crank = mended.walk.crank - right.walk.crank
    assert np.abs(crank - 2.0 * np.pi * round(crank.mean() / (2.0 * np.pi))).max() < 0.1
    for name, most in (("torque", 0.02), ("pitch", 0.002)):
        ours, theirs = getattr(mended.walk, name), getattr(right.walk, name)
        assert ours.mean() == pytest.approx(theirs.mean(), abs=most)
        assert ours.std() == pytest.approx(theirs.std(), rel=0.03)


@pytest.mark.parametrize("path", sorted(MEASUREMENTS.glob("*.csv")), ids=lambda path: path.stem)
def test_every_measurement_is_compared_with_its_prediction(path, tmp_path):
    """The table of the folder's page has its rows, whatever the verdict; not of other machines."""
    page = (MEASUREMENTS / "README.md").read_text(encoding="utf-8")
    shown = {tuple(cell.strip() for cell in line.split("|")) for line in page.splitlines()}
    rows = table(published(path)).splitlines()[2:]
    assert len(rows) >= 3
    assert {tuple(cell.strip() for cell in row.split("|")) for row in rows} <= shown
    other = tmp_path / "log.csv"
    other.write_text(path.read_text().replace("robot: economy", "robot: klann"))
    with pytest.raises(ValueError, match=r"is 'klann', must be one of \['built', 'economy'\]"):
        published(other)


def test_the_examples_are_identified(tmp_path, capsys, monkeypatch, no_scores, few_episodes):
    """From another plant, with noise: the numbers are within, the machine's file has them.

    A short training is over the intervals of the report.
    """
    out = tmp_path / "machine.json"

    def run(command):
        assert Path(command[1]) == Path(train.__file__)
        train.main([*command[2:], "--n-envs", "16", "--eval-freq", "0"])
        return SimpleNamespace(returncode=0)

    monkeypatch.setattr(identify, "subprocess", SimpleNamespace(run=run))
    monkeypatch.chdir(tmp_path)
    known = [*map(str, EXAMPLES), "--copies", "256", "--out", str(out)]
    with pytest.raises(SystemExit, match=r"^0$"):
        identify.main([*known, "--train", "2000"])
    text = capsys.readouterr().out
    rows = {line.split("|")[1].split(",")[0].strip(): line.split("|")[3:5]
            for line in text.splitlines() if line.startswith("| ") and "rad/s |" not in line
            }  # fmt: skip
    for name, value in TRUTH.items():
        low, high = map(float, rows[name])
        assert low <= value <= high, name
    drawn = json.loads(text.partition("randomize=")[2].partition("\n")[0])
    spans = {"friction": "friction", "payload": "payload", "foot_stiffness_scale": "feet"}
    for parameter, name in spans.items():
        np.testing.assert_allclose(drawn[parameter], [*map(float, rows[name])], rtol=5e-3)
    (folder,) = tmp_path.glob("logs/ppo/*")
    config = load_config(folder / "config.yml")
    assert config.timesteps == 2000 and (folder / "final_model.zip").exists()
    assert config.env_kwargs["robot"] == str(out) and config.env_kwargs["randomize"] == drawn
    assert config.env_kwargs["observe"] == "onboard"
    from jansen_env.scoring.rollout import make_env

    env = make_env("JansenWalkerBuilt-v0", {"robot": str(out), "randomize": drawn})
    env.reset(seed=0)
    torque = np.array(env.unwrapped.robot.bearing_friction)
    assert torque[0] > ECONOMY.bearing_friction[0]


def test_what_has_no_effect_is_not_told(rng):
    """A number that the measures show is within its interval in 95 %; another is not identified."""
    numbers = rng.random((1000, 2))
    walked = np.stack([numbers[:, 0], rng.random(1000)], axis=1) + rng.normal(0, 0.1, (1000, 2))
    rows = np.array([identify.estimate(walked[100:], numbers[100:], row) for row in walked[:100]])
    inside = (rows[..., 1] <= numbers[:100]) & (numbers[:100] <= rows[..., 2])
    assert inside.sum(axis=0).min() >= 88
    width = (rows[..., 2] - rows[..., 1]).mean(axis=0)
    assert width[0] < 0.5 and width[1] > 0.9 > identify.TELLS


@pytest.mark.slow
def test_numbers_are_within_their_intervals(tmp_path):
    """Of machines of two other simulators; 95 % of all, less what chance allows of so many."""
    rng, within = np.random.default_rng(7), identify.limits(ECONOMY)
    copies, inside = None, []
    for make in (rigid_body, mujoco):
        for _ in range(6):
            machine, numbers = drawn_machine(ECONOMY, within, rng)
            logs = []
            for speed in (1.0, 2.0):
                path = tmp_path / f"{speed:g}.csv"
                write_log(path, make(machine, numbers["friction"]), speed, rng, numbers["start"])
                logs.append(read_log(path))
            copies = copies or identify.walk_copies(ECONOMY, logs, within, 512)
            found = identify.identify(ECONOMY, logs, copies)
            inside += [row.low <= numbers[name] <= row.high for name, row in found.items()]
    assert len(inside) == 60 and sum(inside) >= 54
