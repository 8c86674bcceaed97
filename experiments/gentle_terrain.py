"""Can a policy walk more gently over rough ground?

Run the experiment as follows. It takes about 55 minutes on one core.

    python experiments/gentle_terrain.py [--episodes 40] [--quick]

The pretrained policy ``hiker`` of JansenWalkerRough-v0 is trained further in several ways, one run
each: with larger exponents of the load in the reward, with a mean of the cost of the load over a
quarter turn of the crank, and with an additional cost that is proportional to the load above
:data:`FREE`. The runs are kept in ``logs/gentle_terrain`` and not trained again. The pretrained
policy and each last model walk over rough ground. The script writes
``docs/judging/gentle_terrain.json`` and a table of docs/judging.md.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pages import options, publish, table
from trained_policies import train_run
from typing_extensions import override

from jansen_env import evaluate
from jansen_env.policies import pretrained
from jansen_env.registration import training_folder

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

DATA, PAGE = "judging/gentle_terrain.json", "judging.md"
RUNS = Path("logs/gentle_terrain")
ENV, NAME = "JansenWalkerRough-v0", "hiker"
EXPONENTS = (0.2, 1.0, 3.0)  # the first number is that of the environment
COSTS = (0.1, 0.3)  # reward per weight of load above FREE, in each control step
FREE = 2.0  # load that has no additional cost, as a multiple of the weight
STEPS = 3_276_800  # environment steps of a training: 50 rollouts of 2048 x 32 steps
SEED = 7  # seed of the scored episodes
METRICS = {
    "success": 3,
    "falls": 3,
    "load": 1,
    "unsupported": 2,
    "steady_speed_error": 3,
    "steady_slip_per_metre": 2,
    "steady_cost_of_transport": 2,
}
"""Metrics of the table, and the number of decimals."""


class Run(NamedTuple):
    """Reward with which the policy is trained further.

    Attributes:
        exponent: Exponent of the load in the reward.
        cost: Additional cost of a control step per weight of load above :data:`FREE`.
        mean_load_cost: Whether the reward averages the cost of the load over a quarter turn.
    """

    exponent: float
    cost: float = 0.0
    mean_load_cost: bool = False


def train_further(run: Run, quick: bool) -> Path:
    """Train the policy further, and return the file of the last model.

    Args:
        run: Reward of the training.
        quick: Whether to train for one rollout of few robots only.
    """
    from agents.training.config import new_config

    env_kwargs: dict[str, Any] = {"load_weight": run.exponent}
    name = f"{run.exponent:g}_{run.cost:g}"
    if run.mean_load_cost:
        env_kwargs["mean_load_cost"] = True
        name += "_mean"
    if quick:
        name += "_quick"
    config = new_config(
        training_folder(ENV) / "hiker_second.yml",
        env_kwargs=env_kwargs,
        timesteps=8 * 32 if quick else STEPS,
        n_envs=8 if quick else None,
    )
    command = "python experiments/gentle_terrain.py"
    change = add_load_cost(config.reward_scale * run.cost) if run.cost else None
    return train_run(RUNS / name, config, command, f"pretrained:{NAME}", change)


def add_load_cost(cost: float) -> Callable[[BaseAlgorithm], None]:
    """Return a function that adds the cost of the load to the rewards of a model's environments.

    Args:
        cost: Cost of a control step per weight of load above :data:`FREE`.
    """
    from stable_baselines3.common.vec_env import VecEnvWrapper

    from jansen_env.sb3 import BatchVecEnv

    class LoadCost(VecEnvWrapper):
        """Environments whose rewards contain the cost of the load."""

        @override
        def reset(self) -> Any:
            """Reset all environments; return the observations."""
            return self.venv.reset()

        @override
        def step_wait(self) -> Any:
            """Return the results of a step, with changed rewards."""
            observations, rewards, dones, infos = self.venv.step_wait()
            load = np.array([info["ground_load"] for info in infos], np.float32)
            return observations, rewards - cost * np.maximum(load - FREE, 0.0), dones, infos

    def change(model: BaseAlgorithm) -> None:
        envs = model.get_env()
        assert envs is not None
        batch = envs
        while isinstance(batch, VecEnvWrapper):
            batch = batch.venv
        assert isinstance(batch, BatchVecEnv)
        batch.info_keys = ("ground_load",)
        model.set_env(LoadCost(envs))

    return change


def score(name: str, episodes: int) -> dict[str, float]:
    """Return the metrics of a policy with the default arguments of the environment.

    Args:
        name: Name of a pretrained policy, or the file of a model.
        episodes: Number of episodes per command.
    """
    from jansen_env.cli.named_policies import load_named
    from jansen_env.scoring.rollout import make_env

    arguments = pretrained.load(ENV, NAME).env_kwargs
    env = make_env(ENV, arguments)
    policy = load_named(name, env)
    env.close()
    scores = evaluate({"policy": policy}, ENV, arguments, episodes=episodes, seed=SEED)
    overall = scores["policy"]["overall"]
    return {metric: overall[metric][0] for metric in METRICS}


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the table of the page.

    Args:
        results: Metrics by policy.
    """
    head = [
        "policy",
        "success",
        "falls",
        "load on rough ground (multiple of the weight)",
        "unsupported (fraction of time)",
        "speed error (m/s)",
        "slip per metre (m/m)",
        "cost of transport",
    ]
    rows = [
        [policy, *(f"{metrics[name]:.{decimals}f}" for name, decimals in METRICS.items())]
        for policy, metrics in results["policies"].items()
    ]
    return {PAGE: [table(head, rows)]}


def main() -> None:
    """Train, measure, and write the data and the table."""
    args = options(__doc__, episodes=40)
    runs = {f"exponent {exponent:g}": Run(exponent) for exponent in EXPONENTS}
    runs["exponent 1, mean over a quarter turn"] = Run(1.0, mean_load_cost=True)
    runs |= {f"exponent {EXPONENTS[0]:g}, cost {cost:g}": Run(EXPONENTS[0], cost) for cost in COSTS}
    episodes = args.episodes
    if args.quick:
        runs = {name: runs[name] for name in [*runs][-1:]}
        episodes = 1
    policies = {"pretrained": score(f"pretrained:{NAME}", episodes)}
    for name, run in runs.items():
        file = train_further(run, args.quick)
        policies[f"trained further, {name}"] = score(str(file), episodes)
    results = {"episodes": episodes, "policies": policies}
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
