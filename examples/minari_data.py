"""Record datasets for offline learning in the format of Minari.

Run the example as follows:

    python examples/minari_data.py [EPISODES] [STEPS] [ENV ...]

Each environment has four datasets: random, medium, expert and pid. `medium` is the policy that
`train.py` has learnt after STEPS steps.

EPISODES is the number of episodes per dataset, 100 by default. STEPS is an eighth of the usual
training steps by default. Without ENV, datasets are recorded on three environments.

The datasets are stored in Minari's folder as jansen/ENV/KIND-v0. The example requires
minari[hdf5]; see docs/data.md.
"""

import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import minari
import numpy as np

from agents.training.config import new_config
from jansen_env.policies import pretrained
from jansen_env.sb3 import load_policy
from jansen_env.scoring.benchmarks import find_benchmark

ROOT = Path(__file__).parents[1]
episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 100
steps = int(sys.argv[2]) if len(sys.argv) > 2 else None
names = sys.argv[3:] or ["JansenWalkerBuilt-v0", "JansenWalkerRough-v0", "JansenWalkerHardcore-v0"]


def medium(name):
    """Return the policy of a short run of train.py; reuse a finished run if there is one."""
    timesteps = steps or new_config(env_id=name).timesteps // 8
    folder, scores = Path(f"medium/{timesteps}"), f"ppo/{name}_*/scores.md"
    if not any(folder.glob(scores)):
        arguments = f"--env {name} --timesteps {timesteps} --log-folder {folder} --eval-episodes 1"
        subprocess.run([sys.executable, ROOT / "train.py", *arguments.split()], check=True)
    return load_policy(max(folder.glob(scores), key=os.path.getmtime).parent)


for name in names:
    env = minari.DataCollector(gym.make(name))
    policies = {
        "random": None,
        "medium": medium(name),
        "expert": pretrained.load(name),
        "pid": find_benchmark(name).baselines["pid"](env.unwrapped),
    }
    for kind, policy in policies.items():
        env.action_space.seed(0)
        returns = []
        for seed in range(episodes):
            observation, _ = env.reset(seed=seed)
            state, start, ended, total = None, True, False, 0.0
            while not ended:
                action = env.action_space.sample()
                if policy is not None:
                    starts = np.array([start])
                    action, state = policy.predict(observation, state, starts, deterministic=True)
                observation, reward, terminated, truncated, _ = env.step(action)
                start, ended, total = False, terminated or truncated, total + reward
            returns.append(total)
        dataset_id = f"jansen/{name.removesuffix('-v0')}/{kind}-v0"
        if dataset_id in minari.list_local_datasets():
            minari.delete_dataset(dataset_id)
        dataset = env.create_dataset(
            dataset_id,
            algorithm_name=kind,
            author="jansen_env",
            author_email="see CITATION.cff",
            code_permalink="examples/minari_data.py",
            description=f"{kind} policy of {name}",
            eval_env=name,
        )
        print(f"{dataset_id}: {dataset.total_steps} steps, return {np.mean(returns):.0f}")
