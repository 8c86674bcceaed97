"""Score policies side by side: ``jansen-env evaluate --policy pid --policy constant``."""

from __future__ import annotations

import argparse
from pathlib import Path

from jansen_env.commands import robustness
from jansen_env.commands.flags import parse_policies, policy_parser, positive_int
from jansen_env.commands.named_policies import load_all
from jansen_env.commands.plots import write_scores
from jansen_env.files import writable
from jansen_env.scoring.benchmarks import WALKERS, find_benchmark
from jansen_env.scoring.evaluation import Scores, evaluate


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line; incompatible options are refused."""
    parser = policy_parser(
        "jansen-env evaluate", "Score policies side by side.",
        "jansen-env evaluate --policy pretrained --policy pid",
        "jansen-env evaluate --env JansenWalkerRough-v0 --policy pretrained --all --out scores",
        required=True, plants=True,
    )  # fmt: skip
    add = parser.add_argument
    add("--commands", type=float, nargs="+", metavar="V",
        help="speeds or goals; default: the benchmark's grid")  # fmt: skip
    add("--episodes", type=positive_int, default=10,
        help="episodes per command, or with --robustness per condition; default: 10")  # fmt: skip
    add("--random-commands", type=positive_int, metavar="N",
        help="also N episodes with commands drawn from the environment's range")  # fmt: skip
    add("--robustness", action="store_true",
        help="scores over friction and foot stiffness with random commands, in place of those by "
        "command; a tenth of the episodes on 'rigid_body'")  # fmt: skip
    add("--all", action="store_true", help="print all metrics with their 95 %% intervals")
    add("--out", type=Path, metavar="DIR",
        help="write all scores: scores.json, .md and .png, or those of --robustness")  # fmt: skip
    args = parse_policies(parser, arguments, "--commands")
    if args.plant and args.env not in WALKERS:
        parser.error(f"--plant is {args.plant}, but {args.env} has one plant only")
    if args.robustness and args.env not in WALKERS:
        parser.error(f"--robustness needs one of {WALKERS}, but --env is {args.env}")
    if args.robustness and (args.commands or args.random_commands):
        parser.error("--robustness goes without --commands and --random-commands")
    args.commands = args.commands or list(find_benchmark(args.env).commands)
    return args


def main(arguments: list[str] | None = None) -> None:
    """Score, draw, print; nothing is written before all arguments are checked."""
    args = parse(arguments)
    benchmark, out = find_benchmark(args.env), args.out
    try:
        loaded = load_all(args, args.commands)
        if out and not writable(out):  # before the work, not after it
            raise ValueError(f"--out is {out}, must be a folder that can be written to")
        if args.robustness:
            print(robustness.report(loaded, args.env, args.episodes, args.seed, out, args.all))
            return
    except ValueError as error:
        args.error(str(error))
    scores, drawn = Scores(args.env), Scores(args.env)
    for policies, env_kwargs in loaded:
        scores |= evaluate(policies, args.env, env_kwargs, args.commands, args.episodes, args.seed)
        if count := args.random_commands:
            drawn |= evaluate(policies, args.env, env_kwargs, None, count, args.seed, drawn=True)
    if out:
        write_scores(scores, out, drawn)
    grid = " ".join(f"{command:g}" for command in args.commands)
    print(f"commands {grid} {benchmark.command_unit}, episodes at each {args.episodes}, "
          f"seed {args.seed}\n\n{scores.table(args.all)}")  # fmt: skip
    if drawn:
        print(f"\n{count} episodes with commands drawn from the environment's range:\n\n"
              f"{drawn.table(args.all)}")  # fmt: skip
    print(f"\n{robustness.where(args.all, out, 'scores')}")
