"""Train PPO from scratch, then watch what it has learnt.

Run the example as follows. It writes walker.gif.

    python examples/train_and_watch.py [STEPS]

STEPS is the number of training steps. The default of 1,000,000 steps takes a minute.
"""

import sys
from pathlib import Path

import gymnasium as gym

from agents.training.config import new_config
from agents.training.runs import record_run
from agents.training.train_model import prepare, train
from jansen_env.cli.enjoy import save_video
from jansen_env.sb3.trained import load_policy

ENV = "JansenWalkerBuilt-v0"
steps = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
folder = Path("walker")

config = new_config(env_id=ENV, timesteps=steps)
record_run(folder, config, command=f"python {' '.join(sys.argv)}")
train(prepare(config), config, folder, eval_every=200_000, save_every=0)

policy = load_policy(folder)
env = gym.make(ENV, speed_command=0.3, render_mode="rgb_array")
observation, info = env.reset(seed=0)
frames, total = [env.render()], 0.0
for step in range(1, 301):
    action, _ = policy.predict(observation, deterministic=True)
    observation, reward, terminated, truncated, info = env.step(action)
    total += reward
    if step % 3 == 0:  # one frame every 60 ms
        frames.append(env.render())
    if terminated or truncated:
        break
print(f"{info['x_position']:.2f} m in {0.02 * step:.2f} s, return {total:.0f}")
save_video(frames, "walker.gif", frame_time=0.06)
