"""Score policies by terrain level: ``python -m agents.levels --env ID --policy pid ...``.

An episode succeeds that does not fall and gets 0.8 of the commanded distance. Commands are spread
evenly over those of the environment; all policies have the same episodes.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate

from jansen_env.baselines.policy import Policy
from jansen_env.commands.flags import non_negative_int, parse_policies, policy_parser, positive_int
from jansen_env.commands.named_policies import load_all
from jansen_env.commands.plots import Sweeps, by_condition, plot_sweeps
from jansen_env.files import write_json, write_text
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
    asked = np.tile(np.resize(np.asarray(commands, float), episodes), len(levels))
    seeds = FIRST_SEED + seed * len(level) + np.arange(len(level))
    run = run_episodes(policy, env_id, env_kwargs, asked, seeds, options={"terrain_level": level})
    found = {}
    for one in levels:
        own = {name: values[level == one] for name, values in run.items()}
        found[str(one)] = {**pooled(METRICS, own, env, seed), "won": succeeded(own, env).tolist()}
    env.close()
    return found


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


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
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
    add("--out", default="logs/levels", metavar="DIR",
        help="folder of levels.md, levels.json and levels.png")  # fmt: skip
    return parse_policies(parser, arguments, "--commands")


def main(arguments: list[str] | None = None) -> None:
    """Score, draw, print."""
    args = parse(arguments)
    out = Path(args.out)
    scores: Sweeps = {LEVEL: {}}
    given = args.levels, args.episodes, args.seed, args.commands
    try:
        out.mkdir(parents=True, exist_ok=True)
        for policies, env_kwargs in load_all(args, args.commands or ()):
            for name, policy in policies.items():
                for level, own in score_levels(policy, args.env, env_kwargs, *given).items():
                    scores[LEVEL].setdefault(level, {})[name] = own
    except (OSError, ValueError) as error:
        args.parser.error(str(error))
    write_json(out / "levels.json", scores)
    plot_sweeps(scores, METRICS, out / "levels.png")
    note = (
        f"{args.episodes} episodes at each level of {args.env}, seed {args.seed}; success: no fall "
        f"and at least {ENOUGH:g} of the commanded distance; {INTERVALS}."
    )
    successes = success_table(scores[LEVEL])
    tables = (
        f"Success:\n\n{successes}\n\nAll scores:\n\n{score_table(METRICS, by_condition(scores))}"
    )
    command = shlex.join(["python", "-m", "agents.levels", *(arguments or sys.argv[1:])])
    head = f"# {args.env} by terrain level\n\n`{command}`: {note}\n\n![Scores](levels.png)"
    write_text(out / "levels.md", f"{head}\n\n{tables}\n")
    print(f"Success:\n\n{successes}\n\n{note} All scores: {out}/levels.md")


if __name__ == "__main__":
    main()
