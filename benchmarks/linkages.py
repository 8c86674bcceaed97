"""Walking linkages compared: equal height, mass, motor and feet, each with its own controllers.

    python -m benchmarks.linkages [--out docs/linkages] [--quick]

PIDs and crank-speed profiles are those of ``docs/linkages/controllers.json``.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import gymnasium as gym
import numpy as np

from benchmarks import climbing, measure
from jansen_env.baselines.pid import PID
from jansen_env.baselines.policy import Array, Policy
from jansen_env.files import write_json
from jansen_env.plants.plant import ProjectionPlant
from jansen_env.plants.trace import find_touchdowns, peak_loads, trace_forces
from jansen_env.robot import ROBOTS, Bar, Robot
from jansen_env.robot.kinematics import advance_per_turn, toe_positions, world_joints
from jansen_env.robot.zoo import standing_height
from jansen_env.scoring.metrics import SETTLING, point_estimates
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking import JansenWalkerEnv
from jansen_env.tasks.walking.profile import Profile
from jansen_env.tasks.walking.walker_baselines import walking_pid
from jansen_env.tasks.walking.walker_benchmark import WALKER, succeeded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ENV = "JansenWalker-v0"
CONTROLLERS = Path(__file__).parents[1] / "docs" / "linkages" / "controllers.json"
LINKAGES = {
    "paper_slender": "Jansen (paper)", "holy_slender": "Jansen (holy)", "klann": "Klann",
    "chebyshev": "Chebyshev", "trotbot": "TrotBot", "strider": "Strider",
}  # fmt: skip
SPEEDS = np.array([0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7])  # m/s
SHOWN = (0.1, 0.3, 0.5, 0.7)  # m/s, of the table's costs of transport
EPISODES, WATCHED = 32, 4  # walks at each speed; those whose heave and forces are worked out
FIRST_SEED = 120_000  # apart from all others
STEPS = np.array([0.02, 0.03, 0.04, 0.06, 0.08, 0.1, 0.13, 0.16, 0.2, 0.25, 0.3])  # m
STEP_SPEEDS = (0.4, 0.5, 0.6, 0.7)  # m/s: a walk that gets there has its last toe over the step
SINGLE = 0.5  # m/s, of the columns that are shown at one speed
COLUMNS = (("slip", 1e3), ("heave", 1e3), ("pin", 1.0))
LOSSES = ("joint_loss", "slip_loss", "impact_loss")

Cells = list[dict[str, float]]  # of each of SPEEDS: outcomes, and numbers of the steady walk
Scores = dict[str, dict[str, Cells]]  # by linkage and controller
Kwargs = dict[str, Any]  # of an environment


def as_tall(name: str) -> Robot:
    """A built-in design, made as tall as the paper's where it is not."""
    robot = ROBOTS[name]()
    scale, bodies = standing_height(ROBOTS["paper"]()) / standing_height(robot), []
    if abs(scale - 1.0) < 1e-9:
        return robot
    for link in robot.bodies:
        sizes = ("length",) if isinstance(link, Bar) else ("d", "l", "h")
        bodies.append(replace(link, **{size: scale * getattr(link, size) for size in sizes}))
    return replace(robot, bodies=tuple(bodies)).with_slender_inertias()


def controllers_of(numbers: Kwargs, robot: Robot) -> dict[str, Policy]:
    """A linkage's profile and PID, interpolated between the speeds of the search."""
    env, cranks = JansenWalkerEnv(robot=robot), numbers["crank_speeds"]
    pid = walking_pid(lambda v: np.interp(v, SPEEDS, cranks), env, PID(*numbers["gains"]))
    return {"profile": Profile(SPEEDS, np.array(numbers["profile"])).policy(env), "pid": pid}


def score(kwargs: Kwargs, policy: Policy, count: int, watched: int) -> Cells:
    """Score ``count`` walks at each of :data:`SPEEDS`; ``kwargs``: of the environment."""
    env, seeds, cells = make_env(ENV, kwargs), FIRST_SEED + np.arange(count), []
    run = run_episodes(policy, ENV, kwargs, np.repeat(SPEEDS, count), np.tile(seeds, len(SPEEDS)))
    for k, command in enumerate(SPEEDS.tolist()):
        part = {name: values[k * count : (k + 1) * count] for name, values in run.items()}
        estimates = point_estimates(WALKER.metrics, part, env)
        seen = [watch(kwargs, policy, command, seed) for seed in seeds[:watched].tolist()]
        cells.append({
            "command": command, "walks": int(succeeded(part, env).sum()),
            "falls": int(part["fell"].sum()), "cost": estimates["steady_cost_of_transport"],
            "slip": estimates["steady_slip_per_metre"],
            **{name: float(np.median([walk[name] for walk in seen])) for name in seen[0]},
        })  # fmt: skip
    return cells


def watch(kwargs: Kwargs, policy: Policy, command: float, seed: int) -> dict[str, float]:
    """Walk once and return heave, largest pin force and shares of :data:`LOSSES` in the work lost.

    They are from :data:`SETTLING` s on, until a fall; the force without time steps of landings.
    """
    env = gym.make(ENV, speed_command=command, **kwargs)
    unwrapped = cast(JansenWalkerEnv, env.unwrapped)
    plant = cast(ProjectionPlant, unwrapped.plant)
    traces, state, over = [], None, False
    rows: list[list[float]] = []
    plant.tracing = True
    seen, _ = env.reset(seed=seed)
    while not over:
        action, state = policy.predict(seen, state, np.array(not rows), True)
        seen, _, fallen, late, info = env.step(action)
        traces.append(plant.trace)
        rows.append([float(plant.state[1]), *(info["energy"][name] for name in LOSSES)])
        over = fallen or late
    steady = round(SETTLING / unwrapped.control_dt)
    steady = steady if len(rows) > steady else 0
    (height, *losses), trace = np.array(rows[steady:]).T, np.concatenate(traces[steady:])
    load = trace_forces(plant.tables, trace, plant.time_step).bearing
    return {
        "heave": float(np.ptp(height)),
        "pin": peak_loads(load, find_touchdowns(trace, None), plant.time_step).force,
        **dict(zip(LOSSES, np.sum(losses, axis=1) / np.sum(losses), strict=True)),
    }  # fmt: skip


def highest_step(kwargs: Kwargs, policy: Policy, heights: Array, count: int) -> str:
    """Return the height (m) up to which half of the walks get over one step, as text.

    They begin with all toes in front of the step, at the best speed.
    """
    reach = float(toe_positions(kwargs["robot"], np.linspace(0.0, 6.3, 500))[..., 0].max())
    cases = [
        (climbing.ground("one step", height, k, reach), speed, FIRST_SEED + k)
        for height in heights.tolist() for speed in STEP_SPEEDS for k in range(count)
    ]  # fmt: skip
    won = climbing.walk(policy, cases, **kwargs).succeeded
    shares = climbing.best(won.reshape(len(heights), len(STEP_SPEEDS), count))
    return climbing.last(heights, shares)


def score_table(scores: Scores, steps: dict[str, list[str]]) -> str:
    """A row a linkage and controller, as Markdown."""
    rows = []
    for name, by_controller in scores.items():
        for (controller, cells), step in zip(by_controller.items(), steps[name], strict=True):
            at = {cell["command"]: cell for cell in cells}
            rows.append((
                LINKAGES[name], controller, *(f"{at[v]['cost'] or np.nan:.2f}" for v in SHOWN),
                *(f"{size * (at[SINGLE][key] or np.nan):.0f}" for key, size in COLUMNS),
                str(sum(cell["falls"] for cell in cells)), step,
            ))  # fmt: skip
    head = ("linkage", "controller", *(f"cost at {v:g} m/s" for v in SHOWN),
            "slip (mm/m)", "heave (mm)", "pin force (N)", "falls", "step (m)")  # fmt: skip
    return measure.table(head, rows)


def draw_scores(scores: Scores, path: Path, count: int) -> None:
    """Draw all numbers over speed; the profile's, the PID's dotted."""
    panels = {
        "cost": ("cost of transport", 1.0), "slip": ("slip (mm/m)", 1e3),
        "walks": (f"walks of {count} that get there", 1.0), "heave": ("heave (mm)", 1e3),
        "pin": ("largest pin force (N)", 1.0), "joint_loss": ("work lost in joints (%)", 100.0),
    }  # fmt: skip
    figure, axes = measure.subplots(2, 3, 12.0, 7.0, sharex=True)
    for axis, (key, (title, size)) in zip(axes.flat, panels.items(), strict=True):
        for i, (name, by_controller) in enumerate(scores.items()):
            for label, cells in zip((LINKAGES[name], None), by_controller.values(), strict=True):
                # Where most do not walk there is nothing to compare but how many do.
                walked = [c for c in cells if 2 * c["walks"] >= count or key == "walks"]
                x, y = [c["command"] for c in walked], [size * c[key] for c in walked]
                axis.plot(x, y, "o-" if label else ":", color=f"C{i}", ms=3.5, lw=1.3, label=label)
        axis.set(title=title, yscale="log" if key in {"cost", "slip", "pin"} else "linear")
    figure.supxlabel("commanded speed (m/s)")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=6)
    measure.save(figure, path)


def draw_linkages(robots: dict[str, Robot], folder: Path) -> None:
    """Draw each with the paths of its toes about the crank axis, on its own and all together."""
    figure, axes = measure.subplots(2, 3, 12.0, 5.4, sharex=True, sharey=True)
    for axis, (name, robot) in zip(axes.flat, robots.items(), strict=False):
        _draw_linkage(axis, robot, f"{LINKAGES[name]}: {abs(advance_per_turn(robot)):.2f} m a turn")
        single, alone = measure.subplots(1, 1, 6.0, 4.0)
        _draw_linkage(alone[0, 0], robot)
        measure.save(single, folder / f"{name}.png")
    measure.save(figure, folder / "zoo.png")


def _draw_linkage(axis: Axes, robot: Robot, title: str = "") -> None:
    """Draw a robot's linkage in m, all legs but the first pale."""
    for k, joints in enumerate(world_joints(robot, np.array([0.0, 0.0, 0.0, 0.6]))):
        for a, b in robot.linkage.skeleton:
            axis.plot(*joints[[a, b]].T, color="C0", lw=1.6, alpha=0.25 if k else 1.0)
    for toe in toe_positions(robot, np.linspace(0.0, 6.3, 500)).swapaxes(0, 1):
        axis.plot(*toe.T, color="C3", lw=1.0)
    axis.axhline(-standing_height(robot), color="0.5", lw=0.8, zorder=0)
    axis.plot(0.0, 0.0, "ko", ms=4)
    axis.set(aspect="equal", title=title)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = measure.options(__doc__, "docs/linkages")
    parser.add_argument("--time-step", type=float, default=1e-3, metavar="S", help="(0.001)")
    args = measure.parse(parser, arguments)
    count, watched, heights = (2, 1, STEPS[:2]) if args.quick else (EPISODES, WATCHED, STEPS)
    robots = {name: as_tall(name) for name in [*LINKAGES][: 3 if args.quick else None]}
    numbers, scores, steps = json.loads(CONTROLLERS.read_text(encoding="utf-8")), {}, {}
    for name, robot in robots.items():
        kwargs = {"robot": robot, "time_step": args.time_step}
        policies = controllers_of(numbers[name], robot)
        scores[name] = {k: score(kwargs, p, count, watched) for k, p in policies.items()}
        steps[name] = [highest_step(kwargs, p, heights, count) for p in policies.values()]
    write_json(args.out / "scores.json", scores)
    command = f"`python -m benchmarks.linkages --time-step {args.time_step:g}`: {count} walks of "
    command += f"each at each of {len(SPEEDS)} speeds. Slip, heave and largest pin force: at "
    command += f"{SINGLE:g} m/s, the last two medians of {watched} walks. Falls: of "
    command += f"{count * len(SPEEDS)} walks. Step: the highest that half of the walks get over."
    measure.report(args.out / "scores.md", "# Scores of the linkages", command,
                   score_table(scores, steps))  # fmt: skip
    draw_scores(scores, args.out / "comparison.png", count)
    draw_linkages(robots, args.out)


if __name__ == "__main__":
    main()
