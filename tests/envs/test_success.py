"""Tests of ``info["is_success"]`` in every environment and through every API."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import EvalCallback

from jansen_env.registration import IDS
from jansen_env.sb3 import make_vec_env
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.rollout import run_episodes
from jansen_env.tasks.walking.walker_benchmark import walking_pid


def last_info(env, policy, **options):
    """Return the ``info`` of the last step of an episode under a policy."""
    observation, _ = env.reset(seed=0, options=options)
    state = None
    starts = np.ones(1, bool)
    over = False
    while not over:
        action, state = policy.predict(observation[None], state, starts, True)
        observation, _, terminated, truncated, info = env.step(action[0])
        starts = np.zeros(1, bool)
        over = terminated or truncated
    return info


def walker(**arguments):
    env = gym.make("JansenWalkerBuilt-v0", max_episode_steps=200, **arguments)
    return env, find_benchmark("JansenWalkerBuilt-v0").baselines["pid"](env.unwrapped)


@pytest.mark.parametrize("command", [0.2, -0.2])
def test_a_walk_of_most_of_the_commanded_distance_is_a_success(command):
    info = last_info(*walker(), speed_command=command)
    walked = info["x_position"] / (command * 4.0)
    assert info["is_success"] and 0.8 < walked < 1.3


def test_too_short_a_walk_the_wrong_way_and_a_fall_are_none():
    env, _ = walker()
    for speed in (0.5, -2.0):  # rad/s; walking at 0.2 m/s takes about 2 rad/s
        slow = walking_pid(
            lambda commands, speed=speed: np.full(len(commands), speed), env.unwrapped
        )
        info = last_info(env, slow, speed_command=0.2)
        assert not info["is_success"] and not info["fallen"]
    env, pid = walker(fall_pitch=0.02, terminate_when_fallen=False)
    info = last_info(env, pid, speed_command=0.2)
    assert info["fallen"] and info["x_position"] > 0.64 and not info["is_success"]


def test_the_crank_is_to_follow_its_reference():
    env = gym.make("JansenCrank-v0", max_episode_steps=300)
    baselines = find_benchmark("JansenCrank-v0").baselines
    info = last_info(env, baselines["pid"](env.unwrapped))
    assert info["is_success"] and 0.0 < info["rms_error"] <= 0.2
    info = last_info(env, baselines["constant"](env.unwrapped), speed_command=3.0)
    assert not info["is_success"] and info["rms_error"] > 0.2


@pytest.mark.parametrize("env_id", IDS)
def test_all_apis_agree(env_id):
    """The last flag of an episode is reported alone, in a batch, and by Stable-Baselines3."""
    short = {"max_episode_steps": 60}
    commands = np.full(2, find_benchmark(env_id).middle)
    env = gym.make(env_id, **short)
    baseline = next(iter(find_benchmark(env_id).baselines.values()))(env.unwrapped)
    options = find_benchmark(env_id).options(commands[0])
    alone = last_info(env, baseline, **options)["is_success"]
    run = run_episodes(baseline, env_id, short, commands, np.array([0, 1]))
    if "success" in run:
        assert bool(run["success"][0]) == alone
    envs = make_vec_env(env_id, 2, seed=0, env_kwargs=short)
    envs.reset()
    for _ in range(60):
        *_, dones, infos = envs.step(np.zeros((2, 1), np.float32))
    assert dones.all() and all(info["is_success"] in (True, False) for info in infos)


def test_stable_baselines3_logs_the_share_of_successes():
    envs = make_vec_env("JansenWalkerBuilt-v0", 2, env_kwargs={"max_episode_steps": 20})
    callback = EvalCallback(envs, n_eval_episodes=2, eval_freq=16, verbose=0)
    model = PPO("MlpPolicy", envs, n_steps=16, batch_size=32, n_epochs=1)
    model.learn(64, callback=callback)
    assert len(callback._is_success_buffer) == 2  # The callback logs the mean of this buffer.
