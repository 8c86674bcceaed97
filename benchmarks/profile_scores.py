"""The crank-speed profile beside the paper's PID: scores at each command.

    python -m benchmarks.profile_scores [--episodes 1000] [--policy RUN] [--quick]

Writes ``scores.md``.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import binomtest

from benchmarks import measure
from benchmarks.measure import WALKER as ENV
from jansen_env.baselines.policy import Policy
from jansen_env.scoring.metrics import Episodes, point_estimates
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking.walker_benchmark import WALKER

COMMANDS = (0.05, 0.06, 0.075, 0.1, 0.125, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.7,
            0.8)  # fmt: skip
EPISODES = 1000  # per command
SCORED_SEED = 100_000  # of the table, and all above
CONFIDENCE = 0.95  # of the bound of falls
FRICTION = 0.8
COLUMNS = {
    "steady_speed_error": ".3f", "slip_per_metre": ".3f", "cost_of_transport": ".2f",
    "rms_torque": ".1f",
}  # fmt: skip
HEAD = ("m/s", "policy", "return", "falls", "speed error (m/s)", "slip (m/m)", "cost of transport",
        "RMS torque (N m)")  # fmt: skip


def most_falls(falls: int, count: int) -> str:
    """The exact (Clopper-Pearson) one-sided upper bound of the probability of a fall, in %."""
    bound = binomtest(falls, count, alternative="less").proportion_ci(CONFIDENCE, "exact")
    return f"{100.0 * bound.high:.2g} %"


def cells(run: Episodes) -> tuple[str, ...]:
    """Return the table's columns after the policy, of episodes at one command."""
    estimates = point_estimates(WALKER.metrics, run, make_env(ENV, {}))
    values = (f"{estimates[name] or 0.0:{digits}}" for name, digits in COLUMNS.items())
    return (f"{run['returns'].mean():.0f}", str(int(run["fell"].sum())), *values)


def score(policies: dict[str, Policy], commands: tuple[float, ...], count: int) -> list[str]:
    """The table by command and policy, and a sentence on each policy's falls, as Markdown."""
    rows, falls = [], dict.fromkeys(policies, 0)
    for i, command in enumerate(commands):
        seeds = SCORED_SEED + i * count + np.arange(count)
        for name, policy in policies.items():
            asked = np.full(count, command)
            run = run_episodes(policy, ENV, {"friction": FRICTION}, asked, seeds)
            rows.append((f"{command:g}", name, *cells(run)))
            falls[name] += int(run["fell"].sum())
    total = count * len(commands)
    return [measure.table(HEAD, rows)] + [
        f"{name}: {fell} falls in the {total:,} episodes of all commands, in the mean a "
        f"probability of at most {most_falls(fell, total)}."
        for name, fell in falls.items()
    ]


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = measure.options(__doc__, "docs/profile", episodes=EPISODES)
    args, policies = measure.parse_with_policies(parser, arguments)
    commands, count = (COMMANDS, args.episodes) if not args.quick else ((0.3,), 2)
    command = f"python -m benchmarks.profile_scores --episodes {count}"
    measure.report(
        args.out / "scores.md",
        "# The profile beside the PID",
        f"`{command}`: {count} episodes of 10 s at each command, rigid feet, friction "
        f"{FRICTION:g}. The speed error is that after the first two seconds. Bounds of falls are "
        f"exact (Clopper-Pearson), one-sided, {100 * CONFIDENCE:g} %.",
        *score(policies, commands, count),
    )


if __name__ == "__main__":
    main()
