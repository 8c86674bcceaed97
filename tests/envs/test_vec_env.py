"""A batch as a ``VecEnv`` of Stable-Baselines3: its information, attributes and arguments."""

import csv
import inspect
import json
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env as their_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.logger import configure
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

from jansen_env import Leg, Payload, paper_robot
from jansen_env.sb3 import make_vec_env
from jansen_env.scoring.benchmarks import can_be_batched
from jansen_env.scoring.rollout import make_env

ENV = "JansenWalker-v0"


def test_information_of_a_step():
    """There is none but at the end of an episode, or under the requested keys; unknown keys are
    refused.
    """
    venv = make_vec_env(ENV, 2, env_kwargs={"max_episode_steps": 2})
    venv.reset()
    assert venv.step(np.zeros((2, 1)))[3] == [{}, {}]
    last = venv.step(np.zeros((2, 1)))[3]
    assert last[0]["TimeLimit.truncated"] and "energy" in last[1]
    kept = last[0]["terminal_observation"].copy()
    venv.step(np.ones((2, 1)))
    assert np.array_equal(last[0]["terminal_observation"], kept)
    venv = make_vec_env(ENV, 2, info_keys=["slip", "energy"])
    venv.reset()
    assert all(set(info) == {"slip", "energy"} for info in venv.step(np.zeros((2, 1)))[3])
    with pytest.raises(ValueError, match="slop"):
        make_vec_env(ENV, 2, info_keys=["slop"])


@pytest.mark.parametrize("batched", [True, False])
def test_a_fall_in_the_last_step_of_the_time_limit_is_a_fall(batched):
    """The value of its last state is not bootstrapped, as ``TimeLimit.truncated`` would have it."""
    kwargs = {"fall_pitch": 1e-6, "max_episode_steps": 1}  # which ends the first step
    venv = make_vec_env(ENV, 2, env_kwargs=kwargs)
    if not batched:
        venv = DummyVecEnv([lambda: make_env(ENV, kwargs)] * 2)
    venv.seed(0), venv.reset()
    _, _, dones, infos = venv.step(np.ones((2, 1), np.float32))
    for done, info in zip(dones, infos, strict=True):
        assert done and info["fallen"] and info["TimeLimit.truncated"] is False


def test_attributes_methods_and_options():
    """``indices`` chooses some robots or all; options hold for the next reset alone."""
    venv = make_vec_env(ENV, 3, env_kwargs={"friction": 0.4})
    assert venv.get_attr("friction") == [0.4] * 3 and venv.has_attr("control_dt")
    assert not venv.has_attr("nothing")
    venv.set_attr("friction", 0.9, indices=[0, 2])
    venv.set_attr("payload", Payload(1.5), indices=1)
    assert venv.get_attr("friction", indices=[1, 2]) == [0.4, 0.9]
    assert venv.env_method("get_wrapper_attr", "payload", indices=1) == [Payload(1.5)]
    assert venv.env_is_wrapped(gym.Wrapper) == [False] * 3
    venv.set_options({"speed_command": 0.33})
    command = venv.env.task.columns["speed_command"]
    assert (venv.reset()[:, command] == np.float32(0.33)).all()
    assert not (venv.reset()[:, command] == np.float32(0.33)).any()
    venv.set_options([{"crank_angle": angle} for angle in (0.0, 1.0, 2.0)])
    venv.reset()
    assert [info["crank_angle"] for info in venv.reset_infos] == [0.0, 1.0, 2.0]


def monitored(folder):
    """Return, length and x position of the episodes in monitor files, sorted."""
    rows = []
    for path in folder.glob("*monitor.csv"):
        with path.open(encoding="utf-8") as file:
            next(file)  # the header
            rows += [[row["r"], row["l"], row["x_position"]] for row in csv.DictReader(file)]
    return np.array(sorted(rows), float)


@pytest.mark.parametrize("wrapper", [None, gym.wrappers.TimeAwareObservation], ids=["", "wrapped"])
def test_arguments_of_stable_baselines3(wrapper, tmp_path):
    """Stable-Baselines3's own function, with the same arguments, starts alike and writes the same
    episodes.
    """
    kwargs = {"max_episode_steps": 4}
    monitor = {"info_keywords": ("x_position",)}
    given = {
        "n_envs": 3,
        "seed": 7,
        "start_index": 2,
        "wrapper_class": wrapper,
        "env_kwargs": kwargs,
        "monitor_kwargs": monitor,
    }
    ours = make_vec_env(ENV, monitor_dir=str(tmp_path / "ours"), **given)
    theirs = their_vec_env(ENV, monitor_dir=str(tmp_path / "theirs"), **given)
    assert np.array_equal(ours.reset(), theirs.reset())
    assert ours.action_space.sample() == theirs.action_space.sample()
    for _ in range(8):
        (*_, infos), (*_, expected) = (venv.step(np.ones((3, 1))) for venv in (ours, theirs))
    for info, other in zip(infos, expected, strict=True):
        a, b = info["episode"], other["episode"]
        assert a.keys() == b.keys()
        assert a["r"] == pytest.approx(b["r"], abs=1e-6) and a["l"] == b["l"]
        assert a["x_position"] == b["x_position"]
    ours.close(), theirs.close()
    names = ["2.monitor.csv", "3.monitor.csv", "4.monitor.csv"] if wrapper else ["2.monitor.csv"]
    assert sorted(path.name for path in (tmp_path / "ours").iterdir()) == names
    a, b = (monitored(tmp_path / folder) for folder in ("ours", "theirs"))
    assert a == pytest.approx(b, abs=1e-6) and a.shape == (6, 3)


def test_arguments_are_in_the_order_of_stable_baselines3():
    ours = inspect.signature(make_vec_env).parameters.values()
    positional = [entry.name for entry in ours if entry.kind == entry.POSITIONAL_OR_KEYWORD]
    assert positional == [*inspect.signature(their_vec_env).parameters]
    assert make_vec_env(ENV, 2, 7, 0, None, None, {"friction": 0.4}).num_envs == 2


def test_monitor_files_are_appended_to(tmp_path):
    for override, count in ((True, 1), (False, 2), (True, 1)):
        venv = make_vec_env(
            ENV,
            monitor_dir=tmp_path,
            monitor_kwargs={"override_existing": override},
            max_episode_steps=1,
        )
        venv.reset(), venv.step(np.ones((1, 1))), venv.close()
        (file,) = tmp_path.iterdir()
        header, names, *rows = file.read_text().splitlines()
        assert (file.name, names, len(rows)) == ("monitor.csv", "r,l,t", count)
        assert json.loads(header[1:])["env_id"] == ENV


@pytest.mark.parametrize("cls", [DummyVecEnv, SubprocVecEnv])
def test_a_class_of_stable_baselines3_holds_single_environments(cls):
    settings = {"start_method": "fork"} if cls is SubprocVecEnv else {}
    venv = make_vec_env(
        ENV,
        2,
        3,
        vec_env_cls=cls,
        vec_env_kwargs=settings,
        max_episode_steps=2,
        monitor_kwargs={"allow_early_resets": False},
    )
    assert type(venv) is cls and venv.env_is_wrapped(Monitor) == [True, True]
    batch = make_vec_env(ENV, 2, 3, max_episode_steps=2)
    assert np.array_equal(venv.reset(), batch.reset())
    for _ in range(2):
        seen, rewards, _, infos = venv.step(np.ones((2, 1), np.float32))
        expected, batch_rewards, _, batch_infos = batch.step(np.ones((2, 1), np.float32))
        assert np.array_equal(seen, expected) and rewards == pytest.approx(batch_rewards)
    assert infos[0]["episode"]["r"] == pytest.approx(batch_infos[0]["episode"]["r"], abs=1e-6)
    venv.close()


def test_returns_are_logged_and_evaluated_without_a_warning(recwarn, tmp_path):
    """``ep_rew_mean`` and ``evaluate_policy`` give what the environments rewarded."""
    venv = make_vec_env(ENV, 3, 0, max_episode_steps=10)
    model = PPO("MlpPolicy", venv, n_steps=20, batch_size=60, n_epochs=1, seed=0, device="cpu")
    model.set_logger(configure(str(tmp_path), ["csv"]))
    model.learn(60)
    returns = [episode["r"] for episode in model.ep_info_buffer]
    (row,) = csv.DictReader((tmp_path / "progress.csv").read_text().splitlines())
    assert len(returns) == 6 and float(row["rollout/ep_len_mean"]) == 10.0
    assert float(row["rollout/ep_rew_mean"]) == pytest.approx(np.mean(returns), rel=1e-6)
    venv.seed(0)
    returns, lengths = evaluate_policy(model, venv, 3, return_episode_rewards=True)
    venv.seed(0)
    assert not [warning for warning in recwarn if "Monitor" in str(warning.message)]
    seen = venv.reset()
    total = np.zeros(3)
    for _ in range(10):
        seen, rewards, dones, infos = venv.step(model.predict(seen, deterministic=True)[0])
        total += rewards
    assert dones.all() and lengths == [10] * 3 and returns == pytest.approx(total, rel=1e-6)
    assert [info["episode"]["r"] for info in infos] == pytest.approx(total, rel=1e-6)


def test_what_is_refused():
    with pytest.raises(gym.error.ResetNeeded):
        make_vec_env(ENV, 2).step(np.zeros((2, 1)))
    for variants, named in (((), "variants"), ([{"speed_command": [1, 2, 3]}], "speed_command")):
        with pytest.raises(ValueError, match=named):
            make_vec_env(ENV, 2, env_kwargs={}, variants=variants)
    with pytest.raises(ValueError, match=r"environment id must be .*, got 'Walker2d-v5'"):
        make_vec_env("Walker2d-v5", 2)
    for name, value in (("n_envs", 0), ("seed", -1), ("start_index", -1)):
        with pytest.raises(ValueError, match=f"{name} must be .*, got {value}"):
            make_vec_env(ENV, **{name: value})
    wrapped = {"wrapper_class": gym.wrappers.TimeAwareObservation}
    for message, given in (
        ("vec_env_kwargs must come with vec_env_cls", {"vec_env_kwargs": {"a": 1}}),
        ("wrapper_kwargs must come with wrapper_class", {"wrapper_kwargs": {"a": 1}}),
        (
            "monitor_kwargs must be among .*, got 'reset_keywords'.*; give vec_env_cls",
            {"monitor_kwargs": {"reset_keywords": ("seed",)}},
        ),
        ("monitor_kwargs must be among .*, got 'file'", {**wrapped, "monitor_kwargs": {"file": 1}}),
        (
            "info_keywords must be among .*, got 'slop'; did|got 'slop'",
            {"monitor_kwargs": {"info_keywords": ("slop",)}},
        ),
    ):
        with pytest.raises(ValueError, match=message):
            make_vec_env(ENV, 2, **given)


def test_what_cannot_move_together_takes_turns():
    assert can_be_batched(ENV, {"friction": 0.5}, [{"payload": 1.0}, {}])
    assert not can_be_batched(ENV, {"plant": "rigid_body"})
    assert not can_be_batched(ENV, {"track_joint_forces": True})
    assert not can_be_batched(ENV, {}, [{"control_dt": 0.01}])
    legs = tuple(Leg(side, phase) for phase in (0.0, 3.0) for side in ("fore", "back"))
    assert not can_be_batched(ENV, {}, [{}, {"robot": replace(paper_robot(), legs=legs)}])
    assert can_be_batched(ENV, {}, [{"robot": "built"}, {}])
    assert can_be_batched("JansenCrank-v0", {"reset_noise_scale": 1.0})
    kwargs = {"track_joint_forces": True}
    assert not can_be_batched("JansenCrank-v0", kwargs)
    assert isinstance(make_vec_env("JansenCrank-v0", 2, env_kwargs=kwargs), DummyVecEnv)
