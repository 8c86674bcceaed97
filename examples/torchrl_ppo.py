"""PPO of TorchRL: loss and advantages from its building blocks, the loop written out.

python examples/torchrl_ppo.py [STEPS]   (200,000 by default: some ten minutes)

Needs torchrl and tensordict: docs/frameworks.md.
"""

import sys

import gymnasium as gym
import torch
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.envs import GymWrapper, RewardSum, StepCounter, TransformedEnv
from torchrl.modules import NormalParamExtractor, ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import jansen_env  # noqa: F401  # registers the environments

BATCH = 5_000  # steps of an iteration
total = int(sys.argv[1]) if len(sys.argv) > 1 else 200_000
torch.set_num_threads(1)
torch.manual_seed(0)

# Not GymEnv("JansenWalker-v0"): it passes arguments that the environment does not have.
env = TransformedEnv(GymWrapper(gym.make("JansenWalkerBuilt-v0", reset_noise_scale=3.0)))
env.append_transform(RewardSum())
env.append_transform(StepCounter())


def network(outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.LazyLinear(64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)
    )


actor = ProbabilisticActor(
    TensorDictModule(
        nn.Sequential(network(2), NormalParamExtractor()), ["observation"], ["loc", "scale"]
    ),
    in_keys=["loc", "scale"],
    distribution_class=TanhNormal,
    return_log_prob=True,
)
critic = ValueOperator(network(1), ["observation"])
rollout = env.rollout(3, actor)  # sets the sizes of the networks
critic(rollout)

advantage = GAE(gamma=0.995, lmbda=0.98, value_network=critic)
loss = ClipPPOLoss(actor, critic, clip_epsilon=0.2, entropy_coeff=0.0005)
optimiser = torch.optim.Adam(loss.parameters(), lr=1e-3)

for data in Collector(env, actor, frames_per_batch=min(BATCH, total), total_frames=total):
    for _ in range(6):
        with torch.no_grad():
            advantage(data)
        for batch in data.reshape(-1)[torch.randperm(data.numel())].split(1_000):
            terms = loss(batch)
            optimiser.zero_grad()
            sum(value for name, value in terms.items() if name.startswith("loss_")).backward()
            nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
            optimiser.step()
    done = data["next", "done"]
    if done.any():
        print(f"mean return {data['next', 'episode_reward'][done].mean():.1f}", flush=True)
