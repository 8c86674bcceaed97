"""Simulate a batch of robots with random torques and different friction; print the speed.

Run the example as follows:

    python examples/thousand_robots.py [ROBOTS]

ROBOTS is the number of robots, 1,000 by default.
"""

import sys
import time

import gymnasium as gym
import numpy as np

import jansen_env  # noqa: F401  # registers the environments

robots = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
steps = 100

envs = gym.make_vec("JansenWalker-v0", num_envs=robots, friction=np.linspace(0.2, 1.0, robots))
envs.action_space.seed(0)
observations, infos = envs.reset(seed=0)
falls = 0
start = time.perf_counter()
for _ in range(steps):
    # After an episode has ended, the next step resets the robot.
    observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())
    falls += terminated.sum()
seconds = time.perf_counter() - start
print(f"{robots} robots: {robots * steps / seconds:,.0f} steps/s, {falls} falls")
