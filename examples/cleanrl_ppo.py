"""PPO in one file, from top to bottom: PyTorch, Gymnasium's vector API and the batch of robots.

python examples/cleanrl_ppo.py [--steps 800000] [--envs 64] [--seed 0]   (a minute)
"""

import argparse
import time
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from torch.distributions import Normal

from agents.evaluate import evaluate
from jansen_env.baselines.walker_baselines import BASELINES

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--steps", type=int, default=800_000, help="of all robots together")
parser.add_argument("--envs", type=int, default=64, help="robots at once")
parser.add_argument("--seed", type=int, default=0, help="of robots, networks and noise")
args = parser.parse_args()

LENGTH, EPOCHS, ROWS = 128, 8, 512  # steps of a rollout, passes over it, rows of a minibatch
GAMMA, LAMBDA, CLIP, ENTROPY, LEARNING_RATE = 0.99, 0.98, 0.2, 0.001, 6e-4
REWARD_SCALE = 0.1  # values of up to 10, whose errors are of the advantages' size
torch.manual_seed(args.seed)
torch.set_num_threads(1)  # the networks are small

# Episodes begin with the crank turning: robots that stand do not find out that walking pays. A
# third of them practises slow walking and a third fast, or one is given up for the other.
third = np.arange(args.envs) % 3
envs = gym.make_vec(
    "jansen_env:JansenWalker-v0",
    num_envs=args.envs,
    reset_noise_scale=np.array([4.0, 2.0, 6.0])[third],
    speed_command=np.array([(0.05, 0.8), (0.05, 0.25), (0.4, 0.8)])[third],
)
envs = gym.wrappers.vector.NormalizeObservation(envs)
size = envs.single_observation_space.shape[0]


def network() -> nn.Sequential:
    """An observation (n, size) to one number (n, 1)."""
    return nn.Sequential(
        nn.Linear(size, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, 1)
    )


actor, critic = network(), network()
nn.init.orthogonal_(actor[-1].weight, 0.01)  # small torques at first
log_std = nn.Parameter(torch.tensor(-0.5))
parameters = [*actor.parameters(), *critic.parameters(), log_std]
optimizer = torch.optim.Adam(parameters, lr=LEARNING_RATE, eps=1e-5)


def policy(observation: torch.Tensor) -> Normal:
    """Actions (n,) for observations (n, size)."""
    return Normal(actor(observation).squeeze(-1), log_std.exp())


shape = (LENGTH, args.envs)
observations = torch.zeros(LENGTH + 1, args.envs, size)
actions, rewards = torch.zeros(shape), torch.zeros(shape)
fallen, over, stepped = (torch.zeros(shape, dtype=torch.bool) for _ in range(3))
observation = torch.as_tensor(envs.reset(seed=args.seed)[0], dtype=torch.float32)
steps_next = torch.ones(args.envs, dtype=torch.bool)  # rather than begins an episode
earned, returns = np.zeros(args.envs), []
updates = max(1, args.steps // (LENGTH * args.envs))
start = time.perf_counter()

for update in range(1, updates + 1):
    for t in range(LENGTH):
        with torch.no_grad():
            action = policy(observation).sample()
        seen, reward, terminated, truncated, _ = envs.step(action[:, None].clamp(-1, 1).numpy())
        observations[t], actions[t] = observation, action
        rewards[t] = REWARD_SCALE * torch.as_tensor(reward)
        fallen[t] = torch.as_tensor(terminated)
        over[t] = torch.as_tensor(terminated | truncated)
        # Autoreset NEXT_STEP: the last step of an episode returns its last observation, and the
        # step after that only begins the next one, whatever the action: nothing to learn from.
        stepped[t], steps_next = steps_next, ~over[t]
        observation = torch.as_tensor(seen, dtype=torch.float32)
        earned += reward
        returns += earned[over[t].numpy()].tolist()
        earned[over[t].numpy()] = 0.0
    observations[LENGTH] = observation

    with torch.no_grad():
        # The next row is what a step led to, at an episode's end too; who fell earns no more, who
        # ran out of time would have earned what the last observation is worth.
        value = critic(observations).squeeze(-1)
        error = rewards + GAMMA * ~fallen * value[1:] - value[:-1]
        advantages, later = torch.zeros(shape), torch.zeros(args.envs)
        for t in reversed(range(LENGTH)):
            advantages[t] = later = error[t] + GAMMA * LAMBDA * ~over[t] * later
        likelihood = policy(observations[:-1]).log_prob(actions)
    targets = advantages + value[:-1]
    rollout = [x[stepped] for x in (observations[:-1], actions, likelihood, advantages, targets)]

    for group in optimizer.param_groups:  # falls to 0 over the run
        group["lr"] = LEARNING_RATE * (1 - (update - 1) / updates)
    for rows in (r for _ in range(EPOCHS) for r in torch.randperm(len(rollout[0])).split(ROWS)):
        seen, action, before, advantage, target = (x[rows] for x in rollout)
        advantage = (advantage - advantage.mean()) / (advantage.std(correction=0) + 1e-8)
        distribution = policy(seen)
        ratio = (distribution.log_prob(action) - before).exp()
        gain = torch.minimum(ratio * advantage, ratio.clamp(1 - CLIP, 1 + CLIP) * advantage)
        loss = 0.5 * (critic(seen).squeeze(-1) - target).square().mean()
        loss = loss - gain.mean() - ENTROPY * distribution.entropy().mean()
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(parameters, 0.5)
        optimizer.step()

    if returns and (update % 10 == 0 or update == updates):
        done = update * LENGTH * args.envs
        print(
            f"{done:,} steps, {done / (time.perf_counter() - start):,.0f} steps/s, "
            f"return {np.mean(returns[-100:]):.0f} with noise"
        )


def predict(observation, state=None, episode_start=None, deterministic=True):
    """The mean action, as :class:`jansen_env.baselines.policy.Policy` has it."""
    scaled = (observation - envs.obs_rms.mean) / np.sqrt(envs.obs_rms.var + envs.epsilon)
    with torch.no_grad():
        return policy(torch.as_tensor(scaled, dtype=torch.float32)).mean[:, None].numpy(), state


pid = BASELINES["pid"](gym.make("JansenWalker-v0").unwrapped)
policies = {"ppo": SimpleNamespace(predict=predict), "pid": pid}
scores = evaluate(policies, "JansenWalker-v0", {}, episodes=10)
print(*(f"{name}: return {s['overall']['return'][0]:.0f}" for name, s in scores.items()), sep=", ")
