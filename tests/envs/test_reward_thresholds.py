"""Tasks count as solved where trained policies solve them, and simple controllers do not."""

import gymnasium as gym
import pytest
from side_by_side import rollout

from jansen_env.policies import pretrained
from jansen_env.policies.policy import still
from jansen_env.registration import IDS
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.tasks.goal.goal_benchmark import goal_pid


def mean_return(policy_of, env_id, episodes):
    """Mean return of episodes as ``reset`` draws them."""
    envs = gym.make_vec(env_id, episodes)
    policy = policy_of(gym.make(env_id).unwrapped)
    return rollout(policy, envs, envs.spec.max_episode_steps, seed=1000)[0].mean()


@pytest.mark.slow
@pytest.mark.parametrize("env_id", IDS)
def test_reward_threshold(env_id):
    threshold = gym.spec(env_id).reward_threshold
    episodes = 20 if "Crank" in env_id else 100
    goal = "Goal" in env_id
    solves = goal_pid if goal else lambda env: pretrained.load(env_id)
    fail = {"still": still} if goal else find_benchmark(env_id).baselines
    assert mean_return(solves, env_id, episodes) >= threshold
    for name in {"pid", "constant", "still"} & {*fail}:
        assert mean_return(fail[name], env_id, episodes) < threshold
