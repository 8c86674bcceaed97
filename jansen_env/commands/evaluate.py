"""Score policies side by side: ``jansen-env evaluate --policy pid --policy constant``.

With ``--robustness`` all policies have the same starts and the same commands, drawn from the
environment's range, under each friction and foot stiffness, or with ``--levels`` at each terrain
level. None is tuned again.
"""

import argparse
import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import astuple
from pathlib import Path
from textwrap import fill

import numpy as np

from jansen_env.commands.flags import (
    episode_count,
    non_negative_int,
    parse_policies,
    path_flag,
    policy_parser,
)
from jansen_env.commands.named_policies import Loaded, load_all
from jansen_env.commands.plots import Sweeps, by_condition, write_files, write_scores
from jansen_env.commands.progress import progress
from jansen_env.files import check_writable
from jansen_env.plants.plant import PLANTS
from jansen_env.robot import RIGID, Compliance, Robot, built_robot
from jansen_env.scoring.benchmarks import WALKERS, find_benchmark
from jansen_env.scoring.evaluation import Scores, evaluate
from jansen_env.scoring.metrics import INTERVALS, interval_text, score_table, screen_table
from jansen_env.scoring.rollout import Advance, EnvKwargs, Options, make_env, no_progress

WRITTEN_NOWHERE = "--all prints them, --out DIR writes them"
FRICTIONS = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
STIFFNESSES = (10, 20, 50, 100, 200, 500, math.inf)  # kN/m
FRICTION, FEET, LEVEL = "friction", "foot stiffness (kN/m)", "terrain level"  # names of the sweeps
METRICS = ("return", "steady_slip_per_metre", "steady_speed_error", "falls")  # of the figure
LEVEL_METRICS = ("success", "return", "falls", "slip_per_metre", "cost_of_transport")
FEWER = {"rigid_body": 10}  # by plant: a 10 s episode takes it some 15 s


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line; incompatible options are refused."""
    parser = policy_parser(
        "jansen-env evaluate", "Score policies side by side.",
        "jansen-env evaluate --policy pretrained --policy pid",
        "jansen-env evaluate --env JansenWalkerRough-v0 --policy pretrained --all --out scores",
        required=True,
    )  # fmt: skip
    add = parser.add_argument
    add("--plant", action="append", default=[], choices=sorted(PLANTS),
        help="plant of the walkers; repeat to compare; default: the environment's")  # fmt: skip
    add("--commands", type=float, nargs="+", metavar="V",
        help="speeds or goals; default: the benchmark's grid")  # fmt: skip
    add("--episodes", type=episode_count, default=10,
        help="per command, or per condition of --robustness and --levels; default: 10")  # fmt: skip
    add("--random-commands", type=episode_count, metavar="N",
        help="also N episodes with commands drawn from the environment's range")  # fmt: skip
    add("--robustness", action="store_true",
        help="scores over friction and foot stiffness with random commands, in place of those by "
        "command; a tenth of the episodes on 'rigid_body'")  # fmt: skip
    add("--levels", type=non_negative_int, nargs="+", default=[], metavar="L",
        help="the same over terrain levels, of 0 to 9")  # fmt: skip
    add("--all", action="store_true", help="print all metrics with their 95 %% intervals")
    add("--out", type=path_flag, metavar="DIR",
        help="write all scores: scores.json, .md and .png, or robustness.*, levels.*")  # fmt: skip
    args = parse_policies(parser, arguments, "--commands")
    if args.plant and args.env not in WALKERS:
        parser.error(f"--plant is {args.plant}, but {args.env} has one plant only")
    if args.levels and args.robustness:
        parser.error("--levels goes without --robustness")
    args.sweep = "levels" if args.levels else "robustness" if args.robustness else None
    if args.sweep and args.env not in WALKERS:
        parser.error(f"--{args.sweep} needs one of {WALKERS}, but --env is {args.env}")
    if args.sweep and (args.commands or args.random_commands):
        parser.error(f"--{args.sweep} goes without --commands and --random-commands")
    args.commands = args.commands or list(find_benchmark(args.env).commands)
    return args


def main(arguments: list[str] | None = None) -> None:
    """Score, draw, print; nothing is written before all arguments are checked."""
    args = parse(arguments)
    out: Path | None = args.out
    name = args.sweep or "scores"
    with args.parser.refusing():
        loaded = load_all(args, args.commands)
        if out:
            check_writable("--out", out)  # before the work
        text = _sweep(args, loaded) if args.sweep else _scores(args, loaded)
    intervals = f"{fill(INTERVALS, 80)}\n" if args.all else ""
    where = f"{out}/{name}.md, {name}.json, {name}.png" if out else WRITTEN_NOWHERE
    print(f"{text}\n\n{intervals}all scores: {where}")


def _scores(args: argparse.Namespace, loaded: Loaded) -> str:
    """Score by command, and with drawn commands."""
    scores, drawn = Scores(args.env), Scores(args.env)
    count = args.random_commands or 0
    each = len(args.commands) * args.episodes + count
    total = each * sum(len(policies) for policies, _ in loaded)
    with progress("scoring", total) as advance:
        for policies, env_kwargs in loaded:
            scores |= evaluate(policies, args.env, env_kwargs, args.commands, args.episodes,
                               args.seed, advance=advance)  # fmt: skip
            if count:
                drawn |= evaluate(policies, args.env, env_kwargs, None, count, args.seed,
                                  drawn=True, advance=advance)  # fmt: skip
    if args.out:
        write_scores(scores, args.out, drawn)
    grid, unit = " ".join(f"{c:g}" for c in args.commands), find_benchmark(args.env).command_unit
    text = (f"commands {grid} {unit}, episodes at each {args.episodes}, seed {args.seed}\n\n"
            f"{scores.table(args.all)}")  # fmt: skip
    if drawn:
        text += (f"\n\n{count} episodes with commands drawn from the environment's range:\n\n"
                 f"{drawn.table(args.all)}")  # fmt: skip
    return text


def _sweep(args: argparse.Namespace, loaded: Loaded) -> str:
    """Score over friction and foot stiffness, or over terrain levels."""
    conditions = len(args.levels) or len(FRICTIONS) + len(STIFFNESSES)
    each = [len(policies) * episodes_on(env_kwargs.get("plant", ""), args.episodes)
            for policies, env_kwargs in loaded]  # fmt: skip
    with progress("scoring", conditions * sum(each)) as advance:
        sweeps = score_conditions(loaded, args.env, args.episodes, args.seed, args.levels, advance)
    known, names = find_benchmark(args.env).metrics, LEVEL_METRICS if args.levels else METRICS
    metrics = {name: known[name] for name in names if name in known}
    table = score_table(metrics, by_condition(sweeps))
    if args.out:
        write_files(args.out / args.sweep, sweeps, table, sweeps, metrics)
    slow = {plant: n for plant, n in FEWER.items() if plant in args.plant}
    fewer = "".join(f" (on {plant} 1/{n} of that)" for plant, n in slow.items())
    shown = table if args.all else sweep_table(sweeps, next(iter(metrics)))
    return (f"{args.episodes} episodes under each condition{fewer}, commands drawn from the "
            f"environment's range, seed {args.seed}\n\n{shown}")  # fmt: skip


def episodes_on(plant: str, episodes: int) -> int:
    """Return the episodes that run under each condition on a plant, fewer on a slow one."""
    return math.ceil(episodes / FEWER.get(plant, 1))


def feet(robot: Robot, stiffness: float) -> Compliance:
    """Return feet of a stiffness, N/m: the robot's scaled, or the built one's if those are rigid.

    An infinite one is rigid. Damping is scaled by the root, as of a rubber of the same loss factor
    at the lower frequency (:func:`jansen_env.robot.buildable.foot_damping`).
    """
    if stiffness == math.inf:
        return RIGID
    nominal = (built_robot() if robot.pad_compliance.rigid else robot).pad_compliance
    powers = np.array((1.0, 0.5, 1.0, 0.5))  # of stiffness and damping, normal and tangential
    scale = (stiffness / nominal.stiffness) ** powers
    return Compliance(*(np.array(astuple(nominal)) * scale).tolist())


def score_conditions(
    loaded: Loaded, env_id: str, episodes: int, seed: int, levels: Sequence[int] = (),
    advance: Advance = no_progress,
) -> Sweeps:  # fmt: skip
    """Score policies under each condition on so many episodes, fewer on a plant in :data:`FEWER`.

    The conditions are terrain ``levels``, or each friction and each foot stiffness without any.

    Raises ValueError: an argument out of range, or feet that give and a restitution above 0.
    """
    sweeps: Sweeps = {LEVEL: {}} if levels else {FRICTION: {}, FEET: {}}
    for policies, env_kwargs in loaded:
        count = episodes_on(env_kwargs.get("plant", ""), episodes)
        with closing(make_env(env_id, env_kwargs)) as env:
            robot = env.unwrapped.robot  # type: ignore[attr-defined]
        conditions: list[tuple[str, float, EnvKwargs, Options]] = [
            (LEVEL, level, {}, {"terrain_level": np.full(count, level)}) for level in levels
        ] or [
            # Friction is set at the reset, as the environment may draw its own.
            *((FRICTION, mu, {}, {"friction": np.full(count, mu)}) for mu in FRICTIONS),
            *((FEET, k, {"pad_compliance": feet(robot, 1e3 * k)}, {}) for k in STIFFNESSES),
        ]
        for sweep, value, changes, options in conditions:
            scores = evaluate(policies, env_id, {**env_kwargs, **changes}, None, count, seed,
                              drawn=True, options=options, advance=advance)  # fmt: skip
            name = "rigid" if value == math.inf else f"{value:g}"
            sweeps[sweep].setdefault(name, {}).update(scores)
    return sweeps


def sweep_table(sweeps: Sweeps, metric: str) -> str:
    """Return a metric under each condition, a column per policy."""
    cells = [
        [f"{sweep} {condition}",
         *(interval_text(summary["overall"][metric][:1]) for summary in policies.values())]
        for sweep, conditions in sweeps.items() for condition, policies in conditions.items()
    ]  # fmt: skip
    first = next(iter(sweeps.values()))
    return screen_table([[metric, *next(iter(first.values()))], *cells])
