"""Walk at a commanded speed with the PID controller of the paper.

Run the example as follows. It writes walk.gif.

    python examples/walk_with_pid.py [STEPS]

STEPS is the number of control steps of 20 ms, 300 by default.
"""

import sys

import gymnasium as gym
import numpy as np

import jansen_env  # noqa: F401  # registers the environments
from jansen_env.cli.enjoy import save_video
from jansen_env.tasks.walking.walker_benchmark import BASELINES

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 300

env = gym.make("JansenWalker-v0", speed_command=0.3, render_mode="rgb_array")
pid = BASELINES["pid"](env.unwrapped)
observation, info = env.reset(seed=0)
frames, memory = [], None
for step in range(steps):
    action, memory = pid.predict(observation, memory, np.array([step == 0]))
    observation, reward, terminated, truncated, info = env.step(action)
    if step % 3 == 0:
        frames.append(env.render())
    if terminated or truncated:
        break
print(f"{info['x_position']:.2f} m in {0.02 * (step + 1):.2f} s")
save_video(frames, "walk.gif", frame_time=0.06)
