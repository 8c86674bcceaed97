"""Policies on bodies that none has trained on: return, slip, cost and falls on each.

    python -m benchmarks.held_out --policy pretrained --policy RUN.json [--starts 3]

A body is the built robot with lengths that a seed has drawn within 10 %; each policy, named as for
``jansen-env evaluate``, walks it at all speeds of the benchmark. Writes ``held_out.md``.
"""

from __future__ import annotations

from pathlib import Path

import gymnasium as gym
import numpy as np

from benchmarks import measure
from jansen_env import built_robot
from jansen_env.commands.named_policies import load_named
from jansen_env.gravity import GRAVITY
from jansen_env.robot.lengths import with_lengths
from jansen_env.scoring.rollout import run_episodes
from jansen_env.tasks.walking.walker_benchmark import WALKER

ENV, COUNT = "JansenWalkerBuilt-v0", 20
BODIES, WALKS = 1000, 70_000  # first seeds, apart from those of runs
COLUMNS = "policy", "body", "return", "slip, m/m", "cost of transport", "falls"


def main(arguments: list[str] | None = None) -> None:
    """Draw bodies, walk, print and write the table."""
    parser = measure.options(__doc__, "logs/held_out", starts=3)
    parser.add_argument("--policy", action="append", required=True)
    args = measure.parse(parser, arguments)
    env = gym.make(ENV, randomize={"lengths": 0.1}, observe_lengths=True)
    bodies = [env.reset(seed=BODIES + k)[1]["lengths"] for k in range(2 if args.quick else COUNT)]
    weights = np.array([with_lengths(built_robot(), body).mass * GRAVITY for body in bodies])
    commands = np.tile(np.repeat(WALKER.commands, args.starts), len(bodies))
    seeds, each = WALKS + np.arange(len(commands)), len(commands) // len(bodies)
    options, rows = {"lengths": np.repeat(np.array(bodies, object), each)}, []
    for name in args.policy:
        policy, kwargs = load_named(name, env), {"observe_lengths": True}
        run = run_episodes(policy, ENV, kwargs, commands, seeds, options=options)
        run["forward"] = np.maximum(run["distance"], 0.0)
        kept = ("returns", "slip", "work", "fell", "forward")
        total, slip, work, falls, way = (run[k].reshape(-1, each).sum(axis=1) for k in kept)
        numbers = np.array([total / each, slip / way, work / way / weights, falls / each])
        lines = [*enumerate(numbers.T), ("median", np.median(numbers, axis=1))]
        rows += [(Path(name).stem, body, *(f"{value:.3g}" for value in values))
                 for body, values in lines]  # fmt: skip
    title = f"# {len(bodies)} bodies, {each} walks of each by each policy"
    measure.report(args.out / "held_out.md", title, measure.table(COLUMNS, rows))


if __name__ == "__main__":
    main()
