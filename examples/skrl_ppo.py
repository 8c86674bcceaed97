"""Train PPO of skrl on one batch of robots.

Run the example as follows:

    python examples/skrl_ppo.py [STEPS]

STEPS is the number of training steps. The default of 1,000,000 steps takes a few minutes.

The example writes its curves and checkpoints to runs/. It requires skrl; see docs/frameworks.md.
"""

import sys

import gymnasium as gym
import torch
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from skrl.trainers.torch import SequentialTrainer, SequentialTrainerCfg
from torch import nn

import jansen_env  # noqa: F401  # registers the environments

ROBOTS, ROLLOUT = 256, 64
steps = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
torch.set_num_threads(1)

# wrapper="auto" fails, because skrl does not detect Gymnasium's vector environments by their base
# class.
env = wrap_env(gym.make_vec("JansenWalkerBuilt-v0", num_envs=ROBOTS), wrapper="gymnasium")
spaces = {"observation_space": env.observation_space, "action_space": env.action_space}


def network(outputs: int) -> nn.Sequential:
    """Return a network for observations of 20 values."""
    return nn.Sequential(
        nn.Linear(20, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)
    )


class Policy(GaussianMixin, Model):
    """Policy with a normal distribution of the action."""

    def __init__(self):
        Model.__init__(self, **spaces)
        GaussianMixin.__init__(self)
        self.mean, self.log_std = network(1), nn.Parameter(torch.full((1,), -0.5))

    def compute(self, inputs, role):
        """Return the mean action and the logarithm of its standard deviation."""
        return self.mean(inputs["observations"]), {"log_std": self.log_std}


class Value(DeterministicMixin, Model):
    """Value function."""

    def __init__(self):
        Model.__init__(self, **spaces)
        DeterministicMixin.__init__(self)
        self.value = network(1)

    def compute(self, inputs, role):
        """Return the value of each observation."""
        return self.value(inputs["observations"]), {}


agent = PPO(
    models={"policy": Policy(), "value": Value()},
    memory=RandomMemory(memory_size=ROLLOUT, num_envs=ROBOTS),
    cfg=PPO_CFG(
        rollouts=ROLLOUT,
        learning_epochs=6,
        mini_batches=4,
        discount_factor=0.995,
        gae_lambda=0.98,
        learning_rate=1e-3,
    ),
    **spaces,
)
cfg = SequentialTrainerCfg(timesteps=max(1, steps // ROBOTS), headless=True)
SequentialTrainer(env=env, agents=agent, cfg=cfg).train()
print(f"curves for TensorBoard in {agent.experiment_dir}")
