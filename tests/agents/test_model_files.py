"""Model files: only numbers are read from them, damaged and hostile ones are refused by name."""

import io
import pickle
import re
import shutil
import struct
import sys
import textwrap
import tracemalloc
import zipfile

import numpy as np
import pytest
import torch
import yaml
from small_runs import small_run
from stable_baselines3 import PPO

import train
from agents.training import models, runs
from agents.training.train_model import prepare
from jansen_env import sb3
from jansen_env.sb3 import model_files
from jansen_env.scoring.rollout import make_env

ENV = "JansenCrank-v0"
SETTINGS = {
    "algo": "ppo", "env": ENV, "seed": 0, "policy": "MlpPolicy", "timesteps": 16, "n_envs": 1,
    "hyperparameters": {"n_steps": 8, "batch_size": 8, "n_epochs": 1},
    "policy_kwargs": {"net_arch": [8], "normalize": True},
}  # fmt: skip
TENSOR = b"ctorch._utils\n_rebuild_tensor_v2\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run's folder with a model of one update, its optimiser's state and all."""
    folder = tmp_path_factory.mktemp("made")
    runs.record_run(folder, SETTINGS, "")
    model = models.build_model("ppo", SETTINGS, make_env(ENV, {}))
    model.learn(8)
    model.save(folder / "best_model.zip")
    return folder


@pytest.fixture
def folder(made, tmp_path):
    return shutil.copytree(made, tmp_path / "run")


def configure(folder, **values):
    text = yaml.safe_dump({**SETTINGS, **values})
    (folder / "config.yml").write_text(text)


def rewritten(data, change):
    """The bytes of a zip file with ``change`` made to each member: (name, bytes) to bytes."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            new.writestr(name, change(name, old.read(name)))
    return out.getvalue()


def spoil(folder, change):
    path = folder / "best_model.zip"
    path.write_bytes(rewritten(path.read_bytes(), change))
    return path


def refused(path, reason, load=sb3.load_policy):
    """Loading is refused in one line that names the file."""
    with pytest.raises(ValueError, match=reason) as error:
        load(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def hostile(path, structure, numbers=b"\0" * 16, data=b'{"num_timesteps": 1}'):
    """A model file whose policy.pth has this pickle and one storage."""
    inner = io.BytesIO()
    with zipfile.ZipFile(inner, "w") as archive:
        archive.writestr("archive/data.pkl", structure)
        archive.writestr("archive/data/0", numbers)
        archive.writestr("archive/version", "3")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("policy.pth", inner.getvalue())
        archive.writestr("data", data)
    return path


def tensor(size, stride, count=4, offset=0, kind=b"FloatStorage"):
    """The pickle of a tensor in a storage of ``count`` numbers, as torch.save writes it."""

    def of(value):
        return pickle.dumps(value, 2)[2:].split(b"q\x00")[0].rstrip(b".")

    storage = b"(" + of("storage") + b"ctorch\n" + kind + b"\n" + of("0") + of("cpu") + of(count)
    ints = [b"(" + b"".join(map(of, values)) + b"t" for values in (size, stride)]
    return b"\x80\x02" + TENSOR + b"(" + storage + b"tQ" + of(offset) + b"".join(ints) + b"\x89}tR."


def test_names_in_a_run_folder_import_nothing(folder, monkeypatch):
    (folder / "payload.py").write_text("import builtins; builtins.payload_ran = True\n")
    (folder / "checkpoints").mkdir()
    shutil.copy(folder / "best_model.zip", folder / "checkpoints" / "model_8_steps.zip")
    monkeypatch.syspath_prepend(folder)
    for values in (
        {"env": f"payload:{ENV}"},
        {"algo": "payload:PPO"},
        {"policy": "payload.Policy"},
        {"env_kwargs": {"entry_point": "payload:Env"}},
        {"training_variants": [{"additional_wrappers": ["payload:Wrapper"]}]},
        {"policy_kwargs": {"features_extractor_class": "payload.Extractor"}},
        {"policy_kwargs": {"activation": "payload.activation"}},
        {"hyperparameters": {"rollout_buffer_class": "payload.Buffer"}},
    ):
        configure(folder, **values)
        refused(folder, "must be", lambda path: sb3.load_policy(path))
        with pytest.raises(SystemExit, match=r"config\.yml: .* must be"):
            train.main(["--resume", str(folder), "--no-progress"])
    assert "payload" not in sys.modules


def test_all_is_read_as_torch_reads_it(made):
    tensors, steps = model_files.read_model(made / "best_model.zip")
    with zipfile.ZipFile(made / "best_model.zip") as archive:
        for name, ours in tensors.items():
            data = io.BytesIO(archive.read(f"{name}.pth"))
            theirs = torch.load(data, weights_only=True)
            torch.testing.assert_close(ours, dict(theirs) if theirs else theirs, rtol=0, atol=0)
    assert steps == 8 and set(tensors) == {"policy", "policy.optimizer", "pytorch_variables"}
    assert tensors["policy.optimizer"]["state"][0]["step"] == 1
    only, _ = model_files.read_model(made / "best_model.zip", ["policy"])
    assert list(only) == ["policy"]


def test_a_model_trained_elsewhere(tmp_path):
    """By plain Stable-Baselines3, with the three lines of config.yml that it takes."""
    env = make_env(ENV, {})
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=8, device="cpu")
    model.save(tmp_path / "mine.zip")
    with pytest.raises(ValueError, match=r"no config\.yml beside ") as error:
        sb3.load_policy(tmp_path / "mine.zip")
    lines = re.search(r"((    \w+: .*\n){3})", str(error.value))[1]
    text = textwrap.dedent(lines).replace("JansenWalkerBuilt-v0", ENV)
    (tmp_path / "config.yml").write_text(text)
    ours = sb3.load_policy(tmp_path / "mine.zip")
    seen = np.stack([env.reset(seed=s)[0] for s in range(5)])
    actions = [p.predict(seen, deterministic=True)[0] for p in (ours, model)]
    assert np.array_equal(*actions)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (
            {"policy_kwargs": {"net_arch": [9], "normalize": True}},
            r"shape torch.Size\(\[8, 5\]\).*model is torch.Size\(\[9, 5\]\)",
        ),
        ({"policy_kwargs": {"net_arch": [8]}}, r"Unexpected key.*extractor\.mean"),
        ({"policy_kwargs": {"net_arch": [8, 8], "normalize": True}}, "Missing key"),
        ({"env": "JansenWalker-v0"}, "size mismatch"),
        ({"env_kwargs": {"torque_limit": -1}}, "torque_limit is -1, must be above 0"),
        ({"policy_kwargs": {"net_arch": [8], "squash_output": True}}, "squash_output"),
    ],
)
def test_models_that_do_not_fit_their_configuration(values, reason, folder):
    configure(folder, **values)
    with pytest.raises(ValueError, match=reason) as error:
        sb3.load_policy(folder)
    assert str(folder / "config.yml") in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("structure", "reason"),
    [
        (b"\x80\x02cbuiltins\neval\n(V1\ntR.", "names builtins eval"),
        (b"\x80\x02cbuiltins\nbytearray\n(I100000000000\ntR.", "names builtins bytearray"),
        (b"\x80\x02ctorch\nTensor\n(I100000000000\ntR.", "names torch Tensor"),
        (b"\x80\x02]q\x00h\x00a.", "levels"),
        (b"\x80\x02]q\x00"
         + b"".join(b"]q%c(" % (i + 1) + b"h%c" % i * 100 + b"e" for i in range(9)) + b".",
         "entries"),
        (tensor((2**40,), (1,)), "not resizable"),
        (tensor((2**30, 2), (0, 0)), r"take more than 4 x \d+ bytes"),
        (tensor((4,), (1,), offset=1), "not resizable"),
        (tensor((2,), (1,), offset=-1), "offset"),
        (tensor((400,), (1,), count=400), "does not match expected size"),
        (tensor((4,), (1,), kind=b"HalfStorage"), "names torch HalfStorage"),
        (b"\x80\x02}NNs.", "a key that is neither"),
        (b"", "exhausted"),
    ],
    ids=range(13),
)  # fmt: skip
def test_pickles_that_are_no_state_dict(structure, reason, folder):
    refused(hostile(folder / "best_model.zip", structure), reason, model_files.read_model)


def test_torch_reads_the_pickle_that_was_checked(folder):
    """Not another of the same name, in capitals or not, nor one in front of the zip file."""

    def in_front(name, data):
        return pickle.dumps({}, 2) + data if name == "policy.pth" else data

    refused(spoil(folder, in_front), "a member is no zip file", model_files.read_model)
    inner = io.BytesIO()
    with zipfile.ZipFile(inner, "w") as archive:
        for name in ("archive/DATA.PKL", "archive/data.pkl"):
            archive.writestr(name, pickle.dumps({}, 2))
    path = spoil(folder, lambda name, data: inner.getvalue() if name == "policy.pth" else data)
    refused(path, "2 files data.pkl", model_files.read_model)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_weights_are_finite(value, folder):
    path = folder / "best_model.zip"
    refused(hostile(path, tensor((4,), (1,)), struct.pack("<4f", 0, 1, value, 0)), "not finite",
            model_files.read_model)  # fmt: skip
    refused(hostile(path, pickle.dumps({"a": value}, 2)), "finite", model_files.read_model)


@pytest.mark.parametrize(
    "data",
    [b"{}", b"[1]", b"", b"\xff", b"[" * 100_000, b'{"num_timesteps": -1}',
     b'{"num_timesteps": 1e3}', b'{"num_timesteps": true}', b'{"num_timesteps": %d}' % 10**30],
)  # fmt: skip
def test_steps_are_a_whole_number(data, folder):
    path = spoil(folder, lambda name, old: data if name == "data" else old)
    refused(path, "no Stable-Baselines3 model", model_files.read_model)


def test_notes_in_a_model_file(folder):
    path = folder / "best_model.zip"
    assert model_files.read_notes(path) == {}
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("notes.json", '{"return": 1.5}')
    assert model_files.read_notes(path) == {"return": 1.5}
    for wrong, reason in ((b"[" * 100_000, "recursion"), (b"[1]", "must be a dict")):
        spoil(folder, lambda name, old, new=wrong: new if name == "notes.json" else old)
        refused(path, reason, model_files.read_notes)


def test_nothing_unpacks_without_bound(folder):
    """A large member, one whose header says less, another packing, a large one inside."""
    path = folder / "best_model.zip"
    large = b"\0" * (model_files.MAX_BYTES + 1)

    def fill(method):
        with zipfile.ZipFile(path, "w", method) as archive:
            archive.writestr("policy.pth", large)
            archive.writestr("data", '{"num_timesteps": 1}')

    tracemalloc.start()
    fill(zipfile.ZIP_DEFLATED)
    shorter = path.read_bytes().replace(struct.pack("<I", len(large)), struct.pack("<I", 1000))
    tracemalloc.reset_peak()
    refused(path, "must be 67108864 at most", model_files.read_model)
    path.write_bytes(shorter)
    refused(path, "no Stable-Baselines3 model", model_files.read_model)
    peak = tracemalloc.get_traced_memory()[1] - len(large)
    tracemalloc.stop()
    assert peak < 2**20
    fill(zipfile.ZIP_BZIP2)
    refused(path, "67108864 at most", model_files.read_model)
    for method in (zipfile.ZIP_BZIP2, zipfile.ZIP_DEFLATED):
        with zipfile.ZipFile(path, "w", method) as archive:
            archive.writestr("policy.pth", b"\0" * 1000)
        refused(path, f"packed by method {method}, must be stored", model_files.read_model)
    refused(hostile(path, tensor((4,), (1,)), large), "67108864 at most", model_files.read_model)


def test_members_that_are_not_needed_stay_unread(folder):
    path = folder / "best_model.zip"
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("other.pth", b"\0" * 2 * model_files.MAX_BYTES)
        archive.writestr("pytorch_variables.pth.bak", b"?")
    sb3.load_policy(path)
    assert "other" not in model_files.read_model(path)[0]


def test_only_what_a_model_saves_is_restored():
    model = prepare(small_run("sac"))
    given = {
        "policy": model.policy.state_dict(),
        "actor.optimizer": model.actor.optimizer.state_dict(),
        "critic.optimizer": model.critic.optimizer.state_dict(),
        "ent_coef_optimizer": model.ent_coef_optimizer.state_dict(),
        "pytorch_variables": {"log_ent_coef": torch.full((1,), -0.5)},
    }
    models.restore(model, given)
    assert model.log_ent_coef.item() == -0.5 and model.log_ent_coef.requires_grad
    one = torch.zeros(1)
    for change, reason in (
        ({"pytorch_variables": {"log_ent_coef": one, "env": one}}, "has the variables"),
        ({"pytorch_variables": {}}, "has the variables"),
        ({"pytorch_variables": {"log_ent_coef": torch.zeros(2)}}, "does not fit"),
        ({"pytorch_variables": {"log_ent_coef": "0"}}, "does not fit"),
        ({"logger": {}}, "does not fit"),
        ({"policy": {}}, "does not fit"),
        ({"actor.optimizer": {"state": 1}}, "does not fit"),
    ):
        with pytest.raises(ValueError, match=f"the saved model {reason}"):
            models.restore(model, {**given, **change})
