"""Train one policy with RLlib's PPO (new API stack) in several processes or on several machines.

Run the example as follows:

    python examples/rllib_ppo.py [--steps 400000] [--envs 48] [--runners 2] [--learners 2]
        [--address auto] [--env JansenCrank-v0] [--checkpoint FOLDER]

Env runners step the robots, and learners average their gradients. If an env runner dies, it is
replaced. The example requires the dependency group `distributed`; see docs/frameworks.md.
"""

import argparse
import math
import os
from pathlib import Path
from types import SimpleNamespace

os.environ.setdefault("RAY_AUTH_MODE", "token")  # keeps strangers off the cluster
os.environ.setdefault("OMP_NUM_THREADS", "1")  # per process, because the networks are small

import gymnasium as gym
import numpy as np
import ray
import torch
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.evaluation import evaluate

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
add = parser.add_argument
add("--env", default="JansenWalker-v0", choices=("JansenWalker-v0", "JansenCrank-v0"))
add("--steps", type=int, default=400_000, help="of all robots together")
add("--envs", type=int, default=48, help="robots in each process")
add("--runners", type=int, default=0, help="processes that run robots; 0: this one does")
add("--learners", type=int, default=0, help="processes that learn; 0: this one does")
add("--address", default="local", help="Ray cluster; default: a new one on this machine")
add("--seed", type=int, default=0)
add("--checkpoint", metavar="FOLDER", help="go on from what is there, and save there")
args = parser.parse_args()

training_robots = {}
if args.env == "JansenWalker-v0":
    # Episodes begin with a turning crank, because robots that stand do not discover that walking is
    # rewarded. One third of the robots practises slow walking and one third fast walking.
    # Otherwise, the policy would give up one of them for the other.
    third = np.arange(args.envs) % 3
    training_robots = {
        "reset_noise_scale": np.array([4.0, 2.0, 6.0])[third],
        "speed_command": np.array([(0.05, 0.8), (0.05, 0.25), (0.4, 0.8)])[third],
    }
robots, learners = args.envs * max(1, args.runners), max(1, args.learners)
config = (
    PPOConfig()
    # The module before the colon is imported in every process that creates robots.
    .environment(f"jansen_env:{args.env}", env_config=training_robots)
    .env_runners(
        num_env_runners=args.runners,
        num_envs_per_env_runner=args.envs,
        gym_env_vectorize_mode="vector_entry_point",  # one batch; "sync" simulates one by one
        rollout_fragment_length=128,
    )
    .learners(num_learners=args.learners)
    .fault_tolerance(restart_failed_env_runners=True)
    .rl_module(
        model_config=DefaultModelConfig(
            fcnet_hiddens=[64, 64], fcnet_activation="tanh", vf_share_layers=False
        )
    )
    .training(
        train_batch_size_per_learner=128 * robots // learners,
        minibatch_size=512 // learners,  # per learner; gradients are averaged
        num_epochs=8,
        lr=[[0, 6e-4], [args.steps, 0.0]],  # schedule over the steps
        gamma=0.99,
        lambda_=0.98,
        clip_param=0.2,
        use_kl_loss=False,
        vf_clip_param=math.inf,  # returns are far above the default of 10
    )
    .debugging(seed=args.seed)
)
# A cluster on this machine may have more processes than cores.
cores = {"num_cpus": 1 + args.runners + args.learners} if args.address == "local" else {}
ray.init(args.address, **cores)
algorithm = config.build_algo()
folder = Path(args.checkpoint).resolve() if args.checkpoint else None
if folder and folder.is_dir():
    algorithm.restore_from_path(folder)

steps = 0
while steps < args.steps:
    result = algorithm.train()
    found, seconds = result["env_runners"], result["time_total_s"]
    steps = int(found["num_env_steps_sampled_lifetime"])
    noisy = found.get("episode_return_mean", math.nan)  # nan if no episode has ended
    print(f"{steps:,} steps, {steps / seconds:,.0f} steps/s, return {noisy:.0f}", flush=True)
if folder:
    print(f"saved: {algorithm.save_to_path(folder)}")
module = algorithm.get_module()
algorithm.stop()
ray.shutdown()


def predict(observation, state=None, episode_start=None, deterministic=True):
    """Return the mean action, with the signature of :class:`jansen_env.policies.policy.Policy`."""
    with torch.no_grad():
        batch = {"obs": torch.as_tensor(observation, dtype=torch.float32)}
        mean = module.forward_inference(batch)["action_dist_inputs"][:, :1]
    return mean.numpy(), state


pid = find_benchmark(args.env).baselines["pid"](gym.make(args.env).unwrapped)
policies = {"ppo": SimpleNamespace(predict=predict), "pid": pid}
scores = evaluate(policies, args.env, {}, episodes=10)
print(*(f"{name}: return {s['overall']['return'][0]:.0f}" for name, s in scores.items()), sep=", ")
