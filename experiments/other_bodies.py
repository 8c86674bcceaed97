"""How well do the policies of ``built`` control robots with other link lengths?

Run the experiment as follows. It takes about two minutes on one core.

    python experiments/other_bodies.py [--starts 3] [--quick]

Twenty robots with link lengths that were sampled within 10 % walk at all commands of the benchmark.
No policy was trained on them. The script writes ``docs/worlds/other_bodies.json`` and a table of
docs/worlds.md.
"""

from typing import Any, cast

import gymnasium as gym
import numpy as np
from pages import options, publish, table

from jansen_env import built_robot
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.policies import pretrained
from jansen_env.policies.policy import Controlled, Policy
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.rollout import run_episodes
from jansen_env.tasks.walking.walker_benchmark import BASELINES

DATA, PAGE = "worlds/other_bodies.json", "worlds.md"
ENV = "JansenWalkerBuilt-v0"
SPREAD = 0.1  # relative range of the link lengths
COUNT = 20  # number of bodies
BODY_SEED, FIRST_SEED = 1000, 70_000  # no other part of the project uses these seeds
METRICS = {"return": 0, "falls": 2, "slip": 2, "cost": 2}
"""Metrics of a controller on a body, and the number of decimals in the table."""


def sample_bodies(count: int) -> list[dict[str, float]]:
    """Return link lengths in m, sampled as in ``randomize={"lengths": 0.1}``."""
    env = gym.make(ENV, randomize={"lengths": SPREAD})
    return [env.reset(seed=BODY_SEED + k)[1]["lengths"] for k in range(count)]


def score(policy: Policy, bodies: list[dict[str, float]], starts: int) -> list[dict[str, float]]:
    """Return the metrics of a controller on each body, over all commands of the benchmark.

    Args:
        policy: The controller.
        bodies: Link lengths of each body, in m.
        starts: Number of episodes for each body and command.
    """
    commands = np.repeat(find_benchmark(ENV).commands, starts)
    n = len(commands)
    run = run_episodes(
        policy,
        ENV,
        {},
        np.tile(commands, len(bodies)),
        FIRST_SEED + np.arange(n * len(bodies)),
        options={"lengths": np.repeat(np.array(bodies, object), n)},
    )
    scores = []
    for k, body in enumerate(bodies):
        part = {name: values[k * n : (k + 1) * n] for name, values in run.items()}
        way = np.maximum(part["distance"], 0.0).sum()
        weight = with_lengths(built_robot(), body).mass * GRAVITY
        scores.append(
            {
                "return": float(part["returns"].mean()),
                "falls": float(part["fell"].mean()),
                "slip": float(part["slip"].sum() / way),
                "cost": float(part["work"].sum() / way / weight),
            }
        )
    return scores


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the table of the page: each controller on its own body and on the others."""
    rows = []
    for name, scores in results["controllers"].items():
        returns = [body["return"] for body in scores["others"]]
        means = {m: np.mean([body[m] for body in scores["others"]]) for m in METRICS}
        rows.append(
            [
                name,
                f"{scores['built'][0]['return']:.0f}",
                *(f"{means[metric]:.{decimals}f}" for metric, decimals in METRICS.items()),
                f"{min(returns):.0f}",
                f"{max(returns):.0f}",
            ]
        )
    head = [
        "controller",
        "return on `built`",
        "return on the others",
        "falls",
        "slip (m/m)",
        "cost of transport",
        "lowest return",
        "highest return",
    ]
    return {PAGE: [table(head, rows)]}


def main() -> None:
    """Measure, and write the data and the table."""
    args = options(__doc__, starts=3)
    count, starts = (2, 1) if args.quick else (COUNT, args.starts)
    env = cast("Controlled", gym.make(ENV).unwrapped)
    controllers: dict[str, Policy] = {
        "`pid`": BASELINES["pid"](env),
        "`pretrained`": pretrained.load(ENV),
        "`pretrained:robust`": pretrained.load(ENV, "robust"),
    }
    bodies = sample_bodies(count)
    own = lengths(built_robot())
    results = {
        "bodies": bodies,
        "controllers": {
            name: {
                "built": score(policy, [own], starts),
                "others": score(policy, bodies, starts),
            }
            for name, policy in controllers.items()
        },
    }
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
