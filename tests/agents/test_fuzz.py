"""Damaged files of strangers: each is read as something valid or refused in one line."""

import io
import json
import random
import shutil
import zipfile

import gymnasium as gym
import numpy as np
import pytest
from small_runs import go_on, small_run

from agents.training import runs
from agents.training import train_model as training
from agents.training.training_state import load_replay_buffer, restore, restore_state
from jansen_env.files import write_json
from jansen_env.policies import pretrained
from jansen_env.robot import paper_robot
from jansen_env.robot.robot_file import robot_to_json
from jansen_env.sb3.run_config import load_config
from jansen_env.sb3.trained import NOTES, read_model
from jansen_env.viewer.recorder import Recorder
from jansen_env.viewer.recording import Recording
from jansen_env.viewer.saved_walk import FORMAT, walk_again

VALUES = (None, True, -1, 0, 7, 10**30, 1e308, -1e-320, float("nan"), "", "x", [], {}, [[]], "\n")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run of SAC and its model, to be resumed; a recording, a walk and a policy beside it."""
    folder = tmp_path_factory.mktemp("fuzz")
    settings = small_run("sac", timesteps=200, n_envs=2, env_kwargs={"max_episode_steps": 9})
    go_on(settings, folder)
    env = Recorder(gym.make("JansenWalker-v0"))
    env.reset(seed=1)
    env.step(np.zeros(1, np.float32))
    env.recording.save(folder / "walk.npz")
    write_json(
        folder / "walk.json",
        {
            "format": FORMAT,
            "label": "",
            "robot": robot_to_json(paper_robot()),
            "ground": [[-1.0, 0.0], [1.0, 0.0]],
            "start": {"crank_angle": 0.0, "command": 0.3, "changes": {"friction": 0.5}},
            "steps": [
                {"action": 0.1, "command": 0.3, "changes": {"tilt": 0.1}, "pushes": [[0.1, 0]]}
            ],
        },
    )
    for file in pretrained.POLICIES.glob("JansenCrank-v0/ppo.*"):
        shutil.copy(file, folder)
    return folder, training.prepare(settings, folder / runs.FINAL)


def damaged(data, rng):
    """Bytes replaced, cut off or put in between."""
    place = rng.randrange(len(data) + 1)
    kept = rng.choice([data[place:], data[place + 8 :], b""])
    return data[:place] + rng.randbytes(rng.choice([0, 4, 8])) + kept


def json_of(data, rng):
    """A value, anywhere in it, replaced or removed."""
    value = root = json.loads(data)
    while keys := list(value) if isinstance(value, dict) else list(range(len(value))):
        key = rng.choice(keys)
        if isinstance(value[key], (dict, list)) and value[key] and rng.random() < 0.8:
            value = value[key]
            continue
        value[key] = rng.choice(VALUES)
        break
    return json.dumps(root).encode()


def zip_of(data, rng):
    """A member changed, its checksum right again; or left out."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = rng.choice([*members])
    out = io.BytesIO()
    members[name] = (json_of if name in (NOTES, "data") else damaged)(members[name], rng)
    with zipfile.ZipFile(out, "w") as archive:
        for key, value in members.items():
            archive.writestr(key, value)
    return out.getvalue()


def read_all(path, model):
    saved = read_model(path)
    restore(model, saved)
    restore_state(model, saved.notes.get("state", {}))


READERS = {
    runs.FINAL: (zip_of, read_all),
    "replay_buffer_200.npz": (zip_of, lambda p, model: load_replay_buffer(model.replay_buffer, p)),
    "config.yml": (damaged, lambda path, model: load_config(path)),
    "walk.npz": (damaged, lambda path, model: Recording.load(path)),
    "walk.json": (json_of, lambda path, model: walk_again(path)),
    "ppo.json": (json_of, lambda path, model: pretrained.load_file(path)),
    "evaluations.json": (json_of, lambda path, model: runs.read_evaluations(path.parent)),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*diverged")  # a walk on a ground that none can walk on
@pytest.mark.parametrize("name", READERS)
def test_damaged_files_are_refused_in_one_line(name, made, tmp_path):
    folder, model = made
    change, read = READERS[name]
    whole = (folder / name).read_bytes()
    rng = random.Random(name)
    refused = 0
    for beside in ("config.yml", "ppo.safetensors"):
        shutil.copy(folder / beside, tmp_path)
    path = tmp_path / name
    for number in range(100):
        path.write_bytes(change(whole, rng))
        try:
            read(path, model)
        except ValueError as error:
            refused += 1
            assert "\n" not in str(error) and len(str(error)) < 2000, (number, str(error))
    assert refused > 20
