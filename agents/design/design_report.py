"""What a search has found: a table, pictures, robot files and profiles, from its journals."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from tabulate import tabulate

from agents.design.design_plan import Plan
from agents.design.measures import MEASURES, Walker
from agents.design.search import JOURNAL, Searched, joined, make_walker, measure, read_journal
from agents.design.variables import Candidate
from agents.plots import save
from jansen_env.baselines.policy import Policy
from jansen_env.files import write_json, write_text
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import toe_positions, world_joints
from jansen_env.robot.robot_file import write_robot

ROBOT, PROFILE, REPORT = "robot.json", "profile.json", "report.md"
FRESH = 16  # crank angles, others than those of the search
CHECKS: dict[str, dict[str, Any]] = {"other starts": {}, "half the time step": {"time_step": 5e-4}}
"""Where what was found is walked again: arguments of the environment."""


class Found(NamedTuple):
    """What one seed's search has found."""

    name: str
    searched: Searched
    best: int
    candidate: Candidate


def read_found(plan: Plan, folder: Path) -> list[Found]:
    """Return what each seed in a folder has found so far.

    Raises:
        ValueError: a journal is damaged, or no seed has one.
    """
    found, space = [], plan.space()
    for path in sorted(folder.glob(f"seed_*/{JOURNAL}"), key=lambda p: (len(p.parts[-2]), p)):
        if parts := read_journal(path):
            searched = joined(parts)
            best = searched.best(plan)
            one = space.candidate(searched.unit[best])
            found.append(Found(path.parent.name, searched, best, one))
    if not found:
        raise ValueError(f"{folder} has no search that has measured anything")
    return found


def write_report(plan: Plan, folder: Path, policy: Policy | None = None) -> str:
    """Write robot files, profiles, pictures and the report of a search; returns the report."""
    found = read_found(plan, folder)
    space = plan.space()
    for one in found:
        write_found(folder / one.name, plan, one.candidate)
    checked = {name: fresh_walker(plan, policy, check) for name, check in CHECKS.items()}
    start = space.candidate(space.start)
    rows = [_row(plan, "start", start, make_walker(plan, policy), checked)]
    rows += [_row(plan, one.name, one.candidate, None, checked, one) for one in found]
    names = [*plan.objectives, *(name for name in plan.limits if name not in plan.objectives)]
    head = ["", *(f"{name} ({MEASURES[name].unit})" for name in names), "limits kept",
            *(f"{next(iter(plan.objectives))}, {name}" for name in checked)]  # fmt: skip
    sizes = tabulate(_lengths_table(plan, found), ["", "start", *(one.name for one in found)],
                     tablefmt="github")  # fmt: skip
    count = sum(len(one.searched.violation) for one in found)
    text = (
        f"# {folder.name}\n\n{plan.method}, {plan.generations} generations of {plan.population}, "
        f"{plan.starts} walks each at {plan.speed:g} m/s; {count} candidates in all.\n\n"
        f"{tabulate(rows, head, tablefmt='github')}\n\n{sizes}\n\n"
        "![designs](designs.png)\n\n![search](search.png)\n"
    )
    draw_designs({"start": start.robot, **{one.name: one.candidate.robot for one in found}},
                 folder / "designs.png")  # fmt: skip
    draw_search(plan, found, folder / "search.png")
    write_text(folder / REPORT, text)
    return text


def fresh_walker(plan: Plan, policy: Policy | None, kwargs: dict[str, Any]) -> Walker:
    """Return what walks one candidate at a time, from other starts than the search."""
    walker = make_walker(plan._replace(starts=FRESH, population=1), policy, **kwargs)
    walker.angles = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, FRESH)
    return walker


def _row(
    plan: Plan, name: str, candidate: Candidate, walker: Walker | None,
    checked: dict[str, Walker], found: Found | None = None,
) -> list[str]:  # fmt: skip
    """A line of the report: as the search saw it, and the first objective elsewhere."""
    if found is None:
        assert walker is not None
        measured, violation = measure(plan, walker, [candidate])
        own, broken = {key: float(values[0]) for key, values in measured.items()}, violation[0]
    else:
        every = found.searched.measured.items()
        own = {key: float(values[found.best]) for key, values in every}
        broken = found.searched.violation[found.best]
    names = [*plan.objectives, *(key for key in plan.limits if key not in plan.objectives)]
    first = next(iter(plan.objectives))
    elsewhere = [
        f"{one.measure(MEASURES[first].group, [candidate])[first][0]:.3g}"
        for one in checked.values()
    ]
    return [name, *(f"{own[key]:.3g}" for key in names), "no" if broken else "yes", *elsewhere]


def _lengths_table(plan: Plan, found: list[Found]) -> list[list[str]]:
    """The variables of the start and of each seed's best."""
    space = plan.space()
    each = [space.values(space.start)]
    each += [space.values(one.searched.unit[one.best]) for one in found]
    return [[name, *(f"{values[name]:.4g}" for values in each)] for name in each[0]]


def write_found(folder: Path, plan: Plan, candidate: Candidate) -> None:
    """Write a design's robot file and the profile that walks it."""
    write_robot(folder / ROBOT, candidate.robot)
    if plan.policy is None:
        numbers = [candidate.numbers.tolist()]
        write_json(folder / PROFILE, {"found": {"commands": [plan.speed], "numbers": numbers}})


def draw_designs(robots: dict[str, Robot], path: Path) -> None:
    """Draw each robot with the paths of its toes, all legs but the first pale."""
    columns = min(len(robots), 4)
    rows = -(-len(robots) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(3.6 * columns, 3.0 * rows), layout="constrained", sharex=True,
        sharey=True, squeeze=False,
    )  # fmt: skip
    for axis, (name, robot) in zip(axes.flat, robots.items(), strict=False):
        for k, joints in enumerate(world_joints(robot, np.array([0.0, 0.0, 0.0, 0.6]))):
            for a, b in robot.linkage.skeleton:
                axis.plot(*joints[[a, b]].T, color="C0", lw=1.8, alpha=0.2 if k else 1.0)
        for toe in toe_positions(robot, np.linspace(0.0, 6.3, 400)).swapaxes(0, 1):
            axis.plot(*toe.T, color="C3", lw=1.2)
        axis.plot(0.0, 0.0, "ko", ms=4)
        axis.set(title=name, aspect="equal")
    for axis in axes.flat[len(robots) :]:
        axis.remove()
    figure.supxlabel("m")
    save(figure, path)


def draw_search(plan: Plan, found: list[Found], path: Path) -> None:
    """Draw the best so far, the front, or the map, as the method has it."""
    figure, axis = plt.subplots(figsize=(7.0, 4.6), layout="constrained")
    names = [*plan.objectives]
    for one in found:
        objectives = one.searched.objectives(plan)
        if plan.method == "nsga2":
            sign = [1.0 if way == "min" else -1.0 for way in plan.objectives.values()]
            front = objectives[one.searched.front(plan)][:, :2] * sign[:2]
            axis.plot(*front.T, "o-", ms=4, lw=1.0, label=one.name)
        elif plan.method == "map_elites":
            places = [one.searched.measured[name] for name in plan.map]
            kept = one.searched.violation == 0.0
            order = np.flatnonzero(kept)[np.argsort(-objectives[kept, 0])]
            shown = axis.scatter(places[0][order], places[1][order], c=np.abs(objectives[order, 0]),
                                 s=8, cmap="viridis_r")  # fmt: skip
            if one is found[0]:
                figure.colorbar(shown, label=names[0])
        else:
            value = np.where(one.searched.violation == 0.0, objectives[:, 0], np.inf)
            best = np.minimum.accumulate(value.reshape(-1, plan.population).min(axis=1))
            axis.plot(np.where(np.isfinite(best), np.abs(best), np.nan), label=one.name)
    labels = {"nsga2": names[:2], "map_elites": [*plan.map]}.get(
        plan.method, ["generation", names[0]]
    )
    axis.set(xlabel=labels[0], ylabel=labels[1])
    if plan.method != "map_elites":
        axis.legend(fontsize=8)
    save(figure, path)
