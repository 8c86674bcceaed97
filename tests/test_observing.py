"""What a policy sees beside the environment's observation: the same in training and in use."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from agents import models, observing, pack, runs
from agents.config import check_config
from agents.observing import observing_policy
from agents.rollout import make_env, run_episodes
from agents.vec_env import make_vec_env
from jansen_env import pretrained
from jansen_env.history import History

ENV = "JansenWalkerHardcore-v0"  # numbers are drawn, and sensors are noisy
SIZE, DRAWN = 35, 17  # of an observation; numbers of an episode
HISTORY = {"length": 3, "every": 2}
VARIANTS = [
    {"speed_command": 0.3, "max_episode_steps": 7},
    {"speed_command": 0.6, "max_episode_steps": 11},
]


def configured(**more):
    """A small configuration."""
    return {
        "algo": "ppo", "env": ENV, "seed": 0, "policy": "MlpPolicy", "timesteps": 64, "n_envs": 4,
        "hyperparameters": {"n_steps": 16, "batch_size": 16},
        "policy_kwargs": {"net_arch": [8], "normalize": True, "harmonics": 1}, **more,
    }  # fmt: skip


def envs(config):
    """Four robots whose episodes end at different times."""
    return observing.observing(make_vec_env(ENV, 4, {}, VARIANTS), config)


def made_model(config):
    """A model that has learnt nothing, with weights and statistics of some size."""
    model = models.build_model("ppo", config, envs(config), seed=0)
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for name, tensor in model.policy.state_dict().items():
            drawn = torch.randn(tensor.shape, generator=generator)
            tensor.copy_(drawn.abs() + 0.1 if "features" in name else 0.4 * drawn)
    return model


def test_a_history_is_of_the_episode_alone():
    """By definition: the observations 0, m, 2 m ... steps back, but none before the first."""
    rng, history = np.random.default_rng(0), History(4, 3)
    seen, memory, begun = [], None, np.zeros(5, int)
    for step in range(60):
        observations, starts = rng.normal(size=(5, 2)), rng.random(5) < 0.08
        begun[starts] = step
        seen.append(observations)
        side_by_side, memory = history.extend(memory, observations, starts)
        for i in range(5):
            back = [max(step - 3 * k, begun[i]) for k in range(4)]
            assert np.array_equal(side_by_side[i], np.ravel([seen[b][i] for b in back]))
    assert memory.shape == (5, history.steps, 2) == (5, 10, 2) and len(set(begun)) > 3


@pytest.mark.parametrize(("length", "every"), [(0, 1), (2, 0), (1.5, 1), (2, True), (1001, 1)])
def test_histories_are_checked(length, every):
    """In a line that names the value; as is a memory of other observations."""
    with pytest.raises(ValueError, match=r"history\.\w+ is .*, must be a whole number from 1 to"):
        History(length, every)
    with pytest.raises(ValueError, match="remembers 1001 steps, must remember at most 1000"):
        History(101, 10)
    assert History(112, 9).steps == 1000
    _, memory = History(2).extend(None, np.zeros((3, 2)), np.zeros(3, bool))
    with pytest.raises(ValueError, match=r"memory has shape \(3, 2, 2\), must have \(4, 2, 2\)"):
        History(2).extend(memory, np.zeros((4, 2)), np.zeros(4, bool))


@pytest.mark.parametrize("privileged", [False, True])
def test_a_policy_in_use_sees_what_it_saw_in_training(privileged):
    """Through ends of episodes, the last observations too; and the critic what only it may know."""
    config = configured(history=HISTORY, privileged_critic=privileged)
    model, plain = made_model(config), make_vec_env(ENV, 4, {}, VARIANTS)
    venv, policy, state = model.get_env(), observing_policy(model), None
    venv.seed(7), plain.seed(7)
    seen, own, starts, ends = venv.reset(), plain.reset(), np.ones(4, bool), 0
    space, known = venv.observation_space, privileged * (DRAWN + SIZE)
    assert seen.shape == (4, *space.shape) == (4, 3 * SIZE + known)
    rng = np.random.default_rng(0)
    for _ in range(40):
        task = plain.env.task
        truth, drawn = task.true_observation.copy(), task.parameters.astype(np.float32)
        assert np.array_equal(seen[:, :SIZE], own) and seen.dtype == np.float32
        assert not np.array_equal(own, truth)
        if privileged:
            assert np.array_equal(seen[:, -known:], np.append(drawn, truth, axis=1))
        in_training = model.policy.predict(seen, deterministic=True)[0]
        in_use, after = policy.predict(own, state, starts, True)
        assert np.array_equal(in_use, in_training)
        noisy = np.clip(in_training + rng.normal(size=(4, 1)), -1.0, 1.0).astype(np.float32)
        seen, _, dones, infos = venv.step(noisy)
        own, _, starts, own_infos = plain.step(noisy)
        assert np.array_equal(dones, starts)
        for i in np.flatnonzero(dones):
            last, own_last = (each[i]["terminal_observation"] for each in (infos, own_infos))
            assert last.shape == seen[i].shape and np.array_equal(last[:SIZE], own_last)
            if privileged:
                truth = own_infos[i]["true_observation"]
                assert np.array_equal(last[-known:], np.append(drawn[i], truth))
            alone = policy.predict(own_last, after[[i]], None, True)[0]
            assert alone == pytest.approx(model.policy.predict(last, deterministic=True)[0])
            ends += 1
        state = after
    assert ends == 16


def test_only_the_critic_knows_the_parameters():
    """Its value depends on them, and no action does."""
    model = made_model(configured(privileged_critic=True))
    seen = torch.as_tensor(model.get_env().reset()).requires_grad_()
    actions, values, _ = model.policy(seen, deterministic=True)
    by_action, by_value = (torch.autograd.grad(x.sum(), seen)[0] for x in (actions, values))
    assert (by_action[:, SIZE:] == 0.0).all() and (by_action[:, :SIZE] != 0.0).any()
    assert (by_value[:, SIZE:] != 0.0).any() and (by_value[:, :SIZE] != 0.0).any()


@pytest.mark.parametrize("privileged", [False, True])
@pytest.mark.parametrize("history", [{}, HISTORY])
def test_a_policy_is_the_same_wherever_it_comes_from(history, privileged, tmp_path):
    """Of the model, its file, and packed for NumPy: episodes within rounding."""
    config = configured(history=history, privileged_critic=privileged, env_kwargs={"delay": 0.01})
    runs.record_run(tmp_path, config, "python train.py")
    model = made_model(config)
    model.save(tmp_path / "best_model.zip")
    path = pack.pack(tmp_path, None, tmp_path / "packed", episodes=1)
    loaded, packed = models.load_policy(tmp_path), pretrained.load_file(path)
    commands, seeds = np.array([0.2, 0.4, 0.6]), np.arange(3)
    of_model, of_file, of_package = (
        run_episodes(policy, ENV, {"max_episode_steps": 30}, commands, seeds)["returns"]
        for policy in (observing_policy(model), loaded, packed)
    )
    assert np.array_equal(of_model, of_file)
    assert of_package == pytest.approx(of_file, rel=1e-3)
    observation = make_env(ENV, {}).reset(seed=0)[0]
    action, state = packed.predict(observation)
    assert action.shape == (1,) and (state is None) == (not history)


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        ({"history": {"length": 0}}, "history.length is 0, must be a whole number from 1"),
        ({"history": {"steps": 2}}, "'steps' is no key of history"),
        ({"history": {"length": 1000, "every": 1000}}, "999001 steps, must remember at most 1000"),
        ({"privileged_critic": True, "policy_kwargs": {}}, "so normalize must be true"),
        ({"privileged_critic": True, "algo": "sac"}, "so algo must be 'ppo'"),
        ({"privileged_critic": True, "env": "JansenCrank-v0"}, "privileged_critic is given, but"),
    ],
)
def test_configurations_are_checked(more, reason):
    """In a line."""
    with pytest.raises(ValueError, match=reason):
        check_config({**configured(), **more})


def test_long_histories_of_many_numbers_are_refused():
    """Before a network for them is made: a look at 1,000 places is remembered for 19 steps."""
    env_kwargs = {"height_scan": [0.5, 0.9, 1000]}
    for length in (19, 20):
        config = configured(history={"length": length}, env_kwargs=env_kwargs)
        check_config(config)
        if length == 19:
            models.untrained_policy(config)
    with pytest.raises(ValueError, match="remembers 20400 numbers of observations of 1020"):
        models.untrained_policy(config)
    policy = pretrained.load(ENV)
    described = {**policy.description, "history": {"length": 101, "every": 9}}
    with pytest.raises(ValueError, match="remembers 31535 numbers of observations of 35"):
        pretrained.PretrainedPolicy(described, policy.tensors)


@pytest.mark.parametrize(
    ("entry", "reason"),
    [
        ([2, 1], "history is .*, must be a dict"),
        ({"length": 2, "skip": 1}, r"history has \['skip'\], must have length and every"),
        ({"length": 10**6}, "history.length is 1000000, must be a whole number from 1 to 1000"),
        ({"length": 2, "every": 1000}, "1001 steps, must remember at most 1000"),
        ({"length": 2}, r"has shape \(20,\), must have \(40,\)"),
    ],
)
def test_descriptions_of_histories_are_checked(entry, reason):
    """A policy's file is not trusted."""
    policy = pretrained.load("JansenWalker-v0")
    with pytest.raises(ValueError, match=reason):
        pretrained.PretrainedPolicy({**policy.description, "history": entry}, policy.tensors)
