"""Learn from a dataset without simulation: behaviour cloning and implicit Q-learning.

Run the example as follows:

    python examples/offline_learning.py [UPDATES] [DATASET ...]

UPDATES is the number of updates, 20,000 by default. The default datasets are
jansen/JansenWalkerBuilt/..., which minari_data.py records; see docs/data.md.

The example prints the return of each policy. Implicit Q-learning is described in arXiv 2110.06169.
"""

import sys

import minari
import numpy as np
import torch
from torch import nn
from torch.nn.functional import mse_loss

import jansen_env

torch.set_num_threads(1)  # such small networks do not benefit from more threads
BATCH, DISCOUNT, EXPECTILE, TEMPERATURE, TARGET_RATE = 256, 0.995, 0.7, 3.0, 0.005
updates = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
kinds = ("random", "medium", "expert", "pid")
dataset_ids = sys.argv[2:] or [f"jansen/JansenWalkerBuilt/{kind}-v0" for kind in kinds]


def network(inputs):
    """Return a network with one output."""
    layers = [nn.Linear(inputs, 128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU(), nn.Linear(128, 1)]
    return nn.Sequential(*layers)


class OfflinePolicy:
    """Policy of a network whose observations are scaled by their mean and standard deviation.

    Actions are limited to [-1, 1].
    """

    def __init__(self, actor, mean, deviation):
        self.actor, self.mean, self.deviation = actor, mean, deviation

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """Return the actions and the unchanged state."""
        scaled = (np.asarray(observation, np.float32) - self.mean) / self.deviation
        with torch.no_grad():
            return self.actor(torch.from_numpy(scaled)).clamp(-1, 1).numpy(), state


def learn(dataset, implicit_q):
    """Learn a policy by implicit Q-learning or by behaviour cloning.

    Behaviour cloning gives the same weight to all actions of the dataset.

    Args:
        dataset: Minari dataset.
        implicit_q: Whether to use implicit Q-learning.
    """
    torch.manual_seed(0)
    episodes = list(dataset)
    seen = np.concatenate([episode.observations for episode in episodes]).astype(np.float32)
    mean, deviation = seen.mean(0), seen.std(0) + 1e-3
    starts = np.cumsum([0, *(len(episode.observations) for episode in episodes)])[:-1]
    first = np.concatenate(
        [np.arange(len(e.rewards)) + start for e, start in zip(episodes, starts, strict=True)]
    )
    scaled = torch.from_numpy((seen - mean) / deviation)
    before, after = scaled[first], scaled[first + 1]
    action, reward, ended = (
        torch.from_numpy(np.concatenate(parts).astype(np.float32)).reshape(-1, 1)
        for parts in (
            [e.actions for e in episodes],
            [e.rewards for e in episodes],
            [e.terminations for e in episodes],
        )
    )
    size = seen.shape[1]
    actor, value = nn.Sequential(network(size), nn.Tanh()), network(size)
    critics, targets = ([network(size + 1) for _ in range(2)] for _ in range(2))
    for critic, target in zip(critics, targets, strict=True):
        target.load_state_dict(critic.state_dict())
    learners = nn.ModuleList([actor, value, *critics])
    optimiser = torch.optim.Adam(learners.parameters(), lr=3e-4)
    for _ in range(updates):
        pick = torch.randint(len(action), (BATCH,))
        x, a = before[pick], action[pick]
        error = (actor(x) - a) ** 2
        if not implicit_q:
            loss = error.mean()
        else:
            pair = torch.cat([x, a], 1)
            with torch.no_grad():
                best = torch.minimum(*(target(pair) for target in targets))
                goal = reward[pick] + DISCOUNT * (1 - ended[pick]) * value(after[pick])
            advantage = best - value(x)
            share = torch.where(advantage > 0, EXPECTILE, 1 - EXPECTILE)
            weight = (TEMPERATURE * advantage.detach()).exp().clamp(max=100)
            loss = (
                (share * advantage**2).mean()
                + sum(mse_loss(critic(pair), goal) for critic in critics)
                + (weight * error).mean()
            )
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        if implicit_q:
            with torch.no_grad():
                for critic, target in zip(critics, targets, strict=True):
                    for old, new in zip(target.parameters(), critic.parameters(), strict=True):
                        old.lerp_(new, TARGET_RATE)
    return OfflinePolicy(actor, mean, deviation)


for dataset_id in dataset_ids:
    dataset = minari.load_dataset(dataset_id)
    policies = {"cloned": learn(dataset, False), "implicit Q": learn(dataset, True)}
    scores = jansen_env.evaluate(policies, dataset.env_spec.id, episodes=10)
    data = np.mean([episode.rewards.sum() for episode in dataset])
    returns = {name: scores[name]["overall"]["return"][0] for name in policies}
    shown = ", ".join(f"{name} {value:.0f}" for name, value in returns.items())
    print(f"{dataset_id}: data {data:.0f}, {shown}")
