"""Train with SAC and hindsight experience replay on the goal-conditioned form of JansenGoal-v0.

Run the example as follows. It prints how often the robot reaches its goal.

    python examples/hindsight_replay.py [STEPS] [EPISODES]

The default is 40,000 steps, which take about 20 minutes of one core, and 30 episodes.
"""

import sys

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import SAC, HerReplayBuffer

import jansen_env  # noqa: F401 - registers the environments
from jansen_env.tasks.goal.goal_conditioned import GoalConditioned

steps, episodes = (int(n) for n in (sys.argv[1:] + ["40000", "30"][len(sys.argv) - 1 :])[:2])
torch.set_num_threads(1)

env = GoalConditioned(gym.make("JansenGoal-v0"))
model = SAC(
    "MultiInputPolicy",
    env,
    replay_buffer_class=HerReplayBuffer,
    replay_buffer_kwargs={"copy_info_dict": True, "n_sampled_goal": 4},
    learning_rate=1e-3,
    learning_starts=1_500,  # two episodes, because the buffer needs a complete one
    gamma=0.995,
    seed=0,
)
model.learn(steps)

reached, distances = 0, []
for episode in range(episodes):
    observation, info = env.reset(seed=1_000 + episode)
    over = False
    while not over:
        action, _ = model.predict(observation, deterministic=True)
        observation, _, terminated, truncated, info = env.step(action)
        over = terminated or truncated
    reached += info["is_success"]
    distances.append(abs(info["distance"]))
env.close()
print(f"{reached} of {episodes} goals reached, median distance {np.median(distances):.2f} m")
