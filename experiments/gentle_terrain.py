"""What does a gentler walk over rough ground cost?

Run the experiment as follows. It takes about half an hour on one core.

    python experiments/gentle_terrain.py [--episodes 40] [--quick]

The pretrained policy ``hiker`` of JansenWalkerRough-v0 is trained further with several exponents of
the load in the reward, one run each. The runs are kept in ``logs/gentle_terrain`` and not trained
again. The pretrained policy and each last model walk over rough ground. The script writes
``docs/judging/gentle_terrain.json`` and a table of docs/judging.md.
"""

from pathlib import Path
from typing import Any

from pages import options, publish, table
from trained_policies import train_run

from jansen_env import evaluate
from jansen_env.policies import pretrained
from jansen_env.registration import training_folder

DATA, PAGE = "judging/gentle_terrain.json", "judging.md"
RUNS = Path("logs/gentle_terrain")
ENV, NAME = "JansenWalkerRough-v0", "hiker"
EXPONENTS: tuple[float, ...] = (0.2, 1.0, 3.0)  # the first number is that of the environment
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


def train_with(exponent: float, quick: bool) -> Path:
    """Train the policy further, and return the file of the last model.

    Args:
        exponent: Exponent of the load in the reward.
        quick: Whether to train for one rollout of few robots only.
    """
    from agents.training.config import new_config

    config = new_config(
        training_folder(ENV) / "hiker_second.yml",
        env_kwargs={"load_weight": exponent},
        timesteps=8 * 32 if quick else STEPS,
        n_envs=8 if quick else None,
    )
    folder = RUNS / (f"{exponent}_quick" if quick else f"{exponent}")
    return train_run(folder, config, "python experiments/gentle_terrain.py", f"pretrained:{NAME}")


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
    exponents = EXPONENTS[:1] if args.quick else EXPONENTS
    episodes = 1 if args.quick else args.episodes
    policies = {"pretrained": score(f"pretrained:{NAME}", episodes)}
    for exponent in exponents:
        file = train_with(exponent, args.quick)
        policies[f"trained further, exponent {exponent:g}"] = score(str(file), episodes)
    publish(
        args.out, DATA, {"episodes": episodes, "policies": policies}, tables({"policies": policies})
    )


if __name__ == "__main__":
    main()
