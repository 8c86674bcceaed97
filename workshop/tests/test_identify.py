"""Logs of machines: bad ones are refused, clocks corrected, machines compared and identified."""

import json
from dataclasses import astuple, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from machine_logs import MEASUREMENTS, TRUTH, drawn_machine, mujoco, rigid_body, write_log
from scipy.signal import lfilter

import train
from jansen_env import ROBOTS, Terrain
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.sb3.run_config import load_config
from jansen_env.tasks.walking.tuned import gains_of
from jansen_workshop import estimation, likeness, machine_copies, walking_copies
from jansen_workshop.commands import identify
from jansen_workshop.commands.measurements import published
from jansen_workshop.measured_walks import MeasuredWalk, read_log, table

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
     r"line 206: gap \(s\) after 3\.98 s"),
    (lambda head, rows: (head, rows[::4]), r"lines 6 to \d+: median time .s. between samples"),
    (lambda head, rows: (head, rows[::-1]), "line 7: time_s must rise, got"),
    (lambda head, rows: (head, rows[:2]), "line 7: the log must have at least 3 rows .* got 2"),
    (lambda head, rows: (head, rows[:0]), "line 5: the log must have at least 3 rows .* got 0"),
    (lambda head, rows: (head, rows[:80]), r"line 85: the log must be at least 9\.86 s long"),
    (lambda head, rows: (head, rows[:300]), "line 305: the log must be at least 9.86 s long"),
    (lambda head, rows: (head, rows * [1.0, 57.3, 1.0, 1.0, 1.0]), "lines 6 to .* crank must turn"),
    (lambda head, rows: (head, rows * [1.05, 1.0, 1.0, 1.0, 1.0]), "the clock is wrong"),
    (lambda head, rows: (head, rows * [1.0, 1.0, -1.0, 1.0, 1.0]), "mean torque must have the"),
    (lambda head, rows: (head.replace("torque_Nm", "current_A"), rows), "give torque_constant"),
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
    with pytest.raises(ValueError, match=r"robot must be one of \['built', 'economy',"):
        published(other)


def test_a_log_of_the_weekend_machine_is_compared(tmp_path):
    """Under its own gains, which a log that names none has; under others there is no prediction."""
    robot, path = ROBOTS["weekend"](), tmp_path / "log.csv"
    gains = gains_of(robot, "steady")
    plant = ProjectionPlant(robot, replace(Terrain.flat(), friction=0.75), 5e-4)
    rng = np.random.default_rng(0)
    write_log(path, plant, 4.0, rng, 0.3, ("# robot: weekend",), gains, torque_noise=3e-4)
    given = path.read_text().replace(f"# gains: {[*astuple(gains)]}\n", "")
    path.write_text(given)
    assert read_log(path).gains == gains
    verdicts = {row[1]: row[-1] for row in published(path)}
    assert verdicts["mean torque (N m)"] == verdicts["speed (m/s)"] == "within"
    path.write_text(f"# gains: [10, 1, 1]\n{given}")
    with pytest.raises(ValueError, match=r"gains must be \[1.0, 0.1, 0.1\], those of the predic"):
        published(path)


@pytest.mark.slow
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
    rows = np.array([estimation.estimate(walked[100:], numbers[100:], row) for row in walked[:100]])
    inside = (rows[..., 1] <= numbers[:100]) & (numbers[:100] <= rows[..., 2])
    assert inside.sum(axis=0).min() >= 88
    width = (rows[..., 2] - rows[..., 1]).mean(axis=0)
    assert width[0] < 0.5 and width[1] > 0.9 > estimation.TELLS


@pytest.fixture(scope="module")
def logs():
    return [read_log(path) for path in EXAMPLES]


@pytest.fixture(scope="module")
def copies(logs):
    """Copies of an economy that walked as the examples."""
    return machine_copies.walk_copies(ECONOMY, logs, machine_copies.limits(ECONOMY), 256)


def low_passed(walk, constant):
    """The walk as a sensor with a filter of the first order shows it."""
    decay = np.exp(-0.02 / constant)
    return walk._replace(torque=lfilter([1.0 - decay], [1.0, -decay], walk.torque))


def late_pitch(walk, steps):
    """The walk with pitch that comes some steps of 20 ms late."""
    cut = MeasuredWalk(*(series[steps:] for series in walk))
    return cut._replace(pitch=walk.pitch[:-steps])


def scaled(name, factor):
    return lambda walk: walk._replace(**{name: factor * getattr(walk, name)})


def shifted(name, offset):
    return lambda walk: walk._replace(**{name: offset + getattr(walk, name)})


def set_up(logs, change, weighed):
    """The logs with an error of set-up, with or without the mass on a scale."""
    return [
        log._replace(
            walk=change(log.walk),
            about={name: text for name, text in log.about.items() if weighed or name != "mass"},
        )
        for log in logs
    ]


SMALL = {
    "none": (lambda walk: walk, {}),
    "crank zero +0.05 rad": (shifted("crank", 0.05), {"crank_zero": 0.05}),
    "crank zero -0.1 rad": (shifted("crank", -0.1), {"crank_zero": -0.1}),
    "IMU +0.3 degrees": (shifted("pitch", np.radians(0.3)), {"pitch_zero": np.radians(0.3)}),
    "IMU -1.5 degrees": (shifted("pitch", np.radians(-1.5)), {"pitch_zero": np.radians(-1.5)}),
    "torque constant +10 %": (scaled("torque", 1.1), {"torque_scale": 1.1}),
    "torque constant -10 %": (scaled("torque", 0.9), {"torque_scale": 0.9}),
    "current filtered by 20 ms": (lambda walk: low_passed(walk, 0.02), {"torque_filter": 0.02}),
    "current filtered by 50 ms": (lambda walk: low_passed(walk, 0.05), {"torque_filter": 0.05}),
    "pitch 20 ms late": (lambda walk: late_pitch(walk, 1), {"pitch_delay": 0.02}),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("weighed", [False, True])
@pytest.mark.parametrize("name", SMALL)
def test_small_errors_of_set_up_are_within_their_intervals(name, weighed, logs, copies):
    """So are the machine's numbers, or they are not identifiable; no interval is without width."""
    change, errors = SMALL[name]
    found = set_up(logs, change, weighed)
    distance, farthest = estimation.check_explained(ECONOMY, found, copies)
    assert distance < 0.6 * farthest
    estimates = estimation.identify(ECONOMY, found, copies)
    truth = {**TRUTH, **dict.fromkeys(machine_copies.SETUP, 0.0), "torque_scale": 1.0, **errors}
    limits = machine_copies.limits(ECONOMY)
    for number, value in truth.items():
        row = estimates[number]
        assert row.low <= value <= row.high, number
        assert (row.low, row.high) == limits[number] if row.value is None else row.low < row.high
    told = {number for number, row in estimates.items() if row.value is not None}
    assert told >= {"friction", "damping", "payload", "pitch_zero"}
    payload = estimates["payload"]
    assert payload.high - payload.low < (0.4 if weighed else 1.4)


LARGE = {
    "pitch reversed": (scaled("pitch", -1.0), "once the sign of pitch is reversed"),
    "pitch in the wrong unit": (scaled("pitch", np.radians(1.0)), "pitch is multiplied by 5[0-9] "),
    "torque of the motor": (scaled("torque", 1.0 / 6.0), r"once torque is .* \(gear ratio 6\)"),
    "torque in kg cm": (scaled("torque", 10.2), "once torque is multiplied by 0.1[0-9] "),
    "crank zero 0.7 rad": (shifted("crank", 0.7), "-0.[67] rad are added to the crank's angle"),
    "crank zero at the bottom": (shifted("crank", np.pi / 2.0), "rad are added to the crank's"),
    "IMU 5 degrees": (shifted("pitch", np.radians(5.0)), r"-0.0\d+ rad are added to pitch"),
    "filtered by 0.1 s": (lambda walk: low_passed(walk, 0.1), "torque_filter must be between 0"),
    "filtered by 0.3 s": (lambda walk: low_passed(walk, 0.3), "filter of 0.[0-9]+ s is taken off"),
    "pitch 0.2 s late": (lambda walk: late_pitch(walk, 10), "pitch is taken 0.[12][0-9]* s"),
    "torque constant +50 %": (scaled("torque", 1.5), "torque_scale|torque is multipl"),
    "pitch held": (lambda walk: walk._replace(pitch=0.0 * walk.pitch), "usual causes are"),
    "torque without pattern": (lambda walk: walk._replace(torque=np.sort(walk.torque)), "usual"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", LARGE)
def test_logs_that_no_copy_explains_are_refused_with_the_cause(name, logs, copies):
    change, message = LARGE[name]
    with pytest.raises(ValueError, match=f"^no simulated copy explains the logs: .*{message}"):
        estimation.check_explained(ECONOMY, set_up(logs, change, weighed=False), copies)


@pytest.mark.slow
def test_another_mass_than_the_scale_shows_is_refused(logs, copies):
    heavy = [log._replace(about={**log.about, "mass": 2.0 * ECONOMY.mass}) for log in logs]
    with pytest.raises(ValueError, match="no simulated copy explains the logs"):
        estimation.check_explained(ECONOMY, heavy, copies)


@pytest.mark.slow
def test_what_is_refused_writes_and_trains_nothing(tmp_path, capsys, monkeypatch, copies):
    """The command ends with an error, without a file and without a command that trains."""
    monkeypatch.setattr(identify, "walk_copies", lambda *given: copies)
    paths = []
    for path in EXAMPLES:
        head, *rows = path.read_text(encoding="utf-8").split("pitch_rad,x_m\n")
        cells = [row.split(",") for row in rows[0].splitlines()]
        turned = [",".join([*row[:3], str(-float(row[3])), row[4]]) for row in cells]
        paths.append(tmp_path / path.name)
        paths[-1].write_text("\n".join([f"{head}pitch_rad,x_m", *turned]), encoding="utf-8")
    out = tmp_path / "machine.json"
    with pytest.raises(SystemExit) as ended:
        identify.main([*map(str, paths), "--out", str(out), "--train"])
    assert ended.value.code == 2 and not out.exists()
    text = "".join(capsys.readouterr())
    assert "once the sign of pitch is reversed" in text and "train.py" not in text


@pytest.mark.slow
def test_an_interval_beyond_the_limits_is_not_identifiable(logs, copies, monkeypatch):
    """Neither one that is beyond by a little nor one that is far away has a width of zero."""
    within = machine_copies.limits(ECONOMY)
    least, most = within["friction"]
    for low, high in ((most - 0.1, most + 0.1), (most + 5.0, most + 6.0), (least - 0.1, 0.5)):
        rows = np.array([[0.5 * (low + high), low, high]] * 11)
        monkeypatch.setattr(estimation, "estimate", lambda *given, rows=rows: rows)
        row = estimation.identify(ECONOMY, logs, copies)["friction"]
        assert row == (None, least, most)
    rows = np.array([[-0.01, -0.05, 0.04]] * 11)
    monkeypatch.setattr(estimation, "estimate", lambda *given: rows)
    assert estimation.identify(ECONOMY, logs, copies)["damping"] == (0.0, 0.0, 0.04)
    monkeypatch.setattr(estimation, "estimate", lambda *given: rows - 1.0)
    assert estimation.identify(ECONOMY, logs, copies)["damping"].value is None


def test_copies_that_fall_are_refused(logs, monkeypatch):
    def falling(robots, known, *given):
        run = {name: np.zeros((600, len(robots)))
               for name in ("crank_angle", "crank_torque", "pitch", "x_position")}  # fmt: skip
        return {**run, "fallen": np.ones((600, len(robots)), bool)}, 0.02

    monkeypatch.setattr(walking_copies, "walk", falling)
    with pytest.raises(ValueError, match=r"half of the 8 simulated copies .* got 8 that fell"):
        machine_copies.walk_copies(ECONOMY, logs, machine_copies.limits(ECONOMY), 8)


def test_sensors_filter_and_delay(rng):
    """A filter is undone exactly, and a delay is an interpolation."""
    series = rng.normal(size=(50, 2))
    slow = machine_copies.filtered(series, np.array([0.0, 0.1]), 0.02)
    np.testing.assert_array_equal(slow[:, 0], series[:, 0])
    np.testing.assert_allclose(likeness.unfiltered(slow[:, 1], 0.1), series[:, 1])
    late = machine_copies.delayed(series, np.array([0.02, -0.03]), 0.02)
    np.testing.assert_allclose(late[1:, 0], series[:-1, 0])
    np.testing.assert_allclose(late[:-2, 1], 0.5 * (series[1:-1, 1] + series[2:, 1]))


@pytest.mark.slow
def test_numbers_are_within_their_intervals(tmp_path):
    """Of machines of two other simulators; 95 % of all, less what chance allows of so many.

    Zeros of crank and pitch are wrong, and so is the torque constant.
    """
    rng, within = np.random.default_rng(7), machine_copies.limits(ECONOMY)
    copies, inside, told = None, [], 0
    for make in (rigid_body, mujoco):
        for _ in range(3):
            machine, numbers = drawn_machine(ECONOMY, within, rng)
            numbers |= {name: rng.uniform(*(0.8 * np.array(within[name])))
                        for name in ("crank_zero", "pitch_zero")}  # fmt: skip
            numbers["torque_scale"] = rng.uniform(0.85, 1.15)
            logs = []
            for speed in (1.0, 2.0):
                path = tmp_path / f"{speed:g}.csv"
                plant = make(machine, numbers["friction"])
                comments = (f"# mass: {machine.mass:.3f}",)
                write_log(path, plant, speed, rng, numbers["start"], comments)
                log = read_log(path)
                walk = log.walk._replace(
                    crank=log.walk.crank + numbers["crank_zero"],
                    torque=log.walk.torque * numbers["torque_scale"],
                    pitch=log.walk.pitch + numbers["pitch_zero"],
                )
                logs.append(log._replace(walk=walk))
            copies = copies or machine_copies.walk_copies(ECONOMY, logs, within, 512)
            estimation.check_explained(ECONOMY, logs, copies)
            found = estimation.identify(ECONOMY, logs, copies)
            numbers |= {"torque_filter": 0.0, "pitch_delay": 0.0, "slope": 0.0}
            inside += [row.low <= numbers[name] <= row.high for name, row in found.items()]
            told += sum(found[name].value is not None for name in TRUTH)
    print(f"{sum(inside)} of {len(inside)} inside; {told} of {6 * len(TRUTH)} are told")
    assert len(inside) == 66 and sum(inside) >= 59
    assert told >= 12
