"""Report of a search: a table, figures, robot files and crank-speed profiles."""

from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from tabulate import tabulate

from agents.design.design_plan import SearchPlan
from agents.design.measures import MEASURES, geometry_measures
from agents.design.search import Journal, best_of, front_of, make_walker, measure, objectives_of
from agents.design.variables import Candidate
from jansen_env.cli.plots import COLUMNS, save
from jansen_env.files import write_json, write_text
from jansen_env.robot import Robot
from jansen_env.robot.kinematics import toe_positions, world_joints
from jansen_env.robot.robot_file import write_robot
from jansen_env.scoring.metrics import screen_table

ROBOT = "robot.json"  # file of a design's robot
PROFILE = "profile.json"  # file of a design's crank-speed profile
REPORT = "report.md"  # file of the report
OTHER_STARTS = "other starts"
FRESH = 16  # number of starting crank angles, which differ from those of the search
MOST_OF_FRONT = 20  # approximate number of designs of a Pareto front that are written to files


def write_report(plan: SearchPlan, folder: Path, results: dict[str, Journal]) -> str:
    """Write the robot files, profiles, figures and the report of the searches of a plan.

    Args:
        plan: Plan of the searches.
        folder: Folder to write to.
        results: Journal of each search by name.

    Returns:
        A short table that compares the initial design with the best design. Both walk from crank
        angles that the search has not used.
    """
    best = {name: best_of(plan, journal) for name, journal in results.items()}
    designs = write_designs(plan, folder, results, best)
    measured = measure_designs(plan, designs)
    robots = {name: design.robot for name, design in designs.items()}
    draw_designs(robots, folder / "designs.png")
    draw_search(plan, results, folder / "search.png")
    write_text(folder / REPORT, report_text(plan, folder.name, results, best, robots, measured))

    winner = min(results, key=lambda name: rank_of(plan, results[name], best[name]))
    columns = [[name, *measured[name, OTHER_STARTS]] for name in ("start", winner)]
    return screen_table([*zip([OTHER_STARTS, *measure_heads(plan)], *columns, strict=True)])


def write_designs(
    plan: SearchPlan, folder: Path, results: dict[str, Journal], best: dict[str, int]
) -> dict[str, Candidate]:
    """Write the best design of each search, and designs of its Pareto front.

    Args:
        plan: Plan of the searches.
        folder: Folder to write to.
        results: Journal of each search by name.
        best: Index of the best candidate of each search.

    Returns:
        The initial design, ``"start"``, and the best design of each search, by name.
    """
    space = plan.space()
    designs = {"start": space.candidate(space.start)}
    for name, journal in results.items():
        designs[name] = space.candidate(journal["unit"][best[name]])
        write_design(folder / name, plan, designs[name])
        front = front_of(plan, journal) if plan.method == "nsga2" else []
        for number, k in enumerate(front[:: max(1, len(front) // MOST_OF_FRONT)]):
            candidate = space.candidate(journal["unit"][k])
            write_design(folder / name / f"front_{number}", plan, candidate)
    return designs


def measure_designs(
    plan: SearchPlan, designs: dict[str, Candidate]
) -> dict[tuple[str, str], list[str]]:
    """Measure designs as in the search, from other crank angles, and with half the time step.

    Args:
        plan: Plan of the searches.
        designs: Designs by name.

    Returns:
        Cells of :func:`measure_heads` by the name of the design and the kind of measurement.
    """
    half = 0.5 * float(plan.env_kwargs.get("time_step", 1e-3))
    walkers = {
        "search": make_walker(plan),
        OTHER_STARTS: make_walker(plan, FRESH),
        "half the time step": make_walker(plan, FRESH, time_step=half),
    }
    cells = {}
    for where, walker in walkers.items():
        if where != "search":
            walker.angles = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, FRESH)
        measured, violation = measure(plan, walker, [*designs.values()])
        for k, name in enumerate(designs):
            values = [f"{measured[key][k]:.3g}" for key in plan.measured]
            cells[name, where] = [*values, "yes" if violation[k] == 0.0 else "no"]
    return cells


def measure_heads(plan: SearchPlan) -> list[str]:
    """Return the heads of the measures of a plan in tables.

    Args:
        plan: Plan of the searches.
    """
    return [*(f"{key} ({MEASURES[key]})" for key in plan.measured), "limits kept"]


def report_text(
    plan: SearchPlan,
    title: str,
    results: dict[str, Journal],
    best: dict[str, int],
    robots: dict[str, Robot],
    measured: dict[tuple[str, str], list[str]],
) -> str:
    """Return the report of the searches as Markdown.

    Args:
        plan: Plan of the searches.
        title: Title of the report.
        results: Journal of each search by name.
        best: Index of the best candidate of each search.
        robots: Robots of the designs by name.
        measured: Cells that :func:`measure_designs` returned.
    """
    assembled = {name: assembles(robot) for name, robot in robots.items()}
    rows = [[name, where, *cells, assembled[name]] for (name, where), cells in measured.items()]
    heads = ["", "where", *measure_heads(plan), "can be assembled"]
    count = sum(map(len, results.values()))
    text = (
        f"# {title}\n\n{plan.method}, {plan.starts} walks at {plan.speed:g} m/s each of "
        f"{count} candidates, {plan.population} a generation.\n\n"
        f"{tabulate(rows, heads, tablefmt='github')}\n\n"
        "![designs](designs.png)\n\n![search](search.png)\n"
    )
    out = [name for name, journal in results.items() if journal["violation"][best[name]] > 0.0]
    if out:
        text += f"\nNone of {', '.join(out)} keeps all limits: shown is the one nearest to them.\n"
    return text


def rank_of(plan: SearchPlan, journal: Journal, candidate: int) -> tuple[float, float]:
    """Return the rank of a candidate among those of other searches, where smaller is better.

    Args:
        plan: Plan of the searches.
        journal: Journal of the candidate's search.
        candidate: Index of the candidate.
    """
    violation = float(journal["violation"][candidate])
    return violation, float(objectives_of(plan, journal)[candidate, 0])


def assembles(robot: Robot) -> str:
    """Return "yes" if the workshop drawings find an order of links without collisions, else "no".

    Without the package ``jansen_workshop``, return "not known".

    Args:
        robot: Robot to assemble.
    """
    if find_spec("jansen_workshop") is None:
        return "not known"
    from jansen_workshop.drawings.shaft_order import layers

    with suppress(ValueError):
        layers(robot)
        return "yes"
    return "no"


def write_design(folder: Path, plan: SearchPlan, candidate: Candidate) -> None:
    """Write the robot file of a design and the crank-speed profile with which it walks.

    Args:
        folder: Folder to write to.
        plan: Plan of the search.
        candidate: The design.
    """
    write_robot(folder / ROBOT, candidate.robot)
    numbers = [candidate.numbers.tolist()]
    write_json(folder / PROFILE, {"found": {"commands": [plan.speed], "numbers": numbers}})


def draw_designs(robots: dict[str, Robot], path: Path) -> None:
    """Draw each robot and the paths of its toes; all legs except the first are pale.

    Args:
        robots: Robots by name.
        path: Image file to write.
    """
    columns = min(len(robots), COLUMNS)
    rows = -(-len(robots) // columns)
    figure = Figure((3.2 * columns, 2.4 * rows), layout="constrained")
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
    figure.supxlabel("x (m)")
    figure.supylabel("y (m)")
    save(figure, path)


def draw_search(plan: SearchPlan, results: dict[str, Journal], path: Path) -> None:
    """Draw the Pareto front of several objectives, or the progress of a single objective.

    Args:
        plan: Plan of the searches.
        results: Journal of each search by name.
        path: Image file to write.
    """
    figure = Figure((7.0, 4.6), layout="constrained")
    axis = figure.subplots()
    names = [*plan.objectives]
    best = np.fmin if plan.objectives[names[0]] == "min" else np.fmax
    for name, result in results.items():
        if plan.method == "nsga2":
            front = front_of(plan, result)
            axis.plot(*(result[key][front] for key in names[:2]), "o-", ms=4, label=name)
        else:
            value = np.where(result["violation"] == 0.0, result[names[0]], np.nan)
            axis.plot(best.accumulate(value), label=name)
    axis.set(xlabel="candidate", ylabel=names[0])
    if plan.method == "nsga2":
        axis.set(xlabel=names[0], ylabel=names[1])
    axis.legend(fontsize=8)
    save(figure, path)
