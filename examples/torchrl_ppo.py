"""Train PPO with the building blocks of TorchRL in an explicit training loop.

Run the example as follows:

    python examples/torchrl_ppo.py [STEPS]

STEPS is the number of training steps. The default of 200,000 steps takes about ten minutes. The
example uses the loss and the advantages of TorchRL. It requires torchrl and tensordict; see
docs/frameworks.md.
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

BATCH = 5_000  # steps per iteration
total = int(sys.argv[1]) if len(sys.argv) > 1 else 200_000
torch.set_num_threads(1)
torch.manual_seed(0)

# GymEnv("JansenWalker-v0") does not work: it passes arguments that the environment does not have.
env = TransformedEnv(GymWrapper(gym.make("JansenWalkerBuilt-v0", reset_noise_scale=3.0)))
env.append_transform(RewardSum())
env.append_transform(StepCounter())


def network(outputs: int) -> nn.Sequential:
    """Return a network that adapts to the size of the observation."""
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
rollout = env.rollout(3, actor)  # initialises the lazy layers of the actor
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
