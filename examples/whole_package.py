"""The whole package on one page: control a robot, compare two backends, train a policy, score it.

Run the example as follows. It prints the toe slip of a walk in both simulation backends, and a
table of scores.

    python examples/whole_package.py [STEPS] [SECONDS]

STEPS is the number of training steps, 1,000,000 by default, which takes a minute on an idle core.
SECONDS is the duration of the walk that is compared, 1 by default. The second backend takes about
4 s for each second of the walk.
"""

import sys
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3 import PPO

import jansen_env
from jansen_env.sb3 import make_vec_env
from jansen_env.tasks.walking.walker_benchmark import BASELINES

ENV = "JansenWalkerBuilt-v0"
steps = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 1.0


def walked(plant: str) -> tuple[float, float]:
    """Return distance and toe slip, in m, of a walk under the paper's PID.

    Args:
        plant: Simulation backend: the projection method of the paper, or rigid bodies, which share
            neither equations nor solvers with it.
    """
    env: Any = gym.make(ENV, speed_command=0.3, plant=plant)
    pid = BASELINES["pid"](env.unwrapped)
    observation, info = env.reset(seed=0)
    memory, slip = None, 0.0
    for step in range(round(seconds / env.unwrapped.control_dt)):
        action, memory = pid.predict(observation, memory, np.array([step == 0]))
        observation, _, terminated, truncated, info = env.step(action)
        slip += info["slip"].sum()
        if terminated or truncated:
            break
    env.close()
    return info["x_position"], slip


print("backend     walked (m)  toe slip (m)")
for plant in ("projection", "rigid_body"):
    distance, slip = walked(plant)
    print(f"{plant:<10} {distance:>11.4f} {slip:>13.4f}")

model = PPO(
    "MlpPolicy",
    make_vec_env(ENV, n_envs=256, seed=0),
    n_steps=64,
    batch_size=4096,
    n_epochs=6,
    learning_rate=lambda left: 2e-3 * left,
    gamma=0.995,
    gae_lambda=0.98,
    policy_kwargs={"net_arch": [64, 64], "log_std_init": -0.5},
    device="cpu",
    seed=0,
)
model.learn(steps)

env: Any = gym.make(ENV)
pid = BASELINES["pid"](env.unwrapped)
scores = jansen_env.evaluate({"PID": pid, "PPO": model}, ENV, commands=[0.1, 0.3, 0.5], episodes=5)
print(f"\n{scores.table()}")
