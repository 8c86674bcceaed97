"""Policies that begin with a baseline's torque, and whose noise suits the commanded speed."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.utils import set_random_seed

from agents import callbacks, imitation
from agents.config import new_config
from agents.exploration import CommandNoisePolicy
from agents.imitation import CriticFirst, imitate
from agents.training import prepare, train
from agents.walker_observation import COMMAND


@pytest.fixture
def small(monkeypatch):
    """A configuration, and imitation, of a few robots and steps."""
    for name, value in (("ROBOTS", 8), ("STEPS", 100), ("ROUNDS", 2), ("EPOCHS", 20)):
        monkeypatch.setattr(imitation, name, value)
    monkeypatch.setattr(imitation, "BATCH", 64)
    config = new_config(n_envs=4, timesteps=64)
    config["hyperparameters"] |= {
        "n_steps": 8,
        "batch_size": 16,
        "n_epochs": 1,
        "learning_rate": 1e-3,
    }
    return config


def weights(model):
    return {name: value.clone() for name, value in model.policy.state_dict().items()}


def changed(before, after):
    return {name.split(".")[0] + "." + name.split(".")[1] if "." in name else name
            for name in before if not torch.equal(before[name], after[name])}  # fmt: skip


def test_a_policy_learns_a_baseline(small):
    model = prepare(small)
    before, drawn = weights(model), torch.get_rng_state()
    error = imitate(model, small)
    assert error < 0.08  # of the torque limit, where the profile's torque is 0.2 in the mean
    assert torch.equal(drawn, torch.get_rng_state())
    parts = changed(before, weights(model))
    assert {"mlp_extractor.policy_net", "action_net.weight"} <= parts
    assert not any("value" in part for part in parts) and "log_std" not in parts
    again = prepare(small)
    assert imitate(again, small) == error


def test_imitation_takes_the_plant_that_moves_many(small):
    """Whichever one is trained on."""
    found = [
        imitate(prepare(config), config)
        for config in (small, {**small, "env_kwargs": {"plant": "rigid_body"}, "n_envs": 2})
    ]
    assert found[0] == found[1]


def test_the_critic_learns_first(small):
    model = prepare(small)
    before = weights(model)
    model.learn(32, callback=CriticFirst(32))
    parts = changed(before, weights(model))
    assert "mlp_extractor.value_net" in parts
    assert not any("policy" in part or "action" in part or part == "log_std" for part in parts)
    model.learn(32, callback=CriticFirst(32), reset_num_timesteps=False)
    parts = changed(before, weights(model))
    assert {"mlp_extractor.policy_net", "log_std"} <= parts


def test_a_run_in_which_the_actor_never_learns_says_so(small, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(callbacks, "EPISODES", 1)
    del small["imitate"]
    small["env_kwargs"] = {"max_episode_steps": 5}
    for steps, said in ((64, True), (32, False)):
        own = {**small, "critic_first": steps}
        folder = tmp_path / str(steps)
        folder.mkdir()
        train(prepare(own), own, folder, eval_every=0, save_every=0, progress=False)
        assert ("the policy stays what it begins as" in capsys.readouterr().out) == said


def test_who_goes_on_with_a_model_trains_its_actor(small):
    """After a run that ended while the critic learned alone."""
    model = prepare(small)
    model.learn(32, callback=CriticFirst(1000))
    before = weights(model)
    model.learn(32, reset_num_timesteps=False)
    assert {"mlp_extractor.policy_net", "log_std"} <= changed(before, weights(model))


def test_noise_grows_with_the_command(small):
    policy = prepare(small).policy
    assert isinstance(policy, CommandNoisePolicy)
    seen = torch.zeros(4, policy.observation_space.shape[0])
    seen[:, COMMAND] = torch.tensor([0.0, -0.1, 0.3, 0.8])
    distribution = policy.get_distribution(seen).distribution
    shares = torch.tensor([0.03, 0.1, 0.2, 0.2]) / 0.2
    expected = policy.log_std.exp() * shares**policy.noise_exponent
    assert torch.allclose(distribution.stddev[:, 0], expected)
    actions, values, likelihood = policy(seen)
    again = policy.evaluate_actions(seen, actions)
    assert torch.equal(values, again[0]) and torch.allclose(likelihood, again[1])
    normal = torch.distributions.Normal(distribution.mean, expected[:, None])
    assert torch.allclose(normal.log_prob(actions)[:, 0], likelihood, atol=1e-5)


def test_files_of_the_library_keep_the_exponent(small, tmp_path):
    """Of the policy alone, and of the whole model."""
    model = prepare(small)
    model.policy.save(tmp_path / "policy.pth")
    model.save(tmp_path / "model.zip")
    read = [
        CommandNoisePolicy.load(tmp_path / "policy.pth"),
        PPO.load(tmp_path / "model.zip", device="cpu").policy,
    ]
    seen = torch.linspace(-0.5, 0.5, 60).reshape(3, 20)
    expected = model.policy.get_distribution(seen).distribution
    for policy in read:
        found = policy.get_distribution(seen).distribution
        assert torch.equal(found.stddev, expected.stddev)
        assert torch.equal(found.mean, expected.mean)


def test_without_an_exponent_it_is_the_usual_policy(small):
    found = []
    for exponent in ({}, {"noise_exponent": 0.0}):
        kwargs = {k: v for k, v in small["policy_kwargs"].items() if k != "noise_exponent"}
        model = prepare({**small, "policy_kwargs": {**kwargs, **exponent}})
        assert isinstance(model.policy, CommandNoisePolicy) == bool(exponent)
        set_random_seed(3)
        with torch.no_grad():
            found.append([part.numpy() for part in model.policy(torch.zeros(2, 20))])
    for usual, own in zip(*found, strict=True):
        np.testing.assert_allclose(usual, own, atol=1e-6)


@pytest.mark.parametrize(
    ("algo", "changes", "message"),
    [
        ("sac", {"imitate": "pid"}, "must be 'ppo'"),
        ("ppo", {"imitate": "nobody"}, "imitate is 'nobody'"),
        ("ppo", {"critic_first": -1}, "critic_first is -1"),
        ("ppo", {"training_variants": [{"slip_wait": 2.0}]}, "'slip_wait' is no argument"),
        ("ppo", {"training_variants": [{"torque_limit": 9.0}]}, "torque_limit is in training_var"),
    ],
)
def test_what_cannot_be_is_refused(algo, changes, message):
    with pytest.raises(ValueError, match=message):
        new_config(algo=algo, **changes)
