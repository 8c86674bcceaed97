"""The goal task: its reward, its success, its baseline; the same at all APIs."""

import itertools

import gymnasium as gym
import numpy as np
import pytest
from side_by_side import rollout

from jansen_env.policies.policy import still
from jansen_env.tasks.goal import goal_benchmark
from jansen_env.tasks.goal.goal_benchmark import goal_pid
from jansen_env.tasks.goal.goal_env import NEAR


def solved(policy, env):
    """Successes (n,), returns (n,) and motor work (n,) J of episodes side by side."""
    returns, work, on, infos = rollout(policy, env, steps=750, seed=1000)
    return on & infos["is_success"], returns, work


def make(n):
    return gym.make_vec("JansenGoal-v0", n, max_episode_steps=None)


def test_the_goal_is_seen():
    """Its flag and its place are drawn, even beyond the picture."""
    env = gym.make("JansenGoal-v0", render_mode="rgb_array")
    pictures = []
    for goal in (0.5, 0.6, 2.9, 3.0):
        env.reset(seed=0, options={"goal": goal, "crank_angle": 0.0})
        pictures.append(env.render())
    changed = [(a != b).any(axis=-1) for a, b in itertools.pairwise(pictures)]
    assert changed[0][200:, 300:].any() and not changed[2][200:].any() and changed[2][:200].any()
    env.close()


class Shaken:
    """A policy whose actions are shaken: as good, and it takes more energy."""

    def __init__(self, policy, size):
        self.policy = policy
        self.size = size
        self.sign = 1.0

    def predict(self, observation, state, episode_start):
        action, state = self.policy.predict(observation, state, episode_start)
        self.sign = -self.sign
        return action + np.float32(self.sign * self.size), state


@pytest.mark.slow
def test_the_baseline_solves_it_and_the_reward_ranks(monkeypatch):
    """It reaches at least 90 of 100 goals on which it was not tuned; controllers that reach fewer
    goals, or do more work, have lower returns.
    """
    env = make(100)
    success, returns, work = solved(goal_pid(env.unwrapped), env)
    assert success.mean() >= 0.9
    shaken = solved(Shaken(goal_pid(env.unwrapped), 0.08), env)
    assert shaken[0].mean() > 0.8 and shaken[2].mean() > 1.2 * work.mean()
    monkeypatch.setattr(goal_benchmark, "GAIN", 0.25)
    slow = solved(goal_pid(env.unwrapped), env)
    rest = solved(still(env.unwrapped), env)
    assert success.mean() > shaken[0].mean() - 0.05 > slow[0].mean() > rest[0].mean() == 0.0
    assert returns.mean() > shaken[1].mean() > slow[1].mean() > rest[1].mean()
    env.close()


def test_success_is_the_last_second_within_two_centimetres():
    env = gym.make("JansenGoal-v0")
    policy = goal_pid(env.unwrapped)
    state = None
    observation, info = env.reset(seed=3, options={"goal": 0.4})
    assert info["goal"] == 0.4 and not info["is_success"]
    distance = env.unwrapped.task.columns["goal_distance"]
    inside = 0
    for k in range(600):
        action, state = policy.predict(observation, state, np.array([k == 0]))
        observation, reward, _, _, info = env.step(action)
        terms = [info[f"reward/{name}"] for name in ("closeness", "arrival", "energy")]
        assert reward == pytest.approx((terms[0] + terms[1]) * terms[2], rel=1e-12)
        assert terms[1] == pytest.approx(6.0 / (1.0 + (info["distance"] / 0.02) ** 2), rel=1e-9)
        inside = inside + 1 if abs(info["distance"]) <= NEAR else 0
        assert info["is_success"] == (inside >= 50)
        assert observation[distance] == np.float32(info["distance"])
    assert info["is_success"]
    state = env.unwrapped.get_state()
    assert env.unwrapped.set_state(state)[distance] == observation[distance]
