"""Train PPO of Stable-Baselines3 and log its curves with Weights & Biases, without an account.

Run the example as follows:

    python examples/log_to_wandb.py [STEPS]

STEPS is the number of training steps. The default of 300,000 steps takes half a minute.

The example runs offline and writes wandb/offline-run-*, which `wandb sync` uploads. It requires
wandb; see docs/frameworks.md.
"""

import sys

import wandb
from stable_baselines3 import PPO
from wandb.integration.sb3 import WandbCallback

from jansen_env.sb3 import make_vec_env

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 300_000
run = wandb.init(project="jansen", mode="offline", sync_tensorboard=True)
model = PPO(
    "MlpPolicy",
    make_vec_env("JansenWalkerBuilt-v0", 64),
    n_steps=64,
    batch_size=1024,
    seed=0,
    tensorboard_log=f"runs/{run.id}",
)
model.learn(steps, callback=WandbCallback())
run.finish()
print(f"logged to {run.dir}")
