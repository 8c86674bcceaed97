"""How do walking linkages of equal height and mass compare?

Run the experiment as follows. It takes about five minutes on one core.

    python experiments/linkages.py [--walks 32] [--quick]

Six linkages walk at eight speeds and over single steps, each under a crank-speed profile and a PID
that were found for it (``docs/linkages/controllers.json``). The script writes
``docs/linkages/scores.json``, the figure ``comparison.png`` in the same folder, and the table of
docs/linkages.md.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import LogLocator
from pages import DOCS, options, publish, table

from jansen_env.plants.trace import find_touchdowns, trace_forces
from jansen_env.policies.pid import PID
from jansen_env.policies.policy import Controlled, Policy
from jansen_env.robot import ROBOTS, Bar, Robot
from jansen_env.robot.kinematics import toe_positions
from jansen_env.robot.zoo import standing_height
from jansen_env.scoring.metrics import SETTLING, point_estimates
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking.profile import Profile
from jansen_env.tasks.walking.walker_benchmark import WALKER, walking_pid
from jansen_env.terrain.ground import one_step

DATA, PAGE, FIGURE = "linkages/scores.json", "linkages.md", "linkages/comparison.png"
CONTROLLERS = DOCS / "linkages" / "controllers.json"
ENV = "JansenWalker-v0"
LINKAGES = {
    "paper_slender": "Jansen (paper)",
    "holy_slender": "Jansen (holy)",
    "klann": "Klann",
    "chebyshev": "Chebyshev",
    "trotbot": "TrotBot",
    "strider": "Strider",
}
SPEEDS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)  # m/s
SHOWN_COSTS = (0.1, 0.3, 0.5, 0.7)  # speeds of the costs in the table, in m/s
SHOWN_SPEED = 0.5  # speed of the other columns, in m/s
WATCHED = 2  # walks at each speed whose heave and pin forces are measured
FIRST_SEED = 120_000  # no other part of the project uses these seeds
STEPS: tuple[float, ...] = (0.02, 0.03, 0.04, 0.06, 0.08, 0.1, 0.13, 0.16, 0.2, 0.25, 0.3)  # m
STEP_SPEEDS = (0.4, 0.5, 0.6, 0.7)  # m/s
STEP_GAP = (0.1, 0.5)  # range of the distance of the foremost toe from the step at the start, in m
LOSSES = ("joint_loss", "slip_loss", "impact_loss")


def as_tall_as_the_paper(name: str) -> Robot:
    """Return a built-in robot, scaled to the standing height of the paper's robot."""
    robot = ROBOTS[name]()
    scale = standing_height(ROBOTS["paper"]()) / standing_height(robot)
    if abs(scale - 1.0) < 1e-9:
        return robot
    bodies = []
    for link in robot.bodies:
        sizes = ("length",) if isinstance(link, Bar) else ("d", "l", "h")
        bodies.append(replace(link, **{size: scale * getattr(link, size) for size in sizes}))
    return replace(robot, bodies=tuple(bodies)).with_slender_inertias()


def controllers_of(name: str, robot: Robot) -> dict[str, Policy]:
    """Return the profile and the PID that were found for a linkage."""
    found = json.loads(CONTROLLERS.read_text(encoding="utf-8"))[name]
    env = cast("Controlled", gym.make(ENV, robot=robot).unwrapped)
    pid = PID(*found["gains"])
    return {
        "profile": Profile(np.array(SPEEDS), np.array(found["profile"])).policy(env),
        "pid": walking_pid(lambda v: np.interp(v, SPEEDS, found["crank_speeds"]), env, pid),
    }


def score(robot: Robot, policy: Policy, walks: int, watched: int) -> list[dict[str, Any]]:
    """Score a controller at each of :data:`SPEEDS`.

    Args:
        robot: The robot.
        policy: The controller.
        walks: Number of walks at each speed.
        watched: Number of walks at each speed whose heave and pin forces are measured.
    """
    kwargs = {"robot": robot}
    env = make_env(ENV, kwargs)
    seeds = FIRST_SEED + np.arange(walks)
    cells = []
    for speed in SPEEDS:
        run = run_episodes(policy, ENV, kwargs, np.full(walks, speed), seeds)
        means = point_estimates(WALKER.metrics, run, env)
        seen = [watch(robot, policy, speed, seed) for seed in seeds[:watched].tolist()]
        cells.append(
            {
                "command": speed,
                "walks": int(run["success"].sum()),
                "falls": int(run["fell"].sum()),
                "cost": means["steady_cost_of_transport"],
                "slip": means["steady_slip_per_metre"],
                **{key: float(np.median([w[key] for w in seen])) for key in seen[0]},
            }
        )
    return cells


def watch(robot: Robot, policy: Policy, command: float, seed: int) -> dict[str, float]:
    """Let a robot walk once, and measure its heave, pin force and losses after :data:`SETTLING`.

    Args:
        robot: The robot.
        policy: The controller.
        command: Commanded speed, in m/s.
        seed: Seed of the reset.

    Returns:
        Heave (m), the largest force on any pin outside of landings ("pin", in N), and the fraction
        of each of :data:`LOSSES` in their sum.
    """
    env = gym.make(ENV, robot=robot, speed_command=command)
    plant: Any = cast(Any, env.unwrapped).task.world.plant
    plant.tracing = True
    observation, _ = env.reset(seed=seed)
    traces, state, over = [], None, False
    rows: list[list[float]] = []
    while not over:
        action, state = policy.predict(observation, state, np.array(not rows), True)
        observation, _, terminated, truncated, info = env.step(action)
        traces.append(plant.trace.copy())
        rows.append([plant.states[0, 1], *(info["energy"][name] for name in LOSSES)])
        over = terminated or truncated
    steady = round(SETTLING / cast(Any, env.unwrapped).control_dt)
    if len(rows) <= steady:
        steady = 0
    height, *losses = np.array(rows[steady:]).T
    trace = np.concatenate(traces[steady:])
    forces = trace_forces(plant.tables_in_force(0), trace, plant.time_step).bearing
    landings = find_touchdowns(trace, None)
    amounts = np.sum(losses, axis=1)
    return {
        "heave": float(np.ptp(height)),
        "pin": float(forces[~landings].max()),
        **dict(zip(LOSSES, (amounts / amounts.sum()).tolist(), strict=True)),
    }


def highest_step(robot: Robot, policy: Policy, walks: int, heights: tuple[float, ...]) -> str:
    """Return the height up to which half of the walks climb a step, at the best speed, as text.

    Args:
        robot: The robot.
        policy: The controller.
        walks: Number of walks for each height and speed.
        heights: Heights, in m.
    """
    reach = float(toe_positions(robot, np.linspace(0.0, 6.3, 500))[..., 0].max())
    gaps = np.random.default_rng(FIRST_SEED).uniform(*STEP_GAP, walks)
    climbed = np.zeros((len(heights), len(STEP_SPEEDS)))
    for k, height in enumerate(heights):
        kwargs = {
            "robot": robot,
            "terrain": [one_step(reach + gap, height) for gap in gaps] * len(STEP_SPEEDS),
        }
        commands = np.repeat(STEP_SPEEDS, walks)
        seeds = FIRST_SEED + np.tile(np.arange(walks), len(STEP_SPEEDS))
        run = run_episodes(policy, ENV, kwargs, commands, seeds)
        climbed[k] = run["success"].reshape(len(STEP_SPEEDS), walks).mean(axis=1)
    best = climbed[:, climbed.mean(axis=0).argmax()]
    failed = np.flatnonzero(best < 0.5)
    count = failed[0] if len(failed) else len(heights)
    if count == 0:
        return "-"
    return ("" if len(failed) else ">= ") + f"{heights[count - 1]:g}"


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the table of the page."""
    head = [
        "linkage",
        "controller",
        *(f"cost at {speed:g} m/s" for speed in SHOWN_COSTS),
        "slip (mm/m)",
        "heave (mm)",
        "pin force (N)",
        "falls",
        "step (m)",
    ]
    rows = []
    for name, by_controller in results["scores"].items():
        for controller, cells in by_controller.items():
            at = {cell["command"]: cell for cell in cells}
            shown = at[SHOWN_SPEED]
            costs = (at[speed]["cost"] for speed in SHOWN_COSTS)
            rows.append(
                [
                    LINKAGES[name],
                    controller,
                    *("-" if cost is None else f"{cost:.2f}" for cost in costs),
                    f"{1e3 * shown['slip']:.0f}",
                    f"{1e3 * shown['heave']:.0f}",
                    f"{shown['pin']:.0f}",
                    str(sum(cell["falls"] for cell in cells)),
                    results["steps"][name][controller],
                ]
            )
    return {PAGE: [table(head, rows, texts=2)]}


def draw(results: dict[str, Any], path: Path) -> None:
    """Draw all values against the speed; the lines of PID controllers are dotted."""
    panels = {
        "cost": ("cost of transport", 1.0),
        "slip": ("slip (mm/m)", 1e3),
        "walks": (f"successful walks of {results['walks']}", 1.0),
        "heave": ("heave (mm)", 1e3),
        "pin": ("largest pin force (N)", 1.0),
        "joint_loss": ("work lost in joints (%)", 100.0),
    }
    figure, axes = plt.subplots(3, 2, figsize=(6.4, 8.0), sharex=True, layout="constrained")
    for axis, (key, (title, size)) in zip(axes.flat, panels.items(), strict=True):
        for i, (name, by_controller) in enumerate(results["scores"].items()):
            for label, cells in zip((LINKAGES[name], None), by_controller.values(), strict=True):
                walked = [c for c in cells if 2 * c["walks"] >= results["walks"] or key == "walks"]
                speeds = [cell["command"] for cell in walked]
                values = [size * cell[key] for cell in walked]
                style = "o-" if label else ":"
                axis.plot(speeds, values, style, color=f"C{i}", ms=3.5, lw=1.3, label=label)
        axis.set_title(title, fontsize=10)
        axis.set(yscale="log" if key in {"cost", "slip", "pin"} else "linear")
        if axis.get_yscale() == "log":
            axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.yaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_minor_formatter("")
    figure.supxlabel("commanded speed (m/s)", fontsize=10)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    figure.savefig(path, dpi=140)


def main() -> None:
    """Measure, and write the data, the figure and the table."""
    args = options(__doc__, walks=32)
    names, walks, watched, heights = [*LINKAGES], args.walks, WATCHED, STEPS
    if args.quick:
        names, walks, watched, heights = names[2:3], 1, 1, STEPS[:1]
    results: dict[str, Any] = {"walks": walks, "scores": {}, "steps": {}}
    for name in names:
        robot = as_tall_as_the_paper(name)
        policies = controllers_of(name, robot)
        results["scores"][name] = {
            controller: score(robot, policy, walks, watched)
            for controller, policy in policies.items()
        }
        results["steps"][name] = {
            controller: highest_step(robot, policy, walks, heights)
            for controller, policy in policies.items()
        }
        print(name, file=sys.stderr, flush=True)
    publish(args.out, DATA, results, tables(results))
    draw(results, args.out / FIGURE)


if __name__ == "__main__":
    main()
