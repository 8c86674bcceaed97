"""Compare the scores of policies: ``jansen-env evaluate --policy pid --policy constant``.

With ``--robustness``, the policies are scored for each friction and each foot stiffness. With
``--levels``, they are scored at each terrain level. All policies then have the same initial states
and the same commands, which are sampled from the environment's range. No policy is tuned again.
"""

import argparse
import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import astuple
from pathlib import Path
from textwrap import fill

import numpy as np

from jansen_env.cli.flags import (
    episode_count,
    non_negative_int,
    parse_policies,
    path_flag,
    policy_parser,
)
from jansen_env.cli.named_policies import Loaded, load_all
from jansen_env.cli.plots import Sweeps, by_condition, write_files, write_scores
from jansen_env.cli.progress import progress
from jansen_env.files import check_writable
from jansen_env.plants.plant import PLANTS
from jansen_env.robot import RIGID, Compliance, Robot, built_robot
from jansen_env.scoring.benchmarks import WALKERS, find_benchmark
from jansen_env.scoring.evaluation import Scores, evaluate
from jansen_env.scoring.metrics import INTERVALS, interval_text, score_table, screen_table
from jansen_env.scoring.rollout import Advance, EnvKwargs, Options, make_env, no_progress

FRICTIONS = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
STIFFNESSES = (10, 20, 50, 100, 200, 500, math.inf)  # kN/m
# Names of the sweeps.
FRICTION = "friction"
FEET = "foot stiffness (kN/m)"
LEVEL = "terrain level"
# Metrics in the figure of --robustness.
METRICS = ("return", "steady_slip_per_metre", "steady_speed_error", "falls")
# Metrics in the figure of --levels.
LEVEL_METRICS = ("success", "return", "falls", "slip_per_metre", "cost_of_transport")
# Divisor of the number of episodes, by simulation backend. An episode of 10 s takes about 15 s.
FEWER = {"rigid_body": 10}


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line, and reject incompatible options.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    parser = policy_parser(
        "jansen-env evaluate",
        "Compare the scores of policies.",
        "jansen-env evaluate --policy pretrained --policy pid",
        "jansen-env evaluate --env JansenWalkerRough-v0 --policy pretrained --all --out scores",
        required=True,
    )
    add = parser.add_argument
    add(
        "--plant",
        action="append",
        default=[],
        choices=sorted(PLANTS),
        help="simulation backend of the walkers; repeat the flag to compare backends; default: the "
        "backend of the environment",
    )
    add(
        "--commands",
        type=float,
        nargs="+",
        metavar="V",
        help="commanded speeds or goals; default: the grid of the benchmark",
    )
    add(
        "--episodes",
        type=episode_count,
        default=10,
        help="number of episodes per command, or per condition of --robustness and --levels; "
        "default: 10",
    )
    add(
        "--random-commands",
        type=episode_count,
        metavar="N",
        help="also run N episodes with commands sampled from the range of the environment",
    )
    add(
        "--robustness",
        action="store_true",
        help="score the policies at several frictions and foot stiffnesses, with sampled commands, "
        "instead of at each command; 'rigid_body' runs a tenth of the episodes",
    )
    add(
        "--levels",
        type=non_negative_int,
        nargs="+",
        default=[],
        metavar="L",
        help="score the policies at these terrain levels, from 0 to 9, with sampled commands",
    )
    add("--all", action="store_true", help="print all metrics with their 95 %% intervals")
    add(
        "--out",
        type=path_flag,
        metavar="DIR",
        help="folder to which all scores are written, as scores.json, scores.md and scores.png, "
        "or as files named robustness or levels",
    )
    args = parse_policies(parser, arguments, "--commands")
    if args.plant and args.env not in WALKERS:
        parser.error(f"--plant must not be given for {args.env}, which has only one plant")
    if args.levels and args.robustness:
        parser.error("--levels cannot be combined with --robustness")
    args.sweep = "levels" if args.levels else "robustness" if args.robustness else None
    if args.sweep and args.env not in WALKERS:
        parser.error(f"--env must be one of {WALKERS} with --{args.sweep}, got {args.env}")
    if args.sweep and (args.commands or args.random_commands):
        parser.error(f"--{args.sweep} cannot be combined with --commands or --random-commands")
    args.commands = args.commands or list(find_benchmark(args.env).commands)
    return args


def main(arguments: list[str] | None = None) -> None:
    """Score the policies, print a table, and write files.

    All arguments are checked before anything is written.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    args = parse(arguments)
    out: Path | None = args.out
    name = args.sweep or "scores"
    with args.parser.refusing():
        loaded = load_all(args, args.commands)
        if out:
            check_writable("--out", out)  # checked before the long computation
        text = _sweep(args, loaded) if args.sweep else _scores(args, loaded)
    intervals = f"{fill(INTERVALS, 80)}\n" if args.all else ""
    where = f"{out}/{name}.md, {name}.json, {name}.png" if out else "--out DIR writes them"
    hint = "" if args.all or out else "--all prints them, "
    print(f"{text}\n\n{intervals}all scores: {hint}{where}")


def _scores(args: argparse.Namespace, loaded: Loaded) -> str:
    """Return the scores by command, and those for sampled commands, as text."""
    scores = Scores(args.env)
    drawn = Scores(args.env)
    count = args.random_commands or 0
    each = len(args.commands) * args.episodes + count
    total = each * sum(len(policies) for policies, _ in loaded)
    with progress("scoring", total) as advance:
        for policies, env_kwargs in loaded:
            scores |= evaluate(
                policies,
                args.env,
                env_kwargs,
                args.commands,
                args.episodes,
                args.seed,
                advance=advance,
            )
            if count:
                drawn |= evaluate(
                    policies,
                    args.env,
                    env_kwargs,
                    None,
                    count,
                    args.seed,
                    drawn=True,
                    advance=advance,
                )
    if args.out:
        write_scores(scores, args.out, drawn)
    grid = " ".join(f"{c:g}" for c in args.commands)
    unit = find_benchmark(args.env).command_unit
    commands = f"{grid} {unit}".rstrip()  # a task without commands has no unit
    text = (
        f"commands {commands}, episodes at each {args.episodes}, seed {args.seed}\n\n"
        f"{scores.table(args.all)}"
    )
    if drawn:
        text += (
            f"\n\n{count} episodes with commands drawn from the environment's range:\n\n"
            f"{drawn.table(args.all)}"
        )
    return text


def _sweep(args: argparse.Namespace, loaded: Loaded) -> str:
    """Return the scores over friction and foot stiffness, or over terrain levels, as text."""
    conditions = len(args.levels) or len(FRICTIONS) + len(STIFFNESSES)
    each = [
        len(policies) * episodes_on(env_kwargs.get("plant", ""), args.episodes)
        for policies, env_kwargs in loaded
    ]
    with progress("scoring", conditions * sum(each)) as advance:
        sweeps = score_conditions(loaded, args.env, args.episodes, args.seed, args.levels, advance)
    known = find_benchmark(args.env).metrics
    names = LEVEL_METRICS if args.levels else METRICS
    metrics = {name: known[name] for name in names if name in known}
    table = score_table(metrics, by_condition(sweeps))
    if args.out:
        write_files(args.out / args.sweep, sweeps, table, sweeps, metrics)
    slow = {plant: n for plant, n in FEWER.items() if plant in args.plant}
    fewer = "".join(f" (on {plant} 1/{n} of that)" for plant, n in slow.items())
    shown = table if args.all else sweep_table(sweeps, next(iter(metrics)))
    return (
        f"{args.episodes} episodes under each condition{fewer}, commands drawn from the "
        f"environment's range, seed {args.seed}\n\n{shown}"
    )


def episodes_on(plant: str, episodes: int) -> int:
    """Return the number of episodes per condition, which is lower for a slow backend.

    Args:
        plant: Name of the simulation backend.
        episodes: Number of episodes on a fast backend.
    """
    return math.ceil(episodes / FEWER.get(plant, 1))


def feet(robot: Robot, stiffness: float) -> Compliance:
    """Return the compliance of feet with a stiffness.

    The compliance of the robot's feet is scaled, or that of the built robot's feet if the robot has
    rigid feet. The damping is scaled by the square root of the factor, as for a rubber with the
    same loss factor at the lower frequency (:func:`jansen_env.robot.buildable.foot_damping`).

    Args:
        robot: Robot whose feet are scaled.
        stiffness: Normal stiffness, in N/m. Feet with an infinite stiffness are rigid.
    """
    if stiffness == math.inf:
        return RIGID
    nominal = (built_robot() if robot.pad_compliance.rigid else robot).pad_compliance
    powers = np.array((1.0, 0.5, 1.0, 0.5))  # for stiffness and damping, normal and tangential
    scale = (stiffness / nominal.stiffness) ** powers
    return Compliance(*(np.array(astuple(nominal)) * scale).tolist())


def score_conditions(
    loaded: Loaded,
    env_id: str,
    episodes: int,
    seed: int,
    levels: Sequence[int] = (),
    advance: Advance = no_progress,
) -> Sweeps:
    """Score policies under each condition.

    Args:
        loaded: Policies by label and arguments of the environment, for each simulation backend.
        env_id: Id of the environment.
        episodes: Number of episodes per condition. It is lower for a backend in :data:`FEWER`.
        seed: Seed of the episodes.
        levels: Terrain levels. If there are none, the conditions are each friction in
            :data:`FRICTIONS` and each foot stiffness in :data:`STIFFNESSES`.
        advance: Function that is called with the number of episodes done since its last call.

    Returns:
        Scores by sweep, condition and policy.

    Raises:
        ValueError: If an argument is out of range, or if the feet are compliant and the restitution
            is above 0.
    """
    sweeps: Sweeps = {LEVEL: {}} if levels else {FRICTION: {}, FEET: {}}
    for policies, env_kwargs in loaded:
        count = episodes_on(env_kwargs.get("plant", ""), episodes)
        with closing(make_env(env_id, env_kwargs)) as env:
            robot = env.unwrapped.robot  # type: ignore[attr-defined]
        conditions: list[tuple[str, float, EnvKwargs, Options]] = [
            (LEVEL, level, {}, {"terrain_level": np.full(count, level)}) for level in levels
        ] or [
            # Friction is set at the reset, because the environment may sample the friction itself.
            *((FRICTION, mu, {}, {"friction": np.full(count, mu)}) for mu in FRICTIONS),
            *((FEET, k, {"pad_compliance": feet(robot, 1e3 * k)}, {}) for k in STIFFNESSES),
        ]
        for sweep, value, changes, options in conditions:
            scores = evaluate(
                policies,
                env_id,
                {**env_kwargs, **changes},
                None,
                count,
                seed,
                drawn=True,
                options=options,
                advance=advance,
            )
            name = "rigid" if value == math.inf else f"{value:g}"
            sweeps[sweep].setdefault(name, {}).update(scores)
    return sweeps


def sweep_table(sweeps: Sweeps, metric: str) -> str:
    """Return a table of a metric, with one row per condition and one column per policy.

    Args:
        sweeps: Scores by sweep, condition and policy.
        metric: Name of the metric.
    """
    cells = [
        [
            f"{sweep} {condition}",
            *(interval_text(summary["overall"][metric][:1]) for summary in policies.values()),
        ]
        for sweep, conditions in sweeps.items()
        for condition, policies in conditions.items()
    ]
    first = next(iter(sweeps.values()))
    return screen_table([[metric, *next(iter(first.values()))], *cells])
