"""How smoothly do four, six, eight and twelve legs walk?

Run the experiment as follows. It takes about a minute on two cores.

    python experiments/legs.py [--episodes 64] [--quick]

Robots with the parts of ``built`` and 4, 6, 8 or 12 legs walk at five commands, each under its
pretrained policy, under the crank-speed profile that was found for it, and under a PID that was
tuned for it. In addition, robots whose links are lighter, so that the whole robot has the mass of
the one with four legs, walk under the same policies. The script writes ``docs/legs/legs.json``,
``docs/legs/legs.png``, and a table per metric of docs/legs.md.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import gymnasium as gym
import matplotlib.pyplot as plt
from pages import options, publish, table

from jansen_env import evaluate
from jansen_env.policies import pretrained
from jansen_env.policies.policy import Policy
from jansen_env.robot import Robot, named_robot
from jansen_env.scoring.benchmarks import find_benchmark

DATA, PAGE = "legs/legs.json", "legs.md"
FIGURE = "legs/legs.png"
ENV = "JansenWalkerBuilt-v0"
COMMANDS = (0.1, 0.2, 0.3, 0.5, 0.8)  # m/s
POLICIES = {4: "ppo", 6: "six_legs", 8: "eight_legs", 12: "twelve_legs"}
METRICS = {
    "return": "return (of 500)",
    "unsupported": "unsupported (fraction of time)",
    "load": "load (multiple of the weight)",
    "steady_slip_per_metre": "slip (m/m)",
    "steady_cost_of_transport": "cost of transport",
}
"""Metrics of the tables and of the figure, with the labels of their axes."""
BASELINES = ("profile", "pid")
SEED = 7  # seed of the initial states
Scores: TypeAlias = dict[str, dict[str, dict[str, list[float]]]]
"""Mean of each metric per command, by controller and number of legs."""
LIGHT = "policy, mass of four legs"
"""Label of the robots that all have the mass of the robot with four legs."""


def with_mass(robot: Robot, mass: float) -> Robot:
    """Return a copy of a robot whose links are lighter, and whose torque limit is lower.

    Masses, moments of inertia and the torque limit are multiplied by the same factor. The feet, the
    friction and the rotor of the motor stay as they are.

    Args:
        robot: The robot.
        mass: Mass of the copy, in kg.
    """
    factor = mass / robot.mass
    links = [
        replace(link, mass=factor * link.mass, inertia=factor * link.inertia)
        for link in robot.bodies
    ]
    motor = replace(robot.motor, torque_limit=factor * robot.motor.torque_limit)
    return replace(robot, bodies=tuple(links), motor=motor)


def measure(episodes: int) -> Scores:
    """Return the scores of all robots.

    Args:
        episodes: Number of episodes per command.
    """
    results: Scores = {name: {} for name in ("policy", *BASELINES, LIGHT)}
    mass = named_robot("built").mass
    for legs, name in POLICIES.items():
        robot = named_robot(f"built:{legs}")
        env = gym.make(ENV, robot=robot)
        policy = pretrained.load(ENV, name)
        robots: dict[str, tuple[Robot, Policy]] = {"policy": (robot, policy)}
        for baseline in BASELINES:
            robots[baseline] = robot, find_benchmark(ENV).baselines[baseline](env.unwrapped)
        if legs > min(POLICIES):
            robots[LIGHT] = with_mass(robot, mass), policy
        for controller, (walker, walks) in robots.items():
            arguments = {"robot": walker}
            scores = evaluate(
                {controller: walks}, ENV, arguments, commands=COMMANDS, episodes=episodes, seed=SEED
            )
            by_command = scores[controller]["by_command"]
            results[controller][str(legs)] = {
                metric: [round(value, 4) for value in by_command[metric]["value"]]
                for metric in METRICS
            }
    return results


def draw(results: Scores, path: Path) -> None:
    """Draw the metrics of the policies against the commanded speed."""
    figure, axes = plt.subplots(3, 2, figsize=(6.0, 7.8), sharex=True, layout="constrained")
    *panels, corner = axes.flat
    for axis, metric in zip(panels, METRICS, strict=True):
        for legs, values in results["policy"].items():
            axis.plot(COMMANDS, values[metric], "o-", label=f"{legs} legs")
        axis.set_ylabel(METRICS[metric])
        axis.set_ylim(bottom=0.0)
        axis.grid(alpha=0.3)
    for axis in panels[-2:]:
        axis.set_xlabel("commanded speed (m/s)")
        axis.tick_params(labelbottom=True)
    corner.axis("off")
    corner.legend(*panels[0].get_legend_handles_labels(), loc="center")
    figure.savefig(path, dpi=140)


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the tables of the page, one per metric.

    Args:
        results: Content of the data file.
    """
    head = ["legs", "controller", *(f"{command} m/s" for command in COMMANDS)]
    scores: Scores = results["scores"]
    found = []
    for metric in METRICS:
        decimals = 0 if metric == "return" else 2
        rows = [
            [legs, controller, *(f"{value:.{decimals}f}" for value in by_legs[legs][metric])]
            for legs in map(str, POLICIES)
            for controller, by_legs in scores.items()
            if legs in by_legs
        ]
        found.append(table(head, rows, texts=2))
    return {PAGE: found}


def main() -> None:
    """Measure, and write the data, the tables and the figure."""
    args = options(__doc__, episodes=64)
    episodes = 2 if args.quick else args.episodes
    scores = measure(episodes)
    results = {"commands": COMMANDS, "episodes": episodes, "scores": scores}
    publish(args.out, DATA, results, tables(results))
    draw(scores, args.out / FIGURE)


if __name__ == "__main__":
    main()
