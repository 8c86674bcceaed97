"""Report of a search: a table, pictures, robot files and profiles, from its journals."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from tabulate import tabulate

from agents.design.design_plan import Plan
from agents.design.measures import MEASURES, Walker
from agents.design.search import (
    JOURNAL,
    Searched,
    joined,
    make_walker,
    measure,
    objectives_of,
    read_journal,
)
from agents.design.shape import geometry_measures
from agents.design.variables import Candidate
from jansen_env.baselines.policy import Policy
from jansen_env.commands.plots import save
from jansen_env.drawings.shaft_order import layers
from jansen_env.files import write_json, write_text
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import toe_positions, world_joints
from jansen_env.robot.lengths import lengths
from jansen_env.robot.robot_file import write_robot
from jansen_env.scoring.metrics import screen_table

ROBOT, PROFILE, REPORT = "robot.json", "profile.json", "report.md"
OTHER_STARTS = "other starts"
FRESH = 16  # crank angles, others than those of the search
MOST_OF_FRONT = 20  # designs of a front or map that are written


class SeedResult(NamedTuple):
    """Result of one seed's search."""

    name: str
    searched: Searched
    best: int
    candidate: Candidate

    def rank(self, plan: Plan) -> tuple[float, float]:
        """Return how far the best design violates the limits, and its first objective."""
        objective = objectives_of(plan, self.searched.measured)[self.best, 0]
        return float(self.searched.violation[self.best]), float(objective)


def read_results(plan: Plan, folder: Path) -> list[SeedResult]:
    """Return what each seed in a folder has found so far.

    Raises:
        ValueError: a journal is damaged, or no seed has one.
    """
    results, space = [], plan.space()
    for path in sorted(folder.glob(f"seed_*/{JOURNAL}"), key=lambda p: (len(p.parts[-2]), p)):
        if parts := read_journal(path, plan):
            searched = joined(parts)
            best = searched.best(plan)
            candidate = space.candidate(searched.unit[best])
            results.append(SeedResult(path.parent.name, searched, best, candidate))
    if not results:
        raise ValueError(f"{folder} has no search that has measured anything")
    return results


def write_report(plan: Plan, folder: Path, policy: Policy | None = None) -> str:
    """Write robot files, profiles, pictures and the report of a search.

    Returns:
        The start and the best design, walked from other starts than the search's: a short table.
    """
    results, space = read_results(plan, folder), plan.space()
    designs = {"start": space.candidate(space.start)}
    for result in results:
        designs[result.name] = result.candidate
        write_design(folder / result.name, plan, result.candidate)
        if plan.method != "cma":
            front = result.searched.front(plan)
            for number, k in enumerate(front[:: max(1, len(front) // MOST_OF_FRONT)]):
                candidate = space.candidate(result.searched.unit[k])
                write_design(folder / result.name / f"front_{number}", plan, candidate)
    names, step = plan.measured, float(plan.env_kwargs.get("time_step", 1e-3))
    places = {
        "search": make_walker(plan, policy), OTHER_STARTS: fresh_walker(plan, policy),
        "half the time step": fresh_walker(plan, policy, time_step=0.5 * step),
    }  # fmt: skip
    rows, walked = [], {}
    for name, candidate in designs.items():
        for place, walker in places.items():
            measured, violation = measure(plan, walker, [candidate])
            cells = [f"{float(measured[key][0]):.3g}" for key in names]
            cells.append("yes" if violation[0] == 0.0 else "no")
            rows.append([name if place == "search" else "", place, *cells])
            if place == OTHER_STARTS:
                walked[name] = cells
        rows[-1].append("yes" if assembles(candidate.robot) else "no")
    head = ["", "where", *(f"{key} ({MEASURES[key].unit})" for key in names), "limits kept",
            "can be assembled"]  # fmt: skip
    values = [space.values(space.start), *(space.values(r.searched.unit[r.best]) for r in results)]
    table = [[name, *(f"{each[name]:.4g}" for each in values)] for name in values[0]]
    count = sum(len(result.searched.violation) for result in results)
    text = (
        f"# {folder.name}\n\n{plan.method}, {plan.starts} walks at {plan.speed:g} m/s each of "
        f"{count} candidates, {plan.population} a generation.\n\n"
        f"{tabulate(rows, head, tablefmt='github')}\n\n"
        f"{tabulate(table, ['', *designs], tablefmt='github')}\n\n"
        "![designs](designs.png)\n\n![search](search.png)\n"
    )
    if out := [result.name for result in results if result.rank(plan)[0] > 0.0]:
        text += f"\nNone of {', '.join(out)} keeps all limits: shown is the one nearest to them.\n"
    robots = {name: candidate.robot for name, candidate in designs.items()}
    closed = all(geometry_measures(robot)["closure"] > 0.0 for robot in robots.values())
    if len(results) > 1 and closed:
        text += f"\n{agreement([*robots.values()])}\n"
    draw_designs(robots, folder / "designs.png")
    draw_search(plan, results, folder / "search.png")
    write_text(folder / REPORT, text)
    best = min(results, key=lambda result: result.rank(plan)).name
    columns = [OTHER_STARTS, *head[2:-1]], ["start", *walked["start"]], [best, *walked[best]]
    return screen_table([*zip(*columns, strict=True)])


def agreement(robots: Sequence[Robot]) -> str:
    """Return how far designs agree as a sentence; the first design is the start.

    Paths of the first toe: mean distance of points over width. Lengths: mean difference.
    """
    psi = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False)
    toes = [toe_positions(robot, psi)[:, 0] @ (1.0, 1.0j) for robot in robots]
    paths = [toe - toe.mean() for toe in toes]
    sizes = np.array([[*lengths(robot).values()] for robot in robots])

    def apart(i: int, k: int) -> tuple[float, float]:
        gap = np.abs(paths[i][:, None] - paths[k])
        mean = 0.5 * (gap.min(axis=0).mean() + gap.min(axis=1).mean())
        width = 0.5 * (np.ptp(paths[i].real) + np.ptp(paths[k].real))
        return mean / width, float(np.mean(np.abs(sizes[i] - sizes[k]) / np.abs(sizes[0])))

    def mean(pairs: Iterable[tuple[int, int]]) -> str:
        path, length = 100.0 * np.mean([apart(*pair) for pair in pairs], axis=0)
        return f"paths {path:.1f} % of their width, lengths {length:.1f} %"

    between = itertools.combinations(range(1, len(robots)), 2)
    return (
        f"Apart from each other in the mean: {mean(between)}; from the start: "
        f"{mean((0, k) for k in range(1, len(robots)))}."
    )


def fresh_walker(plan: Plan, policy: Policy | None, **changes: object) -> Walker:
    """Return what walks candidates from other starts than the search."""
    walker = make_walker(plan, policy, FRESH, **changes)
    walker.angles = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, FRESH)
    return walker


def assembles(robot: Robot) -> bool:
    """Return whether the workshop drawings find an order of links in which nothing collides."""
    try:
        return bool(layers(robot))
    except ValueError:
        return False


def write_design(folder: Path, plan: Plan, candidate: Candidate) -> None:
    """Write a design's robot file and the profile that walks it."""
    write_robot(folder / ROBOT, candidate.robot)
    if plan.policy is None:
        numbers = [candidate.numbers.tolist()]
        write_json(folder / PROFILE, {"found": {"commands": [plan.speed], "numbers": numbers}})


def draw_designs(robots: dict[str, Robot], path: Path) -> None:
    """Draw each robot with the paths of its toes, all legs but the first pale."""
    columns = min(len(robots), 5)
    rows = -(-len(robots) // columns)
    figure = Figure((3.6 * columns, 3.0 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axis, (name, robot) in zip(axes.flat, robots.items(), strict=False):
        axis.set(title=name, aspect="equal")
        if not geometry_measures(robot)["closure"] > 0.0:
            continue
        for k, joints in enumerate(world_joints(robot, np.array([0.0, 0.0, 0.0, 0.6]))):
            for a, b in robot.linkage.skeleton:
                axis.plot(*joints[[a, b]].T, color="C0", lw=1.8, alpha=0.2 if k else 1.0)
        for toe in toe_positions(robot, np.linspace(0.0, 6.3, 400)).swapaxes(0, 1):
            axis.plot(*toe.T, color="C3", lw=1.2)
        axis.plot(0.0, 0.0, "ko", ms=4)
    for axis in axes.flat[len(robots) :]:
        axis.remove()
    figure.supxlabel("m")
    save(figure, path)


def draw_search(plan: Plan, results: list[SeedResult], path: Path) -> None:
    """Draw the best so far, the front, or the map, as the method has it."""
    figure = Figure((7.0, 4.6), layout="constrained")
    axis = figure.subplots()
    names = [*plan.objectives]
    sign = np.array([1.0 if way == "min" else -1.0 for way in plan.objectives.values()])
    for result in results:
        objectives = objectives_of(plan, result.searched.measured)
        if plan.method == "nsga2":
            front = objectives[result.searched.front(plan)][:, :2] * sign[:2]
            axis.plot(*front.T, "o-", ms=4, lw=1.0, label=result.name)
        elif plan.method == "map_elites":
            places = [result.searched.measured[name] for name in plan.map]
            kept = result.searched.violation == 0.0
            order = np.flatnonzero(kept)[np.argsort(-objectives[kept, 0])]
            value, (x, y) = sign[0] * objectives[order, 0], (place[order] for place in places)
            shown = axis.scatter(x, y, c=value, s=8, cmap="viridis_r")
            if result is results[0]:
                figure.colorbar(shown, label=names[0])
        else:
            value = np.where(result.searched.violation == 0.0, objectives[:, 0], np.inf)
            best = np.minimum.accumulate(value.reshape(-1, plan.population).min(axis=1))
            none = "" if np.isfinite(best).any() else ": none keeps all limits"
            axis.plot(np.where(np.isfinite(best), sign[0] * best, np.nan), label=result.name + none)
    labels = {"nsga2": names[:2], "map_elites": [*plan.map]}.get(
        plan.method, ["generation", names[0]]
    )
    axis.set(xlabel=labels[0], ylabel=labels[1])
    if plan.method != "map_elites":
        axis.legend(fontsize=8)
    save(figure, path)
