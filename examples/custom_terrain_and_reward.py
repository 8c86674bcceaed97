"""Climb a flight of low stairs with a reward that weighs distance against motor work.

Run the example as follows:

    python examples/custom_terrain_and_reward.py [STEPS]

STEPS is the number of control steps of 20 ms, 1,000 by default.
"""

import sys

import gymnasium as gym

from jansen_env import Terrain

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
risers = [0.3 + 0.4 * k for k in range(20)]  # positions of the risers, in m
points = [(-1.0, 0.0)]
for k, x in enumerate(risers):
    points += [(x, 0.005 * k), (x + 0.01, 0.005 * (k + 1))]
stairs = Terrain((*points, (risers[-1] + 1.0, points[-1][1])), friction=0.9)


class Distance(gym.Wrapper):
    """Wrapper that rewards 1 per metre and charges 1 per 100 J of motor work and 1 per fall."""

    def step(self, action):
        """Take a step and return the new reward in place of the reward of the environment."""
        observation, _, terminated, truncated, info = self.env.step(action)
        reward = info["x_velocity"] * self.unwrapped.control_dt
        reward -= 0.01 * abs(info["energy"]["motor_work"]) + float(terminated)
        return observation, reward, terminated, truncated, info


env = Distance(gym.make("JansenWalker-v0", terrain=stairs, max_episode_steps=steps))
observation, info = env.reset(seed=0)
total = 0.0
for _ in range(steps):
    torque = 20.0 * (1.5 - observation[2]) + 2.0
    observation, reward, terminated, truncated, info = env.step([torque / 20.0])
    total += reward
    if terminated or truncated:
        break
print(f"{info['x_position']:.2f} m, fallen: {info['fallen']}, return {total:.2f}")
