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
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from tabulate import tabulate

from agents.command_line import non_negative_int, parse_policies, policy_parser, positive_int
from agents.evaluate import load_all
from jansen_env.baselines.policy import Bools, Policy
from jansen_env.files import write_json, write_text, write_whole
from jansen_env.plants.make import PLANTS
from jansen_env.scoring.benchmarks import ENOUGH, find_benchmark, succeeded
from jansen_env.scoring.metrics import Episodes, Interval, point_estimates, proportion_with_interval
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.terrain.generators import HIGHEST

FIRST_SEED = 80_000  # of the episodes: training, tuning and other scores use others
RATIOS = ("slip_per_metre", "cost_of_transport")
HEAD = ("level", "policy", "success", "falls", "slip (m/m)", "cost of transport")


class Score(NamedTuple):
    """Of a policy's episodes at a level.

    Attributes:
        success, falls: shares with their exact 95 % interval. slip: m per metre of all toes.
        transport: mechanical cost of transport, with the robot's weight without what is drawn.
            Both None where nobody walked. won: (n,) whether each episode succeeded.
    """

    success: Interval
    falls: Interval
    slip: float | None
    transport: float | None
    won: tuple[bool, ...]


Scores: TypeAlias = dict[str, dict[int, Score]]
"""By policy and level."""


def share(happened: NDArray[Any]) -> Interval:
    """Return the share of episodes (n,) that are 1, not 0, with its exact 95 % interval."""
    return proportion_with_interval(int(np.count_nonzero(happened)), len(happened))


def score_levels(
    policy: Policy,
    env_id: str,
    env_kwargs: dict[str, Any],
    levels: Sequence[int],
    episodes: int,
    seed: int = 0,
    commands: Sequence[float] | None = None,
) -> dict[int, Score]:
    """A policy's scores by level.

    Args:
        policy: acts deterministically. env_id, env_kwargs: of an environment whose resets have the
            option ``terrain_level``.
        episodes: of each level. seed: of the episodes.
        commands: m/s, that the episodes share evenly; None: as many as there are episodes, over the
            environment's range.

    Raises:
        ValueError: an environment without levels, or an argument out of range.
    """
    env = make_env(env_id, env_kwargs)
    if commands is None:
        low, high = env.unwrapped.task.speed_command[0]  # type: ignore[attr-defined]
        commands = low + (high - low) * (np.arange(episodes) + 0.5) / episodes
    n = len(levels) * episodes
    level = np.repeat(np.asarray(levels, np.int64), episodes)
    asked = np.tile(np.resize(np.asarray(commands, float), episodes), len(levels))
    seeds = FIRST_SEED + seed * n + np.arange(n)
    run = run_episodes(policy, env_id, env_kwargs, asked, seeds, options={"terrain_level": level})
    found = {one: score(_only(run, level == one), env) for one in levels}
    env.close()
    return found


def _only(run: Episodes, chosen: Bools) -> Episodes:
    return {name: values[chosen] for name, values in run.items()}


def score(run: Episodes, env: Any) -> Score:
    """Of episodes at one level; ``env``: that they were run in, as ``gym.make`` gives it."""
    metrics = find_benchmark(env.spec.id).metrics
    ratios = point_estimates({name: metrics[name] for name in RATIOS}, run, env)
    won = succeeded(run, env).astype(bool)
    slip, transport = (ratios[name] for name in RATIOS)
    return Score(share(won), share(run["fell"].astype(bool)), slip, transport, tuple(won.tolist()))


def shown(interval: Interval) -> str:
    """A share and its interval."""
    return "{:.2f} [{:.2f}, {:.2f}]".format(*interval)


def success_table(scores: Scores) -> str:
    """Successes alone as Markdown, a row per level; last the grounds that any of them masters."""
    levels = next(iter(scores.values()))
    rows = []
    for k in levels:
        at_level = [own[k] for own in scores.values()]
        best = share(np.any([one.won for one in at_level], axis=0))
        rows.append([str(k), *(shown(one.success) for one in at_level), shown(best)])
    return tabulate(rows, ["level", *scores, "any of them"], tablefmt="pipe", disable_numparse=True)


def level_table(scores: Scores) -> str:
    """All scores as Markdown, level by level."""

    def cells(own: Score) -> list[str]:
        shares = map(shown, (own.success, own.falls))
        ratios = ("-" if v is None else f"{v:.3g}" for v in (own.slip, own.transport))
        return [*shares, *ratios]

    levels = next(iter(scores.values()))
    rows = [[str(level), name, *cells(scores[name][level])] for level in levels for name in scores]
    return tabulate(rows, HEAD, tablefmt="pipe", disable_numparse=True)


def plot_levels(scores: Scores, path: Path) -> None:
    """Each score over the level, a line per policy; bands are the intervals."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.2), layout="constrained")
    axes: NDArray[Any] = figure.subplots(1, 4)
    for name, own in scores.items():
        for axis, key in zip(axes, Score._fields[:4], strict=True):
            values = [getattr(one, key) for one in own.values()]
            if key in ("success", "falls"):
                middle, low, high = np.array(values, float).T
                axis.fill_between(list(own), low, high, alpha=0.18)
                axis.set_ylim(-0.03, 1.03)
            else:
                middle = np.array(values, float)
            axis.plot(list(own), middle, "o-", markersize=4, label=name)
    for axis, heading in zip(axes, HEAD[2:], strict=True):
        axis.set_title(heading, fontsize=11)
        axis.grid(alpha=0.3)
        axis.set_xlabel("terrain level")
    for axis in axes[2:]:
        if np.isfinite(axis.dataLim.get_points()[:, 1]).all():
            axis.set_yscale("log")
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=4, frameon=False)
    write_whole(path, lambda file: figure.savefig(file, dpi=110))


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line."""
    parser = policy_parser(__doc__, "JansenWalkerRough-v0", required=True)
    add = parser.add_argument
    add("--plant", action="append", default=[], choices=sorted(PLANTS),
        help="plant; repeat to compare; default: the environment's")  # fmt: skip
    add("--levels", type=non_negative_int, nargs="+", default=list(range(HIGHEST + 1)), metavar="L",
        help=f"terrain levels, 0 to {HIGHEST}; default: all")  # fmt: skip
    add("--commands", type=float, nargs="+", metavar="V",
        help="commanded speeds; default: spread over the environment's range")  # fmt: skip
    add("--episodes", type=positive_int, default=100, help="episodes per level; default: 100")
    add("--out", default="logs/levels", metavar="DIR",
        help="folder of levels.md, levels.json and levels.png")  # fmt: skip
    return parse_policies(parser, arguments, "--commands")


def score_all(args: argparse.Namespace) -> Scores:
    """Score all policies on each requested plant.

    Raises:
        ValueError: a policy or an argument is not allowed.
    """
    return {
        name: score_levels(
            policy, args.env, env_kwargs, args.levels, args.episodes, args.seed, args.commands
        )
        for policies, env_kwargs in load_all(args, args.commands or ())
        for name, policy in policies.items()
    }


def main(arguments: list[str] | None = None) -> None:
    """Score, draw, print."""
    args = parse(arguments)
    out = Path(args.out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        scores = score_all(args)
    except (OSError, ValueError) as error:
        args.error(str(error))
    write_json(out / "levels.json", {
        name: {str(level): one._asdict() for level, one in own.items()}
        for name, own in scores.items()
    })  # fmt: skip
    plot_levels(scores, out / "levels.png")
    note = (
        f"{args.episodes} episodes at each level of {args.env}, seed {args.seed}; success: no fall "
        f"and at least {ENOUGH:g} of the commanded distance; exact 95 % intervals."
    )
    tables = f"Success:\n\n{success_table(scores)}\n\nAll scores:\n\n{level_table(scores)}"
    command = shlex.join(["python", "-m", "agents.levels", *(arguments or sys.argv[1:])])
    head = f"# {args.env} by terrain level\n\n`{command}`: {note}\n\n![Scores](levels.png)"
    write_text(out / "levels.md", f"{head}\n\n{tables}\n")
    print(f"{tables}\n\n{note} Written: {out}")


if __name__ == "__main__":
    main()
