"""2,000 mutated files of strangers: each is read as something valid or refused in one line."""

import io
import json
import random
import shutil
import zipfile

import pytest
from small_runs import go_on, small_run

from agents.training import config, models, replay_buffers, runs
from agents.training import train_model as training
from agents.training.training_state import restore_state
from jansen_env.sb3 import model_files

EACH = [100, pytest.param(400, marks=pytest.mark.slow)]  # mutants of a kind of file
MEMORY = 2**29  # bytes beyond what the process has: files here are smaller than 1 MB
WORTH = (None, True, -1, 0, 7, 10**30, 1e308, -1e-320, float("nan"), "", "x", [], {}, [[]], "\n")
TOKENS = ("- ", ": ", "{", "}", "[", "]", "&a ", "*a", "!!python/name:os.system ", "<<: ", "null",
          "1e999", "-1", "9" * 20, "~", "|", "'", '"', "\t", "\n", "\0", "%", "é")  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run of SAC and its model, to be resumed."""
    folder = tmp_path_factory.mktemp("fuzz")
    settings = small_run("sac", timesteps=200, n_envs=2, env_kwargs={"max_episode_steps": 9})
    go_on(settings, folder)
    return folder, training.prepare(settings, folder / runs.FINAL)


@pytest.fixture
def bounded():
    """No more memory than :data:`MEMORY` on top of what there is."""
    resource = pytest.importorskip("resource")
    with open("/proc/self/statm") as file:
        now = int(file.read().split()[0]) * resource.getpagesize()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (now + MEMORY, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def bytes_of(data, rng):
    """Flipped, replaced, cut off, zeroed, put in between, moved."""
    data = bytearray(data)
    for _ in range(rng.choice([1, 1, 1, 3, 10])):
        place = rng.randrange(len(data) + 1)
        kind = rng.randrange(6)
        if kind == 0 and place < len(data):
            data[place] ^= 1 << rng.randrange(8)
        elif kind == 1:
            data[place : place + 1] = rng.randbytes(1)
        elif kind == 2:
            del data[place:]
        elif kind == 3:
            data[place : place + 8] = bytes(len(data[place : place + 8]))
        elif kind == 4:
            data[place:place] = rng.randbytes(4)
        else:
            other = rng.randrange(len(data) + 1)
            data[place:place] = data[other : other + 50]
    return bytes(data)


def json_of(data, rng):
    """A value, anywhere in it, replaced, taken away or doubled; or its text damaged."""
    if rng.random() < 0.2:
        return bytes_of(data, rng)
    value = root = json.loads(data)
    while True:
        keys = list(value) if isinstance(value, dict) else list(range(len(value)))
        if not keys:
            break
        key = rng.choice(keys)
        if isinstance(value[key], (dict, list)) and value[key] and rng.random() < 0.8:
            value = value[key]
            continue
        kind = rng.randrange(4)
        if kind == 0:
            del value[key]
        elif kind == 1 and isinstance(value, list):
            value.insert(key, value[key])
        else:
            value[key] = rng.choice(WORTH)
        break
    return json.dumps(root).encode()


def header_of(data, rng):
    """The header of an array says something else."""
    size = rng.choice(["10**9", "1000000000000", "1", "0", "-1", "1,1", "'x'", "()" * 30, "True"])
    words = [b"(101,", b"False", b"'<f4'", b"shape", b"descr", b"NUMPY", b"\x01\x00", b"}"]
    new = [size.encode(), b"True", b"'|O'", b"'<f8'", b"(", b"2**40,", b"[" * 40, b"\x02\x00"]
    return data[:128].replace(rng.choice(words), rng.choice(new), 1) + data[128:]


def zip_of(data, rng, change):
    """Members changed, their checksums right again; or left out, exchanged, doubled, packed."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name, other = rng.choice(list(members)), rng.choice(list(members))
    kind, out = rng.randrange(8), io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for key, value in members.items():
            if kind == 0 and key == name:
                continue
            if kind == 1 and key in (name, other):
                value = members[other if key == name else name]
            elif kind > 2 and key == name:
                value = change(key, value, rng)
            packed = kind == 2 and key == name
            archive.writestr(key, value, zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED)
    return out.getvalue()


def in_model(name, data, rng):
    """A change to a member of a model: JSON or tensors."""
    if name.endswith(".json") or name == "data":
        return json_of(data, rng)
    if name.endswith(".pth") and rng.random() < 0.5:
        return zip_of(data, rng, lambda _, inner, rng: bytes_of(inner, rng))
    return bytes_of(data, rng)


def state_of(data, rng):
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            value = old.read(name)
            new.writestr(name, json_of(value, rng) if name == model_files.STATE else value)
    return out.getvalue()


def yaml_of(data, rng):
    """Tokens put in anywhere, lines doubled, bytes damaged."""
    text = data.decode()
    for _ in range(rng.choice([1, 1, 2, 5])):
        place = rng.randrange(len(text) + 1)
        text = text[:place] + rng.choice(TOKENS) + text[place + rng.randrange(4) :]
    data = text.encode()
    return bytes_of(data, rng) if rng.random() < 0.2 else data


def read_model_files(path, model):
    tensors, _ = model_files.read_model(path)
    models.restore(model, tensors)
    model_files.read_notes(path)
    restore_state(model, model_files.read_training_state(path))


def model_of(data, rng):
    """A model's file, or a member of it, changed."""
    return bytes_of(data, rng) if rng.random() < 0.3 else zip_of(data, rng, in_model)


def array_of(name, data, rng):
    """An array's file changed, most of the time its header."""
    return (header_of if rng.random() < 0.7 else bytes_of)(data, rng)


READERS = {
    "a model": (runs.FINAL, model_of, read_model_files),
    "its training state": (runs.FINAL, state_of, read_model_files),
    "a replay buffer": (
        "replay_buffer_200.npz",
        lambda data, rng: zip_of(data, rng, array_of),
        lambda path, model: replay_buffers.load_replay_buffer(model.replay_buffer, path),
    ),
    "a configuration": (
        "config.yml",
        yaml_of,
        lambda path, model: config.load_config(path, required=()),
    ),
    "evaluations": (
        "evaluations.json",
        json_of,
        lambda path, model: runs.read_evaluations(path.parent),
    ),
}


@pytest.mark.parametrize("count", EACH)
@pytest.mark.parametrize("kind", READERS)
def test_mutants_are_refused_in_one_line(kind, count, made, tmp_path, bounded):
    folder, model = made
    name, mutate, read = READERS[kind]
    whole, rng, refused = (folder / name).read_bytes(), random.Random(kind), 0
    shutil.copy(folder / "config.yml", tmp_path)
    path = tmp_path / name
    for number in range(count):
        path.write_bytes(mutate(whole, rng))
        try:
            read(path, model)
        except ValueError as error:
            refused += 1
            assert "\n" not in str(error) and len(str(error)) < 2000, (number, str(error))
            assert not isinstance(error.__cause__, MemoryError), number
    assert refused > count // 5
