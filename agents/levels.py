"""Score policies by terrain level: ``python -m agents.levels --env ID --policy pid ...``.

An episode succeeds that does not fall and gets 0.8 of the commanded distance. Commands are spread
evenly over those of the environment; all policies have the same episodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate

from jansen_env.baselines.policy import Policy
from jansen_env.commands.flags import non_negative_int, parse_policies, policy_parser, positive_int
from jansen_env.commands.named_policies import load_all
from jansen_env.commands.plots import Sweeps, by_condition, write_files
from jansen_env.scoring.metrics import INTERVALS, pooled, proportion_with_interval, score_table
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking.walker_benchmark import ENOUGH, WORLD, succeeded
from jansen_env.terrain.generators import HIGHEST

FIRST_SEED = 80_000  # of the episodes: training, tuning and other scores use others
LEVEL = "terrain level"  # what is swept, as it is labelled
METRICS = {name: WORLD.metrics[name]
           for name in ("success", "falls", "slip_per_metre", "cost_of_transport")}  # fmt: skip


def score_levels(
    policy: Policy, env_id: str, env_kwargs: dict[str, Any], levels: Sequence[int], episodes: int,
    seed: int = 0, commands: Sequence[float] | None = None,
) -> dict[str, dict[str, Any]]:  # fmt: skip
    """Score a policy by level: :func:`jansen_env.scoring.metrics.pooled`, and which were ``won``.

    Args:
        policy, env_id, env_kwargs: as of :func:`jansen_env.scoring.rollout.run_episodes`.
        episodes: of each level. commands: m/s, shared evenly; None: over the environment's range.

    Raises:
        ValueError: an environment without levels, or an argument out of range.
    """
    env: Any = make_env(env_id, env_kwargs)
    if commands is None:
        low, high = env.unwrapped.task.speed_command[0]
        commands = low + (high - low) * (np.arange(episodes) + 0.5) / episodes
    level = np.repeat(np.asarray(levels, np.int64), episodes)
    commanded = np.tile(np.resize(np.asarray(commands, float), episodes), len(levels))
    seeds = FIRST_SEED + seed * len(level) + np.arange(len(level))
    options = {"terrain_level": level}
    run = run_episodes(policy, env_id, env_kwargs, commanded, seeds, options=options)
    scores = {}
    for number in levels:
        part = {name: values[level == number] for name, values in run.items()}
        won = succeeded(part, env).tolist()
        scores[str(number)] = {**pooled(METRICS, part, env, seed), "won": won}
    env.close()
    return scores


def success_table(levels: dict[str, dict[str, dict[str, Any]]]) -> str:
    """Return successes alone as Markdown, a row per level; last where any policy succeeds."""
    rows = []
    for level, scores in levels.items():
        best = np.any([score["won"] for score in scores.values()], axis=0)
        shares = [score["overall"]["success"] for score in scores.values()]
        shares.append(proportion_with_interval(int(best.sum()), len(best)))
        rows.append([level, *("{:.2f} [{:.2f}, {:.2f}]".format(*share) for share in shares)])
    headers = ["level", *next(iter(levels.values())), "any of them"]
    return tabulate(rows, headers, tablefmt="pipe", disable_numparse=True)


def main(arguments: list[str] | None = None) -> None:
    """Score, draw, print."""
    parser = policy_parser(
        "python -m agents.levels", __doc__,
        "python -m agents.levels --policy pretrained --policy pid",
        "python -m agents.levels --env JansenWalkerHardcore-v0 --policy pretrained --levels 0 4 8",
        default="JansenWalkerRough-v0", required=True, plants=True,
    )  # fmt: skip
    add = parser.add_argument
    add("--levels", type=non_negative_int, nargs="+", default=list(range(HIGHEST + 1)), metavar="L",
        help=f"terrain levels, 0 to {HIGHEST}; default: all")  # fmt: skip
    add("--commands", type=float, nargs="+", metavar="V",
        help="commanded speeds; default: spread over the environment's range")  # fmt: skip
    add("--episodes", type=positive_int, default=100, help="episodes per level; default: 100")
    add("--out", default="logs/levels", type=Path, metavar="DIR",
        help="folder of levels.md, levels.json and levels.png")  # fmt: skip
    args = parse_policies(parser, arguments, "--commands")
    sweeps: Sweeps = {LEVEL: {}}
    given = args.levels, args.episodes, args.seed, args.commands
    with parser.refusing():
        for policies, env_kwargs in load_all(args, args.commands or ()):
            for name, policy in policies.items():
                for level, score in score_levels(policy, args.env, env_kwargs, *given).items():
                    sweeps[LEVEL].setdefault(level, {})[name] = score
    successes = success_table(sweeps[LEVEL])
    note = (
        f"{args.episodes} episodes at each level of {args.env}, seed {args.seed}; success: no fall "
        f"and at least {ENOUGH:g} of the commanded distance; {INTERVALS}."
    )
    text = f"{note}\n\n{successes}\n\n{score_table(METRICS, by_condition(sweeps))}"
    write_files(args.out / "levels", sweeps, text, sweeps, METRICS)
    print(f"Success:\n\n{successes}\n\n{note} All scores: {args.out}/levels.md")


if __name__ == "__main__":
    main()
