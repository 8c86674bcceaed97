"""How smoothly do four, six, eight and twelve legs walk?

Run the experiment as follows. The defaults are 64 episodes per command and the folder docs/legs.

    python experiments/legs.py [EPISODES] [FOLDER]

Robots with the parts of ``built`` and 4, 6, 8 or 12 legs walk at five commands, each under its
pretrained policy and under a PID that was tuned for it. In addition, robots whose links are
lighter, so that the whole robot has the mass of the one with four legs, walk under the same
policies. The script prints a table per metric and writes ``legs.json`` and ``legs.png``. The page
docs/legs.md contains the tables and the figure, and ``legs.json`` contains the data. The run takes
about a minute on two cores.
"""

import sys
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import matplotlib.pyplot as plt

from jansen_env import evaluate
from jansen_env.files import write_json
from jansen_env.policies import pretrained
from jansen_env.robot import Robot, named_robot
from jansen_env.scoring.benchmarks import find_benchmark

ENV = "JansenWalkerBuilt-v0"
COMMANDS = (0.1, 0.2, 0.3, 0.5, 0.8)
POLICIES = {4: "ppo", 6: "six_legs", 8: "eight_legs", 12: "twelve_legs"}
METRICS = {
    "return": "return (of 500)",
    "unsupported": "unsupported (fraction of time)",
    "load": "load (multiple of the weight)",
    "steady_slip_per_metre": "slip (m/m)",
    "steady_cost_of_transport": "cost of transport",
}
"""Metrics of the figure, with the labels of their axes."""
SEED = 7
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


def measure(episodes: int) -> dict[str, dict[str, dict[str, list[float]]]]:
    """Return the mean of each metric per command, by controller and number of legs."""
    results: dict[str, dict[str, dict[str, list[float]]]] = {"policy": {}, "pid": {}, LIGHT: {}}
    mass = named_robot("built").mass
    for legs, name in POLICIES.items():
        robot = named_robot(f"built:{legs}")
        env = gym.make(ENV, robot=robot)
        policy = pretrained.load(ENV, name)
        pid = find_benchmark(ENV).baselines["pid"](env.unwrapped)
        robots = {"policy": (robot, policy), "pid": (robot, pid)}
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


def draw(results: dict[str, dict[str, dict[str, list[float]]]], path: Path) -> None:
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


def table(results: dict[str, dict[str, dict[str, list[float]]]], metric: str) -> str:
    """Return a table of one metric, as docs/legs.md contains it."""
    lines = [
        "| legs | controller | " + " | ".join(f"{command} m/s" for command in COMMANDS) + " |",
        "| ---: | --- |" + " ---: |" * len(COMMANDS),
    ]
    for legs in map(str, POLICIES):
        for controller, by_legs in results.items():
            if legs not in by_legs:
                continue
            digits = 0 if metric == "return" else 2
            cells = " | ".join(f"{value:.{digits}f}" for value in by_legs[legs][metric])
            lines.append(f"| {legs} | {controller} | {cells} |")
    return "\n".join(lines)


def main() -> None:
    """Measure, print the table, and write the data and the figure."""
    episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 64
    folder = Path(sys.argv[2] if len(sys.argv) > 2 else "docs/legs")
    folder.mkdir(parents=True, exist_ok=True)
    results = measure(episodes)
    for metric, label in METRICS.items():
        print(f"\n{label}\n\n{table(results, metric)}")
    write_json(folder / "legs.json", {"commands": COMMANDS, "episodes": episodes, **results})
    draw(results, folder / "legs.png")


if __name__ == "__main__":
    main()
