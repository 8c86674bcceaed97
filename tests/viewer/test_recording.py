"""Recordings: whole after a round trip, checked on reading, and of episodes that are as without."""

import io
import json
import tracemalloc
import zipfile
from dataclasses import fields, replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import FlattenObservation, RescaleAction, TimeLimit

import jansen_env
from jansen_env.robot.kinematics import world_joints
from jansen_env.viewer import recorder, recording
from jansen_env.viewer.recorder import Recorder
from jansen_env.viewer.recording import ARRAYS, Recording

WALKER = "JansenWalker-v0"
CRANK = "JansenCrank-v0"


def walk(env, steps=20, seed=1, **options):
    """What a step gives, from the reset on, and the states."""
    observation, info = env.reset(seed=seed, options=options)
    results = [(observation, None, False, False, info)]
    states = [env.unwrapped.get_state()["record"]["state"]]
    for k in range(steps):
        results.append(env.step(np.array([0.3 * np.sin(0.3 * k)], np.float32)))
        states.append(env.unwrapped.get_state()["record"]["state"])
        if results[-1][2] or results[-1][3]:
            break
    return results, states


def recorded(env_id=WALKER, steps=20, **arguments):
    env = Recorder(gym.make(env_id, **arguments), "me")
    walk(env, steps)
    return env.recording


@pytest.fixture(scope="module")
def short():
    return recorded(steps=5)


def same(first, second):
    for field in fields(Recording):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(second, field.name))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("env_id", "arguments"),
    [
        (WALKER, {"terrain": "rough", "terrain_level": 3}),
        (WALKER, {"plant": "rigid_body"}),
        ("JansenWalkerHardcore-v0", {}),
        (CRANK, {}),
    ],
)
def test_a_recorded_episode_is_as_it_is_without(env_id, arguments):
    plain, states = walk(gym.make(env_id, **arguments))
    env = Recorder(gym.make(env_id, **arguments))
    results, recorded_states = walk(env)
    np.testing.assert_array_equal(recorded_states, states)
    for step, other in zip(results, plain, strict=True):
        np.testing.assert_array_equal(step[0], other[0])
        assert str(step[1:]) == str(other[1:])
    episode = env.recording
    steps = plain[1:]
    infos = [step[4] for step in steps]
    np.testing.assert_array_equal(episode.state, states)
    np.testing.assert_array_equal(episode.observation, [step[0] for step in plain])
    assert episode.reward.tolist() == [step[1] for step in steps]
    assert episode.torque[1:].tolist() == [info["crank_torque"] for info in infos]
    assert episode.command[1:].tolist() == [info["speed_command"] for info in infos]
    assert episode.crank_speed[1:].tolist() == [info["crank_speed"] for info in infos]
    for name in episode.energies:
        assert episode.energy_of(name).tolist() == [info["energy"][name] for info in infos]
    dt = env.unwrapped.control_dt
    np.testing.assert_allclose(episode.time, dt * np.arange(len(episode.time)), atol=1e-12)
    np.testing.assert_allclose(episode.power, episode.energy_of("motor_work") / dt)
    joints = world_joints(env.unwrapped.task.scene(0)["robot"], episode.pose)
    np.testing.assert_allclose(episode.joints, joints, atol=1e-6)
    if env_id == CRANK:
        assert not episode.parameters and not len(episode.terrain)
        return
    np.testing.assert_array_equal(episode.slip, [info["slip"] for info in infos])
    force = np.array([info["contact_force"] for info in infos])
    sizes = (np.hypot(*each.T) for each in (episode.contact_force[1:], force))
    np.testing.assert_allclose(*sizes, atol=1e-9)
    assert ((episode.contact[1:] == 0) <= (force[..., 1] < 1e-3)).all()
    assert len(episode.terrain) >= 2 and "friction" in episode.parameters


@pytest.mark.parametrize("env_id", [WALKER, CRANK])
def test_round_trip(env_id, tmp_path):
    holy = jansen_env.ROBOTS["holy"]()
    episode = recorded(env_id, robot=holy)
    path = episode.save(tmp_path / "a.npz")
    same(Recording.load(path), episode)
    assert path.read_bytes() == episode.to_bytes()
    assert "Robot(" in episode.env_kwargs["robot"] and episode.env_id == env_id
    assert episode.robot.bodies == holy.bodies
    with np.load(path, allow_pickle=False) as arrays:  # as anybody may
        np.testing.assert_array_equal(arrays["torque"], episode.torque)


def test_other_wrappers_are_free():
    """They may be above and below; spec and label stay, and numbers are those of the recorder's
    place.
    """
    below = RescaleAction(gym.make(WALKER), np.float32(-10), np.float32(10))
    env = TimeLimit(FlattenObservation(Recorder(below, "me")), 3)
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.array([5.0], np.float32))
    episode = env.get_wrapper_attr("recording")
    assert episode.action.tolist() == [[5.0]] * 3 and episode.torque[-1] == pytest.approx(10.0)
    assert (episode.env_id, episode.label, episode.truncated) == (WALKER, "me", False)
    assert gym.make(Recorder(gym.make(WALKER), "me").spec).get_wrapper_attr("label") == "me"


def test_one_episode_after_another():
    env = Recorder(gym.make(WALKER, max_episode_steps=4))
    with pytest.raises(gym.error.ResetNeeded):
        _ = env.recording
    walk(env, 2, seed=5, speed_command=0.25)
    first = env.recording
    assert (first.steps, first.seed, first.options) == (2, 5, {"speed_command": 0.25})
    before = first.to_bytes()
    env.reset()  # in the middle
    with pytest.raises(gym.error.ResetNeeded):
        _ = env.recording
    walk(env, 9)
    assert (env.recording.steps, env.recording.truncated) == (4, True)
    assert first.to_bytes() == before and not first.truncated
    with pytest.raises(ValueError, match="read-only"):
        first.time[0] = 1.0
    with pytest.raises(ValueError, match="speed_command"):
        env.reset(options={"speed_command": 9.0})
    with pytest.raises(gym.error.ResetNeeded):  # what was before is gone
        _ = env.recording
    env.reset()
    env.env.reset()  # behind its back
    env.step(np.zeros(1, np.float32))
    assert env.recording.steps == 1
    env.step(np.zeros(1, np.float32))
    ahead = env.unwrapped.get_state()
    env.reset()
    env.unwrapped.set_state(ahead)
    for _ in range(2):  # the first is no step of what was recorded, and begins another recording
        env.step(np.zeros(1, np.float32))
    assert env.recording.steps == 1


def test_falls_are_in_it_and_long_episodes_are_cut(monkeypatch):
    fall = recorded(steps=100, fall_pitch=1e-4)
    assert fall.terminated and fall.steps < 100
    monkeypatch.setattr(recorder, "MOST_RECORDED", 3)
    with pytest.warns(UserWarning, match="only the first 3 steps"):
        assert recorded(steps=9).steps == 3


def test_an_episode_of_many_legs_is_cut_where_its_file_would_be_too_large(monkeypatch):
    """Everything that the recorder keeps can be loaded again."""
    monkeypatch.setattr(recording, "MAX_UNPACKED", 2**22)
    monkeypatch.setattr(recorder, "MAX_UNPACKED", 2**22)
    with pytest.warns(UserWarning, match=r"only the first \d+ steps of the episode"):
        kept = recorded(steps=310, robot=jansen_env.paper_robot(100), control_dt=0.001)
    assert 280 < kept.steps < 300
    assert Recording.from_bytes(kept.to_bytes()).steps == kept.steps


def test_other_environments_and_what_is_no_number_are_refused(short):
    with pytest.raises(ValueError, match="must be an environment of one Jansen robot"):
        Recorder(gym.make("CartPole-v1"))
    env = Recorder(gym.wrappers.TransformReward(gym.make(WALKER), lambda _: np.nan))
    walk(env, 2)
    with pytest.raises(ValueError, match=r"reward must contain finite .* 1e\+12, got nan"):
        _ = env.recording
    for name in ARRAYS:
        array = np.array(getattr(short, name))
        if array.dtype.kind == "f":
            array.flat[-1] = np.inf
            with pytest.raises(ValueError, match=f"{name} must contain .*, got inf"):
                replace(short, **{name: array})
        with pytest.raises(ValueError, match=f"{name} must have"):
            replace(short, **{name: array[..., None]})
        if name != "terrain":
            with pytest.raises(ValueError, match="must have the shape"):
                replace(short, **{name: array[:-1]})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": np.zeros(6)}, "time must increase by at least 1e-09 s, got a step of 0 s"),
        ({"time": 1e-290 * np.arange(6)}, "time must increase .*, got a step of 1e-290 s"),
        ({"energies": tuple("abcdefghi")}, "must have 'motor_work'"),
        (
            {"pose": np.full((6, 4), 1e12)},
            "pose must be within .* got a distance of 1e[+]12 m",
        ),
        ({"contact": np.full((6, 4), 3)}, "every entry of contact must be 0, 1 or 2, got 3"),
        ({"terrain": [[1.0, 0.0], [0.0, 0.0]]}, "x must increase in terrain, got a change of -1 m"),
        ({"label": 3}, "label must be a str, got 3"),
        ({"seed": "1"}, "seed must be a int, got '1'"),
        ({"robot": {}}, "robot must be a Robot, got {}"),
        (
            {"robot": jansen_env.paper_robot(3)},
            r"contact must have the shape \(6, 6\), got \(6, 4\)",
        ),
    ],
)
def test_other_contents_are_refused(short, change, message):
    with pytest.raises(ValueError, match=message):
        replace(short, **change)


def rewritten(short, packed=zipfile.ZIP_DEFLATED, **changed):
    """A file with other members: bytes, or arrays."""
    with zipfile.ZipFile(io.BytesIO(short.to_bytes())) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    for name, value in changed.items():
        file = io.BytesIO()
        if not isinstance(value, bytes):
            np.lib.format.write_array(file, value, allow_pickle=True)
        members[f"{name}.npy"] = value if isinstance(value, bytes) else file.getvalue()
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", packed) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return out.getvalue()


class Harmful:
    def __reduce__(self):
        return pytest.fail, ("code of the file was run",)


def described(text):
    return np.frombuffer(text, np.uint8)


def nested(depth):
    """A robot within a robot."""
    robot = {"is": "Robot"}
    for _ in range(depth):
        robot = {"is": "Robot", "linkage": robot}
    return {**robot, "format": "jansen_env robot 1"}


def claimed(shape):
    """An array that says it is larger than it is."""
    file = io.BytesIO()
    header = {"descr": "<f8", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, header)
    return file.getvalue() + bytes(48)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"time": np.array([Harmful()], object)}, "allow_pickle=False"),
        ({"time": np.arange(6, dtype=np.int64)}, "time must have the type float64, got int64"),
        ({"time": claimed((10**15,))}, "it is damaged"),
        ({"time": claimed((10**6,))}, "cannot|EOF"),
        ({"time": claimed((-6,))}, "negative|must"),
        ({"time": b"no array"}, "it is damaged"),
        ({"more": np.zeros(1)}, "must contain"),
        ({"description": described(b"[" * 100_000)}, "nested so deeply"),
        ({"description": described(b"9" * 2**21)}, "must have at most"),
        ({"description": described(b'{"format": "jansen_env recording 3"}')}, "recording 3"),
        *(
            ({"description": entry}, message)
            for entry, message in (
                (
                    {"robot": {**nested(0), "is": "Leg", "side": "fore"}},
                    "a robot file must contain a Robot, got 'Leg'",
                ),
                ({"robot": nested(700)}, "nested so deeply"),
                ({"energies": "motor_work"}, r"energy must have the shape \(5, 10\), got \(5, 9\)"),
                ({"energies": 3}, "description is not valid"),
                ({"robott": 3}, "robott"),
                (
                    {"observed": [["name", "unit", "more"]]},
                    "observed must be empty or have one entry per .*, got 1 entries",
                ),
            )
        ),
    ],
)
def test_other_files_are_refused(short, changed, message):
    """So are files with an entry of the description changed."""
    if isinstance(changed.get("description"), dict):
        with np.load(io.BytesIO(short.to_bytes())) as archive:
            entries = json.loads(archive["description"].tobytes())
        text = json.dumps({**entries, **changed["description"]}).encode()
        changed = {"description": described(text)}
    with pytest.raises(ValueError, match=message):
        Recording.from_bytes(rewritten(short, **changed))


def refused_within(data, message, most):
    """Check that a file is refused, and how much memory that takes."""
    tracemalloc.start()
    with pytest.raises(ValueError, match=message):
        Recording.from_bytes(bytes(data))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < most


def with_declared_size(data, name, size):
    """An archive whose directory gives another size for one of its members."""
    out = bytearray(data)
    place = data.rindex(f"{name}.npy".encode()) - 46
    assert out[place : place + 4] == recording.DIRECTORY_ENTRY
    out[place + 24 : place + 28] = size.to_bytes(4, "little")
    return out


@pytest.mark.slow
def test_bombs_stay_small(short, tmp_path, monkeypatch):
    """A file that would unpack to too much is refused before it does, as is an endless
    directory.
    """
    many = io.BytesIO()
    with zipfile.ZipFile(many, "w") as archive:
        for i in range(5000):
            archive.writestr(str(i), b"")
    refused_within(many.getvalue(), "must have at most 64 members", 2**21)
    bomb = rewritten(short, time=claimed((6,)) + bytes(2**25))
    refused_within(with_declared_size(bomb, "time", 100), "it is damaged", 2**21)
    monkeypatch.setattr(recording, "MAX_UNPACKED", 2**22)
    refused_within(bomb, "must unpack to at most", 2**21)
    large = tmp_path / "large.npz"
    with large.open("wb") as out:
        out.truncate(2**40)
    with pytest.raises(ValueError, match="must have at most"):
        Recording.load(large)
    for packed in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):  # zipfile unpacks all of it that is read
        bomb = rewritten(short, packed, reward=bytes(2**25))
        refused_within(with_declared_size(bomb, "reward", 100), "stored or deflated", 2**21)
