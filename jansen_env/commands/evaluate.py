"""Score policies side by side: ``jansen-env evaluate --policy pid --policy constant``."""

from __future__ import annotations

import argparse
from pathlib import Path
from textwrap import fill

from jansen_env.commands import robustness
from jansen_env.commands.flags import parse_policies, policy_parser, positive_int
from jansen_env.commands.named_policies import Loaded, load_all
from jansen_env.commands.plots import Sweeps, write_files, write_scores
from jansen_env.files import check_writable
from jansen_env.scoring.benchmarks import WALKERS, find_benchmark
from jansen_env.scoring.evaluation import Scores, evaluate
from jansen_env.scoring.metrics import INTERVALS, score_table

WRITTEN_NOWHERE = "--all prints them, --out DIR writes them"


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
    out: Path | None = args.out
    name = "robustness" if args.robustness else "scores"
    with args.parser.refusing():
        loaded = load_all(args, args.commands)
        if out:
            check_writable("--out", out)  # before the work
        text = _robustness(args, loaded) if args.robustness else _scores(args, loaded)
    intervals = f"{fill(INTERVALS, 80)}\n" if args.all else ""
    where = f"{out}/{name}.md, {name}.json, {name}.png" if out else WRITTEN_NOWHERE
    print(f"{text}\n\n{intervals}all scores: {where}")


def _scores(args: argparse.Namespace, loaded: Loaded) -> str:
    """Score by command, and with drawn commands."""
    scores, drawn = Scores(args.env), Scores(args.env)
    for policies, env_kwargs in loaded:
        scores |= evaluate(policies, args.env, env_kwargs, args.commands, args.episodes, args.seed)
        if count := args.random_commands:
            drawn |= evaluate(policies, args.env, env_kwargs, None, count, args.seed, drawn=True)
    if args.out:
        write_scores(scores, args.out, drawn)
    grid, unit = " ".join(f"{c:g}" for c in args.commands), find_benchmark(args.env).command_unit
    text = (f"commands {grid} {unit}, episodes at each {args.episodes}, seed {args.seed}\n\n"
            f"{scores.table(args.all)}")  # fmt: skip
    if drawn:
        text += (f"\n\n{count} episodes with commands drawn from the environment's range:\n\n"
                 f"{drawn.table(args.all)}")  # fmt: skip
    return text


def _robustness(args: argparse.Namespace, loaded: Loaded) -> str:
    """Score over friction and foot stiffness."""
    sweeps: Sweeps = {}
    for policies, env_kwargs in loaded:
        more = robustness.score(policies, args.env, env_kwargs, args.episodes, args.seed)
        for sweep, conditions in more.items():
            for condition, scores in conditions.items():
                sweeps.setdefault(sweep, {}).setdefault(condition, {}).update(scores)
    metrics = {name: find_benchmark(args.env).metrics[name] for name in robustness.METRICS}
    table = score_table(metrics, robustness.by_condition(sweeps))
    if args.out:
        write_files(args.out / "robustness", sweeps, table, sweeps, metrics)
    slow = {plant: n for plant, n in robustness.FEWER.items() if plant in args.plant}
    fewer = "".join(f" (on {plant} 1/{n} of that)" for plant, n in slow.items())
    shown = table if args.all else robustness.return_table(sweeps)
    return (f"{args.episodes} episodes under each condition{fewer}, commands drawn from the "
            f"environment's range, seed {args.seed}\n\n{shown}")  # fmt: skip
