"""Model files: only tensors are read from them, damaged and hostile ones are refused by name."""

import io
import pickle
import re
import shutil
import sys
import textwrap
import zipfile

import numpy as np
import pytest
import torch
import yaml
from small_runs import made_run, small_run
from stable_baselines3 import PPO

import train
from agents.training.train_model import prepare
from agents.training.training_state import restore
from jansen_env import sb3
from jansen_env.sb3 import trained
from jansen_env.sb3.trained import read_model
from jansen_env.scoring.rollout import make_env

ENV = "JansenCrank-v0"
POLICY = {"net_arch": [8], "normalize": True}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run's folder with a model."""
    return made_run(tmp_path_factory.mktemp("made") / "run", "ppo", {}, POLICY)


@pytest.fixture
def folder(made, tmp_path):
    return shutil.copytree(made, tmp_path / "run")


def configure(folder, **values):
    values = {"env": ENV, "policy_kwargs": POLICY, **values}
    (folder / "config.yml").write_text(yaml.safe_dump(values))


def changed(path, **members):
    """A model's file with other content in some members."""
    with zipfile.ZipFile(path) as archive:
        content = {name: archive.read(name) for name in archive.namelist()} | members
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    return path


def refused(path, reason, load=sb3.load_policy):
    """Loading is refused in one line that names the file."""
    with pytest.raises(ValueError, match=reason) as error:
        load(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


class Bomb:
    """An object whose pickle imports a module that a stranger has put there."""

    def __reduce__(self):
        return (eval, ("__import__('payload')",))


@pytest.fixture
def payload(folder, monkeypatch):
    """A module in the run's folder that nothing may import."""
    (folder / "payload.py").write_text("")
    monkeypatch.syspath_prepend(folder)
    yield
    assert "payload" not in sys.modules


def test_names_in_a_configuration_import_nothing(folder, payload):
    for values in (
        {"env": f"payload:{ENV}"},
        {"algo": "payload:PPO"},
        {"env_kwargs": {"entry_point": "payload:Env"}},
        {"training_variants": [{"additional_wrappers": ["payload:Wrapper"]}]},
        {"policy_kwargs": {"features_extractor_class": "payload.Extractor"}},
        {"policy_kwargs": {"activation": "payload.activation"}},
    ):
        configure(folder, **values)
        refused(folder, "must be")
        with pytest.raises(SystemExit, match=r"config\.yml: .* must be"):
            train.main(["--resume", str(folder), "--no-progress"])


def test_pickles_in_a_model_never_run(folder, payload):
    """Pickles that Stable-Baselines3 would load stay unread; pickles of tensors are refused."""
    bomb = pickle.dumps(Bomb())
    data = b'{"num_timesteps": 1, "policy_class": {":serialized:": "%s"}}' % bomb.hex().encode()
    sb3.load_policy(changed(folder / "best_model.zip", data=data))
    inner = io.BytesIO()
    torch.save(Bomb(), inner)
    for content in (inner.getvalue(), bomb):
        path = changed(folder / "best_model.zip", **{"policy.pth": content})
        refused(path, "not a Stable-Baselines3 model")


def test_a_model_trained_elsewhere(tmp_path):
    """A model of plain Stable-Baselines3 loads with the three lines of config.yml that it takes."""
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
            {"policy_kwargs": {"net_arch": [8]}},
            r"one with 9 other tensors, such as features_extractor\.count",
        ),
        ({"env": "JansenWalker-v0"}, r"features_extractor\.mean must have the shape"),
        ({"env_kwargs": {"torque_limit": -1}}, "torque_limit must be above 0, got -1"),
        ({"policy_kwargs": {"net_arch": [8], "squash_output": True}}, "squash_output"),
    ],
)
def test_models_that_do_not_fit_their_configuration(values, reason, folder):
    configure(folder, **values)
    with pytest.raises(ValueError, match=reason) as error:
        sb3.load_policy(folder)
    assert str(folder / "config.yml") in str(error.value) and "\n" not in str(error.value)


def test_a_key_in_the_wrong_place_is_told_where_it_belongs(folder):
    configure(folder, net_arch=[8])
    with pytest.raises(ValueError, match="'net_arch' must be a key of policy_kwargs, as in"):
        sb3.load_policy(folder)


@pytest.mark.parametrize("place", ["vecnormalize.pkl", "../vec_normalize.pkl"])
def test_a_model_with_normalized_observations_is_not_scored_wrongly(place, folder, tmp_path):
    """Its statistics are a pickle beside the model; without them its actions mean nothing, so that
    it is refused.
    """
    run = tmp_path / "run" / "inner"
    run.mkdir(parents=True)
    model = PPO("MlpPolicy", make_env(ENV, {}), n_steps=8, batch_size=8)
    model.save(run / "mine.zip")
    (run / "config.yml").write_text(f"algo: ppo\nenv: {ENV}\npolicy: MlpPolicy\n")
    sb3.load_policy(run / "mine.zip")
    (run / place).write_bytes(b"")
    with pytest.raises(ValueError, match=r"was trained with VecNormalize .*docs/training\.md"):
        sb3.load_policy(run / "mine.zip")


def test_weights_are_finite(folder):
    weights = read_model(folder / "best_model.zip").parameters["policy"]
    weights["action_net.bias"][0] = torch.nan
    inner = io.BytesIO()
    torch.save(weights, inner)
    path = changed(folder / "best_model.zip", **{"policy.pth": inner.getvalue()})
    refused(path, "must be finite, got NaN or infinity")


@pytest.mark.parametrize("data", [b"[1]", b"[" * 100_000, b'{"num_timesteps": true}'])
def test_steps_are_a_whole_number(data, folder):
    refused(changed(folder / "best_model.zip", data=data), "not a Stable-Baselines3 model")


def test_nothing_unpacks_without_bound(folder, monkeypatch):
    monkeypatch.setattr(trained, "MAX_BYTES", 10**6)
    with zipfile.ZipFile(folder / "best_model.zip", "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("other", bytes(10**6))
    refused(folder / "best_model.zip", "must unpack to at most 1000000 bytes")


def test_only_what_a_model_saves_is_restored():
    model = prepare(small_run("sac"))
    parameters = {
        "policy": model.policy.state_dict(),
        "actor.optimizer": model.actor.optimizer.state_dict(),
        "critic.optimizer": model.critic.optimizer.state_dict(),
        "ent_coef_optimizer": model.ent_coef_optimizer.state_dict(),
    }
    given = trained.SavedModel(parameters, {"log_ent_coef": torch.full((1,), -0.5)}, 7, {})
    restore(model, given)
    assert model.log_ent_coef.item() == -0.5 and model.log_ent_coef.requires_grad
    assert model.num_timesteps == 7
    for change in (
        {"variables": {}},
        {"variables": {"log_ent_coef": torch.zeros(2)}},
        {"parameters": {**parameters, "logger": {}}},
        {"parameters": {**parameters, "policy": {}}},
        {"parameters": {**parameters, "actor.optimizer": {"state": 1}}},
    ):
        with pytest.raises(ValueError, match="the saved model does not fit"):
            restore(model, given._replace(**change))
