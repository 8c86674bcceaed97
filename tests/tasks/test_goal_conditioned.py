"""The goal-conditioned form of the goal task, which hindsight experience replay needs."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from jansen_env.tasks.goal.goal_conditioned import GoalConditioned


@pytest.fixture
def env():
    """The environment of the wrapper."""
    made = GoalConditioned(gym.make("JansenGoal-v0", disable_env_checker=True))
    yield made
    made.close()


def walk(env, steps, goal=0.0):
    """Observations, rewards and information of random steps."""
    rng = np.random.default_rng(0)
    env.reset(seed=0, options={"goal": goal})
    return [env.step(rng.uniform(-1.0, 1.0, 1).astype(np.float32)) for _ in range(steps)]


def test_it_follows_the_interface_of_gymnasium(env):
    check_env(env, skip_render_check=True)


def test_the_rewards_of_steps_are_those_of_their_goals(env):
    for observation, reward, terminated, truncated, info in walk(env, 100):
        achieved, desired = observation["achieved_goal"], observation["desired_goal"]
        assert env.compute_reward(achieved, desired, info) == reward
        assert env.compute_terminated(achieved, desired, info) == terminated
        assert env.compute_truncated(achieved, desired, info) == truncated


def test_steps_are_those_of_the_goal_task(env):
    plain = gym.make("JansenGoal-v0", disable_env_checker=True)
    names = [observed.name for observed in plain.unwrapped.observed]
    distance = names.index("goal_distance")
    for ours, theirs in zip(walk(env, 50, 1.5), walk(plain, 50, 1.5), strict=True):
        np.testing.assert_array_equal(ours[0]["observation"], np.delete(theirs[0], distance))
        between = ours[0]["desired_goal"] - ours[0]["achieved_goal"]
        np.testing.assert_allclose(between, theirs[0][distance], atol=1e-6)
        assert ours[1:4] == theirs[1:4]
    plain.close()


def test_a_fall_terminates_an_episode_with_any_goal(env):
    fallen = [step for step in walk(env, 200) if step[2]]
    assert fallen
    assert all(env.compute_terminated(np.zeros(1), np.ones(1), step[4]) for step in fallen)


def test_a_copy_has_observations_and_rewards_of_its_own(env):
    walk(env, 10)
    other = pickle.loads(pickle.dumps(env))
    action = np.full(1, 0.5, np.float32)
    for _ in range(30):
        ours, theirs = env.step(action), other.step(action)
    env.reset(seed=3)
    assert other.compute_reward(theirs[0]["achieved_goal"], np.zeros(1), theirs[4]) == (
        env.compute_reward(ours[0]["achieved_goal"], np.zeros(1), ours[4])
    )
    again, _ = other.reset(seed=3)
    for name, values in env.reset(seed=3)[0].items():
        np.testing.assert_array_equal(values, again[name])


def test_information_without_the_energy_is_refused(env):
    with pytest.raises(ValueError, match="copy_info_dict=True"):
        env.compute_reward(np.zeros((1, 1)), np.ones((1, 1)), [{}])


def test_another_goal_gives_the_reward_of_an_episode_with_this_goal(env):
    """Relabelled rewards are those that the same motion earns with the other goal."""
    towards = walk(env, 60, goal=0.0)
    others = walk(env, 60, goal=0.4)
    goals = np.full((60, 1), 0.4)
    achieved = np.array([step[0]["achieved_goal"] for step in towards])
    rewards = env.compute_reward(achieved, goals, [step[4] for step in towards])
    assert rewards.tolist() == [step[1] for step in others]


def test_other_environments_are_refused():
    with pytest.raises(ValueError, match="env must be JansenGoal-v0, got"):
        GoalConditioned(gym.make("JansenCrank-v0"))
    goal = gym.make("JansenGoal-v0")
    cut = gym.wrappers.FlattenObservation(gym.wrappers.FrameStackObservation(goal, 2))
    with pytest.raises(ValueError, match="wrappers that keep its observations, got"):
        GoalConditioned(cut)


@pytest.mark.slow
def test_hindsight_replay_learns_from_it():
    """Relabelled transitions of Stable-Baselines3 have the rewards of their goals."""
    sb3 = pytest.importorskip("stable_baselines3")
    env = GoalConditioned(gym.make("JansenGoal-v0", max_episode_steps=50))
    buffer = {"copy_info_dict": True, "n_sampled_goal": 4}
    model = sb3.SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=sb3.HerReplayBuffer,
        replay_buffer_kwargs=buffer,
        learning_starts=100,
        seed=0,
    )
    model.learn(150)
    batch = model.replay_buffer.sample(64)
    achieved = batch.next_observations["achieved_goal"].numpy()
    desired = batch.next_observations["desired_goal"].numpy()
    at_goal = np.abs(achieved - desired)[:, 0] < 1e-3
    rewards = batch.rewards.numpy()[:, 0]
    assert at_goal.any()
    assert rewards[at_goal].min() > rewards[~at_goal].mean()
