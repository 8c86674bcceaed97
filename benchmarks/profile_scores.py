"""The crank-speed profile beside the paper's PID: scores at each command, and a turn of the crank.

    python -m benchmarks.profile_scores [--episodes 1000] [--policy RUN] [--quick]

The figure shows crank speed, loaded toes and slip over the crank's angle. Writes ``scores.md`` and
``turn.png``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from scipy.stats import binomtest

from agents.tuning.profile_search import ENV
from benchmarks import measure
from jansen_env.baselines.policy import Array, Policy
from jansen_env.commands.named_policies import label, load_named
from jansen_env.scoring.benchmarks import WALKER
from jansen_env.scoring.metrics import SETTLING, Episodes, point_estimates
from jansen_env.scoring.rollout import make_env, run_episodes

COMMANDS = (0.05, 0.06, 0.075, 0.1, 0.125, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.7,
            0.8)  # fmt: skip
EPISODES = 1000  # per command
FIRST_SEED = 70_000  # apart from all others
SCORED_SEED = 100_000  # of the table, and all above
CONFIDENCE = 0.95  # of the bound of falls
FRICTION = 0.8
DURATION = 10.0  # s, of an episode
COLUMNS = {
    "steady_speed_error": ".3f", "slip_per_metre": ".3f", "cost_of_transport": ".2f",
    "rms_torque": ".1f", "torque_change": ".2f",
}  # fmt: skip
HEAD = (
    "m/s", "policy", "return", "falls", "at most", "mean speed - command (m/s)",
    "speed error (m/s)", "slip (m/m)", "cost of transport", "RMS torque (N m)",
    "change of torque (N m)",
)  # fmt: skip
SHOWN = (0.05, 0.1, 0.3)  # m/s, in the figure
WALKS, STEPS, SETTLE = 48, 500, 100  # of the figure
BINS = 90  # of a turn
LOADED = 0.02  # of the weight, from which a toe is drawn as standing


def load(names: list[str], env_id: str = ENV) -> dict[str, Policy]:
    """Policies by label; see :func:`jansen_env.commands.named_policies.load_named`."""
    env = make_env(env_id, {})
    policies = {label(name): load_named(name, env) for name in names}
    env.close()
    return policies


def chosen_with_policies(
    doc: str | None, out: str, episodes: int, arguments: list[str] | None,
    envs: Sequence[str] = (ENV,),
) -> tuple[Any, dict[str, Policy]]:  # fmt: skip
    """The command line, with ``--policy``, and the policies beside the PID and the profile."""
    parser = measure.options(doc, out, episodes=episodes)
    parser.add_argument("--policy", action="append", default=[], metavar="NAME",
                        help="also a run's folder or model")  # fmt: skip
    parser.add_argument("--env", choices=envs, default=ENV, help=f"environment; default: {ENV}")
    found = measure.chosen(parser, arguments)
    try:
        return found, load(["pid", "profile", *found.policy], found.env)
    except ValueError as error:
        parser.error(str(error))


def most_falls(falls: int, count: int) -> str:
    """The exact (Clopper-Pearson) one-sided upper bound of the probability of a fall, in %."""
    bound = binomtest(falls, count, alternative="less").proportion_ci(CONFIDENCE, "exact")
    return f"{100.0 * bound.high:.2g} %"


def cells(run: Episodes) -> tuple[str, ...]:
    """Return the table's columns after the policy, of episodes at one command."""
    found = point_estimates(WALKER.metrics, run, make_env(ENV, {}))
    speed = (run["distance"] - run["early_distance"]) / (DURATION - SETTLING)
    falls, count = int(run["fell"].sum()), len(run["fell"])
    return (
        f"{run['returns'].mean():.0f}", f"{falls} of {count}", most_falls(falls, count),
        f"{(speed - run['command']).mean():+.3f}",
        *(f"{found[name] or 0.0:{digits}}" for name, digits in COLUMNS.items()),
    )  # fmt: skip


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


class Turn(NamedTuple):
    """Over the crank's angle, in bins (b,)."""

    speed: Array  # (3, b) rad/s, quantiles 0.1, 0.5 and 0.9
    load: Array  # (toes, b) share of the time that a toe stands
    slip: Array  # (b,) m per metre and turn of all toes: its mean is the slip per metre


def turn(policy: Policy, command: float, walks: int = WALKS) -> Turn:
    """Return means at each crank angle over that many starts."""
    envs: Any = gym.make_vec(
        ENV, num_envs=walks, autoreset_mode=AutoresetMode.DISABLED, terminate_when_fallen=False,
        info_keys=("crank_angle", "crank_speed", "contact_force", "slip", "x_position"),
    )  # fmt: skip
    observation, _ = envs.reset(seed=FIRST_SEED, options={"speed_command": command})
    weight, rows, state, starts = envs.get_attr("weight")[0], [], None, np.ones(walks, bool)
    for _ in range(STEPS):
        actions, state = policy.predict(observation, state, starts, True)
        starts = np.zeros(walks, bool)
        observation, _, _, _, info = envs.step(actions)
        rows.append([
            info["crank_angle"], info["crank_speed"], info["x_position"],
            *info["slip"].T, *(info["contact_force"][:, :, 1].T / weight),
        ])  # fmt: skip
    envs.close()
    angle, speed, position, *toes = np.array(rows[SETTLE:]).transpose(1, 0, 2)
    slip, load = np.split(np.array(toes), 2)
    bins = (angle % (2.0 * np.pi) / (2.0 * np.pi) * BINS).astype(int) % BINS
    walked = (position[-1] - position[0]).sum()
    speeds, loads, slips = np.full((3, BINS), np.nan), np.zeros((len(load), BINS)), np.zeros(BINS)
    for i in range(BINS):
        here = bins == i
        if here.any():
            speeds[:, i] = np.quantile(speed[here], [0.1, 0.5, 0.9])
            loads[:, i] = (load[:, here] > LOADED).mean(axis=1)
            slips[i] = slip[:, here].sum() / walked * BINS
    return Turn(speeds, loads, slips)


def draw(policies: dict[str, Policy], commands: tuple[float, ...], walks: int, path: Path) -> None:
    """Crank speed, standing toes and slip over a turn, a column per command."""
    figure, axes = measure.subplots(
        2 + len(policies), len(commands), 12.0, 8.0, sharex=True, sharey="row",
        height_ratios=(2.0, *[0.9] * len(policies), 1.6),
    )  # fmt: skip
    degrees = (np.arange(BINS) + 0.5) * 360.0 / BINS
    for j, command in enumerate(commands):
        axes[0, j].set_title(f"{command:g} m/s")
        for i, (name, policy) in enumerate(policies.items()):
            found, colour = turn(policy, command, walks), f"C{i}"
            axes[0, j].plot(degrees, found.speed[1], color=colour, label=name)
            axes[0, j].fill_between(degrees, *found.speed[[0, 2]], color=colour, alpha=0.2)
            axes[1 + i, j].imshow(
                found.load, aspect="auto", extent=(0.0, 360.0, 3.5, -0.5), cmap="Greys",
                vmin=0.0, vmax=1.0, interpolation="nearest",
            )  # fmt: skip
            axes[1 + i, j].set_yticks(range(4), ("rf", "lf", "rb", "lb"))
            axes[1 + i, 0].set_ylabel(f"toes down,\n{name}")
            axes[-1, j].plot(degrees, np.maximum(found.slip, 1e-4), color=colour)
        axes[-1, j].set(yscale="log", xlabel="crank angle (degrees)")
        axes[-1, j].set_xticks(range(0, 361, 90))
    axes[0, 0].set_ylabel("crank speed (rad/s)")
    axes[-1, 0].set_ylabel("slip (m/m)")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    measure.save(figure, path)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    found, policies = chosen_with_policies(__doc__, "docs/profile", EPISODES, arguments)
    commands, count = (COMMANDS, found.episodes) if not found.quick else (SHOWN[-1:], 2)
    command = f"python -m benchmarks.profile_scores --episodes {count}"
    measure.report(
        found.out / "scores.md",
        "# The profile beside the PID",
        f"`{command}`: {count} episodes of 10 s at each command, rigid feet, friction "
        f"{FRICTION:g}. At most: the exact (Clopper-Pearson) one-sided {100 * CONFIDENCE:g} % "
        "bound of the probability of a fall. Mean speed and speed error (mean of its size over the "
        "episodes) are of the time after the first two seconds; the change of torque is that from "
        "one control step to the next.",
        *score(policies, commands, count),
    )
    shown, walks = (commands, count) if found.quick else (SHOWN, WALKS)
    draw(policies, shown, walks, found.out / "turn.png")


if __name__ == "__main__":
    main()
