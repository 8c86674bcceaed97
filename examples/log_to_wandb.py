"""Stable-Baselines3's PPO with its curves in Weights & Biases, offline: no account is needed.

python examples/log_to_wandb.py [STEPS]   (300,000 by default: half a minute)

Writes wandb/offline-run-*; `wandb sync` uploads it. Needs wandb: docs/frameworks.md.
"""

import sys

import wandb
from stable_baselines3 import PPO
from wandb.integration.sb3 import WandbCallback

from jansen_env.sb3 import make_vec_env

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 300_000
run = wandb.init(project="jansen", mode="offline", sync_tensorboard=True)
model = PPO("MlpPolicy", make_vec_env("JansenWalkerBuilt-v0", 64), n_steps=64, batch_size=1024,
            seed=0, tensorboard_log=f"runs/{run.id}")  # fmt: skip
model.learn(steps, callback=WandbCallback())
run.finish()
print(f"logged to {run.dir}")
