"""How well does the crank-speed profile walk, and what does it do within a turn of the crank?

Run the experiment as follows. It takes about two minutes on one core.

    python experiments/profile_scores.py [--episodes 400] [--quick]

The paper's robot walks under its profile and its PID at 16 commands, from initial states that the
search did not use. The script writes ``docs/profile/scores.json``, the figure ``turn.png`` in the
same folder, and the table of docs/profile.md.
"""

from pathlib import Path
from typing import Any, NamedTuple, cast

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
from gymnasium.vector import AutoresetMode
from matplotlib.axes import Axes
from pages import options, publish, table

from jansen_env.arrays import Array
from jansen_env.policies.policy import Controlled, Policy
from jansen_env.scoring.metrics import point_estimates
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking.walker_benchmark import BASELINES, WALKER

DATA, PAGE, FIGURE = "profile/scores.json", "profile.md", "profile/turn.png"
ENV = "JansenWalker-v0"
CONTROLLERS = ("pid", "profile")
COMMANDS: tuple[float, ...] = (
    *(0.05, 0.06, 0.075, 0.1, 0.125, 0.15, 0.2, 0.25),
    *(0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.7, 0.8),
)
"""Commands in m/s, also between those of the search."""
FIRST_SEED = 100_000  # no other part of the project uses these seeds
METRICS = {
    "steady_speed_error": 3,
    "steady_slip_per_metre": 3,
    "steady_cost_of_transport": 2,
    "rms_torque": 1,
}
"""Metrics of the table, and the number of decimals."""
SHOWN: tuple[float, ...] = (0.05, 0.1, 0.3)  # commands of the figure, in m/s
WALKS, STEPS, SETTLING_STEPS = 48, 500, 100  # walks per curve of the figure, and their steps
BINS = 120  # bins of the crank angle
LOADED = 0.01  # normal force, divided by the weight, from which a toe counts as standing


def score(episodes: int, commands: tuple[float, ...]) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the scores of each controller at each command."""
    env = make_env(ENV, {})
    walker = cast("Controlled", env.unwrapped)
    scores: dict[str, dict[str, dict[str, Any]]] = {}
    for i, command in enumerate(commands):
        seeds = FIRST_SEED + i * episodes + np.arange(episodes)
        scores[str(command)] = {}
        for name in CONTROLLERS:
            same = np.full(episodes, command)
            run = run_episodes(BASELINES[name](walker), ENV, {"friction": 0.8}, same, seeds)
            means = point_estimates(WALKER.metrics, run, env)
            scores[str(command)][name] = {
                "return": means["return"],
                "falls": int(run["fell"].sum()),
                "mean_speed": float(run["distance"].mean() / 10.0),
                **{metric: means[metric] for metric in METRICS},
            }
    return scores


class Turn(NamedTuple):
    """Walks at one command, by crank angle.

    Attributes:
        speed: Quantiles 0.1, 0.5 and 0.9 of the crank speed, in rad/s, shape (3, bins).
        stands: Fraction of the time for which each toe stands, shape (toes, bins).
        slip: Slip of all toes per distance, so that the mean over the bins is the slip per distance
            of the walks, shape (bins,).
    """

    speed: Array
    stands: Array
    slip: Array


def turn(policy: Policy, command: float, walks: int) -> Turn:
    """Let the robot walk from many starts, and return what happens at each crank angle."""
    keys = "crank_angle", "crank_speed", "contact_force", "slip", "x_position"
    envs: Any = gym.make_vec(
        ENV,
        walks,
        autoreset_mode=AutoresetMode.DISABLED,
        terminate_when_fallen=False,
        info_keys=keys,
    )
    observation, _ = envs.reset(seed=FIRST_SEED, options={"speed_command": command})
    weight = envs.unwrapped.task.world.weight[0]
    state, starts = None, np.ones(walks, bool)
    rows = []
    for _ in range(STEPS):
        actions, state = policy.predict(observation, state, starts, True)
        starts = np.zeros(walks, bool)
        observation, *_, info = envs.step(actions)
        rows.append({key: np.array(info[key]) for key in keys})
    envs.close()
    steady = {key: np.array([row[key] for row in rows[SETTLING_STEPS:]]) for key in keys}
    walked = (steady["x_position"][-1] - steady["x_position"][0]).sum()
    bins = (steady["crank_angle"] / (2.0 * np.pi) % 1.0 * BINS).astype(int) % BINS
    standing = steady["contact_force"][..., 1] / weight > LOADED
    found = Turn(np.full((3, BINS), np.nan), np.zeros((standing.shape[-1], BINS)), np.zeros(BINS))
    for i in range(BINS):
        here = bins == i
        if here.any():
            found.speed[:, i] = np.quantile(steady["crank_speed"][here], [0.1, 0.5, 0.9])
            found.stands[:, i] = standing[here].mean(axis=0)
            found.slip[i] = steady["slip"][here].sum() / walked * BINS
    return found


def draw(commands: tuple[float, ...], walks: int, path: Path) -> None:
    """Draw crank speed, slip and standing toes over a turn, with two rows of panels per command."""
    walker = cast("Controlled", make_env(ENV, {}).unwrapped)
    rows = 2 * len(commands)  # two columns, so that phones show readable text
    figure, axes = plt.subplots(
        rows, 2, figsize=(6.4, 1.6 * rows), sharex=True, layout="constrained"
    )
    for speed, slip in zip(axes[2::2, 0], axes[3::2, 0], strict=True):
        speed.sharey(axes[0, 0])
        slip.sharey(axes[1, 0])
    for command, panels in zip(commands, axes.reshape(-1, 2, 2), strict=True):
        speed, slip = panels[:, 0]
        for i, name in enumerate(CONTROLLERS):
            found = turn(BASELINES[name](walker), command, walks)
            draw_turn(speed, slip, found, name)
            draw_standing(panels[i, 1], found, walker.robot.leg_names)
            panels[i, 1].set_title(f"standing toes, {name}, {command:g} m/s", fontsize=10)
        speed.set_title(f"crank speed, {command:g} m/s", fontsize=10)
        speed.set_ylabel("rad/s")
        slip.set_title(f"slip, {command:g} m/s", fontsize=10)
        slip.set(yscale="log", ylabel="m/m")
    axes[0, 0].set_xticks(range(0, 361, 90))
    figure.supxlabel("crank angle (degrees)", fontsize=10)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    figure.savefig(path, dpi=140)


def draw_turn(speed: Axes, slip: Axes, found: Turn, name: str) -> None:
    """Draw the crank speed and the slip of a controller over a turn of the crank."""
    degrees = (np.arange(BINS) + 0.5) * 360.0 / BINS
    (line,) = speed.plot(degrees, found.speed[1], label=name)
    speed.fill_between(degrees, *found.speed[[0, 2]], color=line.get_color(), alpha=0.2)
    slip.plot(degrees, np.maximum(found.slip, 1e-4))


def draw_standing(axis: Axes, found: Turn, legs: tuple[str, ...]) -> None:
    """Draw the fraction of time for which each toe stands, from white (0) to black (1)."""
    axis.imshow(
        found.stands,
        aspect="auto",
        extent=(0.0, 360.0, 3.5, -0.5),
        cmap="Greys",
        vmin=0.0,
        vmax=1.0,
        interpolation="nearest",
    )
    axis.set_yticks(range(4), legs)


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the table of the page."""
    head = [
        "controller",
        "command (m/s)",
        "return",
        "falls (%)",
        "speed error (m/s)",
        "slip (m/m)",
        "cost of transport",
        "RMS torque (N m)",
    ]
    rows = [
        [
            name,
            command,
            f"{scores['return']:.0f}",
            f"{100.0 * scores['falls'] / results['episodes']:.1f}",
            *(f"{scores[metric]:.{decimals}f}" for metric, decimals in METRICS.items()),
        ]
        for command, by_controller in results["scores"].items()
        for name, scores in by_controller.items()
    ]
    return {PAGE: [table(head, rows)]}


def main() -> None:
    """Measure, and write the data, the figure and the table."""
    args = options(__doc__, episodes=400)
    episodes, commands, shown, walks = args.episodes, COMMANDS, SHOWN, WALKS
    if args.quick:
        episodes, commands, shown, walks = 2, COMMANDS[3:4], SHOWN[:1], 2
    results = {"episodes": episodes, "scores": score(episodes, commands)}
    publish(args.out, DATA, results, tables(results))
    draw(shown, walks, args.out / FIGURE)


if __name__ == "__main__":
    main()
